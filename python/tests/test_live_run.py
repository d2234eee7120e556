"""palpate.touch with a device: its ends, what a device or a function raises, and interruptions."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from conftest import PATH, pose_matrix

import palpate


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
