#!/usr/bin/env python3
"""palpate ros2 beside a robot on Fast DDS: 640 x 480 depth at 30 Hz in, the wrench at 1 kHz out, on loopback; then beside
one on the Python package cyclonedds, which says nothing of arrivals: it looks for messages now and then.

usage: bench/ros2_figures.py BUILD_DIR [--seconds S] [--csv FILE] [--before BUILD_DIR] [--turns N]

BUILD_DIR needs the targets palpate and fastdds_peer; with --before, the program of another build takes turns with it. Said
are, by the robot's own clock: wrenches lost (by the sequence numbers of DDS), times between two wrenches as they were sent
and as they came, from a tick to its arrival, and from before an image is written that shows contact to the arrival of
the first force (0.6 MB written, read, surface, query, tick) and to when it was sent. The robot runs as any program, or in real time as the
controller of an arm does, and then looks at points and spheres too, 30 times a second. Rows are of the machine as loaded
as it was; load is said.
"""
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from ros_bench import local_ros, machine_now, options_of, pack_ball, programs_of, write_rows

ROOT = Path(__file__).resolve().parent.parent
DOMAIN = 91
COLUMNS = ("program", "case", "seconds", "images", "wrenches", "lost", "sent_gap_p50_ms", "sent_gap_p99_ms",
           "sent_gap_max_ms", "gap_p50_ms", "gap_p99_ms", "gap_max_ms",
           "arrival_p50_ms", "arrival_p99_ms", "arrival_max_ms", "image_to_force_p50_ms",
           "image_to_force_p99_ms", "image_to_force_max_ms", "image_to_sent_p50_ms", "image_to_sent_p99_ms",
           "image_to_sent_max_ms", "measured", "load_before", "load_after", "cores",
           "commit")
# Cases: QoS of the image subscription, and command prefix of the robot.
CASES = {"images best_effort, wrench reliable": ("best_effort", []),
         "images reliable, wrench reliable": ("reliable", []),
         "images best_effort, robot in real time, looks at points and spheres": ("best_effort", ["chrt", "-f", "50"])}


def beside_python(palpate, work, environment, seconds):
    """Returns a row. Lost: by the program's own count of sent messages, since the first wrench came."""
    before = os.getloadavg()[0]
    python = ROOT / "build/python/bin/python"  # made by scripts/setup.sh --test
    robot = subprocess.Popen([python if python.exists() else sys.executable, ROOT / "tests/ros/cyclone_peer.py", str(DOMAIN), "good", "640x480"],
                             stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    run = subprocess.run([palpate, "ros2", "ball.palp", "--depth", "/camera/depth/image_raw", "--pose", "/tool_pose", "-o",
                          "run", "--duration", str(seconds)], cwd=work, env=environment, capture_output=True, text=True,
                         check=False)
    seen = json.loads(robot.communicate()[0])
    if run.returncode != 0:
        sys.exit(f"ros2_figures: {run.stderr}")
    return ["this", "images best_effort, wrench reliable, peer cyclonedds in Python", seconds, seen["images"], seen["wrenches"],
            seen["lost"], *seen["sent_gap_ms"], *[""] * 9, *seen["image_to_sent_ms"], seen["measured"], *machine_now(before)]


def beside_fast_dds(program, palpate, peer, case, work, environment, seconds):
    """Returns a row."""
    qos, as_robot = CASES[case]
    before = os.getloadavg()[0]
    robot = subprocess.Popen([*as_robot, peer, str(DOMAIN), "640", "480", "30", *(["looks"] if as_robot else [])],
                             stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    run = subprocess.run([palpate, "ros2", "ball.palp", "--depth", "/camera/depth/image_raw", "--pose", "/tool_pose", "--qos",
                          qos, "-o", "run", "--points-rate", "30", "--duration", str(seconds)],
                         cwd=work, env=environment, capture_output=True, text=True, check=False)
    said = robot.communicate()[0]
    if run.returncode != 0:
        sys.exit(f"ros2_figures: {run.stderr}")
    if robot.returncode != 0:
        sys.exit(f"ros2_figures: {' '.join(as_robot)} fastdds_peer ended with {robot.returncode}")
    seen = json.loads(said)
    return [program, case, round(seen["seconds"], 1), seen["images"], seen["wrenches"], seen["lost"], *seen["sent_gap_ms"],
            *seen["gap_ms"], *seen["delay_ms"], *seen["image_to_wrench_ms"], *seen["image_to_sent_ms"], seen["measured"], *machine_now(before)]


def main():
    options = options_of(__doc__, 60, before=True)
    palpate, peer = programs_of(options.build, "palpate", "fastdds_peer")
    programs = {"this": palpate}
    if options.before:
        programs = {"before": programs_of(options.before, "palpate")[0], **programs}
    environment = local_ros(DOMAIN)
    rows = []
    with tempfile.TemporaryDirectory() as work:
        pack_ball(palpate, work, 5000)
        for _ in range(options.turns):
            for case in CASES:
                for name, program in programs.items():
                    rows.append(beside_fast_dds(name, program, peer, case, work, environment, options.seconds))
                    print(*(f"{name} {value}" for name, value in zip(COLUMNS, rows[-1])), sep=", ", flush=True)
        rows.append(beside_python(palpate, work, environment, options.seconds))
        print(*(f"{name} {value}" for name, value in zip(COLUMNS, rows[-1])), sep=", ")
    write_rows(options.csv, COLUMNS, rows)


if __name__ == "__main__":
    main()
