"""Shared parts of the benchmarks over ROS 2: options, a packed ball as tool, the machine, and the result table."""

import argparse
import csv
import os
import subprocess
import sys
from pathlib import Path


def options_of(description, seconds, before=False):
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("build", type=Path)
    parser.add_argument("--seconds", type=float, default=seconds)
    parser.add_argument("--csv", type=Path)
    if before:
        parser.add_argument("--before", type=Path)
        parser.add_argument("--turns", type=int, default=1)
    return parser.parse_args()


def programs_of(build, *names):
    """Returns the paths of the programs; exits if one is not built."""
    programs = [build.resolve() / "bin" / name for name in names]
    for program in programs:
        if not program.exists():
            sys.exit(f"{Path(sys.argv[0]).stem}: {program} is missing; build the targets {' and '.join(names)}")
    return programs


def pack_ball(palpate, folder, num_spheres):
    """Makes ball.palp in a folder."""
    for words in (["shape", "sphere", "--size", "0.05", "-o", "ball.obj"],
                  ["pack", "ball.obj", "-o", "ball.palp", "--spheres", str(num_spheres)]):
        subprocess.run([palpate, *words], cwd=folder, check=True, capture_output=True)


def local_ros(domain):
    """Returns the environment of a ROS domain that stays on this machine."""
    return dict(os.environ, ROS_DOMAIN_ID=str(domain), ROS_LOCALHOST_ONLY="1")


def machine_now(load_before):
    """Returns load_before, load_after, cores, commit: the last columns of a row."""
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
    return [round(load_before, 2), round(os.getloadavg()[0], 2), os.cpu_count(), commit.stdout.strip()]


def write_rows(path, columns, rows):
    if path:
        with path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([columns, *rows])
