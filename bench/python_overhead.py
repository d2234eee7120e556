#!/usr/bin/env python3
"""Cost of one Contact.measure in Python beyond the measurement itself: a tool of few spheres in
free space, which C++ answers in a fraction of a microsecond.

usage: PYTHON bench/python_overhead.py [ROUNDS]      with palpate installed (make wheel)
"""

import sys
import time

import numpy as np

import palpate

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.02
FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                  [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])


def main(rounds):
    tool = palpate.pack(CORNERS, FACES, 4)
    camera = palpate.Camera(160, 120, 140, 140, 79.5, 59.5)
    surface = palpate.Sensor(camera).update(np.full((120, 160), 2.0, np.float32))
    contact = palpate.Contact(tool)
    seven = np.array([0, 0, 0.5, 0, 0, 0, 1.0])
    matrix = np.eye(4)
    matrix[2, 3] = 0.5
    for name, pose in (("(7,) float64", seven), ("(4, 4) float64", matrix),
                       ("(4, 4) float32", matrix.astype(np.float32)), ("list of 7", seven.tolist())):
        times = np.empty(rounds)
        for i in range(rounds):
            start = time.perf_counter_ns()
            for _ in range(100):
                contact.measure(surface, pose)
            times[i] = (time.perf_counter_ns() - start) / 100e3
        print(f"{name:16} p50 {np.quantile(times, 0.5):.2f} us, p99 {np.quantile(times, 0.99):.2f} us, least {times.min():.2f} us")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
