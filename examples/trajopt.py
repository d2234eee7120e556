"""Pushes a path of 200 waypoints clear of what one depth frame shows, by gradients of the clearance.

    pip install palpate-*.whl
    python3 examples/trajopt.py

A tool goes in a straight line through a pillar before a wall. Each step moves waypoints that are
nearer than MARGIN along the gradient of their clearance, and then smooths the path between its ends.
The margin keeps an inner packing safe: its standoff, and three times the noise of the camera. It
fails, and exits with 1, if a waypoint is still nearer.
"""

import sys

import numpy as np

import palpate

WAYPOINTS, MARGIN, STEPS = 200, 0.01, 400


def box(size):
    """A box, as vertices and triangles."""
    vertices = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(size) / 2
    triangles = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                 [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return vertices, np.array(triangles)


def turned(poses, turns):
    """Poses (P, 7) turned by small rotation vectors (P, 3) in W about their origins."""
    v = turns / 2
    x, y, z, w = poses[:, 3:].T
    a, b, c = v.T
    q = np.stack([x + a * w + b * z - c * y, y + b * w + c * x - a * z, z + c * w + a * y - b * x,
                  w - a * x - b * y - c * z], 1)
    return np.concatenate([poses[:, :3], q / np.linalg.norm(q, axis=1, keepdims=True)], 1)


def optimized(contact, scene, poses):
    """The path pushed clear of the scene; its ends stay."""
    poses = poses.copy()
    for _ in range(STEPS):
        batch = contact.measure_batch(scene, poses, clearance=True)
        missing = np.maximum(1.5 * MARGIN - batch.clearance, 0)[1:-1, None]
        gradient = batch.clearance_gradient[1:-1]
        poses[1:-1, :3] += 0.5 * missing * gradient[:, :3]
        arm = 0.03  # m: what a turn of one radian counts as
        poses[1:-1] = turned(poses[1:-1], 0.2 * missing * gradient[:, 3:] / arm**2)
        poses[1:-1, :3] += 0.1 * (poses[2:, :3] + poses[:-2, :3] - 2 * poses[1:-1, :3])
    return poses


def main():
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=320, height=240)
    scene = palpate.Scene([palpate.Sensor(camera).update(depth)])
    tool = palpate.pack(*box([0.03, 0.02, 0.06]), 300)
    contact = palpate.Contact(tool)
    points = scene.cameras[0].points
    pillar = np.nanmin(points[120, :, 2])
    path = np.zeros((WAYPOINTS, 7))
    path[:, 0] = np.linspace(-0.2, 0.2, WAYPOINTS)
    path[:, 2] = pillar - 0.02
    path[:, 6] = 1
    path[[0, -1], 2] = pillar - 0.15
    before = contact.measure_batch(scene, path, clearance=True)
    path = optimized(contact, scene, path)
    after = contact.measure_batch(scene, path, clearance=True)
    hits = contact.any(scene, path, MARGIN)
    steps = np.linalg.norm(np.diff(path[:, :3], axis=0), axis=1)
    print(f"least clearance: {1e3 * before.clearance.min():.1f} mm before, {1e3 * after.clearance.min():.1f} mm "
          f"after; {hits.sum()} of {WAYPOINTS} waypoints nearer than {1e3 * MARGIN:.0f} mm; "
          f"path {steps.sum():.3f} m long, largest step {1e3 * steps.max():.1f} mm")
    return 1 if hits.any() else 0


if __name__ == "__main__":
    sys.exit(main())
