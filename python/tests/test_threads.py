"""Several threads of Python at once, Ctrl-C while something takes long, and os.fork."""

import gc
import os
import signal
import struct
import subprocess
import sys
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import palpate

WIDTH, HEIGHT = 64, 48
INTRINSICS = "intrinsics=60,60,31.5,23.5"
#: Before the wall at 1 m, in real time.
RESTING = np.array([[0, 0, 0, 0.97, 0, 0, 0, 1], [0.3, 0, 0, 0.99, 0, 0, 0, 1], [2, 0, 0, 0.99, 0, 0, 0, 1]])


@pytest.fixture
def fifo(tmp_path):
    path = tmp_path / "frames"
    os.mkfifo(path)
    return path


def test_a_thread_of_this_process_feeds_the_camera_that_is_opened(cube, fifo):
    is_over = threading.Event()

    def write():
        image = np.full((HEIGHT, WIDTH), 1000, "<u2").tobytes()
        with open(fifo, "wb", buffering=0) as file:
            try:
                while not is_over.wait(0.02):
                    file.write(struct.pack("<8sIIdd", b"PALPDEP1", WIDTH, HEIGHT, time.time(), 0.001) + image)
            except BrokenPipeError:
                pass

    writer = threading.Thread(target=write)
    writer.start()
    try:
        run = palpate.touch(cube, f"pipe:{fifo}?{INTRINSICS}", RESTING)
        assert run.summary["frames"] > 0
    finally:
        is_over.set()
        writer.join()


def test_ctrl_c_ends_the_opening_of_a_camera(cube, fifo):
    """The camera sends nothing. Other threads continue meanwhile, such as the one that sends SIGINT here."""
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        palpate.touch(cube, f"pipe:{fifo}?{INTRINSICS}", RESTING)
    os.close(os.open(fifo, os.O_WRONLY | os.O_NONBLOCK))  # so it need not be waited for at the end


def test_many_threads_push_to_one_camera(cube, tmp_path):
    """Images of two sizes: each recorded frame is one of them, complete."""
    camera = palpate.PushedCamera(palpate.Camera(WIDTH, HEIGHT, 60, 60, 31.5, 23.5))
    is_over = threading.Event()
    raised = []

    def push(number):
        scale = 1 + number % 2
        image = np.full((scale * HEIGHT, scale * WIDTH), 900 + number, np.uint16)
        try:
            while not is_over.is_set():
                camera.push(image)
        except Exception as error:
            raised.append(error)

    threads = [threading.Thread(target=push, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    try:
        run = palpate.touch(cube, camera, RESTING, output=tmp_path / "run", safety_max_sensor_age=60,
                            safety_max_contact_age=60)
        run.wait()
    finally:
        is_over.set()
        for thread in threads:
            thread.join()
    assert raised == []
    frames = [image for _, image in run.frames()]
    assert len(frames) > 1
    for image in frames:
        assert len(np.unique(image[image > 0])) == 1


def test_a_batch_keeps_the_surfaces_that_it_measures(cube):
    """The list of surfaces loses them while the poses are read, as another thread may cause; then their memory is
    reused."""
    depth, camera, _ = palpate.render_scene("wall", width=160, height=120)
    sensor, contact = palpate.Sensor(camera), palpate.Contact(cube)
    poses = np.array([[0, 0, 0.99, 0, 0, 0, 1.0]])
    expected = contact.measure_batch([sensor.update(depth)], poses).volume
    surfaces = [sensor.update(depth)]

    class Poses:
        def __array__(self, dtype=None, copy=None):
            surfaces[0] = None
            gc.collect()
            sensor.update(depth + np.float32(1))
            return poses

    assert expected > 0
    assert contact.measure_batch(surfaces, Poses()).volume == expected


def test_two_threads_read_one_recording(cube, tmp_path):
    run = palpate.touch(cube, "scene:wall", [[0, 0, 0, 0.9, 0, 0, 0, 1], [1, 0, 0, 0.99, 0, 0, 0, 1]],
                        output=tmp_path / "run")
    alone = {time: image for time, image in run.frames()}
    frames = run.frames()
    with ThreadPoolExecutor(4) as pool:
        read = [one for part in pool.map(lambda _: list(frames), range(4)) for one in part]
    assert sorted(time for time, _ in read) == sorted(alone)
    assert all(np.array_equal(image, alone[time]) for time, image in read)


def test_what_on_tick_refers_to_goes_with_the_run(cube):
    """Usually on_tick refers to the run: a cycle that Python's garbage collector does not see."""
    begun, runs = threading.Event(), []

    def touch():
        def hear(tick):
            begun.wait()
            if tick.number == 0:
                run.mark("the first one")

        run = palpate.touch(cube, "scene:wall", RESTING, on_tick=hear)
        begun.set()
        run.wait()
        runs.append(weakref.ref(run))
        return run.folder

    folder = touch()
    gc.collect()
    assert runs[0]() is None and not folder.exists()


def test_a_run_that_only_on_tick_refers_to_ends(cube):
    """The run's end then destroys the object, in the run's own thread."""
    begun, runs = threading.Event(), []

    def touch():
        def hear(tick):
            begun.wait()
            return tick.number < 100 or run is None

        run = palpate.touch(cube, "scene:wall", device="sim", duration=60, on_tick=hear)
        runs.append((weakref.ref(run), run.folder))
        begun.set()

    touch()
    run, folder = runs[0]
    while run() is not None or folder.exists():
        time.sleep(0.01)


def test_a_child_of_fork_leaves_the_run_to_its_parent(tmp_path):
    """It ends by itself, and what is recorded stays."""
    code = """
import os, sys, palpate
sys.path.insert(0, sys.argv[1])
from conftest import CUBE_TRIANGLES, CUBE_VERTICES
tool = palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 20)
run = palpate.touch(tool, "scene:wall", device="sim", duration=600)
child = os.fork()
if child == 0:
    assert not run.is_running and run.wait()
    sys.exit(7)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
assert run.is_running
run.stop()
assert run.times.size > 0
"""
    subprocess.run([sys.executable, "-W", "ignore", "-c", code, os.path.dirname(__file__)], check=True, timeout=120)
