"""Plans a motion of a Panda past what one depth frame shows, with OMPL's RRT-Connect.

    pip install palpate-*.whl ompl pin example-robot-data matplotlib
    python3 examples/plan_arm.py [PICTURE.png]

A camera above looks down on the arm and a post. The arm is taken out of the image, and every motion of
the planner is proved free, not sampled. Another frame, without the post, gives another plan. Exits with
1 if there is no plan, if a sample of it is blocked, or if both frames give the same.
"""

import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import palpate

HEIGHT = 1.9  # m, of the camera above the floor
X_WC = np.array([[0, -1, 0, 0.45], [-1, 0, 0, 0], [0, 0, -1, HEIGHT], [0, 0, 0, 1.0]])
POST = np.array([[0.55, 0, z, 0.05] for z in np.linspace(0.05, 0.6, 12)])  # spheres x y z r in W, m
START = np.array([-0.9, 0.2, 0, -1.9, 0, 2.1, 0.8])
GOAL = START * [-1, 1, 1, 1, 1, 1, 1]
SHARE = Path((find_spec("pinocchio") or find_spec("palpate")).origin).parents[4] / "share"
URDF = SHARE / "example-robot-data/robots/panda_description/urdf/panda.urdf"


def panda(standoff=0.02, threads=0):
    """Seven joints; the fingers are shut. The base is left out: it stands on the floor that is seen."""
    with tempfile.TemporaryDirectory() as made:
        path = Path(made) / "panda.urdf"
        path.write_text(URDF.read_text().replace('type="prismatic"', 'type="fixed"'))
        return palpate.Robot(path, standoff=standoff, skip=["panda_link0"], packages=str(SHARE), threads=threads)


def spheres_in_world(robot, joints):
    """(N, 4) centers in W and radii."""
    found = []
    for (*p, x, y, z, w), tool in zip(robot.place(joints)[0], robot.tools):
        c, v = tool.spheres[:, :3].astype(float), np.array([x, y, z])
        found.append(np.column_stack([p + c + 2 * np.cross(v, np.cross(v, c) + w * c), tool.spheres[:, 3]]))
    return np.vstack(found)


def image_of(camera, spheres):
    """Depth of the floor and of spheres in W, by exact rays."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1)
    depth, a = np.full(u.shape, HEIGHT), (rays * rays).sum(-1)
    for *p, r in spheres:
        c = (p - X_WC[:3, 3]) @ X_WC[:3, :3]
        b = rays @ c
        root = b * b - a * (c @ c - r * r)
        depth = np.where(root > 0, np.minimum(depth, (b - np.sqrt(np.maximum(root, 0))) / a), depth)
    return depth.astype(np.float32)


def plan(robot, scene, margin):
    """(N, 7) configurations between which the motions are straight."""
    from ompl import base, geometric

    def numbers(state):
        return np.array([[state[i] for i in range(7)]])

    class Proved(base.MotionValidator):
        def checkMotion(self, a, b, last=None):
            return bool(robot.free_motions(scene, numbers(a), numbers(b), margin)[0][0])

    space, bounds = base.RealVectorStateSpace(7), base.RealVectorBounds(7)
    for i, (low, high) in enumerate(robot.joint_limits):
        bounds.setLow(i, low)
        bounds.setHigh(i, high)
    space.setBounds(bounds)
    information = (setup := geometric.SimpleSetup(space)).getSpaceInformation()
    setup.setStateValidityChecker(lambda state: not robot.any(scene, numbers(state), margin)[0])
    proved = Proved(information)
    information.setMotionValidator(proved)
    ends = [space.allocState(), space.allocState()]
    for i in range(7):
        ends[0][i], ends[1][i] = START[i], GOAL[i]
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(geometric.RRTConnect(information))
    if not setup.solve(60.0):
        sys.exit("no plan within 60 s")
    setup.simplifySolution(2.0)
    return np.vstack([numbers(state) for state in setup.getSolutionPath().getStates()])


def main():
    if find_spec("ompl") is None or not URDF.is_file():
        print("SKIPPED plan_arm: no OMPL or no Panda; pip install ompl pin example-robot-data")
        return 0
    robot = panda()
    camera = palpate.Camera(320, 240, 280.0, 280.0, 159.5, 119.5, pose=X_WC)
    margin = robot.standoff + 0.005
    lengths, drawn = [], []
    for post in (POST, POST[:0]):
        seen = image_of(camera, np.vstack([post, spheres_in_world(robot, START)]))
        scene = palpate.Scene([palpate.Sensor(camera).update(robot.remove_from(seen, camera, START))])
        path = plan(robot, scene, margin)
        parts = np.vstack([np.linspace(a, b, 200) for a, b in zip(path[:-1], path[1:])])
        lengths.append(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
        print(f"{robot}, post of {len(post)} spheres: {len(path)} configurations, {lengths[-1]:.2f} rad")
        if robot.any(scene, parts, margin).any():
            return 1
        drawn += [(post, parts[:: len(parts) // 15])]
    if len(sys.argv) > 1:
        from matplotlib import pyplot
        for axis, (post, parts) in zip(pyplot.subplots(1, 2, figsize=(10, 5))[1], drawn):
            for x, y, _, r in np.vstack([*(spheres_in_world(robot, joints) for joints in parts), post]):
                axis.add_patch(pyplot.Circle((y, x), r, alpha=0.1))
            axis.set(xlim=(-1, 1), ylim=(-0.5, 1.2), aspect="equal", xlabel="y, m", ylabel="x, m")
        pyplot.savefig(sys.argv[1])
    return 0 if lengths[0] > 1.05 * lengths[1] else 1


if __name__ == "__main__":
    sys.exit(main())
