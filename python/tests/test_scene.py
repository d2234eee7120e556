"""palpate.Scene: one question to cameras and bodies, against exact solids and single calls."""

import os

import numpy as np
import pytest

import palpate
from conftest import CUBE_TRIANGLES, CUBE_VERTICES


@pytest.fixture(scope="module")
def surface():
    """A wall at 1 m before which a post stands, 0.2 m nearer."""
    camera = palpate.Camera(640, 480, 560.0, 560.0, 319.5, 239.5)
    depth = np.ones((480, 640), np.float32)
    depth[:, 240:320] = 0.8
    return palpate.Sensor(camera).update(depth)


@pytest.fixture(scope="module")
def body():
    return palpate.Body(palpate.pack(CUBE_VERTICES * 2, CUBE_TRIANGLES, 50), [0.3, 0, 0.7, 0, 0, 0, 1])


@pytest.fixture(scope="module")
def tool():
    return palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 60)


def poses_before_the_wall(num):
    rng = np.random.default_rng(1)
    poses = np.zeros((num, 7))
    poses[:, 0] = rng.uniform(0.15, 0.3, num)
    poses[:, 1] = rng.uniform(-0.1, 0.1, num)
    poses[:, 2] = rng.uniform(0.9, 1.0, num)
    poses[:, 3:] = rng.normal(size=(num, 4))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return poses


def centers(tool, pose):
    x, y, z, w = pose[3:]
    R = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])
    return tool.spheres[:, :3] @ R.T + pose[:3]


def test_clearance_to_a_wall_is_exact(tool, surface):
    contact = palpate.Contact(tool)
    poses = poses_before_the_wall(200)
    batch = contact.measure_batch(palpate.Scene([surface]), poses, clearance=True)
    for i, pose in enumerate(poses):
        before = 1 - centers(tool, pose)[:, 2] - tool.spheres[:, 3]
        if abs(before.min()) < 0.09:
            # Inside, the sphere is the one farthest from the middles of pixels, 1.8 mm apart.
            tolerance = 2e-4 if before.min() > 0 else 1.3e-3
            assert batch.clearance[i] == pytest.approx(before.min(), abs=tolerance)
            assert before[batch.nearest[i]] == pytest.approx(before.min(), abs=tolerance)
            np.testing.assert_allclose(batch.clearance_gradient[i, :3], [0, 0, -1], atol=1e-3)
    assert (batch.decided == 0).sum() > 100
    assert batch.unseen.shape == (200,)
    for margin in (0.0, 0.02):
        hits = contact.any(surface, poses, margin)
        assert hits.dtype == bool
        for mine in (np.ones(200, bool), np.full(200, 7, np.uint8)):
            assert contact.any(surface, poses, margin, out=mine) is mine
            np.testing.assert_array_equal(mine, hits)
        np.testing.assert_array_equal(hits, batch.clearance < margin)


def test_one_pose_and_a_batch_agree(tool, surface, body):
    contact = palpate.Contact(tool)
    scene = palpate.Scene([surface], [body])
    poses = poses_before_the_wall(20)
    poses[::2, 2] -= 0.25
    batch = contact.measure_batch(scene, poses, clearance=True, per_sphere=True, stiffness=True)
    for i, pose in enumerate(poses):
        one = contact.measure(scene, pose, clearance=True, per_sphere=True, stiffness=True)
        assert one.volume == batch.volume[i]
        assert one.clearance == batch.clearance[i]
        assert one.nearest == batch.nearest[i]
        np.testing.assert_array_equal(one.clearance_gradient, batch.clearance_gradient[i])
        np.testing.assert_array_equal(one.sphere_depth, batch.sphere_depth[i])
        np.testing.assert_array_equal(one.stiffness, batch.stiffness[i])
        camera = contact.measure(surface, pose).volume
        bodies = contact.measure_batch(body, pose[None]).volume[0]
        assert one.volume == pytest.approx(camera + bodies, rel=1e-12)
    assert (batch.decided == 1).any() and (batch.volume > 0).any()
    assert batch.sphere_direction.shape == (20, 60, 3)
    assert contact.measure(surface, poses[0]).clearance is None


def test_several_tools_and_groups(tool, surface):
    small = palpate.pack(CUBE_VERTICES / 4, CUBE_TRIANGLES, 20)
    both = palpate.Contact([tool, small])
    poses = poses_before_the_wall(60)
    tools = np.arange(60, dtype=np.int32) % 2
    groups = np.arange(60, dtype=np.int32) // 6
    batch = both.measure_batch(surface, poses, clearance=True, tool_of_pose=tools, group_of_pose=groups)
    for k, one in enumerate((tool, small)):
        alone = palpate.Contact(one).measure_batch(surface, poses[k::2], clearance=True)
        np.testing.assert_array_equal(batch.clearance[k::2], alone.clearance)
        np.testing.assert_array_equal(batch.volume[k::2], alone.volume)
    np.testing.assert_array_equal(batch.group_clearance, batch.clearance.reshape(10, 6).min(1))
    np.testing.assert_allclose(batch.group_volume, batch.volume.reshape(10, 6).sum(1))
    hits = both.any(surface, poses, tool_of_pose=tools, group_of_pose=groups)
    np.testing.assert_array_equal(hits, batch.group_clearance < 0)


