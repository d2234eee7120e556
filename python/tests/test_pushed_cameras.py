"""palpate.PushedCamera: depth images from Python during a run."""

import threading
import time

import numpy as np
import pytest

import palpate

#: Into the wall as PATH of conftest.py, for real time: it rests there, as the measurement of its end may come late.
RESTING = np.array([[0, 0, 0, 0.97, 0, 0, 0, 1], [0.2, 0, 0, 0.99, 0, 0, 0, 1], [2, 0, 0, 0.99, 0, 0, 0, 1]])


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


def test_points_are_felt_as_their_image(cube):
    camera = palpate.Camera(160, 120, 140, 140, 79.5, 59.5, unit=0.001)
    depth = (1000 + np.arange(160 * 120, dtype=np.uint16).reshape(120, 160) % 7).astype(np.uint16)
    v, u = np.mgrid[:120, :160]
    z = depth * 0.001
    points = np.stack([(u - 79.5) / 140 * z, (v - 59.5) / 140 * z, z], axis=-1)
    images = []
    for given, normals in ((points, None), (points.reshape(-1, 3)[::-1], None), (points, -points)):
        pushed = palpate.PushedCamera(camera)
        is_over = threading.Event()

        def push(pushed=pushed, given=given, normals=normals, is_over=is_over):
            while not is_over.wait(0.02):
                pushed.push_points(given, normals)

        pusher = threading.Thread(target=push)
        pusher.start()
        try:
            run = palpate.touch(cube, pushed, RESTING)
            run.wait()
        finally:
            is_over.set()
            pusher.join()
        images.append(next(iter(run.frames()))[1])
    for image in images:
        np.testing.assert_array_equal(image, depth)
    pushed = palpate.PushedCamera(camera)
    with pytest.raises(ValueError, match="points"):
        pushed.push_points(np.zeros((5, 2)))
    with pytest.raises(ValueError, match="normals"):
        pushed.push_points(np.ones((5, 3)), np.ones((4, 3)))
    with pytest.raises(ValueError, match="moving=True"):
        pushed.push_points(np.ones((5, 3)), pose=[0, 0, 0, 0, 0, 0, 1])
