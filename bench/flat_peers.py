"""Flat places of recorded frames, by our contact and by those of others: where does the force point, and how calm is it while a
ball slides along them?

Truth is the plane fitted to the pixels around a place, 45 mm each way, and the cap of the ball behind it. A ball of 60 mm or 20 mm
is pressed 5 mm in and drawn 60 mm along. All get the points of our filter, others those around the place. Rows: the angle between
force and normal (median and rms), the error of the volume in % of the ball, and while it slides, the ripple of the force along the
normal and the false force across it, in % of the force (medians of the places).
Usage: flat_peers.py DATA FILE.csv [--peers ...] [--places 12]   DATA: a folder with MANIFEST.json and frames/
Needs what contact_peers.py needs."""

import argparse
import json
import sys
from pathlib import Path

import frame_peers
import numpy as np
import palpate
from contact_peers import coal_contacts, mesh_of, ours, warp
from frame_peers import Window
from peer_rows import guarded, stamp, write

DEPTH, STEPS = 0.005, 31  # m into the plane; poses of a slide
HALF = (0.1, 0.1, 0.25)   # m, of the window around a place
SPHERES = 1000


def flat_places(data, most):
    """Yields file, camera, image in m, middle and normal of flat places, the same in every run: at most so many in a frame."""
    random = np.random.default_rng(3)
    entries = {entry["file"]: entry for entry in json.loads((data / "MANIFEST.json").read_text())}
    for file in sorted(name for name in entries if name.startswith("frames/") and name.endswith(".png")):
        lens, unit = entries[file]["intrinsics"], entries[file]["unit_m"]
        fx, fy, cx, cy = (lens[name] for name in ("fx", "fy", "cx", "cy"))
        image = palpate.load_depth_png(str(data / file))
        depth, found = image.astype(float) * unit, 0
        height, width = depth.shape
        camera = palpate.Camera(width, height, fx, fy, cx, cy, unit=unit)
        for _ in range(4000):
            if found == most:
                break
            u, v = random.integers(60, width - 60), random.integers(60, height - 60)
            if not 0.4 < depth[v, u] < 2.5:
                continue
            half = int(min(55, max(12, 0.045 * fx / depth[v, u])))
            around = depth[v - half:v + half + 1, u - half:u + half + 1]
            if around.shape != (2 * half + 1, 2 * half + 1) or (around <= 0).mean() > 0.01:
                continue
            rows, columns = np.mgrid[v - half:v + half + 1, u - half:u + half + 1]
            points = np.stack([(columns - cx) / fx * around, (rows - cy) / fy * around, around], axis=-1)[around > 0]
            middle = points.mean(axis=0)
            _, sizes, axes = np.linalg.svd(points - middle, full_matrices=False)
            normal = -np.sign(axes[2, 2]) * axes[2]
            rms = sizes[2] / np.sqrt(len(points))
            off = np.quantile(abs((points - middle) @ normal), 0.99)
            if rms > 0.004 * max(1, depth[v, u]**2) or off > 5 * rms or -normal[2] < 0.4:
                continue
            found += 1
            yield file, camera, image, middle, normal


def ball(radius, rings=24):
    """Vertices and triangles of a ball."""
    polar, turn = np.linspace(0, np.pi, rings + 1)[1:-1], np.arange(2 * rings) * np.pi / rings
    p, t = np.meshgrid(polar, turn, indexing="ij")
    grid = np.stack([np.sin(p) * np.cos(t), np.sin(p) * np.sin(t), np.cos(p)], axis=-1).reshape(-1, 3)
    num, across = len(grid), 2 * rings
    a = np.arange(num - across)
    b = a // across * across + (a + 1) % across
    k = np.arange(across)
    end = num - across + k
    caps = [np.stack([np.full(across, num), k, (k + 1) % across], axis=1),
            np.stack([np.full(across, num + 1), num - across + (k + 1) % across, end], axis=1)]
    sides = [np.stack([a, a + across, b + across], axis=1), np.stack([a, b + across, b], axis=1)]
    return radius * np.concatenate([grid, [[0, 0, 1], [0, 0, -1]]]), np.concatenate(sides + caps)


