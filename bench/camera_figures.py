#!/usr/bin/env python3
"""Cost of a camera that is read through OpenNI2's own stack, 640 x 480 at 30 Hz.

usage: bench/camera_figures.py BUILD_DIR [--seconds S]

The real libOpenNI2 loads the driver of the tests, which sends frames of a wavy wall by the clock. Said are:
the share of a core that reading takes (of the whole process, so with the library and the driver that fills
its images), frames lost, how late forces are, live and with the same frames from a file, and when the first
one is there (the time that the program needs at its end counts too). BUILD_DIR needs the targets palpate and
fake_openni2_driver.
"""
import argparse
import array
import csv
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

WIDTH, HEIGHT, NUM_FRAMES = 640, 480, 450
# Intrinsics from the field of view that the driver reports.
INTRINSICS = f"{320 / math.tan(1.0145 / 2):.6f},{240 / math.tan(0.7898 / 2):.6f},319.5,239.5"


def write_frames(path):
    with path.open("wb") as file:
        for number in range(NUM_FRAMES):
            depth = 600 + 4 * math.sin(2 * math.pi * number / 30)
            row = array.array("H", (int(depth + 3 * math.sin(0.05 * u)) for u in range(WIDTH)))
            file.write(row.tobytes() * HEIGHT)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=Path)
    parser.add_argument("--seconds", type=float, default=600)
    options = parser.parse_args()
    palpate = options.build.resolve() / "bin/palpate"
    redist = options.build.resolve() / "tests/cameras/openni2"
    for needed in (palpate, redist / "OpenNI2/Drivers/libPalpate.so.0"):
        if not needed.exists():
            sys.exit(f"camera_figures: {needed} is missing; build the targets palpate and fake_openni2_driver")

    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        frames = work / "frames.raw"
        write_frames(frames)
        environment = dict(os.environ, OPENNI2_REDIST=str(redist), PALPATE_FAKE_OPENNI2=str(frames))

        def run(*words):
            done = subprocess.run([palpate, *map(str, words)], env=environment, cwd=work, text=True,
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            if done.returncode != 0:
                sys.exit(f"camera_figures: {words}: {done.stderr}")
            return done.stdout

        run("shape", "box", "--size", 0.1, "-o", "box.ply")
        run("pack", "box.ply", "--spheres", 5000, "-o", "box.palp")
        print(f"load before: {os.getloadavg()[0]:.1f}")
        said = run("cameras", "--selftest", "openni2", "--seconds", options.seconds)
        print(said.strip())
        lost = re.search(r"(\d+) are missing", said)
        print(f"frames lost: {lost.group(1) if lost else 0}")
        late = {}
        for source, words in {"live": ("--camera", "openni2"),
                              "recorded": ("--camera", f"pipe:{frames}?size={WIDTH}x{HEIGHT}&intrinsics="
                                                       f"{INTRINSICS}&rate=30&sensor=structured_light")}.items():
            seconds = NUM_FRAMES / 30 - 1  # a file is finite
            begin = time.monotonic()
            run("touch", "box.palp", *words, "--device", "sim", "--probe", "320,240", "--duration", seconds,
                "-o", source)
            wall = time.monotonic() - begin
            with (work / source / "wrench.csv").open() as rows:
                ticks = [(float(row["time_s"]), float(row["gain"])) for row in csv.DictReader(rows)]
            whole = next((at for at, gain in ticks if gain == 1), math.inf)
            print(f"{source}: the force is there at most {wall - ticks[-1][0] + whole:.1f} s after the program's start")
            summary = json.loads((work / source / "summary.json").read_text())
            late[source] = summary["microseconds"]["sensor_to_force"]
            print(f'{source}: sensor to force {late[source]["p50"]:.0f} us p50, {late[source]["p99"]:.0f} us p99; '
                  f'{summary["frames"]} frames, {summary["frames_left_out"]} left out, {summary["ticks"]} ticks'
                  + (f'; {summary["failure"]}' if summary["failure"] else ""))
        print(f'live over recorded: {late["live"]["p50"] / late["recorded"]["p50"]:.2f} p50, '
              f'{late["live"]["p99"] / late["recorded"]["p99"]:.2f} p99')


if __name__ == "__main__":
    main()
