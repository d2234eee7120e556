"""palpate.Sensor and palpate.Surface: closed forms of planes, derivatives by differences, DLPack."""

import numpy as np
import pytest
from conftest import plane_depth, pose_matrix

import palpate

#: Off at every axis: X_WC of a camera that stands somewhere.
STANDS = [0.3, -0.2, 0.5, 0.1, 0.7, -0.3, 0.6]


@pytest.mark.parametrize("pose", [None, STANDS])
@pytest.mark.parametrize("normal", [[0, 0, -1], [0.3, 0.2, -0.9]])
def test_a_plane_is_a_plane(camera, normal, pose):
    normal = np.array(normal, float) / np.linalg.norm(normal)
    distance = 0.8
    surface = palpate.Sensor(camera).update(plane_depth(camera, normal, distance), pose=pose)
    X_WC = np.eye(4) if pose is None else pose_matrix(pose)
    random = np.random.default_rng(1)
    # Near it: deep inside, the way to the border of the image is the way out.
    p_C = np.stack([*random.uniform(-0.1, 0.1, (2, 200)), np.zeros(200)], axis=1)
    p_C[:, 2] = -(distance + p_C @ normal) / normal[2] + random.uniform(-0.2, 0.02, 200)
    p_W = p_C @ X_WC[:3, :3].T + X_WC[:3, 3]
    radii = random.uniform(0.005, 0.02, 200)
    assert surface.phi(p_W, radii) == pytest.approx(p_C @ normal + distance, abs=2e-5)
    gradient = surface.gradient(p_W, radii)
    assert gradient == pytest.approx(np.tile(X_WC[:3, :3] @ normal, (200, 1)), abs=2e-3)
    inside = (slice(20, 100), slice(20, 140))
    points_C = (surface.points[inside] - X_WC[:3, 3]) @ X_WC[:3, :3]
    assert points_C @ normal == pytest.approx(np.full(points_C.shape[:2], -distance), abs=2e-5)
    n = surface.normals[inside]
    assert n == pytest.approx(np.broadcast_to(X_WC[:3, :3] @ normal, n.shape), abs=1e-3)


def test_the_gradient_is_the_derivative_of_phi():
    """On a scene with silhouettes, by central differences in double."""
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=160, height=120)
    surface = palpate.Sensor(camera).update(depth, pose=STANDS)
    X_WC = pose_matrix(STANDS)
    random = np.random.default_rng(2)
    p_C = random.uniform([-0.3, -0.2, 0.5], [0.3, 0.2, 1.3], (500, 3))
    points = p_C @ X_WC[:3, :3].T + X_WC[:3, 3]
    radii = random.uniform(0.003, 0.03, 500)
    step = 1e-6
    differences = np.stack(
        [
            (surface.phi(points + step * axis, radii) - surface.phi(points - step * axis, radii))
            / (2 * step)
            for axis in np.eye(3)
        ],
        axis=1,
    )
    gradient = surface.gradient(points, radii)
    # Once continuously differentiable: a few differences straddle a bend.
    off = np.abs(differences - gradient).max(axis=1)
    assert np.quantile(off, 0.98) < 1e-4 and off.max() < 0.05
    assert np.abs(gradient).max() > 0.5


def test_counts_and_meters_of_any_kind_are_one_image(camera):
    counts = np.full((120, 160), 800, np.uint16)
    counts[40:60, 50:80] = 700
    expected = palpate.Sensor(camera).update(counts).points
    meters = counts.astype(np.float32) * np.float32(0.001)
    for same in (meters, meters.astype(float), np.asfortranarray(meters), meters.tolist(),
                 np.repeat(meters, 2, axis=1)[:, ::2], np.asfortranarray(counts), memoryview(counts)):
        np.testing.assert_allclose(palpate.Sensor(camera).update(same).points, expected, atol=1e-6)
    half = palpate.Camera(160, 120, 140, 140, 79.5, 59.5, unit=0.0005)
    assert np.array_equal(palpate.Sensor(half).update(counts * 2).points, expected, equal_nan=True)


def test_pixels_without_measurement(camera):
    counts = np.full((120, 160), 800, np.uint16)
    counts[:, :30], counts[:, -30:] = 0, 65535
    meters = counts * 0.001
    meters[:, -30:] = np.nan
    for image in (counts, meters.astype(np.float32)):
        points = palpate.Sensor(camera, fill_levels=0).update(image).points
        assert np.isnan(points[:, :30]).all() and np.isnan(points[:, -30:]).all()
        assert np.isfinite(points[:, 40:-40]).all()


