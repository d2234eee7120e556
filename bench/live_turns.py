#!/usr/bin/env python3
"""Compares the live programs of two builds, one CSV row per case, program and round, in
bench/results/live-turns-MACHINE.csv.

A cube of 0.1 m in a simulated hand before a simulated hand and wall, and, led by poses of a file, wholly behind the
wall. Each program has two cores. On a machine of four or more both run at the same time and change cores every
round; on a smaller one they take turns, and change their order. Times are microseconds.

usage: bench/live_turns.py BEFORE AFTER [--rounds 3] [--seconds 10] [--spheres 17000] [--names BEFORE,AFTER]
                           [--note TEXT]
       BEFORE, AFTER: build folders with bin/palpate; set PALPATE_ISA to choose the instruction set
"""
import argparse
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from live_figures import row_of, write_rows
from record_results import machine_name

CASES = {"hand": ["--scene", "hand", "--device", "sim"], "wall": ["--scene", "wall", "--device", "sim"]}
SERIES = ("contact_compute", "surface_compute", "sensor_to_force", "haptic_compute")


def cores():
    """Returns two pairs of processors, each of another physical core if there are enough, or one pair twice."""
    allowed = sorted(os.sched_getaffinity(0))
    one_of_each = [cpu for cpu in allowed if cpu == int(
        Path(f"/sys/devices/system/cpu/cpu{cpu}/topology/thread_siblings_list").read_text().replace("-", ",").split(",")[0])]
    chosen = one_of_each if len(one_of_each) >= 4 else allowed
    return (chosen[:2], chosen[2:4]) if len(chosen) >= 4 else (chosen[:2], chosen[:2])


def write_inside(path, seconds):
    """Writes poses that go through the wall of scene wall within 2 s, and stay 0.1 m behind it."""
    with path.open("w") as out:
        for tick in range(int(1000 * seconds)):
            t = tick / 1000
            out.write(f"{t:.3f} 0 0 {0.8 + 0.35 * min(t / 2, 1) + 0.002 * math.sin(12 * t):.6f} 0 0 0 1\n")


def start(palpate, options, pair, folder, errors):
    """Starts a run on a pair of processors; what it complains about goes into a file."""
    return subprocess.Popen(["taskset", "-c", ",".join(map(str, pair)), palpate, "touch", *options, "-o", folder],
                            stdout=subprocess.DEVNULL, stderr=errors.open("w"))


def told(command):
    """Returns a command as rows tell it: files by their names."""
    return " ".join(["palpate touch cube.palp", *(re.sub(r"(^|:)/.*/", r"\1", str(word)) for word in command[1:])])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--spheres", type=int, default=17000)
    parser.add_argument("--names", default="before,after", help="commits of both, for the rows")
    parser.add_argument("--note", default="")
    options = parser.parse_args()
    programs = dict(zip(options.names.split(","), (options.before / "bin/palpate", options.after / "bin/palpate")))
    rows = []
    with tempfile.TemporaryDirectory() as work:
        work = Path(work)
        write_inside(work / "inside.tum", options.seconds)
        cases = {**CASES, "inside": ["--scene", "wall", "--device", f"replay:{work}/inside.tum", "--coupling", "direct"]}
        tools = {}
        for name, palpate in programs.items():
            subprocess.run([palpate, "shape", "box", "--size", "0.1", "-o", work / "box.ply"], check=True, stdout=subprocess.DEVNULL)
            tools[name] = work / f"{name}.palp"
            subprocess.run([palpate, "pack", work / "box.ply", "--spheres", str(options.spheres), "-o", tools[name]], check=True,
                           stdout=subprocess.DEVNULL)
        pairs = cores()
        for turn in range(options.rounds):
            for case, words in cases.items():
                runs = {}
                in_order = list(programs.items())[:: 1 if turn % 2 == 0 else -1]
                for (name, palpate), pair in zip(in_order, pairs):
                    command = [tools[name], *words, "--duration", f"{options.seconds:g}", "--set", "loop.threads=2"]
                    folder = work / f"{name}-{case}-{turn}"
                    errors = folder.with_suffix(".txt")
                    load = f"{os.getloadavg()[0]:.1f}"
                    runs[name] = (command, folder, errors, load, start(palpate, command, pair, folder, errors))
                    if pairs[0] == pairs[1]:
                        runs[name][-1].wait()
                for name, (command, folder, errors, load, process) in runs.items():
                    process.wait()
                    summary = folder / "summary.json"
                    if not summary.exists():
                        sys.exit(f"live_turns: {name}: {errors.read_text()}")
                    summary = json.loads(summary.read_text())
                    for series in SERIES:
                        facts = {key: summary[key] for key in ("frames", "frames_left_out", "stiffness_left_out", "ticks", "missed")}
                        rows.append(row_of(f"{series}/scene:{case}/spheres:{options.spheres}/cores:2/turn:{turn}",
                                           summary["microseconds"][series], facts, commit=name, machine=machine_name(),
                                           isa=os.environ.get("PALPATE_ISA", ""), load_before=load, command=told(command),
                                           note=" ".join(filter(None, (options.note, summary["failure"])))))
    write_rows("live-turns", machine_name(), rows)


if __name__ == "__main__":
    main()
