"""Several cameras combined, against exact rays and by derivatives."""

import numpy as np
import pytest
from conftest import pose_matrix

import palpate

BALL, RADIUS, WALL = np.array([0, 0, 1.0]), 0.06, 1.3
TARGET = np.array([0, 0, 1.05])


def look_at(position):
    """X_WC of a camera that looks at the target, upright."""
    z = TARGET - position
    z = z / np.linalg.norm(z)
    x = np.cross([0, 1.0, 0], z)
    x = x / np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.stack([x, np.cross(z, x), z], 1)
    X[:3, 3] = position
    return X


def first_hit(origin, rays):
    """Distances to a ball in front of a wall along rays, in lengths of each ray."""
    with np.errstate(divide="ignore", invalid="ignore"):
        to_wall = (WALL - origin[2]) / rays[..., 2]
        a, b = (rays * rays).sum(-1), rays @ (origin - BALL)
        root = b * b - a * ((origin - BALL) @ (origin - BALL) - RADIUS**2)
        to_ball = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    to_wall[~(to_wall > 0)] = np.inf
    return np.minimum(to_wall, to_ball)


@pytest.fixture(scope="module")
def views():
    """Surfaces of three cameras, with the poses that they were seen from."""
    angles = np.radians([0, 35, -35])
    poses = [look_at(TARGET + 1.05 * np.array([np.sin(a), 0, -np.cos(a)])) for a in angles]
    surfaces = []
    v, u = np.mgrid[0:480, 0:640]
    rays_C = np.stack([(u - 319.5) / 525, (v - 239.5) / 525, np.ones(u.shape)], -1)
    for X in poses:
        depth = first_hit(X[:3, 3], rays_C @ X[:3, :3].T).astype(np.float32)
        depth[~np.isfinite(depth)] = 0
        camera = palpate.Camera(640, 480, 525, 525, 319.5, 239.5, pose=X)
        surfaces.append(palpate.Sensor(camera, joined=True).update(depth))
    return surfaces, poses


def share_of_hull(poses, center):
    """Share of a 40 mm cube that no camera sees to be free, by exact rays."""
    steps = 0.02 * ((np.arange(24) + 0.5) / 12 - 1)
    points = center + np.stack(np.meshgrid(steps, steps, steps), -1).reshape(-1, 3)
    solid = np.ones(len(points), bool)
    for X in poses:
        depth = (points - X[:3, 3]) @ X[:3, 2]
        solid &= first_hit(X[:3, 3], (points - X[:3, 3]) / depth[:, None]) <= depth
    return solid.mean()


def test_the_shadow_shrinks_with_every_camera(views, cube):
    surfaces, poses = views
    contact = palpate.Contact(cube)
    for z in (1.1, 1.15, 1.2):
        shares = []
        for num in (1, 2, 3):
            result = contact.measure(surfaces[:num], [0, 0, z, 0, 0, 0, 1])
            assert result.fraction == pytest.approx(
                share_of_hull(poses[:num], np.array([0, 0, z])), abs=0.03
            )
            assert result.status == palpate.Status.OK
            shares.append(result.unseen)
        assert shares[0] > 0.9 and shares[2] < 0.1


def test_spheres_tell_who_decided(views, cube):
    surfaces, _ = views
    contact = palpate.Contact(cube)
    # In the ball, and behind it, where three cameras see free space.
    for pose, touches in (([0.01, 0, 0.93, 0, 0, 0, 1], True), ([0, 0, 1.15, 0, 0, 0, 1], False)):
        result = contact.measure(surfaces, pose, states=True)
        felt = result.states > 0
        assert felt.any() == touches and (result.decided[~felt] == -1).all()
        assert set(result.decided[felt]) <= {-1, 0, 1, 2}
        volume = cube.spheres[:, 3].astype(float) ** 3
        share = (volume * result.unseen_spheres).sum() / volume.sum()
        assert result.unseen == pytest.approx(share, abs=0.1)
    alone = contact.measure(surfaces[0], pose, states=True)
    assert alone.unseen_spheres.all() and (alone.decided == 0).all()
    assert contact.measure(surfaces, pose).decided is None


