#!/usr/bin/env python3
"""Did a change make the kernels faster or slower? Builds the benchmarks of another commit and of this working
tree, runs them in turns on this machine, and prints the ratio of their times with its scatter.

usage: tools/bench_compare.py BASE [--program bench_contact ...] [--filter REGEX] [--rounds 7] [--jobs 2]

A ratio below 1: this tree is faster. In each round both run one after the other, every second round the other
way round, so that what else the machine does meets both. The scatter is the range of the middle half of the
rounds' ratios; '*' marks ratios whose whole range of all rounds lies on one side of 1.
"""

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path
from statistics import median, quantiles

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "build/compare"
BUILD = "build/bench-compare"


def run(*command, **options):
    return subprocess.run(command, check=True, text=True, **options)


def unpack(commit):
    """The sources of a commit, in a folder of their own."""
    source = FOLDER / "base"
    number = run("git", "-C", str(ROOT), "rev-parse", commit, capture_output=True).stdout.strip()
    if source.exists():
        for entry in source.iterdir():  # its build stays, so that only what differs is compiled again
            if entry.name != "build":
                shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
    source.mkdir(parents=True, exist_ok=True)
    archive = FOLDER / "base.tar"
    run("git", "-C", str(ROOT), "archive", "-o", str(archive), number)
    run("tar", "-C", str(source), "-xf", str(archive))
    archive.unlink()
    return source


def build(source, programs, jobs):
    run("cmake", "--preset", "bench", "-B", BUILD, "-DPALPATE_APPS=OFF", cwd=source, stdout=subprocess.DEVNULL)
    run("cmake", "--build", BUILD, "-j", str(jobs), "--target", *programs, cwd=source, stdout=subprocess.DEVNULL)
    return source / BUILD / "bin"


def times(program, pattern):
    """CPU time of each benchmark, ns."""
    scale = {"ns": 1, "us": 1e3, "ms": 1e6, "s": 1e9}
    out = run(str(program), f"--benchmark_filter={pattern}", "--benchmark_min_time=0.2",
              "--benchmark_format=json", capture_output=True).stdout
    return {b["name"]: b["cpu_time"] * scale[b["time_unit"]] for b in json.loads(out)["benchmarks"]}


def compare(folders, program, options):
    """Yields name, base ns, head ns and the ratios of the rounds."""
    rounds = {"base": [], "head": []}
    for i in range(options.rounds):
        for which in ("base", "head") if i % 2 == 0 else ("head", "base"):
            rounds[which].append(times(folders[which] / program, options.filter))
    for name in rounds["base"][0]:
        if name in rounds["head"][0]:
            base = [r[name] for r in rounds["base"]]
            head = [r[name] for r in rounds["head"]]
            yield name, median(base), median(head), [h / b for h, b in zip(head, base)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", metavar="BASE")
    parser.add_argument("--program", nargs="+", default=["bench_contact", "bench_field", "bench_cloud"])
    parser.add_argument("--filter", default=".")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    if options.rounds < 2:
        parser.error("--rounds: a scatter needs at least 2")
    try:
        folders = {"base": build(unpack(options.base), options.program, options.jobs),
                   "head": build(ROOT, options.program, options.jobs)}
        print(f"{'benchmark':50} {'base us':>10} {'here us':>10} {'ratio':>7}  scatter")
        for program in options.program:
            for name, base, head, ratios in compare(folders, program, options):
                low, _, high = quantiles(ratios, n=4, method="inclusive")
                mark = "*" if max(ratios) < 1 or min(ratios) > 1 else " "
                print(f"{name:50} {base / 1e3:10.2f} {head / 1e3:10.2f} {median(ratios):7.3f}{mark} "
                      f"{low:.3f}..{high:.3f}", flush=True)
    except subprocess.CalledProcessError as error:
        if error.stderr:
            sys.stderr.write(error.stderr)
        sys.exit(f"bench_compare: {' '.join(map(str, error.cmd))} failed; see above")


if __name__ == "__main__":
    main()
