"""Draws what the examples of this folder do, into docs/pictures/simulators.png: those whose simulator is installed.

usage: pictures.py FILE.png
"""

import sys

import matplotlib
import numpy as np

matplotlib.use("Agg")
import drake_depth_world  # noqa: E402
import isaac_teleop_device  # noqa: E402
import mujoco_depth_world  # noqa: E402
import newton_depth_world  # noqa: E402
from matplotlib import pyplot  # noqa: E402
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # noqa: E402
from room import HALF_SIDES, MASS, box, table  # noqa: E402

import palpate  # noqa: E402

LENS = table()


def scene(figure, place, title, limit=0.2):
    """An axis with the points that the camera sees."""
    axis = figure.add_subplot(2, 2, place, projection="3d", computed_zorder=False)
    points = palpate.Sensor(LENS[1]).update(LENS[0]).points[::3, ::3].reshape(-1, 3)
    points = points[(abs(points[:, :2]) < limit + 0.05).all(axis=1)]
    axis.scatter(*points.T, s=0.4, c=points[:, 2], cmap="viridis", vmin=-0.02, vmax=0.08, zorder=0)
    axis.set(title=title, xlim=(-limit, limit), ylim=(-limit, limit), zlim=(0, 1.2 * limit), xlabel="x, m", ylabel="y, m")
    axis.set_box_aspect((2, 2, 1.2))
    axis.view_init(28, -70)
    return axis


def solid(axis, X, half, color):
    corners, triangles = box(half)
    faces = (corners @ X[:3, :3].T + X[:3, 3])[triangles]
    axis.add_collection3d(Poly3DCollection(faces, facecolors=color, edgecolors="0.3", linewidths=0.3, shade=True, zorder=5))


def of_mujoco(figure):
    shown = {}

    def keep(data):
        shown["bodies"] = [(mujoco_depth_world.pose_of(data, body), half) for body, half in ((1, HALF_SIDES), (4, mujoco_depth_world.HAND))]
        shown["links"] = np.array([*data.xanchor[1:], data.xipos[4]])

    times, path, wrenches = mujoco_depth_world.run(*LENS, 2.5, keep)
    axis = scene(figure, 1, f"MuJoCo: the arm presses with {wrenches[-1, 1, 2]:.1f} N,\nthe table carries {wrenches[-1, 0, 2]:.2f} N of the peg", 0.3)
    for (X, half), color in zip(shown["bodies"], ("tab:orange", "tab:red")):
        solid(axis, X, half, color)
    axis.plot(*shown["links"].T, "-o", color="0.2", lw=3, zorder=4)


def of_newton(figure):
    poses, wrenches = newton_depth_world.run(*LENS, 1.0, 64)
    axis = scene(figure, 2, f"Newton: 64 worlds in one batch,\neach carries {wrenches[:, 2].min():.3f} to {wrenches[:, 2].max():.3f} N", 0.15)
    for pose in poses[::8]:
        X = np.eye(4)
        X[:3, 3] = pose[:3]
        solid(axis, X, HALF_SIDES, "tab:orange")


def of_drake(figure):
    times, path, wrenches = drake_depth_world.run(*LENS, 0.6, (0, 0, HALF_SIDES[2] + 0.01))
    axis = figure.add_subplot(2, 2, 3)
    axis.plot(times, wrenches[:, 2])
    axis.axhline(MASS * 9.81, color="0.6", lw=1)
    axis.set(title="Drake: a peg falls 10 mm onto the table", xlabel="time, s", ylabel="force of the table, N")


def of_isaac(figure):
    times, asked, got = isaac_teleop_device.run("sim", 4.0)
    axis = figure.add_subplot(2, 2, 4)
    axis.step(times, asked, where="post", label="from the robot's loop, 60 Hz")
    axis.plot(times, got, label="on the hand, after the safety filter")
    axis.legend()
    axis.set(title="Isaac Teleop: EndEffectorForce", xlabel="time, s", ylabel="force, N")


def main():
    figure = pyplot.figure(figsize=(10, 9), layout="constrained")
    for draw in (of_mujoco, of_newton, of_drake, of_isaac):
        try:
            draw(figure)
        except (ImportError, AttributeError, NameError) as error:
            print(f"SKIPPED {draw.__name__}: {error}")
    figure.savefig(sys.argv[1], dpi=80)


if __name__ == "__main__":
    main()
