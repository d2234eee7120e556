"""Scenes with poses and answers of PyTorch and CuPy on a GPU: the same bits as from and to host memory."""

import numpy as np
import pytest
from test_gpu import NUM, library, scene  # noqa: F401

import palpate

SCENE_ARRAYS = {"volume": (), "potential": (), "force": (3,), "torque": (3,), "unseen": (), "clearance": (),
                "clearance_gradient": (6,)}


@pytest.mark.parametrize("num_cameras", [1, 3])
def test_a_scene_takes_and_leaves_arrays_there(cube, scene, library, num_cameras):
    """The same bits as from and to host memory, in arrays of the caller and in new ones, and captured in a graph."""
    camera, images, poses, _ = scene
    poses = poses - np.eye(7)[2] * np.linspace(0, 0.2, NUM)[:, None]  # some are in front
    block = palpate.Body(cube, [0.05, 0, 0.8, 0, 0, 0, 1])
    sensors = [palpate.Sensor(camera, place="cuda", joined=num_cameras > 1) for _ in range(num_cameras)]
    surfaces = [sensor.update(image) for sensor, image in zip(sensors, images)]
    everything = palpate.Scene(surfaces, [block])
    contact = palpate.Contact(cube, place="cuda")
    want = contact.measure_batch(everything, poses, clearance=True)
    blocked = contact.any(everything, poses, 0.01)
    assert (want.nearest >= 0).sum() > NUM / 4 and 0 < blocked.sum() < NUM

    where = library.on_gpu(poses)
    new = contact.measure_batch(everything, where, clearance=True)
    hits = contact.any(everything, where, 0.01)
    library.wait()
    for name in (*SCENE_ARRAYS, "nearest", "decided", "status"):
        assert np.array_equal(library.taken(getattr(new, name)), getattr(want, name)), name
    hits = library.taken(hits)
    assert hits.dtype == bool and np.array_equal(hits, blocked)

    there = {name: library.on_gpu(np.full((NUM, *shape), np.nan)) for name, shape in SCENE_ARRAYS.items()}
    there["nearest"] = library.on_gpu(np.full(NUM, 77, np.int32))
    before = {name: library.address(array) for name, array in there.items()}
    out = palpate.Batch(**there)
    stream = library.stream()
    with library.within(stream):
        library.keep_busy()
        library.write(where, library.on_gpu(poses))
        contact.measure_batch(everything, where, out=out, stream=stream)
    library.wait()
    for name in there:
        assert np.array_equal(library.host(there[name]), getattr(want, name)), name
    assert {name: library.address(array) for name, array in there.items()} == before

    replay = library.captured(lambda stream: contact.measure_batch(everything, where, out=out, stream=stream))
    library.write(where, library.on_gpu(poses[::-1].copy()))
    library.wait()
    replay()
    library.wait()
    for name in there:
        assert np.array_equal(library.host(there[name])[::-1], getattr(want, name)), name

    is_hit = library.on_gpu(np.full(NUM, 7, np.uint8))  # CuPy lends no bool by DLPack
    replay = library.captured(lambda stream: contact.any(everything, where, 0.01, out=is_hit, stream=stream))
    library.write(where, library.on_gpu(poses))
    library.wait()
    replay()
    library.wait()
    assert np.array_equal(library.host(is_hit), blocked)
    with pytest.raises(ValueError, match="out: is elsewhere than the poses"):
        contact.any(everything, where, out=np.zeros(NUM, bool))
    with pytest.raises((TypeError, ValueError), match="out: "):
        contact.any(everything, where, out=library.on_gpu(np.zeros(NUM, np.int16)))
    library.write(where, library.on_gpu(poses[::-1].copy()))
    library.wait()

    smooth = contact.measure_batch(everything, where, clearance=True, smooth=0.002)
    library.wait()
    there = library.taken(smooth.clearance)[::-1]
    assert (there <= want.clearance + 1e-9).all() and (there < want.clearance - 1e-4).any()


def test_tools_and_groups_of_a_scene_are_in_host_memory(cube, scene, library):
    camera, images, poses, _ = scene
    seen = palpate.Scene([palpate.Sensor(camera, place="cuda").update(images[0])])
    contact = palpate.Contact([cube, cube], place="cuda")
    tools, groups = (np.arange(NUM) % 2).astype(np.int32), (np.arange(NUM) // 5).astype(np.int32)
    where = library.on_gpu(poses)
    want = contact.any(seen, poses, 0.01, tool_of_pose=tools, group_of_pose=groups)
    got = contact.any(seen, where, 0.01, tool_of_pose=tools, group_of_pose=groups)
    library.wait()
    assert np.array_equal(library.taken(got), want) and want.shape == (NUM // 5,)
    with pytest.raises(ValueError, match="tool_of_pose: not an array of numbers in host memory"):
        contact.any(seen, where, tool_of_pose=library.on_gpu(tools))
    with pytest.raises(palpate.Error, match="groups are put together in host memory"):
        contact.measure_batch(seen, where, clearance=True, tool_of_pose=tools, group_of_pose=groups)
    with pytest.raises(palpate.Error, match="give poses and answers in host memory"):
        contact.measure_batch(seen, where, per_sphere=True, tool_of_pose=tools)
    with pytest.raises(palpate.Error, match="given to a contact on the CPU; create it with Place::cuda"):
        palpate.Contact(cube).any(palpate.Scene([palpate.Sensor(camera).update(images[0])]), where)


def test_a_camera_anywhere_takes_poses_there(cube, scene, library):
    camera, images, poses, _ = scene
    X_WC = [0.3, -0.2, 0.1, 0, 0.6, 0, 0.8]
    k = camera
    placed = palpate.Camera(160, 120, k.fx, k.fy, k.cx, k.cy, pose=X_WC)
    surface = palpate.Sensor(placed, place="cuda").update(images[0])
    contact = palpate.Contact(cube, place="cuda")
    want, got = (contact.measure_batch(surface, given) for given in (poses, library.on_gpu(poses)))
    library.wait()
    assert np.array_equal(library.taken(got.volume), library.taken(want.volume))
