#!/usr/bin/env python3
"""palpate ros2 beside a robot on Fast DDS: 640 x 480 depth at 30 Hz in, the wrench at 1 kHz out, on loopback.

usage: bench/ros2_figures.py BUILD_DIR [--seconds S] [--csv FILE]

BUILD_DIR needs the targets palpate and fastdds_peer. Said are, by the robot's own clock: wrenches lost (by the
sequence numbers of DDS), times between two wrenches, from a tick to its arrival, and from before an image is
written that shows contact to the arrival of the first force (0.6 MB written, read, surface, query, tick). Rows are of the
machine as loaded as it was; load is said.
"""
import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

DOMAIN = 91
COLUMNS = ("case", "seconds", "images", "wrenches", "lost", "gap_p50_ms", "gap_p99_ms", "gap_max_ms",
           "arrival_p50_ms", "arrival_p99_ms", "arrival_max_ms", "image_to_force_p50_ms",
           "image_to_force_p99_ms", "image_to_force_max_ms", "measured", "load_before", "load_after", "cores",
           "commit")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=Path)
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    programs = options.build.resolve() / "bin"
    palpate, peer = programs / "palpate", programs / "fastdds_peer"
    for needed in (palpate, peer):
        if not needed.exists():
            sys.exit(f"ros2_figures: {needed} is missing; build the targets palpate and fastdds_peer")
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True,
                            check=False).stdout.strip()
    environment = dict(os.environ, ROS_DOMAIN_ID=str(DOMAIN), ROS_LOCALHOST_ONLY="1")
    rows = []
    with tempfile.TemporaryDirectory() as work:
        for words in (["shape", "sphere", "--size", "0.05", "-o", "ball.obj"],
                      ["pack", "ball.obj", "-o", "ball.palp", "--spheres", "5000"]):
            subprocess.run([palpate, *words], cwd=work, check=True, capture_output=True)
        for qos in ("best_effort", "reliable"):
            before = os.getloadavg()[0]
            robot = subprocess.Popen([peer, str(DOMAIN), "640", "480"], stdin=subprocess.PIPE,
                                     stdout=subprocess.PIPE, text=True)
            run = subprocess.run([palpate, "ros2", "ball.palp", "--depth", "/camera/depth/image_raw", "--pose",
                                  "/tool_pose", "--qos", qos, "-o", "run", "--duration", str(options.seconds)],
                                 cwd=work, env=environment, capture_output=True, text=True, check=False)
            seen = json.loads(robot.communicate()[0])
            if run.returncode != 0:
                sys.exit(f"ros2_figures: {run.stderr}")
            rows.append([f"images {qos}, wrench reliable", round(seen["seconds"], 1), seen["images"],
                         seen["wrenches"], seen["lost"], *seen["gap_ms"], *seen["delay_ms"],
                         *seen["image_to_wrench_ms"], seen["measured"], round(before, 2),
                         round(os.getloadavg()[0], 2), os.cpu_count(), commit])
            print(*(f"{name} {value}" for name, value in zip(COLUMNS, rows[-1])), sep=", ")
    if options.csv:
        with options.csv.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([COLUMNS, *rows])


if __name__ == "__main__":
    main()
