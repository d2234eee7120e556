"""Refines grasps of a gripper, two fingers, on what one depth frame shows: palpate.torch.

    pip install palpate-*.whl torch
    python3 examples/grasp_refine.py

Each grasp is a pose of the gripper. Descent on the potential takes its fingers out of the scene, and a
soft wall of the clearance keeps them 3 mm away; a spring holds the grasp near to where it was wanted.
"""

import sys

import numpy as np
from trajopt import box

import palpate

GRASPS, STEPS, WANTED = 64, 150, 0.003


def fingers():
    """Two fingers of 10 x 20 x 50 mm with 60 mm between them, as one mesh."""
    vertices, triangles = box([0.01, 0.02, 0.05])
    sides = [vertices + [side, 0, 0] for side in (-0.035, 0.035)]
    return np.concatenate(sides), np.concatenate([triangles, triangles + len(vertices)])


def main():
    try:
        import torch

        from palpate.torch import clearance, penetration
    except ImportError:
        print("SKIPPED grasp_refine: no PyTorch; pip install torch")
        return 0
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=320, height=240)
    surface = palpate.Sensor(camera).update(depth)
    tool = palpate.pack(*fingers(), 200)
    nearest = np.nanmin(surface.points[120, :, 2])
    random = np.random.default_rng(2)
    start = np.zeros((GRASPS, 7))
    start[:, :3] = random.uniform([-0.06, -0.05, nearest - 0.05], [0.06, 0.05, nearest + 0.01], (GRASPS, 3))
    start[:, 3:] = [0, 0, 0, 1] + random.normal(size=(GRASPS, 4)) * 0.05
    wanted = torch.tensor(start)
    poses = wanted.clone().requires_grad_()
    optimizer = torch.optim.Adam([poses], lr=1e-3)
    for _ in range(STEPS):
        optimizer.zero_grad()
        potential = penetration(tool, surface, poses).potential / (tool.volume * 0.01)
        missing = torch.relu(WANTED + 0.001 - clearance(tool, surface, poses)) / WANTED
        spring = ((poses - wanted) ** 2).sum(1)
        (potential + missing**2 + spring).sum().backward()
        optimizer.step()
    contact = palpate.Contact(tool)
    before = contact.measure_batch(surface, start, clearance=True).clearance
    after = contact.measure_batch(surface, poses.detach().numpy(), clearance=True).clearance
    print(f"{(before < WANTED).sum()} of {GRASPS} grasps were nearer than {1e3 * WANTED:.0f} mm, "
          f"{(after < WANTED - 0.001).sum()} still are nearer than {1e3 * WANTED - 1:.0f} mm; least clearance "
          f"{1e3 * before.min():.1f} mm before, {1e3 * after.min():.1f} mm after")
    return 0 if (after < 0).sum() < (before < 0).sum() else 1


if __name__ == "__main__":
    sys.exit(main())
