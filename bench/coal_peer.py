"""Contact of coal with an octree of a depth image's points: the first scene of the evaluation's
figure `others` (a box, turned by 20 degrees, goes into a wall that is seen with 1.5 mm of noise).

Appends rows to the file of bench_peers, which palpate_eval --peers reads.
Usage: coal_peer.py FILE.csv   (needs the packages of scripts/setup.sh --peers, in build/python-peers)"""

import ctypes
import sys
import time

import coal
import numpy as np

WIDTH, HEIGHT, FOCAL = 640, 480, 575.8157
WALL, NOISE = 1.0, 0.0015  # m
SIDE = 0.2                 # m, of the box
VOXELS = (0.004, 0.008)    # m


class Heap(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks",
                                                     "fsmblks", "uordblks", "fordblks", "keepcost")]


def bytes_in_use():
    mallinfo2 = ctypes.CDLL(None).mallinfo2
    mallinfo2.restype = Heap
    heap = mallinfo2()
    return heap.uordblks + heap.hblkhd


def wall_points(random):
    u, v = np.meshgrid(np.arange(WIDTH) - 319.5, np.arange(HEIGHT) - 239.5)
    z = WALL + NOISE * random.standard_normal(u.shape)
    return np.stack([u / FOCAL * z, v / FOCAL * z, z], axis=-1).reshape(-1, 3)


def rotation(axis, angle):
    axis = np.asarray(axis) / np.linalg.norm(axis)
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def median_and_p99(times):
    return np.median(times), np.quantile(times, 0.99)


def force_of(box, octree, pose):
    """Sum of depth times normal over all voxels that the box meets, turned towards the camera: coal
    says which way a voxel leaves the box soonest, and that is along a normal of the box."""
    request = coal.CollisionRequest()
    request.num_max_contacts = 100000
    request.enable_contact = True
    result = coal.CollisionResult()
    coal.collide(box, pose, octree, coal.Transform3s(), request, result)
    force = np.zeros(3)
    for i in range(result.numContacts()):
        contact = result.getContact(i)
        force += abs(contact.penetration_depth) * np.asarray(contact.normal)
    return -np.sign(force[2]) * force, result.numContacts()


def measure(voxel, points):
    near = points[(abs(points[:, 0]) < 0.25) & (abs(points[:, 1]) < 0.25)]
    before, builds, kept = bytes_in_use(), [], []
    for _ in range(5):
        start = time.perf_counter()
        kept.append(coal.makeOctree(near, voxel))
        builds.append(time.perf_counter() - start)
    octree, memory = kept[0], (bytes_in_use() - before) / len(kept)
    box = coal.Box(SIDE, SIDE, SIDE)
    turned = rotation([1, 2, 0.5], np.radians(20))
    reach = SIDE / 2 * np.abs(turned[2]).sum()
    # First contact to 60 % of the way, then steps of 0.05 mm.
    way = 2 * reach
    errors, times = [], []
    for depth in np.linspace(0.05, 0.6, 60):
        pose = coal.Transform3s(turned, np.array([0.011, -0.007, WALL - reach + depth * way]))
        start = time.perf_counter()
        force, num = force_of(box, octree, pose)
        times.append(time.perf_counter() - start)
        if num > 0 and np.linalg.norm(force) > 0:
            errors.append(np.degrees(np.arccos(np.clip(-force[2] / np.linalg.norm(force), -1, 1))))
    steps = []
    for i in range(60):
        z = WALL - reach + 0.3 * way + i * 5e-5
        steps.append(force_of(box, octree, coal.Transform3s(turned, np.array([0.011, -0.007, z])))[0])
    steps = np.linalg.norm(np.diff(steps, axis=0), axis=1)
    mean = np.mean(steps)
    rms = np.sqrt(np.mean(np.square(errors))) if errors else float("nan")
    median, p99 = median_and_p99(times)
    return {"direction_deg": rms, "largest_over_mean": steps.max() / mean if mean > 0 else float("nan"),
            "memory_MB": memory / 1e6, "missed": 60 - len(errors)}, median, p99, np.median(builds)


def main():
    points = wall_points(np.random.default_rng(1))
    with open(sys.argv[1], "a") as file:
        for voxel in VOXELS:
            facts, median, p99, build = measure(voxel, points)
            words = " ".join(f"{name}={value:.2f}" for name, value in facts.items())
            line = (f"octree/voxel:{1e3 * voxel:.0f},coal {coal.__version__} octree {1e3 * voxel:.0f} mm,"
                    f"0,0,{1e6 * median:.2f},{1e6 * p99:.2f},{1e6 * build:.2f},{words}")
            file.write(line + "\n")
            print(line)


if __name__ == "__main__":
    main()