def slide(middle, normal, radius):
    """Poses of the ball along the plane."""
    along = np.cross(normal, [0, 1, 0])
    along /= np.linalg.norm(along)
    poses = np.zeros((STEPS, 7))
    poses[:, :3] = middle + np.linspace(-0.03, 0.03, STEPS)[:, None] * along + normal * (radius - DEPTH)
    poses[:, 6] = 1
    return poses


def asked(tool, camera, image, points, poses, middle, radius):
    """Returns the peers by name, each to be called."""
    window = Window(tuple(middle), HALF)
    return {"palpate": lambda: ours(tool, image, camera, poses, "cpu"),
            "image": lambda: frame_peers.image_peers(tool, None, camera, points, poses, "cpu", window),
            "warp": lambda: warp(tool, *mesh_of(points, window), poses, "cpu"),
            "coal": lambda: coal_contacts(*mesh_of(points, window), poses, radius),
            "field": lambda: frame_peers.mujoco_height_field(points, poses, radius, window, 0.01),
            "drake": lambda: frame_peers.drake_hydroelastic(*mesh_of(points, window), poses, radius)}


def figures(places):
    """Returns the row of a peer: (shares or None, forces, normal) of each place, for a ball of this radius."""
    angles, volumes, ripples, across = [], [], [], []
    for shares, forces, normal, cap in places:
        along = forces @ normal
        length = np.linalg.norm(forces[STEPS // 2])
        if length > 0:
            angles.append(np.degrees(np.arccos(np.clip(along[STEPS // 2] / length, -1, 1))))
        if shares is not None:
            volumes.append(shares[STEPS // 2] - cap)
        mean = max(along.mean(), 1e-12)
        ripples.append(along.std() / mean)
        across.append(np.sqrt((np.linalg.norm(forces - along[:, None] * normal, axis=1)**2).mean()) / mean)
    rms = lambda values: np.sqrt(np.mean(np.square(values)))  # noqa: E731
    return {"places": len(places), "no_force": len(places) - len(angles), "direction_median_deg": f"{np.median(angles):.2f}",
            "direction_rms_deg": f"{rms(angles):.2f}", "volume_rms_percent": f"{100 * rms(volumes):.2f}" if volumes else "",
            "ripple_percent": f"{100 * np.median(ripples):.1f}", "sideways_percent": f"{100 * np.median(across):.1f}",
            "sideways_p90_percent": f"{100 * np.quantile(across, 0.9):.1f}"}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("file")
    parser.add_argument("--peers", default="palpate,image,warp,field,coal,drake")
    parser.add_argument("--places", type=int, default=12, help="at most in a frame")
    parser.add_argument("--balls", default="60,20", help="mm across")
    given = parser.parse_args()
    places = list(flat_places(given.data, given.places))
    filtered = {}
    for file, camera, image, *_ in places:
        if file not in filtered:
            filtered[file] = np.asarray(palpate.Sensor(camera).update(image).points, float)
    rows, is_whole = [], True
    for radius in (0.0005 * float(size) for size in given.balls.split(",")):
        tool = palpate.pack(*ball(radius), SPHERES)
        cap = DEPTH**2 * (3 * radius - DEPTH) / (4 * radius**3)  # of a ball of volume 1

        def measure(peer):
            found = {}
            for file, camera, image, middle, normal in places:
                poses = slide(middle, normal, radius)
                for who, shares, forces, *_ in asked(tool, camera, image, filtered[file], poses, middle, radius)[peer]():
                    found.setdefault(who, []).append((shares, forces, normal, cap))
            for who, results in found.items():
                rows.append({**stamp(), "peer": who, "ball_mm": round(2000 * radius), **figures(results)})
                print(*list(rows[-1].values())[2:], flush=True)

        for peer in given.peers.split(","):
            is_whole &= guarded(f"{peer}, ball of {2000 * radius:.0f} mm", lambda: measure(peer))
            write(given.file, rows)
    return 0 if is_whole else 1


if __name__ == "__main__":
    sys.exit(main())
