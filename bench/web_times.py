#!/usr/bin/env python3
"""A frame, queries and a packing through the C header, natively and as WebAssembly in Chromium, in seconds of processor and by turns.

usage: PALPATE_ISA=baseline bench/web_times.py build/release/lib/libpalpate_c.so build/web [PART OF A NAME]
"""
import json
import math
import subprocess
import sys
import time
from ctypes import byref, c_double, c_size_t, c_uint16, c_uint32, c_void_p
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests/c"))
import calls

TURNS = 7
NUM_CALLS = {"frame": 20, "query of 1000": 4000, "query of 5000": 1000, "packing": 1}

lib, error = calls.load(sys.argv[1]), calls.Error()
camera = calls.sized(calls.Camera, width=320, height=240, intrinsics=(288, 288, 159.5, 119.5))
sensor = c_void_p(lib.palpate_sensor_create(byref(camera), None, 1, byref(error)))
image = (c_uint16 * (320 * 240))(*[600] * (320 * 240))
work = {"frame": lambda: lib.palpate_sensor_update_counts(sensor, image, c_double(0.001), None, byref(error))}
work["frame"]()
scene = c_void_p(lib.palpate_scene_create(byref(error)))
lib.palpate_scene_add_sensor(scene, sensor, byref(error))
pose = calls.Pose((0, 0, 0.57), (0, 1, 0, 0))
measure = calls.sized(calls.Measure, progress=1)
for num in (1000, 5000):
    tool = c_void_p(lib.palpate_tool_pack_shape(b"stylus", c_double(0.12), b"packing.spheres = %d" % num, byref(error)))
    contact = c_void_p(lib.palpate_contact_create(tool, None, 1, byref(error)))
    work[f"query of {num}"] = lambda contact=contact: lib.palpate_contact_measure(
        contact, scene, byref(pose), byref(measure), byref(error))


def ellipsoid(n):
    """Returns corners and triangles, 4 n (n - 1), of a closed ellipsoid of 6 cm."""
    corners = [(0, 0, 0.012)]
    for i in range(1, n):
        s, c = math.sin(math.pi * i / n), math.cos(math.pi * i / n)
        corners += [(0.03 * s * math.cos(math.pi * k / n), 0.021 * s * math.sin(math.pi * k / n), 0.012 * c) for k in range(2 * n)]
    corners.append((0, 0, -0.012))
    at = lambda i, k: 0 if i == 0 else len(corners) - 1 if i == n else 1 + 2 * n * (i - 1) + k % (2 * n)
    faces = []
    for i in range(n):
        for k in range(2 * n):
            faces += ([(at(i, k), at(i + 1, k), at(i, k + 1))] if i > 0 else []) + (
                [(at(i, k + 1), at(i + 1, k), at(i + 1, k + 1))] if i < n - 1 else [])
    return [x for corner in corners for x in corner], [i for face in faces for i in face]


vertices, triangles = ellipsoid(160)
num_vertices, num_triangles = len(vertices) // 3, len(triangles) // 3
native_vertices, native_triangles = (c_double * len(vertices))(*vertices), (c_uint32 * len(triangles))(*triangles)
lib.palpate_tool_pack.restype = c_void_p
work["packing"] = lambda: lib.palpate_tool_free(c_void_p(lib.palpate_tool_pack(
    native_vertices, c_size_t(num_vertices), native_triangles, c_size_t(num_triangles), b"packing.spheres = 1000", None, None, byref(error))))

page = subprocess.Popen(["node", str(ROOT / "bench/web_times.mjs"), sys.argv[2]], text=True, stdin=subprocess.PIPE,
                        stdout=subprocess.PIPE)
page.stdin.write(json.dumps({"vertices": vertices, "triangles": triangles}) + "\n")


def native_seconds(name):
    begin = time.process_time()  # of all threads
    for _ in range(NUM_CALLS[name]):
        work[name]()
    return time.process_time() - begin


def page_seconds(name):
    page.stdin.write(f"{name} {NUM_CALLS[name]}\n")
    page.stdin.flush()
    for answer in page.stdout:
        if answer.startswith("seconds "):
            return float(answer.split()[1])
    sys.exit("web_times: the page does not answer; see its message above")


for name, num in NUM_CALLS.items():
    if len(sys.argv) > 3 and sys.argv[3] not in name:
        continue
    page_seconds(name)  # its code warms up
    turns = [(native_seconds(name) / num, page_seconds(name) / num) for _ in range(TURNS)]
    native, web = (1e6 * median(turn[side] for turn in turns) for side in (0, 1))
    ratios = sorted(turn[1] / turn[0] for turn in turns)
    print(f"{name}: native {native:.1f} us, page {web:.1f} us of processor; "
          f"ratio {median(ratios):.2f} ({ratios[1]:.2f} to {ratios[-2]:.2f}, {TURNS} turns)", flush=True)
page.communicate()
