"""A guard for a robot: an arm of seven joints that keeps away from, or keeps to, what a depth camera sees.

    pip install palpate-*.whl pin quadprog
    python guard_arm.py                # prints what came out, leaves the recording guard/ for palpate view

The arm wants to go straight through a block on a table. What it may do is a row of its quadratic program,

    minimize |J qdot - V|^2 + eps |qdot|^2   so that   A qdot <= b  and  |qdot| <= its limits,

and the rows are made of one measurement of a guard body around the gripper: its potential U (m4, how much of it is inside
and how deep) and the gradient of that, minus force and torque. U must not rise above a limit, and rises the more slowly
the nearer it is (a control barrier function): dU/dt = -(f, t) V <= rate (U_max - U). To keep to a surface, U must not fall
below one, either. The stiffness is the second derivative: it bounds what the row leaves out within a step.

Where nothing was measured, U is zero and its row allows everything. Unobserved space is a row of its own: the same
measurement against all that was not seen to be free (the setting unknown = "blocked", holes not closed). Deep inside that has no
gradient; no motion obeys the row then, and the arm stops.
"""

import argparse
from pathlib import Path

import numpy as np
import palpate
import pinocchio
import quadprog

STEP, RATE, FASTEST = 0.01, 20.0, 2.0  # s, 1/s, rad/s
START = np.array([0.45, 0, 0.2])      # m, in the world W, which is the arm's base
EYE = [0.6, 0, 1, 1, 0, 0, 0]         # X_WC: above the middle of the block, looking down
LINKS = [0.36, 0.0, 0.42, 0.0, 0.40, 0.0, 0.13]  # m, of an arm with a shoulder, an elbow and a wrist


def arm():
    """Seven joints that turn about z and y in turn."""
    model, parent = pinocchio.Model(), 0
    for number, length in enumerate(LINKS):
        place = pinocchio.SE3(np.eye(3), np.array([0, 0, length]))
        joint = pinocchio.JointModelRZ() if number % 2 == 0 else pinocchio.JointModelRY()
        parent = model.addJoint(parent, joint, place, f"joint{number + 1}")
    tip = pinocchio.SE3(np.eye(3), np.array([0, 0, 0.1]))
    model.addFrame(pinocchio.Frame("guard", parent, tip, pinocchio.FrameType.OP_FRAME))
    return model


