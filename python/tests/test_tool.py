"""palpate.pack, palpate.Tool and tool files against closed forms and brute force."""

import os
import signal
import threading
import time

import numpy as np
import pytest
from conftest import CUBE_TRIANGLES, CUBE_VERTICES

import palpate


def test_spheres_are_disjoint_and_inside(cube):
    centers, radii = cube.spheres[:, :3].astype(float), cube.spheres[:, 3].astype(float)
    assert cube.spheres.shape == (300, 4) and cube.spheres.dtype == np.float32
    apart = np.linalg.norm(centers[:, None] - centers[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    assert (apart >= radii[:, None] + radii[None]).all()
    assert (np.abs(centers).max(axis=1) + radii <= 0.02).all()


def test_masses_are_those_of_the_spheres(cube):
    volumes = 4 / 3 * np.pi * cube.spheres[:, 3].astype(float) ** 3
    centers = cube.spheres[:, :3].astype(float)
    middle = (volumes[:, None] * centers).sum(0) / volumes.sum()
    assert cube.volume == pytest.approx(0.04**3)
    assert cube.sphere_volume == pytest.approx(volumes.sum())
    assert cube.center_of_mass == pytest.approx(middle, abs=1e-12)
    inertia = np.zeros((3, 3))
    for m, r, c in zip(volumes, cube.spheres[:, 3].astype(float), centers - middle):
        inertia += m * ((0.4 * r * r + c @ c) * np.eye(3) - np.outer(c, c))
    assert cube.inertia == pytest.approx(inertia, rel=1e-9, abs=1e-20)


def test_arrays_are_views_that_outlive_the_tool():
    tool = palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 20)
    spheres, again = tool.spheres, tool.spheres
    assert np.shares_memory(spheres, again)
    assert not spheres.flags.writeable
    for name in ("edges", "center_of_mass", "inertia"):
        view = getattr(tool, name)
        assert np.shares_memory(view, getattr(tool, name)) and not view.flags.writeable, name
    copy = spheres.copy()
    del tool, again
    assert np.array_equal(spheres, copy)


def test_edges_and_mesh(cube):
    edges = cube.edges
    assert edges.dtype == np.int32 and edges.shape[1] == 2
    assert (edges[:, 0] < edges[:, 1]).all() and edges.max() < 300
    vertices, triangles = cube.mesh
    corners = vertices[triangles]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(0.04**3)


def test_packing_takes_any_numbers_and_scale():
    integers = np.sign(CUBE_VERTICES).astype(np.int16)
    tool = palpate.pack(integers.tolist(), CUBE_TRIANGLES.astype(np.uint8), 50, scale=0.02)
    fortran = palpate.pack(np.asfortranarray(CUBE_VERTICES), CUBE_TRIANGLES, 50)
    assert np.array_equal(tool.spheres, fortran.spheres)
    seeded = palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 50, seed=1)
    assert not np.array_equal(tool.spheres, seeded.spheres)


def test_a_tool_file_gives_the_same_tool(cube, tmp_path):
    cube.save(tmp_path / "cube.palp")
    loaded = palpate.load_tool(str(tmp_path / "cube.palp"))
    assert np.array_equal(loaded.spheres, cube.spheres)
    assert np.array_equal(loaded.edges, cube.edges)
    assert np.array_equal(loaded.prefix(10).spheres, cube.spheres[:10])


def test_a_mesh_file_is_read_in_its_unit(tmp_path):
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE_VERTICES * 1000]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in CUBE_TRIANGLES]
    (tmp_path / "cube.obj").write_text("\n".join(lines) + "\n")
    tool = palpate.pack_file(tmp_path / "cube.obj", 10, unit="mm")
    assert tool.volume == pytest.approx(0.04**3)
    with pytest.raises(ValueError, match="unit"):
        palpate.pack_file(tmp_path / "cube.obj", 10, unit="furlong")


def test_progress_is_told_and_ends_it():
    told = []
    palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 3000, progress=lambda *now: told.append(now))
    assert told and all(0 <= spheres <= 3000 and 0 <= fill < 1 for spheres, fill, _ in told)
    with pytest.raises(palpate.Error):
        palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 100000, progress=lambda *now: False)
    with pytest.raises(ZeroDivisionError):
        palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 100000, progress=lambda *now: 1 / 0)


def test_ctrl_c_ends_packing_while_other_threads_go_on():
    def interrupt_later():  # needs the GIL for every step
        for _ in range(300):
            time.sleep(0.001)
        os.kill(os.getpid(), signal.SIGINT)

    other = threading.Thread(target=interrupt_later)
    with pytest.raises(KeyboardInterrupt):
        other.start()
        palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 500000)
    other.join()


@pytest.mark.parametrize(
    "vertices, triangles, error, words",
    [
        (CUBE_VERTICES[:, :2], CUBE_TRIANGLES, ValueError, r"vertices: shape \(8, 2\) is not \(V, 3\)"),
        (CUBE_VERTICES, CUBE_TRIANGLES.ravel(), ValueError, r"triangles: shape \(36,\) is not \(F, 3\)"),
        (CUBE_VERTICES, CUBE_TRIANGLES + 1, ValueError, "names vertex 8"),
        (CUBE_VERTICES, CUBE_TRIANGLES[:-1], palpate.Error, "open edges"),
        (CUBE_VERTICES * np.nan, CUBE_TRIANGLES, palpate.Error, "finite"),
        ("words", CUBE_TRIANGLES, ValueError, "vertices: not an array"),
        (CUBE_VERTICES, np.zeros((0, 3), int), palpate.Error, "mesh"),
    ],
)
def test_bad_meshes(vertices, triangles, error, words):
    with pytest.raises(error, match=words):
        palpate.pack(vertices, triangles, 10)


def test_bad_limits_and_files(tmp_path):
    with pytest.raises(palpate.Error, match="spheres"):
        palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 0)
    with pytest.raises(palpate.Error, match="no setting 'min_radiu'.*min_radius"):
        palpate.pack(CUBE_VERTICES, CUBE_TRIANGLES, 10, min_radiu=0.001)
    (tmp_path / "cut.palp").write_bytes(b"palp")
    with pytest.raises(palpate.Error, match="cut.palp"):
        palpate.load_tool(tmp_path / "cut.palp")
    assert issubclass(palpate.Error, RuntimeError)
