#!/usr/bin/env python3
"""Runs benchmark programs and writes one CSV row per case to bench/results/.

usage: bench/record_results.py BUILD_DIR [--filter REGEX] [--min-time SECONDS] [--note TEXT]

Each row says what was measured (program, case, its sizes), when, on which commit and machine, how the
times of single calls are distributed (microseconds), and the exact command. Times of different files
are not comparable unless the machine was quiet; ratios within one file are.
"""
import argparse
import csv
import datetime
import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

COLUMNS = ["date", "commit", "machine", "isa", "program", "case", "calls", "median_us", "p99_us",
           "p99.9_us", "max_us", "cpu_us", "facts", "load_before", "command", "note"]
TIMES = {"p50_us": "median_us", "p99_us": "p99_us", "p999_us": "p99.9_us", "max_us": "max_us"}
KNOWN = set(TIMES) | {"name", "run_name", "run_type", "family_index", "per_family_instance_index",
                      "repetitions", "repetition_index", "threads", "iterations", "real_time",
                      "cpu_time", "time_unit", "label"}
TO_US = {"ns": 1e-3, "us": 1.0, "ms": 1e3, "s": 1e6}


def machine_name():
    model = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                model = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass
    return f"{model}, {os.cpu_count()} cores"


def commit():
    run = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    dirty = subprocess.run(["git", "status", "--porcelain"], capture_output=True, text=True).stdout
    return (run.stdout.strip() or "unknown") + ("+" if dirty.strip() else "")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build")
    parser.add_argument("--filter", default=".")
    parser.add_argument("--min-time", default="0.5")
    parser.add_argument("--note", default="")
    arguments = parser.parse_args()
    programs = sorted(Path(arguments.build, "bin").glob("bench_*"))
    if not programs:
        sys.exit(f"record_results: no bench_* programs under {arguments.build}/bin; run 'make bench' first")

    machine, revision = machine_name(), commit()
    rows = []
    for program in programs:
        command = [str(program), f"--benchmark_filter={arguments.filter}",
                   f"--benchmark_min_time={arguments.min_time}", "--benchmark_format=json"]
        load = f"{os.getloadavg()[0]:.1f}"
        run = subprocess.run(command, stdout=subprocess.PIPE, text=True)
        if run.returncode != 0 or not run.stdout.strip():
            continue  # nothing of this program matches the filter
        for case in json.loads(run.stdout).get("benchmarks", []):
            row = dict.fromkeys(COLUMNS, "")
            facts = {key: round(value, 4) for key, value in case.items()
                     if key not in KNOWN and isinstance(value, (int, float))}
            scale = TO_US[case["time_unit"]]
            row.update(date=datetime.date.today().isoformat(), commit=revision, machine=machine,
                       isa=case.get("label", ""), program=program.name, case=case["name"],
                       calls=case["iterations"], cpu_us=round(case["cpu_time"] * scale, 2),
                       facts=" ".join(f"{key}={value:g}" for key, value in facts.items()),
                       load_before=load, command=" ".join(command), note=arguments.note)
            if "p50_us" not in case:
                row["median_us"] = round(case["real_time"] * scale, 2)
            for key, column in TIMES.items():
                if key in case:
                    row[column] = round(case[key], 2)
            rows.append(row)
            print(f'{row["case"]:60} {row["median_us"]:>10} us median {row["p99_us"]:>10} us p99',
                  file=sys.stderr)
    if not rows:
        sys.exit("record_results: nothing matched the filter")
    slug = re.sub(r"[^a-z0-9]+", "-", machine.lower()).strip("-")
    path = Path(__file__).parent / "results" / f"{slug}-{revision.rstrip('+')}.csv"
    path.parent.mkdir(exist_ok=True)
    new = not path.exists()
    with path.open("a", newline="") as out:
        writer = csv.DictWriter(out, COLUMNS)
        if new:
            writer.writeheader()
        writer.writerows(rows)
    print(f"{len(rows)} rows in {path}", file=sys.stderr)


if __name__ == "__main__":
    main()
