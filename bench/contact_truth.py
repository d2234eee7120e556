"""Truth for contact_peers.py: a box in exact solids, its share inside and its force by sums over points."""

import numpy as np

SIDES = np.array([0.1, 0.08, 0.06])  # m, of the box


def wall(p):
    """Depth of points below the surface, m, and its normal."""
    return p[..., 2] - 1, np.broadcast_to([0.0, 0, -1], p.shape)


def ball(p, radius=160 / 575.8157):
    lever = p - [0, 0, 1 + radius]
    length = np.linalg.norm(lever, axis=-1)
    return radius - length, lever / length[..., None]


def ridge(p):
    """Two walls at right angles, their edge towards the camera."""
    side = np.where(p[..., 0] < 0, -1.0, 1.0)
    normal = np.stack([side, np.zeros_like(side), -np.ones_like(side)], axis=-1) * np.sqrt(0.5)
    return -((p - [0, 0, 1]) * normal).sum(axis=-1), normal


SCENES = {"wall": wall, "sphere-out-160": ball, "ridge-90": ridge}


def points_of_box(num):
    axis = (np.arange(num) + 0.5) / num - 0.5
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3) * SIDES


def truth(solid, R, p, points):
    """Share of the box in the solid, and the mean of the normal over the whole box: its force over its volume."""
    depth, normal = solid(points @ R.T + p)
    inside = depth > 0
    return inside.mean(), (normal * inside[:, None]).mean(axis=0)


def random_poses(solid, num, random):
    """Rotations, positions, shares and forces."""
    coarse, fine = points_of_box(20), points_of_box(72)
    poses, shares, forces = [], [], []
    for _ in range(num):
        q = random.standard_normal(4)
        q /= np.linalg.norm(q)
        R = rotation(q)
        p, wanted = np.append(random.uniform(-0.02, 0.02, 2), 0.0), random.uniform(0.05, 0.6)
        low, high = 0.85, 1.3
        for _ in range(12):
            p[2] = (low + high) / 2
            low, high = (p[2], high) if truth(solid, R, p, coarse)[0] < wanted else (low, p[2])
        share, force = truth(solid, R, p, fine)
        poses.append(np.concatenate([p, q]))
        shares.append(share)
        forces.append(force)
    return np.array(poses), np.array(shares), np.array(forces)


def rotation(q):
    x, y, z, w = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
