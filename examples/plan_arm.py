"""Plans a motion of a Panda arm past what one depth frame shows, with OMPL's RRT-Connect.

    pip install palpate-*.whl ompl example-robot-data matplotlib
    python3 examples/plan_arm.py [PICTURE.png]

A camera above looks down on the arm and a post. The arm is taken out of the image; every motion of the
planner is proved free, not sampled. Without the post the plan is another one. Exits with 1 if there is
no plan, or if a sample of it is blocked.
"""

import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import palpate

HEIGHT = 1.9  # m, of the camera above the floor
X_WC = np.array([[0, -1, 0, 0.45], [-1, 0, 0, 0], [0, 0, -1, HEIGHT], [0, 0, 0, 1.0]])
POST = np.array([[0.55, 0, z, 0.05] for z in np.linspace(0.05, 0.6, 12)])
START = np.array([-0.9, 0.2, 0, -1.9, 0, 2.1, 0.8])
GOAL = START * [-1, 1, 1, 1, 1, 1, 1]


def panda(standoff=0.02, threads=0):
    """The arm with 7 joints; its fingers are shut. Its base stands on the floor, which it may touch."""
    share = Path(find_spec("pinocchio").origin).parents[4] / "share"  # where example-robot-data is, too
    urdf = share / "example-robot-data/robots/panda_description/urdf/panda.urdf"
    text = urdf.read_text().replace('type="prismatic"', 'type="fixed"')
    with tempfile.TemporaryDirectory() as made:
        path = Path(made) / "panda.urdf"
        path.write_text(text)
        return palpate.Robot(path, standoff=standoff, skip=["panda_link0"], packages=str(share), threads=threads)


def spheres_in_world(robot, joints):
    """(N, 4) centers in W and radii."""
    found = []
    for pose, tool in zip(robot.place(joints)[0], robot.tools):
        x, y, z, w = pose[3:]
        v = np.array([x, y, z])
        c = tool.spheres[:, :3].astype(float)
        turned = c + 2 * np.cross(v, np.cross(v, c) + w * c)
        found.append(np.column_stack([turned + pose[:3], tool.spheres[:, 3]]))
    return np.vstack(found)


def image_of(camera, spheres):
    """Depth of the floor and of spheres in W, by exact rays."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1)
    depth = np.full(u.shape, HEIGHT)
    for x, y, z, r in spheres:
        c = (np.array([x, y, z]) - X_WC[:3, 3]) @ X_WC[:3, :3]
        a, b = (rays * rays).sum(-1), rays @ c
        root = b * b - a * (c @ c - r * r)
        depth = np.where(root > 0, np.minimum(depth, (b - np.sqrt(np.maximum(root, 0))) / a), depth)
    return depth.astype(np.float32)


def plan(robot, scene, margin):
    from ompl import base, geometric

    space = base.RealVectorStateSpace(7)
    bounds = base.RealVectorBounds(7)
    for i, (low, high) in enumerate(robot.joint_limits):
        bounds.setLow(i, low)
        bounds.setHigh(i, high)
    space.setBounds(bounds)

    def numbers(state):
        return np.array([[state[i] for i in range(7)]])

    class Proved(base.MotionValidator):
        def checkMotion(self, a, b, last=None):
            return bool(robot.free_motions(scene, numbers(a), numbers(b), margin)[0][0])

    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
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
    return np.vstack([numbers(state) for state in setup.getSolutionPath().getStates()])


def draw(robot, paths, picture):
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(10, 5))
    for axis, (path, length), title in zip(axes, paths, ("with a post", "without")):
        for i, joints in enumerate(path[:: max(1, len(path) // 12)]):
            for x, y, _, r in spheres_in_world(robot, joints):
                axis.add_patch(pyplot.Circle((y, x), r, color=pyplot.cm.viridis(i / 13), alpha=0.15, lw=0))
        axis.add_patch(pyplot.Circle((0, POST[0, 0]), POST[0, 3], color="red", fill=title == "with a post"))
        axis.set(xlim=(-1, 1), ylim=(-0.4, 1.1), aspect="equal", xlabel="y, m", ylabel="x, m", title=f"{title}: {length:.2f} rad")
    figure.savefig(picture)


def main():
    if any(find_spec(name) is None for name in ("ompl", "pinocchio")):
        print("SKIPPED plan_arm: pip install ompl pin example-robot-data")
        return 0
    robot = panda()
    camera = palpate.Camera(320, 240, 280.0, 280.0, 159.5, 119.5, pose=X_WC)
    margin = robot.standoff + 0.005
    print(robot, f"standoff {1e3 * robot.standoff:.1f} mm")
    paths = []
    for spheres in (POST, POST[:0]):
        seen = image_of(camera, np.vstack([spheres, spheres_in_world(robot, START)]))
        depth = robot.remove_from(seen, camera, START)
        scene = palpate.Scene([palpate.Sensor(camera).update(depth)])
        path = plan(robot, scene, margin)
        parts = [np.linspace(a, b, 200) for a, b in zip(path[:-1], path[1:])]
        blocked = robot.any(scene, np.vstack(parts), margin).sum()
        length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        print(f"{len(spheres)} spheres of a post: {len(path)} configurations, {length:.2f} rad, {blocked} samples blocked")
        if blocked:
            return 1
        paths.append((np.vstack(parts), length))
    if len(sys.argv) > 1:
        draw(robot, paths, sys.argv[1])
    return 0 if paths[0][1] > 1.01 * paths[1][1] else 1


if __name__ == "__main__":
    sys.exit(main())
