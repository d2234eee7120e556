"""Contact.measure_batch and Sensor.update_batch: the same bits as one by one, and what is refused."""

import ctypes

import numpy as np
import pytest
from conftest import pose_matrix

import palpate


@pytest.fixture(scope="module")
def scene():
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=160, height=120)
    surface = palpate.Sensor(camera).update(depth)
    random = np.random.default_rng(7)
    at = surface.points[30:90, 40:120].reshape(-1, 3)
    poses = np.concatenate([at[random.choice(len(at), 200)], random.normal(size=(200, 4))], axis=1)
    poses[:, 2] += random.uniform(-0.02, 0.02, 200)
    return depth, camera, surface, poses


def numbers(result):
    return [result.volume, result.potential, *result.force, *result.torque, *result.stiffness.ravel()]


def rows(batch):
    num = len(batch)
    return np.concatenate([batch.volume[:, None], batch.potential[:, None], batch.force, batch.torque,
                           batch.stiffness.reshape(num, 36)], axis=1)


def test_a_batch_has_the_bits_of_single_measurements(cube, scene):
    *_, surface, poses = scene
    contact = palpate.Contact(cube)
    batch = contact.measure_batch(surface, poses, stiffness=True)
    one_by_one = np.array([numbers(contact.measure(surface, pose, stiffness=True)) for pose in poses])
    assert np.array_equal(rows(batch), one_by_one)
    assert (one_by_one[:, 0] > 0).sum() > 50
    assert (batch.status == 0).all() and batch.status.dtype == np.uint32
    shuffled = np.random.default_rng(8).permutation(200)[:77]
    assert np.array_equal(rows(contact.measure_batch(surface, poses[shuffled], stiffness=True)),
                          one_by_one[shuffled])
    assert contact.measure_batch(surface, poses[:3]).stiffness is None


def test_matrices_are_poses_too(cube, scene):
    *_, surface, poses = scene
    contact = palpate.Contact(cube)
    seven = contact.measure_batch(surface, poses)
    matrices = contact.measure_batch(surface, np.array([pose_matrix(pose) for pose in poses]))
    assert matrices.volume == pytest.approx(seven.volume, rel=1e-4, abs=1e-12)


def test_several_surfaces_of_cameras_anywhere(cube, scene):
    depth, camera, surface, poses = scene
    stands = [None, [0.3, -0.2, 0.5, 0.1, 0.7, -0.3, 0.6], [0, 1, 0, 0, 0, 1, 1]]
    sensor = palpate.Sensor(camera)
    surfaces = [sensor.update(depth + 0.01 * k, pose=stand) for k, stand in enumerate(stands)]
    X_WC = [np.eye(4) if stand is None else pose_matrix(stand) for stand in stands]
    which = np.arange(200, dtype=np.int32) % 3
    X_WT = np.array([X_WC[k] @ pose_matrix(pose) for k, pose in zip(which, poses)])
    contact = palpate.Contact(cube)
    batch = contact.measure_batch(surfaces, X_WT, surface_of_pose=which, stiffness=True)
    one_by_one = np.array([numbers(contact.measure(surfaces[k], X, stiffness=True))
                           for k, X in zip(which, X_WT)])
    scale = np.abs(one_by_one).max(axis=0)
    assert (np.abs(rows(batch) - one_by_one) < 1e-5 * scale).all()
    each_its_own = contact.measure_batch(surfaces, X_WT[:3])
    assert each_its_own.volume == pytest.approx(batch.volume[:3], rel=1e-12)


def test_many_images_at_once(cube, scene):
    depth, camera, _, poses = scene
    images = np.stack([depth, depth + np.float32(0.02), depth + np.float32(0.04)])
    sensor = palpate.Sensor(camera)
    many = sensor.update_batch(images)
    assert len(many) == 3
    which = np.arange(200, dtype=np.int64) % 3
    contact = palpate.Contact(cube)
    together = contact.measure_batch(many, poses, surface_of_pose=which)
    alone = contact.measure_batch([sensor.update(image) for image in images], poses, surface_of_pose=which)
    assert np.array_equal(together.volume, alone.volume)
    assert np.array_equal(together.torque, alone.torque)
    sensor.update_batch(images + 1)
    again = contact.measure_batch(many, poses, surface_of_pose=which)
    assert np.array_equal(again.volume, together.volume)  # as long as it is held
    with pytest.raises(ValueError, match=r"depth: shape \(120, 160\) is not \(F, H, W\)"):
        sensor.update_batch(depth)


