"""palpate.Contact against closed forms: cap volumes, planes, potentials by differences."""

import numpy as np
import pytest
from conftest import plane_depth, pose_matrix

import palpate

STANDS = [0.3, -0.2, 0.5, 0.1, 0.7, -0.3, 0.6]


def cap_volume(r, d):
    """Volume of the part of a ball behind a plane, with its center d in front of the plane."""
    h = np.clip(r - d, 0, 2 * r)
    return np.pi / 3 * h * h * (3 * r - h)


@pytest.fixture(scope="module")
def slanted(camera):
    normal = np.array([0.2, -0.3, -0.9])
    normal /= np.linalg.norm(normal)
    return normal, 0.8, palpate.Sensor(camera).update(plane_depth(camera, normal, 0.8))


@pytest.mark.parametrize("method", ["field", "weighted", "simplified"])
def test_spheres_behind_a_plane(cube, slanted, method):
    """Volume, force and torque of spheres cut by the plane: sums of caps."""
    normal, distance, surface = slanted
    contact = palpate.Contact(cube, method, volumes="spheres")
    R = pose_matrix([0, 0, 0, 0.2, 0.4, -0.1, 0.9])
    for depth in (-0.01, 0.0, 0.01):
        X = R.copy()
        X[:3, 3] = -normal * (distance + depth)
        centers = cube.spheres[:, :3].astype(float) @ X[:3, :3].T + X[:3, 3]
        volumes = cap_volume(cube.spheres[:, 3].astype(float), centers @ normal + distance)
        levers = centers - (X[:3, :3] @ cube.center_of_mass + X[:3, 3])
        result = contact.measure(surface, X)
        # The field measures large balls by smaller ones; points are 6 mm apart.
        tolerance = (0.008 if method == "field" else 0.04) * cube.sphere_volume
        assert result.volume == pytest.approx(volumes.sum(), abs=tolerance)
        assert result.force == pytest.approx(volumes.sum() * normal, abs=tolerance)
        torque = np.cross(levers, volumes[:, None] * normal).sum(0)
        assert result.torque == pytest.approx(torque, abs=tolerance * 0.02)
        assert result.fraction == pytest.approx(result.volume / cube.sphere_volume)
        assert result.status == palpate.Status.OK and not result.status


def test_half_a_cube_behind_a_wall(cube, camera):
    surface = palpate.Sensor(camera).update(np.full((120, 160), 0.8, np.float32))
    result = palpate.Contact(cube).measure(surface, [0, 0, 0.8, 0, 0, 0, 1])
    assert result.volume == pytest.approx(0.04**3 / 2, rel=0.005)
    assert result.fraction == pytest.approx(0.5, rel=0.005)
    assert result.force == pytest.approx([0, 0, -result.volume], abs=1e-4 * result.volume)
    assert result.potential == pytest.approx(0.04**2 * 0.02**2 / 2, rel=0.03)
    assert result.stiffness is None


def test_standard_deviations_by_the_noise(cube, camera):
    """A face of the cube behind a wall: each pixel of noise moves as much volume as its area."""
    depth = (0.8 + 0.0005 * np.random.default_rng(1).standard_normal((120, 160))).astype(np.float32)
    surface = palpate.Sensor(camera, noise_at_zero=0.0005, filter=False).update(depth)
    contact, poses = palpate.Contact(cube), np.array([[0, 0, z, 0, 0, 0, 1] for z in (0.7, 0.8, 0.81)])
    assert contact.measure(surface, poses[1]).volume_std is None
    single = [contact.measure(surface, pose, std=True) for pose in poses]
    assert single[0].volume_std == 0 and single[1].volume_std > 0
    assert single[1].force_std.shape == single[1].torque_std.shape == (3,)
    closed = 0.0005 * 0.04 * 0.8 / camera.fx
    assert single[1].volume_std == pytest.approx(closed, rel=0.5)
    batch = contact.measure_batch(surface, poses, std=True)
    assert batch.volume_std == pytest.approx([result.volume_std for result in single], rel=1e-6)
    assert batch.force_std == pytest.approx(np.array([result.force_std for result in single]), rel=1e-6)
    assert batch.torque_std.shape == (3, 3)
    assert contact.measure_batch(surface, poses).volume_std is None
    own = np.full(3, np.nan)
    contact.measure_batch(surface, poses, std=True, out=palpate.Batch(volume_std=own))
    assert np.array_equal(own, batch.volume_std)
    with pytest.raises(palpate.Error, match='the method "graph" does not say'):
        palpate.Contact(cube, "graph").measure(surface, poses[1], std=True)
    own[:] = -7
    with pytest.raises(palpate.Error, match="not with graph"):
        out = palpate.Batch(volume_std=own)
        palpate.Contact(cube, "graph").measure_batch(palpate.Scene(surface), poses, std=True, out=out)
    assert (own == -7).all()


