"""Cost of a batch on a GPU from Python: an asynchronous call, a synchronous one, and a replayed graph.

16,384 poses of a finger of 100 spheres, each against its own 64 x 64 image, all arrays PyTorch's on the GPU; medians.
Then palpate.torch, 1,000 spheres at the surface of one 640 x 480 image: gradient, Hessian and the clearance's gradient over the plain batches.
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


def device_us(call, repetitions=60, calls=5):
    """Median of the device's time of a call among a few in a row."""
    for _ in range(3):
        call()
    times = []
    for _ in range(repetitions):
        marks = [torch.cuda.Event(enable_timing=True) for _ in range(2)]
        marks[0].record()
        for _ in range(calls):
            call()
        marks[1].record()
        marks[1].synchronize()
        times.append(1e3 * marks[0].elapsed_time(marks[1]) / calls)
    return float(np.median(times))


def captured(call):
    side = torch.cuda.Stream()
    with torch.cuda.stream(side):
        call()
    side.synchronize()
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph, stream=side):
        call()
    return graph.replay


def gradients(tool):
    """palpate.torch beside the batches that it asks: medians by turns in one process, us."""
    from palpate.torch import clearance, penetration

    depth, camera, _ = palpate.render_scene("wall")
    surface = palpate.Sensor(camera, place="cuda").update(depth)
    contact = palpate.Contact(tool, place="cuda")
    random = np.random.default_rng(2)
    q = random.normal(size=(NUM, 4))
    points = palpate.Sensor(camera).update(depth).points[100:380, 150:490].reshape(-1, 3)
    p = points[random.choice(len(points), NUM)] + random.uniform(-0.03, 0.01, (NUM, 1)) * [0, 0, 1]
    numbers = np.concatenate([p, q / np.linalg.norm(q, axis=1)[:, None]], axis=1)
    fixed = torch.from_numpy(numbers).cuda()

    def empty(*shape):
        return torch.empty(NUM, *shape, dtype=torch.float64, device="cuda")

    made = {"volume": empty(), "potential": empty(), "force": empty(3), "torque": empty(3)}
    plain, stiff = palpate.Batch(**made), palpate.Batch(**made, stiffness=empty(6, 6))
    nearest = torch.empty(NUM, dtype=torch.int32, device="cuda")
    far = palpate.Batch(clearance=empty(), clearance_gradient=empty(6), nearest=nearest)

    def batch():
        contact.measure_batch(surface, fixed, out=plain, stream=torch.cuda.current_stream())

    def batch_with_stiffness():
        contact.measure_batch(surface, fixed, stiffness=True, out=stiff, stream=torch.cuda.current_stream())

    def gradient():
        poses = fixed.detach().requires_grad_()  # a leaf of the stream that captures
        return torch.autograd.grad(penetration(contact, surface, poses).potential.sum(), poses)

    def hessian():
        poses = fixed.detach().requires_grad_()
        potential = penetration(contact, surface, poses, second=True).potential
        (first,) = torch.autograd.grad(potential.sum(), poses, create_graph=True)
        return torch.autograd.grad(first.sum(), poses)

    def clearances():
        contact.measure_batch(surface, fixed, clearance=True, out=far, stream=torch.cuda.current_stream())

    def clearance_gradient():
        poses = fixed.detach().requires_grad_()
        return torch.autograd.grad(clearance(contact, surface, poses).sum(), poses)

    batch()
    torch.cuda.synchronize()
    print(f"at the surface, {len(tool.spheres)} spheres, {(made['volume'] > 0).float().mean():.0%} touch")
    for way in (lambda call: call, captured):
        named = "replayed" if way is captured else "asked"
        calls = (batch, gradient, batch_with_stiffness, hessian, clearances, clearance_gradient)
        times = {call.__name__: device_us(way(call)) for call in calls}
        for over, under in (("gradient", "batch"), ("hessian", "batch_with_stiffness"), ("clearance_gradient", "clearances")):
            print(f"{over} {named}: {times[over]:.1f} us, over {under} {times[under]:.1f} us: {times[over] / times[under]:.3f}")


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
    gradients(palpate.pack(vertices, np.array(faces), 1000))


if __name__ == "__main__":
    main()