def test_out_is_written_again(cube, scene):
    *_, surface, poses = scene
    contact = palpate.Contact(cube)
    out = contact.measure_batch(surface, poses)
    volume, before = out.volume, out.volume.copy()
    same = contact.measure_batch(surface, poses[::-1], out=out)
    assert same is out and np.array_equal(volume, before[::-1])
    assert np.shares_memory(volume, same.volume)
    with pytest.raises(ValueError, match=r"out: shape \(200,\) is not \(3,\), without stiffness"):
        contact.measure_batch(surface, poses[:3], out=out)
    with pytest.raises(ValueError, match="with stiffness"):
        contact.measure_batch(surface, poses, out=out, stiffness=True)


def test_out_over_arrays_of_the_caller(cube, scene):
    *_, surface, poses = scene
    contact = palpate.Contact(cube)
    expected = contact.measure_batch(surface, poses, stiffness=True)
    volume, force = np.full(200, np.nan), np.full((200, 3), np.nan)
    out = palpate.Batch(volume=volume, force=force)
    assert contact.measure_batch(surface, poses, out=out) is out and len(out) == 200
    assert np.array_equal(volume, expected.volume) and np.array_equal(force, expected.force)
    assert np.shares_memory(out.volume, volume)
    with pytest.raises(palpate.Error, match="no array for that"):
        out.torque
    # The same for the remaining arrays.
    whole = palpate.Batch(potential=np.zeros(200), torque=np.zeros((200, 3)), stiffness=np.zeros((200, 6, 6)),
                          status=np.ones(200, np.uint32))
    contact.measure_batch(surface, poses, stiffness=True, out=whole)
    for name in ("potential", "torque", "stiffness", "status"):
        assert np.array_equal(getattr(whole, name), getattr(expected, name)), name


def test_bad_arrays_of_the_caller(cube, scene):
    *_, surface, poses = scene
    locked = np.zeros(200)
    locked.flags.writeable = False
    for wrong, why in (({"volume": np.zeros((200, 1))}, r"volume: shape \(200, 1\) is not \(200,\)"),
                       ({"volume": np.zeros(200), "force": np.zeros((100, 3))},
                        r"force: shape \(100, 3\) is not \(200, 3\)"),
                       ({"volume": np.zeros(200, np.float32)}, "volume: has to be float64, row by row"),
                       ({"status": np.zeros(200, np.int64)}, "status: has to be uint32"),
                       ({"force": np.zeros((200, 6))[:, ::2]}, "force: has to be float64, row by row"),
                       ({}, "one array or more")):
        with pytest.raises(ValueError, match=why):
            palpate.Batch(**wrong)
    for wrong in (locked, [0.0] * 200):
        with pytest.raises(TypeError, match="volume: not an array that can be written"):
            palpate.Batch(volume=wrong)
    with pytest.raises(ValueError, match=r"out: shape \(3,\) is not \(200,\)"):
        palpate.Contact(cube).measure_batch(surface, poses, out=palpate.Batch(volume=np.zeros(3)))


def test_surfaces_are_made_again(cube, scene):
    depth, camera, _, poses = scene
    sensor, contact = palpate.Sensor(camera), palpate.Contact(cube)
    fields = sensor.update_batch(np.stack([depth, depth]))
    which = np.zeros(200, np.int32)
    before = contact.measure_batch(fields, poses, surface_of_pose=which).volume
    moved = np.stack([depth + np.float32(0.01), depth])
    assert sensor.update_batch(moved, out=fields) is fields
    expected = contact.measure_batch(palpate.Sensor(camera).update_batch(moved), poses, surface_of_pose=which).volume
    assert not np.array_equal(expected, before)
    assert np.array_equal(contact.measure_batch(fields, poses, surface_of_pose=which).volume, expected)
    assert np.array_equal(contact.measure_batch(fields, poses, surface_of_pose=which + 1).volume, before)
    with pytest.raises(ValueError, match="out: another sensor"):
        palpate.Sensor(camera).update_batch(np.stack([depth]), out=fields)
    with pytest.raises(TypeError, match="out"):
        sensor.update_batch(np.stack([depth]), out=1)


