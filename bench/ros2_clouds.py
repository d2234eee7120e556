#!/usr/bin/env python3
"""Clouds over ROS 2, felt live: 320 x 240 points at 30 Hz from a robot on Fast DDS, on loopback.

usage: bench/ros2_clouds.py BUILD_DIR [--seconds S] [--csv FILE]

BUILD_DIR needs the targets palpate and fastdds_peer. The same bent wall comes as depth images, as organized clouds and as
loose points in any order, whose stamps are exactly a period apart; the subscription is reliable. Said are, by the program's own count: frames that
came, that are missing between them, that were dropped for newer ones; and by what the robot hears: the wrench, and how far
it is from that of the depth images, as a share of it. Rows are of the machine as loaded as it was; load is said.
"""
import json
import math
import os
import re
import subprocess
import sys
import tempfile

from ros_bench import local_ros, machine_now, options_of, pack_ball, programs_of, write_rows

DOMAIN, WIDTH, HEIGHT, RATE = 93, 320, 240, 30
COLUMNS = ("case", "points", "seconds", "frames", "missing", "dropped_for_newer", "wrenches", "force_z_n", "force_off", "torque_off_nm",
           "load_before", "load_after", "cores", "commit")
CASES = {"still": "depth images", "cloud": "organized clouds", "loose": "loose points"}


def beside_fast_dds(palpate, peer, case, work, environment, seconds):
    """Returns what the robot heard, and the program's notes on its stream."""
    topic = "/camera/depth/image_raw" if case == "still" else "/camera/depth/points"
    robot = subprocess.Popen([peer, str(DOMAIN), str(WIDTH), str(HEIGHT), str(RATE), case], stdin=subprocess.PIPE,
                             stdout=subprocess.PIPE, text=True)
    run = subprocess.run([palpate, "ros2", "ball.palp", "--depth", topic, "--pose", "/tool_pose", "--qos", "reliable", "-o", case,
                          "--duration", str(seconds)], cwd=work, env=environment, capture_output=True, text=True, check=False)
    said = robot.communicate()[0]
    if run.returncode != 0:
        sys.exit(f"ros2_clouds: {run.stderr}")
    return json.loads(said), run.stderr


def count(pattern, notes):
    found = re.search(pattern, notes)
    return int(found.group(1)) if found else 0


def main():
    options = options_of(__doc__, 60)
    palpate, peer = programs_of(options.build, "palpate", "fastdds_peer")
    environment = local_ros(DOMAIN)
    rows, wrench = [], None
    with tempfile.TemporaryDirectory() as work:
        pack_ball(palpate, work, 5000)
        for case, name in CASES.items():
            before = os.getloadavg()[0]
            seen, notes = beside_fast_dds(palpate, peer, case, work, environment, options.seconds)
            wrench = wrench or seen
            force_off = math.dist(seen["force"], wrench["force"]) / math.hypot(*wrench["force"])
            rows.append([name, WIDTH * HEIGHT, options.seconds, count(r"has sent (\d+) frames", notes),
                         count(r"(\d+) are missing", notes), count(r"(\d+) were dropped for newer", notes),
                         seen["wrenches"], seen["force"][2], f"{force_off:.2g}",
                         f"{math.dist(seen['torque'], wrench['torque']):.2g}", *machine_now(before)])
            print(*(f"{column} {value}" for column, value in zip(COLUMNS, rows[-1])), sep=", ", flush=True)
    write_rows(options.csv, COLUMNS, rows)


if __name__ == "__main__":
    main()
