#!/usr/bin/env python3
"""A frame and queries through the C header, natively and as WebAssembly in Chromium, in seconds of processor and by turns.

usage: PALPATE_ISA=baseline bench/web_times.py build/release/lib/libpalpate_c.so build/web
"""
import subprocess
import sys
import time
from ctypes import byref, c_double, c_uint16, c_void_p
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests/c"))
import calls

TURNS = 7
NUM_CALLS = {"frame": 20, "query of 1000": 4000, "query of 5000": 1000}

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

page = subprocess.Popen(["node", str(ROOT / "bench/web_times.mjs"), sys.argv[2]], text=True, stdin=subprocess.PIPE,
                        stdout=subprocess.PIPE)


def native_seconds(name):
    begin = time.thread_time()
    for _ in range(NUM_CALLS[name]):
        work[name]()
    return time.thread_time() - begin


def page_seconds(name):
    page.stdin.write(f"{name} {NUM_CALLS[name]}\n")
    page.stdin.flush()
    for answer in page.stdout:
        if answer.startswith("seconds "):
            return float(answer.split()[1])
    sys.exit("web_times: the page does not answer; see its message above")


for name, num in NUM_CALLS.items():
    page_seconds(name)  # its code warms up
    turns = [(native_seconds(name) / num, page_seconds(name) / num) for _ in range(TURNS)]
    native, web = (1e6 * median(turn[side] for turn in turns) for side in (0, 1))
    ratios = sorted(turn[1] / turn[0] for turn in turns)
    print(f"{name}: native {native:.1f} us, page {web:.1f} us of processor; "
          f"ratio {median(ratios):.2f} ({ratios[1]:.2f} to {ratios[-2]:.2f}, {TURNS} turns)", flush=True)
page.communicate()