def test_beside_an_object_before_what_is_far(camera, cube):
    """REP 117: +inf is free space, NaN and -inf are holes, which the object fills."""
    def felt(background, dtype):
        image = np.full((120, 160), background, np.float32)
        image[40:80, :80] = 1.0
        if dtype == np.uint16:
            image = np.where(np.isfinite(image), np.minimum(image, 65.535) * 1000, 65535).round().astype(dtype)
        surface = palpate.Sensor(camera).update(image)
        assert np.isnan(surface.points[:, 100:]).all() == (background != 9.5)
        beside, over = (palpate.Contact(cube).measure(surface, [x, 0, 0.99, 0, 0, 0, 1]).fraction for x in (0.05, 0.0))
        return beside, over

    beside, over = felt(9.5, np.float32)
    assert beside == 0 and 0.05 < over < 0.95
    for background in (10.01, 12, 30, 1e30, np.inf):
        for dtype in (np.float32, np.uint16):
            assert felt(background, dtype) == pytest.approx((0, over), abs=0.01), (background, dtype)
    for background in (np.nan, 0, -1, -np.inf):
        assert felt(background, np.float32)[0] > 0.1, background


def test_surfaces_stay_while_they_are_held(camera):
    sensor = palpate.Sensor(camera)
    depths = [0.5, 0.6, 0.7, 0.8]
    held = [sensor.update(np.full((120, 160), depth, np.float32), time=depth) for depth in depths]
    arrays = [surface.points for surface in held]
    times = [surface.time for surface in held]
    del held
    for _ in range(5):
        sensor.update(np.full((120, 160), 2.0, np.float32))
    assert times == depths
    for depth, points in zip(depths, arrays):
        assert np.nanmax(np.abs(points[..., 2] - depth)) < 1e-6


def test_points_are_not_copied(camera):
    surface = palpate.Sensor(camera).update(np.full((120, 160), 0.8, np.float32))
    assert np.shares_memory(surface.points, surface.points)
    assert np.shares_memory(surface.points, surface.points_C)
    assert np.from_dlpack(surface.normals).base is not None
    moved = palpate.Sensor(camera).update(np.full((120, 160), 0.8, np.float32), pose=STANDS)
    assert np.shares_memory(moved.points_C, moved.points_C)


def test_a_lens_is_straightened(camera):
    """A wall seen through a lens: forward distortion by its formula, then seen flat again."""
    k = [-0.2, 0.05, 0.001, -0.002, 0.01]
    lens = palpate.Camera(160, 120, 140, 140, 79.5, 59.5, distortion=k)
    u, v = np.meshgrid(np.arange(160), np.arange(120))
    xd, yd = (u - 79.5) / 140, (v - 59.5) / 140
    x, y = xd.copy(), yd.copy()
    for _ in range(50):  # the undistorted ray of each raw pixel
        q = x * x + y * y
        radial = 1 + k[0] * q + k[1] * q**2 + k[4] * q**3
        x = (xd - 2 * k[2] * x * y - k[3] * (q + 2 * x * x)) / radial
        y = (yd - k[2] * (q + 2 * y * y) - 2 * k[3] * x * y) / radial
    normal, distance = np.array([0.4, 0.1, -0.9]), 0.9
    raw = (-distance / (x * normal[0] + y * normal[1] + normal[2])).astype(np.float32)
    points = palpate.Sensor(lens, filter=False).update(raw).points[20:100, 20:140]
    off = (points @ normal + distance) / np.linalg.norm(normal)
    assert np.abs(off).max() < 0.004  # the nearest pixel
    bent = palpate.Sensor(camera, filter=False).update(raw).points[20:100, 20:140]
    assert np.abs((bent @ normal + distance) / np.linalg.norm(normal)).max() > 0.008
    assert np.allclose(lens.distortion, k + [0, 0, 0])


def test_bytes_in_another_order_and_masks_are_understood(camera):
    sensor = palpate.Sensor(camera)
    image = np.full((120, 160), 800, np.uint16)
    image[:, 80:] = 900
    points = sensor.update(image).points.copy()
    assert np.isfinite(points[60, 40]).all()
    for other in (image.astype(">u2"), (image * 0.001).astype(">f4"), (image * 0.001).astype(">f8")):
        assert np.allclose(sensor.update(other).points, points, atol=1e-6, equal_nan=True)
    batch = np.stack([image.astype(">u2")] * 2)
    assert len(sensor.update_batch(batch)) == 2
    masked = np.ma.masked_array(image, mask=np.zeros_like(image, bool))
    masked[:, 80:] = np.ma.masked
    seen = sensor.update(masked).points
    assert np.isnan(seen[60, 120]).all()
    assert np.allclose(seen[60, 40], points[60, 40])


