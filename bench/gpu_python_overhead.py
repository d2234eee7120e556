"""Cost of a batch on a GPU from Python: an asynchronous call, a synchronous one, and a replayed graph.

16,384 poses of a finger of 100 spheres, each against its own 64 x 64 image, all arrays PyTorch's on the GPU; medians.
Usage: gpu_python_overhead.py   (the module palpate with CUDA, PyTorch)"""

import time

import numpy as np
import torch

import palpate

NUM, SIDE = 16384, 64


def median_us(call, repetitions=200):
    times = []
    for _ in range(repetitions):
        torch.cuda.synchronize()
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return 1e6 * float(np.median(times))


def main():
    vertices = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * [0.01, 0.008, 0.04]
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
             [1, 5, 7], [1, 7, 3]]
    contact = palpate.Contact(palpate.pack(vertices, np.array(faces), 100), place="cuda")
    camera = palpate.Camera(SIDE, SIDE, 60.0, 60.0, 31.5, 31.5)
    images = torch.full((NUM, SIDE, SIDE), 1.0, device="cuda")
    random = np.random.default_rng(1)
    q = random.normal(size=(NUM, 4))
    p = np.stack([*random.uniform(-0.2, 0.2, (2, NUM)), random.uniform(0.7, 1.03, NUM)], axis=1)
    poses = torch.from_numpy(np.concatenate([p, q / np.linalg.norm(q, axis=1)[:, None]], axis=1)).cuda()
    made = {"volume": torch.zeros(NUM, dtype=torch.float64, device="cuda"),
            "force": torch.zeros(NUM, 3, dtype=torch.float64, device="cuda"),
            "torque": torch.zeros(NUM, 3, dtype=torch.float64, device="cuda")}
    out = palpate.Batch(**made)
    fields = palpate.Sensor(camera, place="cuda").update_batch(images)
    stream = torch.cuda.Stream()

    def ask():
        contact.measure_batch(fields, poses, out=out, stream=stream)

    def ask_and_wait():
        ask()
        stream.synchronize()

    ask_and_wait()
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        contact.measure_batch(fields, poses, out=out, stream=torch.cuda.current_stream())

    def replay_and_wait():
        graph.replay()
        torch.cuda.synchronize()

    print(f"{torch.cuda.get_device_name()}: {NUM} poses x 100 spheres, {(made['volume'] > 0).float().mean():.0%} touch")
    for name, call in (("asked", ask), ("asked and waited for", ask_and_wait), ("replayed and waited for", replay_and_wait)):
        print(f"{name}: {median_us(call):.1f} us")


if __name__ == "__main__":
    main()
