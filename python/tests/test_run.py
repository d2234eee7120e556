"""palpate.touch and palpate.Run: forces, recordings, interruptions."""

import csv
import gc
import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from conftest import pose_matrix

import palpate

#: Into the wall at 1 m, 10 mm deep, in half a second.
PATH = np.array([[0, 0, 0, 0.95, 0, 0, 0, 1], [0.5, 0, 0, 0.99, 0, 0, 0, 1]])
#: As long and as deep, for real time: it rests there, as the measurement of its end may come late.
RESTING = np.array([[0, 0, 0, 0.97, 0, 0, 0, 1], [0.2, 0, 0, 0.99, 0, 0, 0, 1], [2, 0, 0, 0.99, 0, 0, 0, 1]])


@pytest.fixture(scope="module")
def recorded(cube, tmp_path_factory):
    run = palpate.touch(cube, "scene:wall", PATH, duration=0.5, output=tmp_path_factory.mktemp("run") / "a")
    run.wait()
    return run


def test_several_cameras_of_which_one_moves(cube, recorded, tmp_path):
    """The wall is at the same place from every camera pose."""
    poses = tmp_path / "poses.tum"
    times = np.linspace(0, 2, 41)
    poses.write_text("".join(f"{t} {0.1 * t} 0 {-0.05 * t} 0 0 0 1\n" for t in times))
    cameras = [f"scene:wall?poses={poses}", "scene:wall?pose=-0.2,0,0,0,0.0998334,0,0.9950042"]
    run = palpate.touch(cube, cameras, PATH, duration=0.5, output=tmp_path / "run")
    run.wait()
    deep = recorded.volume > 0.1 * cube.volume
    assert run.volume[deep] == pytest.approx(recorded.volume[deep], rel=0.05)
    moving, still = list(run.frames()), list(run.frames(camera=1))
    assert len(moving) == len(still) == len(list(recorded.frames()))
    rows = run.frame_records["camera"] == 0
    x = run.frame_records["camera_pose.position.x"]
    assert x[rows] == pytest.approx(0.1 * run.frame_records["source_time"][rows], abs=1e-9)
    assert (x[~rows] == -0.2).all()
    assert run.contacts["cameras.1.camera_frame"][-1] == len(still) - 1
    with pytest.raises(ValueError, match="the run has 2"):
        run.frames(camera=2)


def test_pushed_cameras_say_where_they_are(cube):
    camera = palpate.Camera(64, 48, 60, 60, 31.5, 23.5)
    still = palpate.PushedCamera(camera)
    with pytest.raises(ValueError, match="moving=True"):
        still.push(np.ones((48, 64), np.float32), pose=[1, 0, 0, 0, 0, 0, 1])
    moving = palpate.PushedCamera(camera, moving=True)
    with palpate.touch(cube, [moving], np.array([[0, 0.5, 0, 0.99, 0, 0, 0, 1]] * 2) + [[0] * 8, [30] + [0] * 7],
                       safety_max_sensor_age=60, safety_max_contact_age=60) as run:
        k = 0
        # The camera beside the tool, looking along z: 0.4 m from the wall at z = 1 m in the world.
        while run.latest is None or run.latest.volume == 0:
            moving.push(np.full((48, 64), 0.4, np.float32), pose=[0.5, 0, 0.6, 0, 0, 0, 1])
            time.sleep(0.02)
            k += 1
            assert k < 1500
        assert run.latest.volume == pytest.approx(0.01 * 0.04**2, rel=0.15)


def test_a_path_on_a_simulated_clock(cube, recorded):
    assert recorded.times == pytest.approx(np.arange(500) / 1000)
    expected = np.array([np.interp(recorded.times, PATH[:, 0], PATH[:, 3])])
    assert recorded.poses[:, 2] == pytest.approx(expected[0], abs=1e-12)
    assert recorded.poses[:, 3:] == pytest.approx(np.tile([0, 0, 0, 1], (500, 1)))
    # A wall: the part of the cube behind it, and a force back along the camera's axis.
    inside = np.clip(recorded.poses[:, 2] + 0.02 - 1, 0, 0.04) * 0.04**2
    deep = inside > 0.1 * cube.volume
    assert recorded.volume[deep] == pytest.approx(inside[deep], rel=0.1)
    force = -inside[deep] * recorded.summary["newtons_per_m3"]
    assert recorded.wrench[deep, 2] == pytest.approx(force, rel=0.1)
    assert np.abs(recorded.wrench[:, :2]).max() < 0.05 * np.abs(recorded.wrench[:, 2]).max()


