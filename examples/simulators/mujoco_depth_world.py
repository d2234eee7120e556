"""A peg and an arm of MuJoCo in the room of a depth frame.

    pip install palpate-*.whl -r requirements.txt
    python3 mujoco_depth_world.py [--frame depth.png --intrinsics fx,fy,cx,cy | --camera URI] [--seconds 3]

With --camera (palpate cameras lists them) the room is what a camera that stands still sees now. MuJoCo keeps its own
contacts; to them, `feel` adds those with what the camera sees, as xfrc_applied. The step is semi-implicit: A is
J M^-1 J^T of each body, so that an arm opposes its joints' inertia to the wrench.
"""

import argparse
import sys
import time

import numpy as np
from room import GRAVITY, HALF_SIDES, MASS, STEP, Room, box, on_its_table, peg, table, watch

import palpate

HAND = np.array([0.015, 0.015, 0.03])  # m, half sides
WORLD = f"""<mujoco>
  <option timestep="{STEP}" gravity="0 0 -{GRAVITY}"/>
  <worldbody>
    <body name="peg" pos="0 0 {HALF_SIDES[2] + 0.002}">
      <freejoint/>
      <geom type="box" size="{' '.join(map(str, HALF_SIDES))}" mass="{MASS}"/>
    </body>
    <body pos="-0.3 0 0.3">
      <joint name="shoulder" axis="0 1 0" damping="2"/>
      <geom type="capsule" size="0.015" fromto="0 0 0 0.2 0 0" mass="1"/>
      <body pos="0.2 0 0">
        <joint name="elbow" axis="0 1 0" damping="2"/>
        <geom type="capsule" size="0.015" fromto="0 0 0 0 0 -0.22" mass="0.5"/>
        <body name="hand" pos="0 0 -0.24">
          <joint name="wrist" axis="0 1 0" damping="0.5"/>
          <geom type="box" size="{' '.join(map(str, HAND))}" mass="0.2"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="shoulder" kp="200"/> <position joint="elbow" kp="200"/> <position joint="wrist" kp="20"/>
  </actuator>
</mujoco>"""


def pose_of(data, body):
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = data.ximat[body].reshape(3, 3), data.xipos[body]
    return X


def feel(mujoco, model, data, rooms):
    """Sets xfrc_applied of the bodies in `rooms` (Room by body) for the next mj_step, whose integrator is Euler's."""
    data.xfrc_applied[:] = 0
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    M += STEP * np.diag(model.dof_damping)  # as the integrator does
    free = data.qvel + STEP * np.linalg.solve(M, data.qfrc_smooth + data.qfrc_constraint)
    for body, room in rooms.items():
        J = np.zeros((6, model.nv))
        mujoco.mj_jacBodyCom(model, data, J[:3], J[3:], body)
        data.xfrc_applied[body] = room.wrench(pose_of(data, body), J @ free, J @ np.linalg.solve(M, J.T), STEP, data.time)


def run(depth, camera, seconds, on_step=None, frames=()):
    """Times, heights of the peg and wrenches on peg and hand: (N,), (N, 3), (N, 6) each. frames: those after the first."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(WORLD)
    data = mujoco.MjData(model)
    sensor = palpate.Sensor(camera)
    surface = sensor.update(depth)
    peg_id, hand_id = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in ("peg", "hand"))
    rooms = {peg_id: Room(peg(), surface), hand_id: Room(palpate.pack(*box(HAND), 300), surface)}
    watch(frames, sensor, rooms.values(), lambda: data.time)
    times, path, wrenches, start = [], [], [], time.monotonic()
    for k in range(round(seconds / STEP)):
        # The hand goes down until it presses, then draws towards the peg and back.
        down, swing = min(1.0, k * STEP), 0.15 * np.sin(2 * max(0.0, k * STEP - 1))
        data.ctrl[:] = 0.2 * down, swing, -0.2 * down - swing
        feel(mujoco, model, data, rooms)
        mujoco.mj_step(model, data)
        if frames:  # a camera's time is that of the clock
            time.sleep(max(0.0, start + data.time - time.monotonic()))
        times.append(data.time)
        path.append(data.xipos[[peg_id, hand_id]].copy())
        wrenches.append(data.xfrc_applied[[peg_id, hand_id]].copy())
        if on_step is not None:
            on_step(data)
    return np.array(times), np.array(path), np.array(wrenches)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--frame")
    source.add_argument("--camera")
    parser.add_argument("--intrinsics", default="525,525,319.5,239.5")
    parser.add_argument("--seconds", type=float, default=3)
    given = parser.parse_args()
    frames = palpate.CameraFrames(given.camera) if given.camera else ()
    if frames:
        seen, depth = frames.camera, next(frames)[1]
        camera = on_its_table(depth, *depth.shape[::-1], seen.fx, seen.fy, seen.cx, seen.cy, seen.unit)
    elif given.frame:
        depth = palpate.load_depth_png(given.frame)
        camera = on_its_table(depth, *depth.shape[::-1], *map(float, given.intrinsics.split(",")))
    else:
        depth, camera = table()
    try:
        times, path, wrenches = run(depth, camera, given.seconds, frames=frames)
    except ImportError:
        print("SKIPPED mujoco_depth_world: no MuJoCo; pip install -r requirements.txt")
        return 0
    late = times > times[-1] - 0.2
    carried = wrenches[late, 0, 2].mean()
    print(f"the table carries {carried:.4f} N of the {MASS * GRAVITY:.4f} N of the peg, which moved by "
          f"{1e6 * np.ptp(path[late, 0], axis=0).max():.2f} um in the last 0.2 s; the hand presses with "
          f"{wrenches[late, 1, 2].mean():.1f} N")
    return 0 if given.camera or abs(carried / MASS / GRAVITY - 1) < 0.001 else 1


if __name__ == "__main__":
    sys.exit(main())
