#!/usr/bin/env python3
"""Distance of the surface of packed tools from their spheres, by two builds of palpate, as CSV.

  packing_tips.py PALPATE [--before PALPATE] [--data DIR] [--commit ID] > packing-tips.csv

Shapes of `palpate shape`, longest side 0.196 m, and the meshes of DIR/meshes_good scaled to it.
Standoffs are measured by `PALPATE info` for both builds, at all corners too.
"""
import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
import tempfile

SIZE = 0.196
NUMBERS = (1000, 5000, 20000)
SHAPES = ("box", "octahedron", "tetrahedron", "sphere", "cylinder", "stylus", "spiral", "torus",
          "finger", "comb", "needle", "blade")


def run(*command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"packing_tips: {command}: {done.stderr}")
    return json.loads(done.stdout) if "--json" in command else None


def longest_side(info):
    low, high = info["bounds"]
    return max(b - a for a, b in zip(low, high))


def machine():
    try:
        with open("/proc/cpuinfo") as file:
            names = [line.split(":")[1].strip() for line in file if line.startswith("model name")]
        return f"{names[0]}, {len(names)} cores"
    except (OSError, IndexError):
        return platform.machine()


def meshes(palpate, data, folder):
    """Yields names, files and the factor to SIZE."""
    for name in SHAPES:
        path = os.path.join(folder, name + ".ply")
        run(palpate, "shape", name, "--size", SIZE, "-o", path)
        yield name, path, 1
    if not data:
        return
    good = os.path.join(data, "meshes_good")
    for name in sorted(os.listdir(good)):
        path = os.path.join(good, name)
        # Units differ: a mesh that is too large in meters is taken in millimeters.
        for scale in (1, 1e-3):
            tool = os.path.join(folder, "probe.palp")
            done = subprocess.run([palpate, "pack", path, "--scale", str(scale), "--spheres", "1",
                                   "-o", tool, "--json"], capture_output=True, text=True)
            if done.returncode == 0:
                yield name, path, scale * SIZE / longest_side(json.loads(done.stdout))
                break
        else:
            sys.exit(f"packing_tips: {path}: {done.stderr}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("palpate")
    parser.add_argument("--before")
    parser.add_argument("--data")
    parser.add_argument("--commit", default="unknown")
    arguments = parser.parse_args()
    print(f"# date: {datetime.date.today()}")
    print(f"# machine: {machine()}")
    print(f"# commit: {arguments.commit}")
    print(f"# settings: longest side {SIZE} m; all threads; seconds of pack, mesh check included")
    print("# command: bench/packing_tips.py build/release/bin/palpate --before PALPATE --data DIR")
    print("mesh,spheres,build,fill,p95_mm,max_mm,bound_mm,smallest_radius_mm,seconds,graph_parts")
    builds = [("before", arguments.before)] if arguments.before else []
    builds.append(("after", arguments.palpate))
    with tempfile.TemporaryDirectory() as folder:
        for name, path, scale in meshes(arguments.palpate, arguments.data, folder):
            for number in NUMBERS:
                for build, palpate in builds:
                    tool = os.path.join(folder, "tool.palp")
                    packed = run(palpate, "pack", path, "--scale", scale, "--spheres", number,
                                 "-o", tool, "--json")
                    info = run(arguments.palpate, "info", tool, "--json")
                    gap = info["standoff"]
                    bound = max(4 * gap["p95"], 0.01 * longest_side(info))
                    print(f"{name},{info['spheres']},{build},{info['fill']:.5f},"
                          f"{1e3 * gap['p95']:.4g},{1e3 * gap['max']:.4g},{1e3 * bound:.4g},"
                          f"{1e3 * info['min_radius']:.4g},{packed['seconds']:.2f},"
                          f"{info['graph']['components_before_bridging']}", flush=True)


if __name__ == "__main__":
    main()