def test_the_arrays_are_those_of_the_files(recorded):
    with (recorded.folder / "wrench.csv").open() as file:
        rows = list(csv.DictReader(file))
    for name in rows[0]:
        assert np.array_equal(recorded.table[name], [float(row[name]) for row in rows], equal_nan=True)
    assert recorded.summary == json.loads((recorded.folder / "summary.json").read_text())
    ticks = recorded.ticks
    assert np.array_equal(ticks["number"], np.arange(500))
    assert np.array_equal(ticks["coupling.contact.force.z"], recorded.wrench[:, 2])
    assert np.array_equal(ticks["penetration.volume"], recorded.volume)
    assert recorded.contacts["number"].size == recorded.summary["contacts"]
    assert recorded.frame_records["number"].size == recorded.summary["frames"]


def test_frames_and_tool_come_back(cube, recorded):
    frames = list(recorded.frames())
    assert len(frames) == recorded.summary["frames"]
    times = [at for at, _ in frames]
    assert times == sorted(times)
    assert all(image.dtype == np.uint16 and image.shape == (480, 640) for _, image in frames)
    assert 990 < np.median(frames[0][1]) < 1010
    assert recorded.camera.width == 640 and recorded.camera.fx == pytest.approx(575.8157)
    assert np.array_equal(recorded.tool.spheres, cube.spheres)


def test_the_same_run_by_the_program(cube, recorded, tmp_path):
    """The program and the module give the same bits."""
    program = os.environ.get("PALPATE_PROGRAM")
    if not program:
        pytest.skip("the program: PALPATE_PROGRAM names none")
    cube.save(tmp_path / "cube.palp")
    lines = [" ".join(repr(float(x)) for x in row) for row in PATH]
    (tmp_path / "path.txt").write_text("\n".join(lines) + "\n")
    subprocess.run(
        [program, "touch", tmp_path / "cube.palp", "--camera", "scene:wall", "--path",
         tmp_path / "path.txt", "--duration", "0.5", "-o", tmp_path / "b"], check=True)
    run = palpate.Run.open(tmp_path / "b")
    assert np.array_equal(run.wrench, recorded.wrench, equal_nan=True)
    assert np.array_equal(run.poses, recorded.poses)
    subprocess.run([program, "replay", recorded.folder], check=True)


def test_a_cut_off_recording_is_read(recorded, tmp_path):
    folder = tmp_path / "cut"
    folder.mkdir()
    whole = (recorded.folder / "recording.mcap").read_bytes()
    (folder / "recording.mcap").write_bytes(whole[: len(whole) - 2000])
    run = palpate.Run.open(folder)
    num = run.times.size
    assert 100 < num <= 500
    assert np.array_equal(run.wrench, recorded.wrench[:num])
    assert np.array_equal(run.volume, recorded.volume[:num])
    with pytest.raises(palpate.Error, match="summary.json"):
        run.summary


def test_pandas(recorded):
    pandas = pytest.importorskip("pandas")
    table = recorded.to_dataframe()
    assert isinstance(table, pandas.DataFrame) and len(table) == 500
    assert table["force_z_N"].min() == recorded.wrench[:, 2].min()


def test_plots(recorded):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from palpate import plot

    for draw, num in ((plot.wrench, 3), (plot.torque, 3), (plot.volume, 1), (plot.latency, 2)):
        axes = draw(recorded)
        assert len(axes.lines) == num
        assert axes.lines[0].get_xdata() == pytest.approx(recorded.times)
        assert "time, s" in axes.get_xlabel() and axes.get_ylabel()
    again = plot.volume(recorded, axes=axes)
    assert again is axes


def test_a_live_run_ends_with_its_block(cube):
    start = time.monotonic()
    with palpate.touch(cube, "scene:wall", device="sim", duration=60) as run:
        assert run.is_running
        while run.is_running and run.latest.number < 100:
            time.sleep(0.01)
        assert run.latest.pose.shape == (7,) and run.latest.wrench.shape == (6,)
        run.mark("here")
        folder = run.folder
    assert not run.is_running and time.monotonic() - start < 50
    assert run.times.size > 100 and "here" in " ".join(run.notes)
    assert folder.exists()
    del run
    gc.collect()
    assert not folder.exists()  # a temporary one goes with its run