class OnGpu:
    """Pretends to be on GPU 0, and stores the stream that it is requested for."""

    def __init__(self, array):
        self.array, self.stream = array, "nobody asked"

    def __dlpack_device__(self):
        return 2, 0

    def __dlpack__(self, *, stream=None, **_):
        self.stream = stream
        return self.array.__dlpack__()


@pytest.mark.parametrize("given, told", [(None, 1), (77, 77), (0, 1)])  # 0 is CUDA's default, which DLPack calls 1
def test_makers_of_arrays_are_told_the_stream(cube, scene, given, told):
    *_, surface, poses = scene
    array = OnGpu(poses)
    with pytest.raises(palpate.Error, match="memory of GPU 0"):
        palpate.Contact(cube).measure_batch(surface, array, stream=given)
    assert array.stream == told


@pytest.mark.parametrize("given", [None, 0])
def test_makers_of_images_are_told_the_stream(scene, given):
    """Without a stream, image producers would not wait for the one in which they write."""
    depth, camera, *_ = scene
    sensor = palpate.Sensor(camera)
    for update, image in ((sensor.update, OnGpu(depth)), (sensor.update_batch, OnGpu(depth[None]))):
        # The image is really in host memory, and is then treated as such.
        update(image, stream=given)
        assert image.stream == 1


class OfAnotherAccelerator:
    """Pretends to be in the memory of a ROCm GPU; it is in host memory."""

    def __init__(self, array):
        self.array = array

    def __dlpack_device__(self):
        return 10, 0

    def __dlpack__(self, **_):
        capsule = self.array.__dlpack__()
        pointer = ctypes.pythonapi.PyCapsule_GetPointer
        pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
        ctypes.c_int32.from_address(pointer(capsule, b"dltensor") + 8).value = 10  # DLTensor.device.device_type
        return capsule


def test_arrays_of_other_accelerators_are_refused(cube, scene):
    depth, camera, surface, poses = scene
    refused = r"is in the memory of a device of DLPack's type 10 \(ROCm\); host memory and CUDA GPUs are read"
    sensor, contact = palpate.Sensor(camera), palpate.Contact(cube)
    with pytest.raises(ValueError, match="depth: " + refused):
        sensor.update(OfAnotherAccelerator(depth))
    with pytest.raises(ValueError, match="depth: " + refused):
        sensor.update_batch(OfAnotherAccelerator(depth[None]))
    with pytest.raises(ValueError, match="poses: " + refused):
        contact.measure_batch(surface, OfAnotherAccelerator(poses))
    with pytest.raises(ValueError, match="volume: " + refused):
        palpate.Batch(volume=OfAnotherAccelerator(np.zeros(200)))


def test_what_cannot_be_measured_is_told_by_pose(cube, scene):
    *_, surface, poses = scene
    poses = poses[:4].copy()
    poses[1, 0] = np.nan
    contact = palpate.Contact(cube)
    batch = contact.measure_batch([surface], poses, surface_of_pose=[0, 0, 1, -1])
    assert list(batch.status) == [0, palpate.Status.NON_FINITE_POSE, palpate.Status.NO_SURFACE,
                                  palpate.Status.NO_SURFACE]
    assert (batch.volume[1:] == 0).all()


def test_bad_batches(cube, scene):
    *_, surface, poses = scene
    contact = palpate.Contact(cube)
    with pytest.raises(ValueError, match=r"poses: shape \(7,\) is not \(P, 4, 4\) or \(P, 7\)"):
        contact.measure_batch(surface, poses[0])
    with pytest.raises(ValueError, match=r"surface_of_pose: shape \(3,\) is not \(200,\)"):
        contact.measure_batch(surface, poses, surface_of_pose=[0, 0, 0])
    with pytest.raises(palpate.Error, match="surface"):
        contact.measure_batch([surface, surface], poses)
    with pytest.raises(TypeError, match="Surface"):
        contact.measure_batch([1], poses)
    with pytest.raises(ValueError, match="empty"):
        contact.measure_batch([], poses)
    with pytest.raises(palpate.Error, match="field"):
        palpate.Contact(cube, "graph").measure_batch(surface, poses)


