#!/usr/bin/env python3
"""The longest steps of a build and their share of all: what to divide, or to free of heavy headers, first.

Seconds are those of the last time that each step ran, from Ninja's log: with a compiler's cache or other work on the
machine they say little. Compile from nothing, with CCACHE_DISABLE=1 and one job.

usage: tools/compile_times.py [BUILD] [--top 20]
"""

import argparse
from collections import defaultdict
from pathlib import Path

from project_files import ROOT


def seconds_of(log):
    """{output: seconds} of compile and link steps."""
    seconds = {}
    for line in log.splitlines():
        if not line.startswith("#"):
            begin, end, _, output, _ = line.split("\t")
            seconds[output] = (int(end) - int(begin)) / 1000
    return {output: value for output, value in seconds.items() if "/CMakeFiles/" in output or output.startswith("bin/")}


def target_of(output):
    """The CMake target that an object belongs to; programs are their own."""
    return output.split("/CMakeFiles/")[1].split(".dir/")[0] if "/CMakeFiles/" in output else output


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", nargs="?", type=Path, default=ROOT / "build/release")
    parser.add_argument("--top", type=int, default=20)
    arguments = parser.parse_args()
    seconds = seconds_of((arguments.build / ".ninja_log").read_text(encoding="utf-8"))
    total = sum(seconds.values())
    targets = defaultdict(float)
    for output, value in seconds.items():
        targets[target_of(output)] += value
    print(f"{len(seconds)} steps, {total:.0f} s")
    for title, rows in (("step", seconds), ("target", targets)):
        print(f"\n{'s':>7}  {'share':>6}  {title}")
        for name, value in sorted(rows.items(), key=lambda row: -row[1])[: arguments.top]:
            print(f"{value:7.1f}  {100 * value / total:5.1f}%  {name}")


if __name__ == "__main__":
    main()