class Plunger:
    """A device in Python: the handle goes down 30 mm in half a second."""

    rate, max_force = 400, 5.0

    def __init__(self):
        self.told, self.is_felt = [], False

    def read(self):
        return [0, 0, -0.03 * min(1, len(self.told) / 200), 0, 0, 0, 1]

    def write(self, wrench):
        self.told.append(np.array(wrench))


def test_a_device_in_python(cube):
    plunger, heard = Plunger(), []
    start = [[0, 0, 0, 0.97, 0, 0, 0, 1]]

    def hear(tick):
        heard.append((tick.number, tick.hand_wrench))
        # Until it is down and was felt.
        plunger.is_felt = plunger.is_felt or tick.hand_wrench[2] > 0.5
        return len(plunger.told) < 400 or not plunger.is_felt

    run = palpate.touch(cube, "scene:wall", start, device=plunger, duration=60, on_tick=hear, safety_max_tick=60,
                        safety_max_device_silence=60, safety_max_contact_age=60, safety_max_sensor_age=60)
    run.wait()
    told = np.array(plunger.told)
    assert told.shape[1] == 6 and np.array_equal(told[-1], np.zeros(6))  # the motors are off
    # It is pushed out, along z of its base, within its limits.
    assert told[:, 2].max() > 0.5 and np.linalg.norm(told[:, :3], axis=1).max() <= 5.0 * 1.0001
    numbers = [number for number, _ in heard]
    assert numbers == list(range(len(numbers))) and len(numbers) == run.times.size
    assert np.array_equal(np.array([wrench for _, wrench in heard]), run.hand_wrench)
    period = run.summary["microseconds"]["haptic_period"]
    assert period["p50"] >= 2000  # the real one: 400 Hz were requested


def test_a_camera_in_python(cube):
    camera = palpate.Camera(160, 120, 140, 140, 79.5, 59.5)
    pushed = palpate.PushedCamera(camera)
    is_over = threading.Event()

    def push():
        while not is_over.wait(0.02):
            pushed.push(np.full((120, 160), 1000, np.uint16))

    pusher = threading.Thread(target=push)
    pusher.start()
    try:
        run = palpate.touch(cube, pushed, RESTING)
        assert run.wrench[-1, 2] < -1
        assert run.summary["frames"] > 2
    finally:
        is_over.set()
        pusher.join()
    assert np.median(next(iter(run.frames()))[1]) == 1000
    with pytest.raises(ValueError, match="uint16"):
        pushed.push(np.zeros((120, 160), np.int64))


def pushed_in_a_run(cube, camera, *images, **keywords):
    """The first frame of a run whose camera gets these images."""
    is_over = threading.Event()

    def push():
        while not is_over.wait(0.02):
            for image in images:
                camera.push(image, **keywords)

    pusher = threading.Thread(target=push)
    pusher.start()
    try:
        run = palpate.touch(cube, camera, RESTING)
        return next(iter(run.frames()))[1]
    finally:
        is_over.set()
        pusher.join()


def test_pushed_meters_below_zero_are_no_measurement(cube):
    image = np.full((120, 160), 1.0, np.float32)
    image[:, :40], image[:, 40:60], image[:, 60:80], image[:, 80:100] = -1, np.nan, np.inf, -np.inf
    fine = palpate.PushedCamera(palpate.Camera(160, 120, 140, 140, 79.5, 59.5, unit=0.0001))
    frame = pushed_in_a_run(cube, fine, image)
    assert (frame[:, :60] == 0).all() and (frame[:, 80:100] == 0).all() and (frame[:, 100:] == 10000).all()
    assert (frame[:, 60:80] == 65535).all()  # farther than can be counted


