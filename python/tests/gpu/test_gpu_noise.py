"""Standard deviations on a GPU: those of the CPU, the same bits on every run, in arrays of PyTorch and CuPy."""

import numpy as np
import pytest
from test_gpu import NUM, library, scene  # noqa: F401

import palpate

NAMES = ("volume_std", "force_std", "torque_std")


def is_near(got, want):
    """Is true if nearly all deviations are equal to 1e-4 of themselves, those of a vector to 1e-4 of its length.

    The others lie at the border of two grids, and are equal to a tenth.
    """
    sizes = np.abs(want) if want.ndim == 1 else np.linalg.norm(want, axis=1)[:, None]
    errors = np.abs(got - want)
    return (errors <= 1e-4 * sizes).mean() > 0.99 and (errors <= 0.1 * sizes).all()


@pytest.mark.parametrize("num_images", [1, 4])
@pytest.mark.parametrize("settings", [{}, {"noise_at_zero": 0.001, "noise_length": 4.0}])
def test_batches_as_on_the_cpu(cube, scene, library, num_images, settings):  # noqa: F811
    """One frame, and images of a batch, which learn their noise or have it set."""
    camera, images, poses, which = scene

    def answered(place, std=True):
        sensor, contact = palpate.Sensor(camera, place=place, **settings), palpate.Contact(cube, place=place)
        if num_images == 1:
            return contact.measure_batch(sensor.update(images[0]), poses, std=std)
        return contact.measure_batch(sensor.update_batch(images), poses, surface_of_pose=which, std=std)

    want, got, again, plain = answered("cpu"), answered("cuda"), answered("cuda"), answered("cuda", std=False)
    library.wait()
    assert (want.volume_std > 0).sum() > NUM / 4
    for name in NAMES:
        deviations = library.taken(getattr(got, name))
        assert is_near(deviations, getattr(want, name)), name
        assert np.array_equal(deviations, library.taken(getattr(again, name))), name
    for name in ("volume", "potential", "force", "torque"):
        assert np.array_equal(library.taken(getattr(got, name)), library.taken(getattr(plain, name))), name


def test_single_measurements_and_scenes_as_on_the_cpu(cube, scene):  # noqa: F811
    camera, images, poses, _ = scene
    block = palpate.Body(cube, [0.05, 0, 0.8, 0, 0, 0, 1])
    answers = {}
    for place in ("cpu", "cuda"):
        sensors = [palpate.Sensor(camera, place=place, joined=True) for _ in range(3)]
        surfaces = [sensor.update(image) for sensor, image in zip(sensors, images)]
        contact = palpate.Contact(cube, place=place)
        alone = [contact.measure(surfaces[0], pose, std=True) for pose in poses[:40]]
        joined = [contact.measure(surfaces, pose, std=True) for pose in poses[:40]]
        batch = contact.measure_batch(palpate.Scene(surfaces, [block]), poses, std=True)
        one = contact.measure(palpate.Scene(surfaces, [block]), poses[0], std=True)
        for name in NAMES:
            assert np.array_equal(getattr(one, name), getattr(batch, name)[0]), name
        answers[place] = [[np.array([getattr(each, name) for each in many]) for name in NAMES] for many in (alone, joined)]
        answers[place].append([getattr(batch, name) for name in NAMES])
    for got, want in zip(answers["cuda"], answers["cpu"]):
        assert (want[0] > 0).sum() > len(want[0]) / 8
        for name, a, b in zip(NAMES, got, want):
            assert is_near(a, b), name


def test_in_arrays_there_and_captured_in_a_graph(cube, scene, library):  # noqa: F811
    camera, images, poses, _ = scene
    surface, contact = palpate.Sensor(camera, place="cuda").update(images[0]), palpate.Contact(cube, place="cuda")
    batch = contact.measure_batch(surface, poses, std=True)
    library.wait()
    want = {name: library.taken(getattr(batch, name)) for name in NAMES}
    shapes = {"volume_std": (NUM,), "force_std": (NUM, 3), "torque_std": (NUM, 3)}
    there = {name: library.on_gpu(np.full(shape, np.nan)) for name, shape in shapes.items()}
    out, where = palpate.Batch(**there), library.on_gpu(poses)
    contact.measure_batch(surface, where, std=True, out=out)
    library.wait()
    for name in NAMES:
        assert np.array_equal(library.host(there[name]), want[name]), name
    replay = library.captured(lambda stream: contact.measure_batch(surface, where, std=True, out=out, stream=stream))
    library.write(where, library.on_gpu(poses[::-1].copy()))
    library.wait()
    replay()
    library.wait()
    for name in NAMES:
        assert np.array_equal(library.host(there[name])[::-1], want[name]), name