def guard_body():
    """A box of 6 cm around the tip: the gripper, and room to stop in."""
    h = 0.03
    corners = np.array([[x, y, z] for x in (-h, h) for y in (-h, h) for z in (-h, h)])
    triangles = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                 [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return palpate.pack(corners, triangles, 300)


def seen():
    """A camera that looks down on a table with a block on it, 20 cm long and 10 cm high."""
    v, u = np.mgrid[:240, :320]
    x, y = (u - 159.5) / 280 * 0.9, (v - 119.5) / 280 * 0.9
    depth = np.where((abs(x) < 0.1) & (abs(y) < 0.1), 900, 1000).astype(np.uint16)
    return depth, palpate.Camera(320, 240, 280.0, 280.0, 159.5, 119.5, pose=EYE)


def dark_strip(depth):
    """The same image of a camera that measures nothing on the block and beside it, because it is black."""
    u = np.arange(depth.shape[1])
    return np.where(abs(u - 159.5) < 31, 0, depth).astype(np.uint16)


def not_seen_free(depth, camera):
    """A surface around all that this image does not show to be free."""
    return palpate.Sensor(camera, unknown="blocked", fill_levels=0).update(depth)


def guard_rows(result, least, most):
    """A and b for the twist of the guard's center of mass in W: A V <= b. `least`: None, or m4 that U is kept above."""
    gradient = -np.concatenate([result.force, result.torque])
    rows, bounds = [gradient], [RATE * (most - result.potential)]
    if least is not None and result.potential > least / 2:  # until it has come there, nothing keeps it
        rows.append(-gradient)
        bounds.append(RATE * (result.potential - least))
    # In units in which numbers are neither tiny nor huge.
    return np.array(rows) / most, np.array(bounds) / most


def solve(jacobian, desired, rows, bounds):
    """The joint velocities that come nearest to a twist."""
    n = jacobian.shape[1]
    weights = np.diag([1, 1, 1, 0.05, 0.05, 0.05])  # meters count more than radians
    hessian = jacobian.T @ weights @ jacobian + 1e-4 * np.eye(n)
    a = np.vstack([rows @ jacobian, np.eye(n), -np.eye(n)])
    b = np.concatenate([bounds, np.full(2 * n, FASTEST)])
    try:
        return quadprog.solve_qp(hessian, jacobian.T @ weights @ desired, -a.T, -b)[0]
    except ValueError:  # no motion that is slow enough obeys them all: it stops
        return np.zeros(n)


class Arm:
    def __init__(self):
        self.model = arm()
        self.data = self.model.createData()
        self.frame = self.model.getFrameId("guard")
        self.q = np.array([0.0, 0.5, 0, 1.6, 0, 1.04, 0])
        for _ in range(500):  # to where the ways begin
            self.move(START, [], [])

    def pose(self):
        """X_WT: tx ty tz qx qy qz qw."""
        at = self.data.oMf[self.frame]
        return np.concatenate([at.translation, pinocchio.Quaternion(at.rotation).coeffs()])

    def move(self, aim, rows, bounds):
        """Towards a point, with the hand level, for a step."""
        at = self.data.oMf[self.frame]
        level = pinocchio.log3(at.rotation.T @ pinocchio.rpy.rpyToMatrix(0, np.pi, 0))
        desired = np.concatenate([4 * (aim - at.translation), 4 * at.rotation @ level])
        pinocchio.computeJointJacobians(self.model, self.data, self.q)
        jacobian = pinocchio.getFrameJacobian(self.model, self.data, self.frame, pinocchio.LOCAL_WORLD_ALIGNED)
        speeds = solve(jacobian, desired, np.reshape(rows, (-1, 6)), bounds)
        self.q = pinocchio.integrate(self.model, self.q, STEP * speeds)
        pinocchio.framesForwardKinematics(self.model, self.data, self.q)


def go(tool, surface, way, least=None, most=None, unseen=None):
    """Along a way of (time, point), as far as the guard lets it: times and poses of the guard, and what it met there: U,
    the share inside, the share that is unseen. `unseen`: a surface that it is kept away from, too."""
    robot, contact = Arm(), palpate.Contact(tool)
    times, points = np.array([t for t, _ in way]), np.array([p for _, p in way])
    path, met = [], []
    for k in range(int(times[-1] / STEP)):
        result = contact.measure(surface, robot.pose())
        path.append([k * STEP, *robot.pose()])
        met.append([result.potential, result.fraction, result.unseen])
        aim = np.array([np.interp(k * STEP, times, column) for column in points.T])
        rows, bounds = (np.zeros((0, 6)), np.zeros(0)) if most is None else guard_rows(result, least, most)
        if unseen is not None:
            more, further = guard_rows(contact.measure(unseen, robot.pose()), None, most)
            rows, bounds = np.vstack([rows, more]), np.concatenate([bounds, further])
        robot.move(aim, rows, bounds)
    return np.array(path), np.array(met)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("-o", "--output", default="guard", help="folder of the recording")
    output = Path(parser.parse_args().output)
    tool = guard_body()
    depth, camera = seen()
    surface = palpate.Sensor(camera).update(depth)
    goal, most = np.array([0.76, 0, 0.06]), 2e-8  # m4: the whole bottom, 3.3 mm deep
    through = [(0, START), (4, goal), (6, goal)]
    down_and_up = [(0, START), (2, [0.58, 0, 0.12]), (6, [0.65, 0.05, 0.2])]

    _, met = go(tool, surface, through)
    print(f"unguarded: U up to {met[:, 0].max():.1e} m4, {100 * met[:, 1].max():.1f} % of the guard inside")
    path, met = go(tool, surface, through, most=most)
    print(f"keeps away: U up to {met[:, 0].max():.1e} of {most:.0e} m4, {100 * met[:, 1].max():.1f} % inside, "
          f"ends {1000 * np.linalg.norm(path[-1, 1:4] - goal):.0f} mm from its goal")
    _, met = go(tool, surface, down_and_up, most / 4, most)
    there = np.argmax(met[:, 0] > most / 4)
    print(f"keeps to: U from {met[there:, 0].min():.1e} to {met[there:, 0].max():.1e} m4 while it is pulled up")

    dark = dark_strip(depth)
    surface = palpate.Sensor(camera).update(dark)
    for words, unseen in (("unseen space allowed", None), ("unseen space guarded", not_seen_free(dark, camera))):
        _, met = go(tool, surface, [(0, START), (4, START + [0.3, 0, 0])], most=most, unseen=unseen)
        print(f"{words}: up to {100 * met[:, 2].max():.0f} % of the guard where nothing was measured")

    output.mkdir(exist_ok=True)
    np.savetxt(output / "path.txt", path, fmt="%.9g")
    (output / "depth.raw").write_bytes(depth.tobytes() * 7)
    eye = ",".join(map(str, EYE))
    palpate.touch(tool, f"pipe:{output}/depth.raw?size=320x240&unit=0.001&rate=1&intrinsics=280,280,159.5,119.5&pose={eye}",
                  path, output=str(output / "run")).wait()
    print(f"palpate view {output}/run shows how it kept away")


if __name__ == "__main__":
    main()