def test_bad_images_and_numbers(camera):
    sensor = palpate.Sensor(camera)
    with pytest.raises(ValueError, match=r"depth: shape \(3, 4\) is not the camera's \(120, 160\)"):
        sensor.update(np.zeros((3, 4), np.uint16))
    with pytest.raises(ValueError, match="uint16 counts or float32"):
        sensor.update(np.zeros((120, 160), np.int32))
    for kind in ("S2", "M8[s]", object, [("depth", "u2")]):
        with pytest.raises(ValueError, match="uint16 counts or float32"):
            sensor.update(np.zeros((120, 160), kind))
    for threads in (-1, 257):
        with pytest.raises(ValueError, match="threads: a whole number from 0"):
            palpate.Sensor(camera, threads=threads)
    for k1 in (np.nan, 1e30):
        bent = palpate.Camera(160, 120, 140, 140, 79.5, 59.5, distortion=[k1, 0, 0, 0])
        with pytest.raises(palpate.Error, match="distortion coefficient k1 must be a number"):
            palpate.Sensor(bent)
    with pytest.raises(ValueError, match=r"pose: shape \(3,\) is not \(4, 4\) or \(7,\)"):
        sensor.update(np.zeros((120, 160), np.uint16), pose=[1, 2, 3])
    with pytest.raises(ValueError, match="no rigid motion"):
        sensor.update(np.zeros((120, 160), np.uint16), pose=2 * np.eye(4))
    with pytest.raises(ValueError, match="quaternion"):
        sensor.update(np.zeros((120, 160), np.uint16), pose=np.zeros(7))
    surface = sensor.update(np.full((120, 160), 0.8, np.float32))
    with pytest.raises(ValueError, match=r"points: shape \(3,\) is not \(M, 3\)"):
        surface.phi([0, 0, 1], 0.01)
    with pytest.raises(ValueError, match=r"radii: shape \(2,\) is not \(1,\)"):
        surface.phi([[0, 0, 1]], [0.01, 0.02])
    with pytest.raises(ValueError, match="positive"):
        surface.gradient([[0, 0, 1]], 0.0)
    with pytest.raises(palpate.Error, match="8"):
        palpate.Sensor(palpate.Camera(4, 4, 1, 1, 1, 1))
    with pytest.raises(palpate.Error, match="nearest one is 'surface_max_depth'"):
        palpate.Sensor(camera, max_dept=3)
    with pytest.raises(palpate.Error, match="max_depth"):
        palpate.Sensor(camera, max_depth=-1)
    with pytest.raises(ValueError, match="place"):
        palpate.Sensor(camera, place="tpu")
    with pytest.raises(ValueError, match="distortion"):
        palpate.Camera(160, 120, 140, 140, 79.5, 59.5, distortion=[1, 2])


def test_the_simulated_camera():
    depth, camera, X_WC = palpate.render_scene("wall")
    assert depth.dtype == np.float32 and depth.shape == (camera.height, camera.width)
    assert np.nanmax(np.abs(depth - depth[0, 0])) < 1e-6
    assert np.array_equal(X_WC, [0, 0, 0, 0, 0, 0, 1])
    noisy, *_ = palpate.render_scene("wall", noise=True)
    assert noisy.dtype == np.uint16
    again, *_ = palpate.render_scene("wall", noise=True)
    assert np.array_equal(noisy, again)
    seen = noisy > 0
    assert 0 < np.abs(noisy[seen] * 0.001 - depth[seen]).mean() < 0.01
    with pytest.raises(palpate.Error, match="known are wall"):
        palpate.render_scene("nowhere")
    assert "wall" in palpate.scene_names()


def test_where_no_point_is_there_is_no_distance() -> None:
    camera = palpate.Camera(160, 120, 200, 200, 79.5, 59.5)
    surface = palpate.Sensor(camera).update(np.full((120, 160), 0.8, np.float32))
    points = np.array([[0, 0, 0.7], [np.nan, 0, 0.7], [0, np.nan, 0.7], [0, 0, np.nan], [0, 0, np.inf]])
    assert np.isnan(surface.phi(points, np.full(5, 0.01))).tolist() == [False, True, True, True, True]
    assert np.isnan(surface.gradient(points, np.full(5, 0.01))).all(axis=1).tolist() == [False, True, True, True, True]
    with pytest.raises(ValueError, match="positive"):
        surface.phi(points, np.full(5, np.inf))