def test_bad_pushes(cube):
    camera = palpate.Camera(160, 120, 140, 140, 79.5, 59.5)
    image = np.full((120, 160), 1000, np.uint16)
    plain, timed = palpate.PushedCamera(camera), palpate.PushedCamera(camera, has_time_stamps=True)
    with pytest.raises(ValueError, match="time: this camera has no clock of its own.*has_time_stamps=True"):
        plain.push(image, time=1.0)
    with pytest.raises(ValueError, match="time: this camera has timestamps; pass that of the image"):
        timed.push(image)
    for bad in (np.nan, np.inf):
        with pytest.raises(ValueError, match="time: not finite"):
            timed.push(image, time=bad)
    with pytest.raises(ValueError, match=r"flow: shape \(160, 120, 2\) is not \(H, W, 2\)"):
        palpate.PushedCamera(camera, flow=True).push(image, flow=np.zeros((160, 120, 2), np.float32))
    for latency in (33, -0.1, np.nan):
        with pytest.raises(palpate.Error, match="latency of pushed frames must be from 0 to 1 s"):
            palpate.PushedCamera(camera, latency=latency)
    with pytest.raises(ValueError, match="the same PushedCamera is there twice"):
        palpate.touch(cube, [plain, plain], RESTING)
    pushed_in_a_run(cube, plain, image)
    with pytest.raises(palpate.Error, match="a PushedCamera is for one run; create another one"):
        palpate.touch(cube, plain, RESTING)


def test_a_pushed_flow_drags_the_tool(cube):
    camera = palpate.Camera(160, 120, 140, 140, 79.5, 59.5)
    plain = palpate.PushedCamera(camera)
    flow = np.zeros((120, 160, 2), np.float32)
    with pytest.raises(ValueError, match="flow=True"):
        plain.push(np.full((120, 160), 1000, np.uint16), flow=flow)
    pushed = palpate.PushedCamera(camera, flow=True)
    with pytest.raises(ValueError, match="flow"):
        pushed.push(np.full((120, 160), 1000, np.uint16), flow=flow[:, :, :1])
    is_over = threading.Event()

    def push():
        flow[:, :, 1] = 140 * 0.1  # 0.1 m/s at 1 m
        while not is_over.wait(0.02):
            pushed.push(np.full((120, 160), 1000, np.uint16), flow=flow)

    pusher = threading.Thread(target=push)
    pusher.start()
    try:
        run = palpate.touch(cube, pushed, RESTING, friction_coefficient=0.5)
        # Down with the belt, with half of what the wall pushes.
        assert run.wrench[-1, 1] == pytest.approx(-0.5 * run.wrench[-1, 2], rel=0.05)
    finally:
        is_over.set()
        pusher.join()


@pytest.mark.parametrize("where", ["read", "write"])
def test_what_a_device_raises_is_raised(cube, where):
    class Broken(Plunger):
        def read(self):
            if where == "read" and len(self.told) > 20:
                raise ArithmeticError("the encoder is gone")
            return super().read()

        def write(self, wrench):
            if where == "write" and len(self.told) > 20:
                raise ArithmeticError("the motor is gone")
            super().write(wrench)

    with pytest.raises(ArithmeticError, match="is gone"):
        palpate.touch(cube, "scene:wall", Broken(), duration=20).wait()


@pytest.mark.parametrize("text", [None, "\ud800"])
def test_an_exception_of_a_device_need_not_have_a_text(cube, text):
    class Unprintable(Exception):
        def __str__(self):
            return 1 / 0 if text is None else text

    class Broken(Plunger):
        def read(self):
            if len(self.told) > 20:
                raise Unprintable
            return super().read()

    with pytest.raises(Unprintable):
        palpate.touch(cube, "scene:wall", Broken(), duration=20).wait()


def test_on_tick_ends_a_run_and_its_errors_are_raised(cube):
    run = palpate.touch(cube, "scene:wall", device="sim", duration=60, on_tick=lambda tick: tick.number < 50)
    assert 50 <= run.times.size and run.times[-1] < 50
    with pytest.raises(ZeroDivisionError):
        palpate.touch(cube, "scene:wall", PATH, on_tick=lambda tick: 1 / 0).wait()


def test_ctrl_c_ends_a_run_and_keeps_it(cube, tmp_path):
    run = palpate.touch(cube, "scene:wall", device="sim", duration=60, output=tmp_path / "run")
    with pytest.raises(KeyboardInterrupt):
        threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        run.wait()
    assert palpate.Run.open(tmp_path / "run").times.size > 0