def test_bodies_have_no_noise(cube):
    batch = palpate.Contact(cube).measure_batch(palpate.Body(cube), np.array([[0.01, 0, 0, 0, 0, 0, 1.0]]), std=True)
    assert batch.volume[0] > 0 and batch.volume_std[0] == 0 and not batch.force_std.any()


@pytest.mark.parametrize("pose", [None, STANDS])
def test_wrench_and_stiffness_are_derivatives(cube, pose):
    """The wrench against differences of the potential, and the stiffness against those of the wrench, with edges."""
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=160, height=120)
    surface = palpate.Sensor(camera).update(depth, pose=pose)
    contact = palpate.Contact(cube)
    X_WC = np.eye(4) if pose is None else pose_matrix(pose)
    X = X_WC @ pose_matrix([*surface.points_C[60, 70], 0.3, 0.1, 0.2, 0.9])
    C = X[:3, :3] @ cube.center_of_mass + X[:3, 3]

    def moved(motion):
        turn = motion[3:]
        angle = np.linalg.norm(turn)
        q = [*(np.sin(angle / 2) * turn / angle if angle else turn), np.cos(angle / 2)]
        R = pose_matrix([0, 0, 0, *q])[:3, :3]
        Y = np.eye(4)
        Y[:3, :3] = R @ X[:3, :3]
        Y[:3, 3] = R @ (X[:3, 3] - C) + C + motion[:3]
        return contact.measure(surface, Y)

    at = contact.measure(surface, X, stiffness=True)
    wrench = np.concatenate([at.force, at.torque])
    scale = np.array([1, 1, 1, 0.02, 0.02, 0.02])
    steps = 1e-4 / scale
    for k, step in enumerate(steps):
        motion = np.eye(6)[k] * step
        ahead, behind = moved(motion), moved(-motion)
        by_difference = (behind.potential - ahead.potential) / (2 * step)
        assert by_difference == pytest.approx(wrench[k], abs=2e-3 * np.linalg.norm(at.force) * scale[k])
        change = np.concatenate([ahead.force - behind.force, ahead.torque - behind.torque]) / (2 * step)
        worst = np.abs(change + at.stiffness[:, k]) / (scale * scale[k])
        assert worst.max() < 0.02 * np.abs(at.stiffness[:3, :3]).max()


def test_a_camera_anywhere_sees_the_same(cube, camera):
    """The whole world moved: the wrench moves with it."""
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=160, height=120)
    X_WC = pose_matrix(STANDS)
    posed = palpate.Camera(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, pose=X_WC)
    here, there = palpate.Sensor(camera).update(depth), palpate.Sensor(posed).update(depth)
    X_CT = pose_matrix([*here.points[60, 70], 0.3, 0.1, 0.2, 0.9])
    contact = palpate.Contact(cube)
    a = contact.measure(here, X_CT, stiffness=True)
    b = contact.measure([there], X_WC @ X_CT, stiffness=True)
    R = np.kron(np.eye(2), X_WC[:3, :3])
    assert b.volume == pytest.approx(a.volume, rel=1e-5)
    assert b.force == pytest.approx(X_WC[:3, :3] @ a.force, rel=1e-4, abs=1e-5 * a.volume)
    assert b.torque == pytest.approx(X_WC[:3, :3] @ a.torque, abs=1e-5 * a.volume * 0.02)
    assert b.stiffness == pytest.approx(R @ a.stiffness @ R.T, abs=1e-4 * np.abs(a.stiffness).max())


def test_poses_of_all_kinds_are_one_pose(cube, slanted):
    _, _, surface = slanted
    contact = palpate.Contact(cube)
    seven = np.array([0.01, 0.02, 0.86, 0.1, -0.2, 0.3, 0.9])
    expected = contact.measure(surface, seven)
    assert expected.volume > 0
    X = pose_matrix(seven)
    for same in (seven.tolist(), seven * [1, 1, 1, -2, -2, -2, -2], X, X.T.copy().T, X.tolist()):
        result = contact.measure(surface, same)
        assert result.volume == pytest.approx(expected.volume, rel=1e-6)
        assert result.torque == pytest.approx(expected.torque, rel=1e-4, abs=1e-13)
    single = contact.measure(surface, X.astype(np.float32))
    assert single.volume == pytest.approx(expected.volume, rel=1e-4)
    # Half a turn about each axis and nearby rotations: every branch of matrix to quaternion.
    for q in np.concatenate([np.eye(4), np.eye(4) + 0.01, -np.eye(4) + 0.02]):
        a = contact.measure(surface, [*seven[:3], *q])
        b = contact.measure(surface, pose_matrix([*seven[:3], *q]))
        assert b.torque == pytest.approx(a.torque, rel=1e-4, abs=1e-13)