def test_poses_lie_where_they_are(cube, scene):
    """A (P, 7) float64 array is read in place: measured again after it changed, nothing is remembered."""
    *_, surface, poses = scene
    contact = palpate.Contact(cube)
    asked = poses.copy()
    lengths = np.linalg.norm(asked[:, 3:], axis=1)
    assert lengths.min() < 0.9 and lengths.max() > 1.1
    first = rows(contact.measure_batch(surface, asked, stiffness=True))
    one_by_one = [numbers(contact.measure(surface, pose, stiffness=True)) for pose in asked]
    assert np.array_equal(first, np.array(one_by_one))
    asked[:] = asked[::-1].copy()
    assert np.array_equal(rows(contact.measure_batch(surface, asked, stiffness=True)), first[::-1])
    for other in (np.asfortranarray(poses), poses.tolist()):
        assert np.array_equal(rows(contact.measure_batch(surface, other, stiffness=True)), first)
    asked[5, 3:] = 0
    with pytest.raises(ValueError, match="quaternion qx qy qz qw is zero"):
        contact.measure_batch(surface, asked)


def test_numbers_of_surfaces_are_whole_ones(cube, scene):
    *_, surface, poses = scene
    contact = palpate.Contact(cube)
    few = poses[:3]
    for whole in (np.array([0, 1, 0]), [0, 1, 0], np.array([0, 1, 0], np.uint8)):
        assert contact.measure_batch([surface, surface], few, surface_of_pose=whole).volume.shape == (3,)
    for broken in ([0, 0.5, 1], np.array([0, 1 << 32, 1])):
        with pytest.raises(ValueError, match="surface_of_pose: not whole numbers that fit int32"):
            contact.measure_batch([surface, surface], few, surface_of_pose=broken)


@pytest.fixture(scope="module")
def block():
    """A cube of 10 cm."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.05
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
             [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return palpate.pack(corners, faces, 50)


def test_bodies_in_place_of_surfaces(cube, block):
    contact = palpate.Contact(cube)
    side = cube.volume ** (1 / 3)
    near = palpate.Body(block, [0, 0, 0.5, 0, 0, 0, 1])
    far = near.at([1, 0, 0.5, 0, 0, 0, 1])
    depth = np.linspace(-0.004, 0.006, 11)  # of the face, from below
    poses = np.tile([0.0, 0, 0, 0, 0, 0, 1], (11, 1))
    poses[:, 2] = 0.45 - side / 2 + depth
    alone = contact.measure_batch(near, poses, stiffness=True)
    # Spheres are softer than a face at a light touch.
    assert alone.volume[6:] == pytest.approx(side**2 * depth[6:], rel=0.12)
    assert alone.volume[7:] == pytest.approx(side**2 * depth[7:], rel=0.05)
    assert (alone.force[6:, 2] < 0).all() and alone.volume[:3].max() < 2e-3 * alone.volume[-1]
    assert alone.potential[-1] > 0 and alone.stiffness.shape == (11, 6, 6)
    # The force is the derivative of the potential by a shift.
    step = 1e-5
    shifted = [contact.measure_batch(near, poses + [0, 0, s, 0, 0, 0, 0]).potential for s in (step, -step)]
    assert -(shifted[0] - shifted[1]) / (2 * step) == pytest.approx(alone.force[:, 2], rel=2e-3, abs=1e-9)

    numbers_of = np.arange(11) % 2
    poses[numbers_of == 1, 0] += 1
    both = contact.measure_batch([near, far], poses, surface_of_pose=numbers_of, stiffness=True)
    assert both.volume == pytest.approx(alone.volume, rel=1e-4, abs=1e-12)
    again = contact.measure_batch([near, far], poses[3:9], surface_of_pose=numbers_of[3:9], stiffness=True)
    assert np.array_equal(rows(again), rows(both)[3:9])
    assert contact.measure_batch([near, far], poses, surface_of_pose=numbers_of + 1).status[1] != 0


def test_bad_batches_against_bodies(cube, block, scene):
    *_, surface, poses = scene
    body = palpate.Body(block)
    contact = palpate.Contact(cube)
    with pytest.raises(palpate.Error, match="200 poses was given 2 bodies"):
        contact.measure_batch([body, body], poses)
    with pytest.raises(TypeError, match="not both"):
        contact.measure_batch([body, surface], poses, surface_of_pose=np.zeros(200, np.int32))
    with pytest.raises(TypeError):
        contact.measure_batch([surface, body], poses, surface_of_pose=np.zeros(200, np.int32))
    with pytest.raises(palpate.Error, match="by the method field"):
        palpate.Contact(cube, "graph").measure_batch(body, poses)
    with pytest.raises(ValueError, match=r"\(3,\)"):
        palpate.Body(block, [1, 2, 3])