def test_unseen_space_is_a_policy(tool, surface):
    contact = palpate.Contact(tool)
    behind_the_post = [[-0.055, 0, 0.93, 0, 0, 0, 1]]
    assert contact.any(palpate.Scene([surface]), behind_the_post)[0]
    assert not contact.any(palpate.Scene([surface], unseen="free", thickness=0.02), behind_the_post)[0]


def test_results_in_arrays_of_the_caller(tool, surface, body):
    contact = palpate.Contact(tool)
    scene = palpate.Scene([surface], [body])
    poses = poses_before_the_wall(12)
    want = contact.measure_batch(scene, poses, clearance=True, per_sphere=True)
    clearance, nearest = np.full(12, -7.0), np.full(12, -7, np.int32)
    force, depth = np.full((12, 3), -7.0), np.full((12, 60), -7, np.float32)
    out = palpate.Batch(clearance=clearance, nearest=nearest, force=force, sphere_depth=depth)
    assert contact.measure_batch(scene, poses, out=out) is out
    np.testing.assert_array_equal(clearance, want.clearance)
    np.testing.assert_array_equal(nearest, want.nearest)
    np.testing.assert_array_equal(force, want.force)
    np.testing.assert_array_equal(depth, want.sphere_depth)
    assert out.clearance is clearance and out.decided is None
    with pytest.raises(ValueError, match="out"):
        contact.measure_batch(scene, poses[:5], out=out)
    with pytest.raises(ValueError, match="sphere_depth"):
        contact.measure_batch(scene, poses, out=palpate.Batch(sphere_depth=depth[:, :50].copy()))
    with pytest.raises(TypeError, match="over your own arrays"):
        contact.measure_batch(scene, poses, out=want)


def test_smooth_minimum_is_below_the_least(tool, surface):
    contact = palpate.Contact(tool)
    poses = poses_before_the_wall(30)
    least = contact.measure_batch(surface, poses, clearance=True)
    smooth = contact.measure_batch(surface, poses, clearance=True, smooth=0.002)
    inside = (least.nearest >= 0) & (smooth.clearance > -0.1)
    below = (least.clearance - smooth.clearance)[inside]
    assert inside.sum() > 10 and (below >= 0).all() and (below > 1e-5).any()
    assert (below <= 0.002 * np.log(len(tool.spheres))).all()
    assert contact.measure(surface, poses[0], clearance=True, smooth=0.002).clearance == smooth.clearance[0]
    with pytest.raises(palpate.Error, match="smoothed over a length"):
        contact.measure_batch(surface, poses, clearance=True, smooth=-1)


def test_bad_input_is_refused_in_a_sentence(tool, surface):
    contact = palpate.Contact([tool, tool])
    pose = [[0, 0, 0.5, 0, 0, 0, 1]]
    with pytest.raises(palpate.Error, match="tool_of_pose of pose 0 is 2, but there are 2 tools"):
        contact.measure_batch(surface, pose, tool_of_pose=[2])
    with pytest.raises(palpate.Error, match="the scene is empty"):
        contact.any(palpate.Scene(), pose, tool_of_pose=[0])
    with pytest.raises(palpate.Error, match="not with weighted"):
        palpate.Contact(tool, "weighted").measure_batch(surface, pose, clearance=True)
    with pytest.raises(palpate.Error, match="fewer poses at a time"):
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        many = np.broadcast_to(np.float64([0, 0, 0.5, 0, 0, 0, 1]), (memory // (20 * 3000), 7))
        fine = palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 3000)
        palpate.Contact(fine).measure_batch(surface, many, per_sphere=True)
    with pytest.raises(ValueError, match="solid, free or fade"):
        palpate.Scene([surface], unseen="open")
    with pytest.raises(TypeError, match=r"palpate\.Surface, palpate\.Body"):
        contact.any([3], pose)
    with pytest.raises(ValueError, match="one for each pose"):
        contact.any(surface, pose, tool_of_pose=[0, 1])
    one = palpate.Contact(tool)
    refused = "out: has to be bool or uint8"
    for out, why in ((np.zeros(2, bool), r"out: shape \(2,\) is not \(1,\)"), (np.zeros(1), refused),
                     (np.zeros(1, np.int8), refused)):
        with pytest.raises(ValueError, match=why):
            one.any(surface, pose, out=out)
    with pytest.raises(TypeError, match="out: not an array of bool or uint8 that can be written"):
        one.any(surface, pose, out=[False])
    broken = palpate.Contact(tool).measure_batch(surface, [[np.nan] * 7], clearance=True)
    assert broken.status[0] & palpate.Status.NON_FINITE_POSE
