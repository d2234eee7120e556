"""Bodies of examples/simulators in the room of a depth frame, against closed forms; each example where its simulator is."""

import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

import palpate

EXAMPLES = Path(__file__).resolve().parents[3] / "examples/simulators"
if not EXAMPLES.is_dir():
    pytest.skip("the tests run without the project's folder", allow_module_level=True)
sys.path.insert(0, str(EXAMPLES))
import room as rooms  # noqa: E402
from room import GRAVITY, HALF_SIDES, MASS, STEP, Room  # noqa: E402

WEIGHT = MASS * GRAVITY


@pytest.fixture(scope="module")
def tool():
    return rooms.peg(200)


def room_of(tool, tilt=0.0, **law):
    """The table of the examples, tilted about the y axis."""
    depth, camera = rooms.table(tilt, 160, 120)
    return Room(tool, palpate.Sensor(camera).update(depth), **law)


def placed(tilt=0.0, above=0.0):
    """The peg flat on the tilted table, its center so far above where it just touches."""
    X = np.eye(4)
    X[:3, :3] = rooms.turn(np.array([0, tilt, 0]))
    X[:3, 3] = X[:3, 2] * (HALF_SIDES[2] + above)
    return X


def go(room, X, v, seconds, each=lambda k, X, v, w: None):
    """A free body by semi-implicit Euler steps, the simplest of simulators."""
    for k in range(round(seconds / STEP)):
        free = v.copy()
        free[2] -= STEP * GRAVITY
        A = rooms.free_body(X[:3, :3], rooms.peg_inertia())
        w = room.wrench(X, free, A, STEP, k * STEP)
        v = free + STEP * A @ w
        X = rooms.moved(X, STEP * v)
        each(k, X, v, w)
    return X, v


def test_the_table_carries_the_weight_and_makes_no_energy(tool):
    room, X, energies, carried = room_of(tool), placed(above=0.003), [], []

    def each(k, X, v, w):
        turning = X[:3, :3].T @ v[3:]
        energies.append(MASS * v[:3] @ v[:3] / 2 + (rooms.peg_inertia() * turning) @ turning / 2 +
                        WEIGHT * (X[2, 3] - HALF_SIDES[2] - 0.003) + room.felt(X)[2])
        carried.append(w[2])

    X, v = go(room, X, np.zeros(6), 0.8, each)
    assert abs(np.mean(carried[-50:]) / WEIGHT - 1) < 1e-3
    assert max(energies) < 1e-5
    assert min(energies) < -0.01  # it fell, and settled
    rest = X[:3, 3].copy()
    X, v = go(room, X, v, 0.3)
    assert np.linalg.norm(X[:3, 3] - rest) < 1e-6


@pytest.mark.parametrize("mu, tilt, slides", [(0.5, 0.35, False), (0.5, 0.55, True), (0.25, 0.35, True)])
def test_on_a_slope_friction_holds_up_to_its_angle(tool, mu, tilt, slides):
    """A block on a slope: at rest while tan(tilt) <= mu, else with g (sin - mu cos)."""
    room = room_of(tool, tilt, friction=mu)
    X, v = go(room, placed(tilt, -0.0008), np.zeros(6), 0.3)
    downhill = np.array([np.cos(tilt), 0, -np.sin(tilt)])
    speed = []
    go(room, X, v, 0.05, lambda k, X, v, w: speed.append(v[:3] @ downhill))
    gained = (speed[-1] - speed[0]) / (STEP * (len(speed) - 1))
    expected = GRAVITY * (np.sin(tilt) - mu * np.cos(tilt)) if slides else 0.0
    assert abs(gained - expected) < 0.03 * GRAVITY
    assert (speed[-1] > 0.05) == slides


def test_sliding_it_stops_after_the_way_of_coulomb(tool):
    room = room_of(tool)
    X, _ = go(room, placed(above=-0.0008), np.zeros(6), 0.3)
    begin = X[:3, 3].copy()
    X, v = go(room, X, np.array([-0.5, 0, 0, 0, 0, 0]), 0.9)
    assert abs(begin[0] - X[0, 3] - 0.5**2 / (2 * 0.5 * GRAVITY)) < 0.05 * 0.0255
    assert np.linalg.norm(v) < 1e-4


def test_a_new_frame_blends_in(tool):
    room, X = room_of(tool), placed(above=-0.001)
    before = room.felt(X)[0]
    depth, camera = rooms.table(0.0, 160, 120)
    other = palpate.Sensor(camera).update((depth - 0.0005).astype(np.float32))
    room.show(other, 1.0)
    after = Room(tool, other).felt(X)[0]
    assert np.linalg.norm(after - before) > 1
    for share in (0, 0.25, 0.5, 1, 3):
        part = min(share, 1)
        assert np.allclose(room.felt(X, 1.0 + share * room.blend)[0], (1 - part) * before + part * after, atol=1e-9)


