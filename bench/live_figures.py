#!/usr/bin/env python3
"""Runs the live program and writes its latencies, one CSV row per case, to bench/results/.

usage: bench/live_figures.py BUILD_DIR [--data DIR] [--backend cpu|cuda|auto] [--seconds S]
                             [--spheres N,N,...] [--note TEXT]

A cube of 0.1 m in a simulated hand, for each number of spheres and each --time: against the wall of
a simulated camera, which renders beside the loop, and against recorded frames, which costs little:
a sequence of DIR (PALPATE_DATA), else frames that this script draws. The bare query (one frame, no
stiffness, nothing beside it) is measured at the poses of the same run, straight afterwards. Times
are microseconds; compare ratios within one file, and look at load_before: other work on the machine
makes everything late. BUILD_DIR needs the targets palpate and recorded_query.
"""
import argparse
import csv
import datetime
import json
import math
import os
import re
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

from record_results import COLUMNS, commit, machine_name

TIMES = {"p50": "median_us", "p99": "p99_us", "p999": "p99.9_us", "max": "max_us"}
REAL = ("sequences/visp_rbt/depth", "607.178,607.234,321.391,241.918")
DRAWN = "575.8157,575.8157,319.5,239.5"


def write_depth(path, width, height, rows):
    """Writes a 16-bit PNG of rows of big-endian numbers."""
    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))
    raw = b"".join(b"\0" + row for row in rows)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" +
                     chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)) +
                     chunk(b"IDAT", zlib.compress(raw, 1)) + chunk(b"IEND", b""))