def test_the_order_of_cameras_hardly_matters(views, cube):
    surfaces, _ = views
    contact = palpate.Contact(cube)
    pose = [0.01, 0, 0.93, 0, 0, 0, 1]
    one = contact.measure(surfaces, pose)
    other = contact.measure(surfaces[::-1], pose)
    # Cameras that agree are averaged one after the other.
    assert other.volume == pytest.approx(one.volume, rel=0.02)
    assert other.force == pytest.approx(one.force, abs=0.02 * one.volume)


def test_the_wrench_is_a_derivative(views, cube):
    surfaces, _ = views
    contact = palpate.Contact(cube)
    pose = np.array([0.02, 0.01, 0.94, 0, 0, 0, 1.0])
    result = contact.measure(surfaces, pose, stiffness=True)
    step = 1e-4
    for axis in range(3):
        moved = [pose + step * sign * np.eye(7)[axis] for sign in (1, -1)]
        more, less = (contact.measure(surfaces, p) for p in moved)
        slope = -(more.potential - less.potential) / (2 * step)
        assert result.force[axis] == pytest.approx(slope, abs=5e-3 * result.volume)
        change = -(more.force - less.force) / (2 * step)
        largest = np.abs(result.stiffness[:3, :3]).max()
        assert result.stiffness[:3, axis] == pytest.approx(change, abs=0.1 * largest)


def test_a_camera_anywhere_is_the_camera_at_the_origin(views, cube):
    """The same scene and tool, moved together."""
    surfaces, poses = views
    contact = palpate.Contact(cube)
    X = pose_matrix([0.3, -1, 2, 0.1, 0.7, -0.3, 0.6])
    here = contact.measure(surfaces, [0, 0, 0.94, 0, 0, 0, 1])
    v, u = np.mgrid[0:480, 0:640]
    rays_C = np.stack([(u - 319.5) / 525, (v - 239.5) / 525, np.ones(u.shape)], -1)
    moved = []
    for pose in poses:
        depth = first_hit(pose[:3, 3], rays_C @ pose[:3, :3].T).astype(np.float32)
        depth[~np.isfinite(depth)] = 0
        camera = palpate.Camera(640, 480, 525, 525, 319.5, 239.5, pose=X @ pose)
        moved.append(palpate.Sensor(camera, joined=True).update(depth))
    tool = np.eye(4)
    tool[2, 3] = 0.94
    there = contact.measure(moved, X @ tool)
    assert there.volume == pytest.approx(here.volume, rel=1e-4)
    assert there.force == pytest.approx(X[:3, :3] @ here.force, abs=1e-4 * here.volume)


def test_what_cannot_be_joined_is_refused(views, cube, camera):
    surfaces, _ = views
    alone = palpate.Sensor(camera).update(np.full((120, 160), 0.8, np.float32))
    pose = [0, 0, 0.8, 0, 0, 0, 1]
    with pytest.raises(palpate.Error, match="joined=True"):
        palpate.Contact(cube).measure([surfaces[0], alone], pose)
    with pytest.raises(palpate.Error, match="method"):
        palpate.Contact(cube, "weighted").measure(surfaces, pose)
    with pytest.raises(ValueError, match="16"):
        palpate.Contact(cube).measure([surfaces[0]] * 17, pose)
    for wrong in ([], [3], [surfaces[0], None], "surface"):
        with pytest.raises(TypeError, match="Surface"):
            palpate.Contact(cube).measure(wrong, pose)
    assert palpate.Contact(cube).measure([alone], pose).volume > 0


def test_frames_of_a_camera_end_when_they_are_closed():
    """The first image of a simulated wall is the one that is rendered, within its noise; after close none comes."""
    frames = palpate.CameraFrames("scene:wall", in_real_time=False)
    depth, camera, _ = palpate.render_scene("wall", 0.0)
    time, counts, pose = next(frames)
    assert counts.shape == depth.shape == (frames.camera.height, frames.camera.width)
    assert np.allclose(pose[3:], [0, 0, 0, 1]) and time >= 0
    seen = (counts > 0) & (depth > 0)
    assert np.abs(counts[seen] * frames.camera.unit - depth[seen]).mean() < 0.005
    assert next(frames)[0] > time
    frames.close()
    with pytest.raises(StopIteration):
        next(frames)
    with pytest.raises(palpate.Error, match="nowhere"):
        palpate.CameraFrames("nowhere:")