def test_repeated_and_threaded_measurements_are_the_same_to_the_bit(cube, slanted):
    from concurrent.futures import ThreadPoolExecutor

    _, _, surface = slanted
    contact = palpate.Contact(cube)
    random = np.random.default_rng(3)
    poses = [[0, 0, z, *random.normal(size=4)] for z in random.uniform(0.83, 0.9, 100)]

    def numbers(pose):
        result = contact.measure(surface, pose, stiffness=True)
        return result.volume, result.potential, *result.force, *result.torque, *result.stiffness.ravel()

    one_by_one = [numbers(pose) for pose in poses]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(numbers, poses)) == one_by_one


def test_what_cannot_be_measured_is_told(cube, slanted):
    _, _, surface = slanted
    contact = palpate.Contact(cube)
    result = contact.measure(surface, [np.nan, 0, 1, 0, 0, 0, 1])
    assert result.status == palpate.Status.NON_FINITE_POSE and result.volume == 0
    X = np.eye(4)
    X[0, 0] = np.inf
    assert contact.measure(surface, X).status == palpate.Status.NON_FINITE_POSE


def test_what_is_unseen(cube, camera):
    """The unseen share by brute force, from the pixel at which each center is seen."""
    image = np.where(np.arange(160) < 80, 0.8, 0).astype(np.float32) * np.ones((120, 1), np.float32)
    surface = palpate.Sensor(camera, fill_levels=0).update(image)
    contact = palpate.Contact(cube)
    radii = cube.spheres[:, 3].astype(float)
    shares = []
    for x in (-0.2, -0.01, 0.005, 0.01, 0.2, 0.46, 5):
        for z in (0.8, -0.8):
            centers = cube.spheres[:, :3].astype(float) + [x, 0, z]
            pixels = np.floor(centers[:, :2] / centers[:, 2:] * 140 + [79.5, 59.5] + 0.5)
            is_inside = (centers[:, 2] > 0) & (pixels >= 0).all(1) & (pixels < [160, 120]).all(1)
            clipped = np.where(is_inside[:, None], pixels, 0).astype(int)
            is_seen = is_inside & (image[clipped[:, 1], clipped[:, 0]] > 0)
            share = (radii**3)[~is_seen].sum() / (radii**3).sum()
            assert contact.measure(surface, [x, 0, z, 0, 0, 0, 1]).unseen == pytest.approx(share)
            shares.append(share)
    assert any(0.1 < share < 0.9 for share in shares)


def test_bad_arguments(cube, slanted):
    _, _, surface = slanted
    contact = palpate.Contact(cube)
    with pytest.raises(ValueError, match=r"pose: shape \(3, 3\) is not \(4, 4\) or \(7,\)"):
        contact.measure(surface, np.eye(3))
    with pytest.raises(TypeError, match="Surface"):
        contact.measure(np.eye(4), np.eye(4))
    with pytest.raises(palpate.Error, match="joined=True"):
        contact.measure([surface, surface], np.eye(4))
    with pytest.raises(palpate.Error, match="one of weighted"):
        palpate.Contact(cube, "feeling")
    with pytest.raises(palpate.Error, match="edges"):
        palpate.Contact(cube, edges="cut")
    if "cuda" not in palpate.__version__:
        try:
            palpate.Contact(cube, place="cuda")
        except palpate.Error as error:
            assert "CUDA" in str(error) or "GPU" in str(error)


def test_results_and_arrays_outlive_what_they_came_from(camera):
    from conftest import CUBE_TRIANGLES, CUBE_VERTICES

    contact = palpate.Contact(palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 20))
    result = contact.measure(
        palpate.Sensor(camera).update(np.full((120, 160), 0.8, np.float32)),
        [0, 0, 0.8, 0, 0, 0, 1], stiffness=True)
    force, stiffness = result.force, result.stiffness
    expected = force.copy(), stiffness.copy()
    del contact, result
    palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 20)
    assert np.array_equal(force, expected[0]) and np.array_equal(stiffness, expected[1])