def draw_frames(folder, num=150, width=640, height=480):
    """Writes frames of a wavy wall that moves by a few millimeters."""
    folder.mkdir(parents=True)
    for number in range(num):
        depth = 600 + 4 * math.sin(number / 10)
        waves = [[int(depth + 3 * math.sin(0.05 * u + phase)) for u in range(width)]
                 for phase in range(6)]
        packed = [struct.pack(f">{width}H", *wave) for wave in waves]
        write_depth(folder / f"{number:04}.png", width, height,
                    [packed[v // 20 % 6] for v in range(height)])


def run_json(command, result=None):
    """Returns the JSON that the program prints or writes into a file, even if the run ended early."""
    run = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, text=True,
                         stderr=subprocess.PIPE)
    text = result.read_text() if result and result.exists() else run.stdout
    if not text.strip():
        sys.exit(f"live_figures: {' '.join(map(str, command))}\n{run.stderr}")
    return json.loads(text)


def gpu_name():
    try:
        names = subprocess.run(["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"],
                               stdout=subprocess.PIPE, text=True).stdout.splitlines()
    except OSError:
        names = []
    return names[0] if names else "no GPU"


def row_of(case, times, facts, **columns):
    """Returns a row of a case of the live program, and prints it in short."""
    row = dict.fromkeys(COLUMNS, "")
    row.update(date=datetime.date.today().isoformat(), program="palpate", case=case, calls=int(times.get("num", 0)),
               facts=" ".join(f"{key}={value:g}" for key, value in facts.items()), **columns)
    row.update({column: round(times[key], 2) for key, column in TIMES.items() if key in times})
    print(f'{row["commit"]:10} {case:70} {row["median_us"]:>10} {row["p99_us"]:>10}  {row["facts"]}', file=sys.stderr)
    return row


def write_rows(stem, machine, rows):
    """Writes bench/results/STEM-MACHINE.csv."""
    slug = re.sub(r"[^a-z0-9]+", "-", machine.lower()).strip("-")
    path = Path(__file__).parent / "results" / f"{stem}-{slug}.csv"
    with path.open("w", newline="") as out:
        writer = csv.DictWriter(out, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    print(f"{len(rows)} rows in {path}", file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=Path)
    parser.add_argument("--data", default=os.environ.get("PALPATE_DATA", ""))
    parser.add_argument("--backend", default="cpu", choices=["cpu", "cuda", "auto"])
    parser.add_argument("--seconds", type=float, default=4)
    parser.add_argument("--spheres", default="5000,17000,100000")
    parser.add_argument("--note", default="")
    options = parser.parse_args()
    palpate, bare_query = options.build / "bin/palpate", options.build / "bin/recorded_query"
    for program in (palpate, bare_query):
        if not program.exists():
            sys.exit(f"live_figures: {program} is missing; build the targets palpate and recorded_query")

    work = options.build / "live-figures"
    work.mkdir(exist_ok=True)
    box = work / "box.ply"
    subprocess.run([palpate, "shape", "box", "--size", "0.1", "-o", box], check=True,
                   stdout=subprocess.DEVNULL)
    recorded = Path(options.data) / REAL[0] if options.data else Path("absent")
    intrinsics = REAL[1]
    if not recorded.is_dir():
        recorded, intrinsics = work / "frames", DRAWN
        if not recorded.is_dir():
            draw_frames(recorded)
    sources = {"scene wall": ["--scene", "wall"],
               f"recorded {recorded.parent.name if intrinsics == REAL[1] else 'wavy wall'}":
                   ["--depth-sequence", recorded, "--intrinsics", intrinsics]}

    rows, machine, revision = [], machine_name(), commit()
    if options.backend != "cpu":
        machine = f"{gpu_name()}, {machine}"

    def add(case, times, command, facts, load):
        rows.append(row_of(case, times, facts, commit=revision, machine=machine, load_before=load, command=command,
                           note=options.note))

    print(f'{"":81} {"median us":>10} {"p99 us":>10}', file=sys.stderr)
    for num in map(int, options.spheres.split(",")):
        tool = work / f"cube{num}.palp"
        if not tool.exists():
            subprocess.run([palpate, "pack", box, "--spheres", str(num), "-o", tool], check=True,
                           stdout=subprocess.DEVNULL)
        for source, source_options in sources.items():
            for time in ("interpolate", "latest", "predict"):
                load = f"{os.getloadavg()[0]:.1f}"
                with tempfile.TemporaryDirectory(dir=work) as folder:
                    run = Path(folder) / "run"
                    command = ["palpate", "touch", tool.name, *source_options, "--device", "sim", "--duration",
                               f"{options.seconds:g}", "--time", time, "--backend", options.backend]
                    summary = run_json([palpate, "touch", tool, *command[3:], "-o", run],
                                       run / "summary.json")
                    bare = run_json([bare_query, run])
                words = " ".join(Path(word).name if isinstance(word, Path) else word for word in command)
                times = summary["microseconds"]
                case = f"spheres:{num}/time:{time}/source:{source}/backend:{options.backend}"
                contact = times["contact_compute"]
                base = max(bare["p50"], 1e-3)
                add(f"bare query/{case}", bare, words, {}, load)
                add(f"live contact/{case}", contact, words, {
                    "p50_over_bare_p50": contact["p50"] / base, "p99_over_bare_p50": contact["p99"] / base,
                    "stiffness_left_out": summary["stiffness_left_out"],
                    "peak_memory_MB": round(summary["peak_memory_bytes"] / 1e6)}, load)
                add(f"surface_compute/{case}", times["surface_compute"], words,
                    {"frames": summary["frames"], "frames_left_out": summary["frames_left_out"]}, load)
                add(f"sensor_to_force/{case}", times["sensor_to_force"], words, {}, load)
                add(f"haptic_compute/{case}", times["haptic_compute"], words,
                    {"ticks": summary["ticks"], "missed": summary["missed"]}, load)
                if summary["failure"]:
                    print(f"    ended early: {summary['failure']}", file=sys.stderr)
    memory = run_json([bare_query, "--memory", "100"])
    add(f"memory of a field query/spheres:{memory['spheres']}", {}, "recorded_query --memory 100",
        {"index_MB": memory["index"] / 1e6, "query_beyond_MB": memory["query"] / 1e6}, "")

    write_rows("live", machine, rows)


if __name__ == "__main__":
    main()
