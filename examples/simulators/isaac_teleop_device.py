"""A grounded force device behind NVIDIA Isaac Teleop's EndEffectorForce: Palpate's devices, safety filter and contact.

    pip install palpate-*.whl -r requirements.txt
    python3 isaac_teleop_device.py [--device sim] [--seconds 4]

The robot's loop knows the force 60 times a second, the hand needs it 1000 times. So a force is not sent to the motors as
it is: it becomes a wall beside the tool, at right angles to the force and just as deep in the tool as the force is large.
The wall is a depth image; `palpate.touch` renders its contact at 1 kHz, and what reaches the device has passed the safety
filter. Here the robot is a soft block in the way of a simulated hand.
"""

import argparse
import sys
import time

import numpy as np

import palpate

try:
    from isaacteleop.haptic_devices import IHapticDevice
    from isaacteleop.retargeting_engine.deviceio_source_nodes.haptic_sink import HapticSink
    from isaacteleop.retargeting_engine.interface import TensorGroup
    from isaacteleop.retargeting_engine.interface.value_input import ValueInput
    from isaacteleop.retargeting_engine.tensor_types import EndEffectorForce
except ImportError:
    IHapticDevice = object

RADIUS, AWAY, FULL = 0.03, 0.3, 8.0  # m, of the ball that is the tool; m, camera before the wall; N at an eighth of the ball
BLOCK, SOFT = 0.01, 150.0            # m that the hand goes along -z before it meets the robot's block, and N/m
TO_SCENE = np.array([1.0, -1, -1])    # from the device's base (x right, y up, z to the hand) to a camera's axes


def ball(rings=16):
    """Vertices and triangles of a sphere."""
    a, b = np.linspace(0, np.pi, rings + 1)[1:-1], np.arange(2 * rings) * np.pi / rings
    sides = np.stack([np.outer(np.sin(a), np.cos(b)), np.outer(np.sin(a), np.sin(b)),
                      np.outer(np.cos(a), np.ones(2 * rings))], axis=-1).reshape(-1, 3)
    n, k = 2 * rings, np.arange(2 * rings)
    faces = [np.stack([np.full(n, (rings - 1) * n), k, (k + 1) % n], axis=1)]
    for i in range(rings - 2):
        p, q, r, s = i * n + k, i * n + (k + 1) % n, (i + 1) * n + k, (i + 1) * n + (k + 1) % n
        faces += [np.stack([p, r, s], axis=1), np.stack([p, s, q], axis=1)]
    last = (rings - 2) * n
    faces.append(np.stack([np.full(n, (rings - 1) * n + 1), last + (k + 1) % n, last + k], axis=1))
    return np.concatenate([sides, [[0, 0, 1], [0, 0, -1]]]) * RADIUS, np.concatenate(faces)


def depth_of(force):
    """Depth (m) of a wall in the ball, so that it pushes with this force (N)."""
    share = min(force / (8 * FULL), 0.4)  # of the volume
    d = 0.0
    for _ in range(60):  # share = d^2 (3 r - d) / (4 r^3)
        d = np.sqrt(share * 4 * RADIUS**3 / (3 * RADIUS - d))
    return d


def wall(center, force):
    """X_WC of a camera that sees nothing but the wall."""
    size = np.linalg.norm(force)
    n = force / size if size > 1e-3 else np.array([0.0, 0, 1])
    x = np.cross([0.0, 1, 0] if abs(n[1]) < 0.9 else [1.0, 0, 0], n)
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.stack([x, np.cross(-n, x), -n], axis=1)
    X[:3, 3] = center + n * (AWAY - (RADIUS - depth_of(size) if size > 1e-3 else 2 * RADIUS))
    return X


class GroundedDevice(IHapticDevice):
    """Any device of Palpate ("sim", "haply", ...) as the endpoint "device"; forces are in the device's base frame."""

    def __init__(self, device, path, seconds):
        self.lens = palpate.Camera(64, 48, 40.0, 40.0, 31.5, 23.5)
        self.camera = palpate.PushedCamera(self.lens, rate=60, moving=True)
        self.force, self.image = np.zeros(3), np.full((48, 64), AWAY, np.float32)
        self.run = palpate.touch(palpate.pack(*ball(), 300), self.camera, path, device=device, duration=seconds,
                                 force_at_eighth=FULL)

    def accepted_type(self):
        return EndEffectorForce()

    def endpoints(self):
        return ("device",)

    def get_tracker(self):
        return None

    def apply(self, endpoint, values):
        self.force = np.asarray(values, float)

    def position(self):
        tick = self.run.latest
        return np.zeros(3) if tick is None else TO_SCENE * np.asarray(tick.pose, float)[:3]

    def flush(self, session):
        """Shows the wall of the newest force. Never throws: a run that has ended takes no images."""
        self.camera.push(self.image, pose=wall(TO_SCENE * self.position(), TO_SCENE * self.force))


def run(name, seconds):
    """Times (s), the robot's forces and those on the hand along z (N), 60 times a second."""
    t = np.arange(0, seconds, 0.01)
    path = np.column_stack([t, 0 * t, 0 * t, 0.03 * np.clip(t - 1, 0, 2) / 2, 0 * t, 0 * t, 0 * t, 0 * t + 1])
    device = GroundedDevice(name, path, seconds)
    # The graph of a teleoperation, without its session: the robot's force -> the device.
    force = ValueInput("force", EndEffectorForce())
    graph = HapticSink("grounded", device).connect({"device": force.output("value")})
    rows = []
    while device.run.is_running:
        value = TensorGroup(EndEffectorForce())
        value[0] = np.array([0, 0, SOFT * max(0.0, -BLOCK - device.position()[2])], np.float32)
        graph({"force": {"value": value}})
        device.flush(None)
        tick = device.run.latest
        if tick is not None and tick.time < seconds - 0.2:  # at its end, a run fades out
            rows.append([tick.time, value[0][2], tick.hand_wrench[2]])
        time.sleep(1 / 60)
    return np.array(rows).T


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="sim")
    parser.add_argument("--seconds", type=float, default=4)
    given = parser.parse_args()
    if IHapticDevice is object:
        print("SKIPPED isaac_teleop_device: no Isaac Teleop; pip install -r requirements.txt")
        return 0
    _, asked, got = run(given.device, given.seconds)
    asked, got = np.median(asked[-30:]), np.median(got[-30:])
    print(f"the robot's force is {asked:.2f} N, the hand feels {got:.2f} N at 1 kHz")
    return 0 if asked > 0.5 and 0.5 < got / asked < 1.5 else 1


if __name__ == "__main__":
    sys.exit(main())