def test_kernels_of_warp_compute_the_same(tool):
    """They measure in the camera's frame, room.py in W."""
    wp = pytest.importorskip("warp", reason="SKIPPED: no Warp; scripts/setup.sh --simulators fetches it")
    from warp_room import compile_for, mat66, predict, press, vec6

    compile_for("cpu")

    room, random, num = room_of(tool), np.random.default_rng(1), 20
    depth, camera = rooms.table(0.0, 160, 120)
    X_WC = wp.transformd(*camera.pose)
    seen = palpate.Sensor(palpate.Camera(160, 120, camera.fx, camera.fy, camera.cx, camera.cy)).update(depth)
    poses = [rooms.moved(placed(above=-0.001), 0.001 * random.normal(size=6)) for _ in range(num)]
    twists = 0.1 * random.normal(size=(num, 6))
    q = np.array([[*X[:3, 3], *quaternion(X[:3, :3])] for X in poses])
    asked, free = wp.zeros((num, 7), dtype=wp.float64, device="cpu"), wp.zeros(num, dtype=vec6, device="cpu")
    wp.launch(predict, num, [wp.array(q, dtype=wp.transform, device="cpu"),
                             wp.array(twists, dtype=wp.spatial_vector, device="cpu"), wp.vec3d(0, 0, -GRAVITY), X_WC],
              [asked, free], device="cpu")
    batch = room.contact.measure_batch(seen, asked.numpy(), stiffness=True)
    got = wp.zeros(num, dtype=wp.spatial_vector, device="cpu")
    wp.launch(press, num, [asked, free, *(wp.array(values, dtype=kind, device="cpu") for values, kind in (
        (batch.force, wp.vec3d), (batch.torque, wp.vec3d), (batch.stiffness, mat66))), X_WC, wp.vec3d(*rooms.peg_inertia()),
        wp.vec3d(*HALF_SIDES), wp.vec3d(*tool.center_of_mass), wp.vec3d(room.stiffness, room.friction, room.settling)],
        [got], device="cpu")
    for X, v, w in zip(poses, twists, got.numpy()):
        v = v - [0, 0, STEP * GRAVITY, 0, 0, 0]
        expected = room.wrench(X, v, rooms.free_body(rooms.moved(X, STEP * v)[:3, :3], rooms.peg_inertia()))
        assert np.allclose(w, expected, atol=2e-4 * np.linalg.norm(expected) + 1e-4)
    assert (np.linalg.norm(got.numpy(), axis=1) > 0).sum() > num / 2


def quaternion(R):
    """x y z w of a rotation by less than half a turn."""
    w = np.sqrt(1 + np.trace(R)) / 2
    return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 4 * w * w]) / (4 * w)


@pytest.mark.parametrize("name, arguments", [
    ("mujoco_depth_world", ["--seconds", "1.5"]), ("drake_depth_world", ["--seconds", "1.5"]),
    ("newton_depth_world", ["--seconds", "1", "--worlds", "4"]), ("isaac_teleop_device", ["--seconds", "4"])])
def test_example(name, arguments):
    done = subprocess.run([sys.executable, EXAMPLES / f"{name}.py", *arguments], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    if done.stdout.startswith("SKIPPED"):
        pytest.skip(done.stdout.strip())


def test_a_live_camera(tmp_path):
    """MuJoCo's peg rests on what a camera sends: a folder of images of the table, each with new noise."""
    depth, camera = rooms.table(0.0, 160, 120)
    random = np.random.default_rng(2)
    for k in range(20):
        save_png(tmp_path / f"{k:03}.png", np.rint(1000 * (depth + 0.0005 * random.normal(size=depth.shape))))
    uri = f"folder:{tmp_path}?intrinsics={camera.fx},{camera.fy},{camera.cx},{camera.cy}&rate=30&unit=0.001"
    times = [time for time, _, _ in palpate.CameraFrames(uri, in_real_time=False)]
    assert len(times) == 20 and np.allclose(np.diff(times), 1 / 30, atol=1e-6)
    done = subprocess.run([sys.executable, EXAMPLES / "mujoco_depth_world.py", "--camera", uri, "--seconds", "1.5"],
                          capture_output=True, text=True, timeout=600)
    if done.stdout.startswith("SKIPPED"):
        pytest.skip(done.stdout.strip())
    assert "the table carries 9." in done.stdout, done.stdout + done.stderr


def save_png(path, counts):
    """A 16-bit grayscale PNG, by its specification."""
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in counts)

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", counts.shape[1], counts.shape[0], 16, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
