"""Fixtures of the Python module's tests: a tool, surfaces with known truth."""

import os
from pathlib import Path

import numpy as np
import pytest

import palpate

CUBE_VERTICES = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.02
CUBE_TRIANGLES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
])
#: Into the wall at 1 m, 10 mm deep, in half a second.
PATH = np.array([[0, 0, 0, 0.95, 0, 0, 0, 1], [0.5, 0, 0, 0.99, 0, 0, 0, 1]])


@pytest.fixture(scope="session")
def cube():
    """A cube with sides of 40 mm in 300 spheres."""
    return palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 300)


@pytest.fixture(scope="session")
def camera():
    return palpate.Camera(160, 120, 140.0, 140.0, 79.5, 59.5)


def plane_depth(camera, normal, distance):
    """Exact depth (m) of the plane normal . x = -distance in the frame C, by its closed form."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1
    )
    return (-distance / (rays @ normal)).astype(np.float32)


@pytest.fixture
def data():
    """The folder of real frames."""
    folder = os.environ.get("PALPATE_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("real frames: PALPATE_DATA names no folder")
    return Path(folder)


def pose_matrix(seven):
    """(4, 4) of tx ty tz qx qy qz qw, by the textbook."""
    x, y, z, w = np.asarray(seven[3:], float) / np.linalg.norm(seven[3:])
    X = np.eye(4)
    X[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    X[:3, 3] = seven[:3]
    return X
