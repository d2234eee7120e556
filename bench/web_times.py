#!/usr/bin/env python3
"""Least times of a frame and of queries through the C header, as tests/web/core_test.mjs prints them for Chromium.

usage: PALPATE_ISA=baseline bench/web_times.py build/release/lib/libpalpate_c.so
"""
import sys
import time
from ctypes import byref, c_double, c_uint16, c_void_p
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/c"))
import calls

lib, error = calls.load(sys.argv[1]), calls.Error()


def least(name, num, work):
    times = []
    for _ in range(num):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    print(f"{name}: {1e6 * min(times):.1f} us")


camera = calls.sized(calls.Camera, width=320, height=240, intrinsics=(288, 288, 159.5, 119.5))
sensor = c_void_p(lib.palpate_sensor_create(byref(camera), None, 1, byref(error)))
image = (c_uint16 * (320 * 240))(*[600] * (320 * 240))
scene = c_void_p(lib.palpate_scene_create(byref(error)))
least("frame", 100, lambda: lib.palpate_sensor_update_counts(sensor, image, c_double(0.001), None, byref(error)))
lib.palpate_scene_add_sensor(scene, sensor, byref(error))
pose = calls.Pose((0, 0, 0.57), (0, 1, 0, 0))
for num in (1000, 5000):
    tool = c_void_p(lib.palpate_tool_pack_shape(b"stylus", c_double(0.12), b"packing.spheres = %d" % num, byref(error)))
    contact = c_void_p(lib.palpate_contact_create(tool, None, 1, byref(error)))
    measure = calls.sized(calls.Measure, progress=1)
    least(f"query of {num}", 2000, lambda: lib.palpate_contact_measure(contact, scene, byref(pose), byref(measure), byref(error)))