def test_a_run_that_nobody_ends_ends_with_python(tmp_path):
    code = """
import numpy as np, sys, palpate
sys.path.insert(0, sys.argv[1])
from conftest import CUBE_TRIANGLES, CUBE_VERTICES
tool = palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 20)
run = palpate.touch(tool, "scene:wall", device="sim", duration=600, output=sys.argv[2])
"""
    here = os.path.dirname(__file__)
    subprocess.run([sys.executable, "-c", code, here, str(tmp_path / "run")], check=True, timeout=120)
    assert palpate.Run.open(tmp_path / "run").times.size > 0


def test_a_hand_moves_as_in_the_picture_of_the_camera(cube):
    class Shift:
        rate, num_reads = 200, 0

        def read(self):  # to the right
            self.num_reads += 1
            return [0.02 if self.num_reads > 20 else 0, 0, 0, 0, 0, 0, 1]

        def write(self, wrench):
            pass

    X_WC = pose_matrix([0.3, -0.2, 0.1, 0.5, -0.5, 0.5, 0.5])
    start = [[0, 0.3, 0.1, 0.2, 0, 0, 0.6, 0.8]]
    posed = "scene:wall?pose=0.3,-0.2,0.1,0.5,-0.5,0.5,0.5"
    pushed = palpate.PushedCamera(palpate.Camera(160, 120, 140.0, 140.0, 79.5, 59.5, pose=X_WC))
    for camera in (posed, pushed):
        poses = {}

        def hear(tick):
            poses[tick.hand_pose[0]] = tick.pose
            return len(poses) < 2

        pushed.push(np.ones((120, 160), np.float32))
        palpate.touch(cube, camera, start, device=Shift(), duration=60, on_tick=hear, coupling_kind="none").wait()
        np.testing.assert_allclose(poses[0], start[0][1:], atol=1e-12)
        np.testing.assert_allclose(poses[0.02][:3] - poses[0][:3], 0.02 * X_WC[:3, 0], atol=1e-12)


def test_what_is_a_device_and_what_a_path(tmp_path, monkeypatch):
    from palpate._run import _is_device

    monkeypatch.chdir(tmp_path)
    (tmp_path / "haply").mkdir()
    (tmp_path / "page").write_text("0 0 0 0 0 0 0 1\n")
    for given in ("sim", "sim:touch", "replay:a.txt", "spacenav", "haply", "ros2:tool0@camera", "ros2:/pose",
                  "vrpn:Falcon0@localhost"):
        assert _is_device(given), given
    for given in ("page", "sims", "path.txt", "folder/sim"):
        assert not _is_device(given), given


def test_bad_requests(cube, tmp_path):
    def refused(error, words, *arguments, **keywords):
        with pytest.raises(error, match=words):
            palpate.touch(cube, *arguments, **keywords)

    refused(palpate.Error, "no scene 'nowhere'", "scene:nowhere", PATH)
    for cameras in (None, 3, b"scene:wall"):
        refused(TypeError, "cameras: a camera as text, .* is taken, not", cameras, PATH)
    refused(ValueError, r"path: shape \(2, 7\) is not \(N, 8\)", "scene:wall", PATH[:, :7])
    refused(ValueError, "row 1", "scene:wall", PATH[::-1])
    refused(palpate.Error, "nearest one is 'contact_method'", "scene:wall", PATH, contact_metod="graph")
    refused(palpate.Error, "no setting 'rate'", "scene:wall", PATH, rate=3)
    refused(palpate.Error, "contact_rate", "scene:wall", PATH, contact_rate=0)
    refused(ValueError, "duration", "scene:wall", PATH, duration=0)
    refused(palpate.Error, "method field", ["scene:wall", "scene:hand"], PATH, method="graph")
    refused(ValueError, "one, or several", [], PATH)
    refused(palpate.Error, "no-such", "scene:wall", tmp_path / "no-such.txt")
    refused(palpate.Error, "one device", "scene:wall", "sim", device="sim")
    refused(TypeError, "write", "scene:wall", device=object())
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "letter").write_text("mine")
    refused(palpate.Error, "taken", "scene:wall", PATH, output=tmp_path / "taken")
    for folder, words in ((tmp_path / "none", "no folder"), (tmp_path, "holds no run")):
        with pytest.raises(palpate.Error, match=words):
            palpate.Run.open(folder)
    (tmp_path / "wrench.csv").write_text("time_s\nfour\n")
    with pytest.raises(palpate.Error, match="wrench.csv cannot be read"):
        palpate.Run.open(tmp_path).times
