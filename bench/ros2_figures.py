#!/usr/bin/env python3
"""palpate ros2 beside a robot on Fast DDS: 640 x 480 depth at 30 Hz in, the wrench at 1 kHz out, on loopback.

usage: bench/ros2_figures.py BUILD_DIR [--seconds S] [--csv FILE]

BUILD_DIR needs the targets palpate and fastdds_peer. Said are, by the robot's own clock: wrenches lost (by the
sequence numbers of DDS), times between two wrenches, from a tick to its arrival, and from before an image is
written that shows contact to the arrival of the first force (0.6 MB written, read, surface, query, tick). Rows are of the
machine as loaded as it was; load is said.
"""
import json
import os
import subprocess
import sys
import tempfile

from ros_bench import local_ros, machine_now, options_of, pack_ball, programs_of, write_rows

DOMAIN = 91
COLUMNS = ("case", "seconds", "images", "wrenches", "lost", "gap_p50_ms", "gap_p99_ms", "gap_max_ms",
           "arrival_p50_ms", "arrival_p99_ms", "arrival_max_ms", "image_to_force_p50_ms",
           "image_to_force_p99_ms", "image_to_force_max_ms", "measured", "load_before", "load_after", "cores",
           "commit")


def main():
    options = options_of(__doc__, 60)
    palpate, peer = programs_of(options.build, "palpate", "fastdds_peer")
    environment = local_ros(DOMAIN)
    rows = []
    with tempfile.TemporaryDirectory() as work:
        pack_ball(palpate, work, 5000)
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
                         *seen["image_to_wrench_ms"], seen["measured"], *machine_now(before)])
            print(*(f"{name} {value}" for name, value in zip(COLUMNS, rows[-1])), sep=", ")
    write_rows(options.csv, COLUMNS, rows)


if __name__ == "__main__":
    main()
