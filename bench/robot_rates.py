"""Configurations of a Panda a second, on one core, before a wall of 640 x 480 pixels: forward kinematics with clearance, gradient,
yes or no, contact, and proved motions. Prints rows name,value,unit of processor time; best of 5.

    python3 bench/robot_rates.py [NUM_MOTIONS]   # in a Python with palpate, pin and example-robot-data

With a number it samples so many motions past a post instead: is one that is proved free blocked anywhere?
"""

import sys
import time
from pathlib import Path

import numpy as np

import palpate

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))
from plan_arm import panda  # noqa: E402

NUM = 20000


def rate(work, num=NUM):
    best = 1e9
    for _ in range(5):
        start = time.process_time()
        work()
        best = min(best, time.process_time() - start)
    return num / best


def sample_motions(robot, scene, num):
    rng = np.random.default_rng(3)
    low, high = robot.joint_limits.T
    start = rng.uniform(low, high, (num, len(low)))
    end = np.clip(start + rng.normal(0, 0.3, start.shape), low, high)
    margin = robot.standoff + 0.005
    free, _ = robot.free_motions(scene, start, end, margin)

    def num_blocked(motions, samples):
        shares = np.linspace(0, 1, samples)[:, None]
        return sum(robot.any(scene, start[i] + shares * (end[i] - start[i]), margin).any() for i in motions)

    print(f"proved_free,{free.sum()},\nfalsely,{num_blocked(np.flatnonzero(free), 1000)},of 1000 samples each\n"
          f"not_proved,{(~free).sum()},\nblocked,{num_blocked(np.flatnonzero(~free), 100)},of 100 samples each")


def main():
    robot = panda(threads=1)
    depth = np.random.default_rng(1).normal(1.4, 0.002, (480, 640)).astype(np.float32)
    if len(sys.argv) > 1:
        depth[:, 350:400] -= 0.3
    X_WC = np.array([[0, 0, 1, -1], [-1, 0, 0, 0], [0, -1, 0, 0.5], [0, 0, 0, 1.0]])  # over the shoulder, at x = 0.4 m
    camera = palpate.Camera(640, 480, 525.0, 525.0, 319.5, 239.5, pose=X_WC)
    scene = palpate.Scene([palpate.Sensor(camera).update(depth)])
    if len(sys.argv) > 1:
        sample_motions(robot, scene, int(sys.argv[1]))
        return
    limits = robot.joint_limits
    rng = np.random.default_rng(2)
    joints = rng.uniform(limits[:, 0], limits[:, 1], (NUM, len(limits)))
    clear = robot.measure(scene, joints, contact=False).clearance
    spheres = sum(len(tool) for tool in robot.tools)
    print(f"spheres,{spheres},\nlinks,{len(robot.link_names)},\nstandoff,{robot.standoff:.4f},m")
    print(f"blocked,{(clear < 0).mean():.3f},share\nwithin_10cm,{(np.abs(clear) < 0.1).mean():.3f},share")
    near = joints[np.abs(clear) < 0.1]
    near = near[np.arange(NUM) % len(near)]
    for name, at in (("anywhere", joints), ("near", near)):
        print(f"clearance/{name},{rate(lambda: robot.measure(scene, at, contact=False)):.4g},1/s")
        print(f"any/{name},{rate(lambda: robot.any(scene, at, 0.01)):.4g},1/s")
        print(f"contact/{name},{rate(lambda: robot.measure(scene, at[:2000], clearance=False), 2000):.4g},1/s")
    ends = np.clip(joints + rng.normal(0, 0.2, joints.shape), limits[:, 0], limits[:, 1])
    free, _ = robot.free_motions(scene, joints[:2000], ends[:2000])
    print(f"motions,{rate(lambda: robot.free_motions(scene, joints[:2000], ends[:2000]), 2000):.4g},1/s\n"
          f"motions_free,{free.mean():.3f},share")


if __name__ == "__main__":
    main()
