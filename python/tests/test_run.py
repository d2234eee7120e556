"""palpate.touch along a path, and palpate.Run: forces, and recordings as arrays."""

import csv
import json
import os
import subprocess

import numpy as np
import pytest
from conftest import PATH

import palpate


@pytest.fixture(scope="module")
def recorded(cube, tmp_path_factory):
    run = palpate.touch(cube, "scene:wall", PATH, duration=0.5, output=tmp_path_factory.mktemp("run") / "a")
    run.wait()
    return run


def test_several_cameras_of_which_one_moves(cube, recorded, tmp_path):
    """The wall is at the same place from every camera pose."""
    poses = tmp_path / "poses.tum"
    times = np.linspace(0, 2, 41)
    poses.write_text("".join(f"{t} {0.1 * t} 0 {-0.05 * t} 0 0 0 1\n" for t in times))
    cameras = [f"scene:wall?poses={poses}", "scene:wall?pose=-0.2,0,0,0,0.0998334,0,0.9950042"]
    run = palpate.touch(cube, cameras, PATH, duration=0.5, output=tmp_path / "run")
    run.wait()
    deep = recorded.volume > 0.1 * cube.volume
    assert run.volume[deep] == pytest.approx(recorded.volume[deep], rel=0.05)
    moving, still = list(run.frames()), list(run.frames(camera=1))
    assert len(moving) == len(still) == len(list(recorded.frames()))
    rows = run.frame_records["camera"] == 0
    x = run.frame_records["camera_pose.position.x"]
    assert x[rows] == pytest.approx(0.1 * run.frame_records["source_time"][rows], abs=1e-9)
    assert (x[~rows] == -0.2).all()
    assert run.contacts["cameras.1.camera_frame"][-1] == len(still) - 1
    with pytest.raises(ValueError, match="the run has 2"):
        run.frames(camera=2)


def test_a_path_on_a_simulated_clock(cube, recorded):
    assert recorded.times == pytest.approx(np.arange(500) / 1000)
    expected = np.array([np.interp(recorded.times, PATH[:, 0], PATH[:, 3])])
    assert recorded.poses[:, 2] == pytest.approx(expected[0], abs=1e-12)
    assert recorded.poses[:, 3:] == pytest.approx(np.tile([0, 0, 0, 1], (500, 1)))
    # A wall: the part of the cube behind it, and a force back along the camera's axis.
    inside = np.clip(recorded.poses[:, 2] + 0.02 - 1, 0, 0.04) * 0.04**2
    deep = inside > 0.1 * cube.volume
    assert recorded.volume[deep] == pytest.approx(inside[deep], rel=0.1)
    force = -inside[deep] * recorded.summary["newtons_per_m3"]
    assert recorded.wrench[deep, 2] == pytest.approx(force, rel=0.1)
    assert np.abs(recorded.wrench[:, :2]).max() < 0.05 * np.abs(recorded.wrench[:, 2]).max()


def test_the_arrays_are_those_of_the_files(recorded):
    with (recorded.folder / "wrench.csv").open() as file:
        rows = list(csv.DictReader(file))
    for name in rows[0]:
        assert np.array_equal(recorded.table[name], [float(row[name]) for row in rows], equal_nan=True)
    assert recorded.summary == json.loads((recorded.folder / "summary.json").read_text())
    ticks = recorded.ticks
    assert np.array_equal(ticks["number"], np.arange(500))
    assert np.array_equal(ticks["coupling.contact.force.z"], recorded.wrench[:, 2])
    assert np.array_equal(ticks["penetration.volume"], recorded.volume)
    assert recorded.contacts["number"].size == recorded.summary["contacts"]
    assert recorded.frame_records["number"].size == recorded.summary["frames"]


def test_frames_and_tool_come_back(cube, recorded):
    frames = list(recorded.frames())
    assert len(frames) == recorded.summary["frames"]
    times = [at for at, _ in frames]
    assert times == sorted(times)
    assert all(image.dtype == np.uint16 and image.shape == (480, 640) for _, image in frames)
    assert 990 < np.median(frames[0][1]) < 1010
    assert recorded.camera.width == 640 and recorded.camera.fx == pytest.approx(575.8157)
    assert np.array_equal(recorded.tool.spheres, cube.spheres)


def test_the_same_run_by_the_program(cube, recorded, tmp_path):
    """The program and the module give the same bits."""
    program = os.environ.get("PALPATE_PROGRAM")
    if not program:
        pytest.skip("the program: PALPATE_PROGRAM names none")
    cube.save(tmp_path / "cube.palp")
    lines = [" ".join(repr(float(x)) for x in row) for row in PATH]
    (tmp_path / "path.txt").write_text("\n".join(lines) + "\n")
    subprocess.run(
        [program, "touch", tmp_path / "cube.palp", "--camera", "scene:wall", "--path",
         tmp_path / "path.txt", "--duration", "0.5", "-o", tmp_path / "b"], check=True)
    run = palpate.Run.open(tmp_path / "b")
    assert np.array_equal(run.wrench, recorded.wrench, equal_nan=True)
    assert np.array_equal(run.poses, recorded.poses)
    subprocess.run([program, "replay", recorded.folder], check=True)


def test_a_cut_off_recording_is_read(recorded, tmp_path):
    folder = tmp_path / "cut"
    folder.mkdir()
    whole = (recorded.folder / "recording.mcap").read_bytes()
    (folder / "recording.mcap").write_bytes(whole[: len(whole) - 2000])
    run = palpate.Run.open(folder)
    num = run.times.size
    assert 100 < num <= 500
    assert np.array_equal(run.wrench, recorded.wrench[:num])
    assert np.array_equal(run.volume, recorded.volume[:num])
    with pytest.raises(palpate.Error, match="summary.json"):
        run.summary


def test_pandas(recorded):
    pandas = pytest.importorskip("pandas")
    table = recorded.to_dataframe()
    assert isinstance(table, pandas.DataFrame) and len(table) == 500
    assert table["force_z_N"].min() == recorded.wrench[:, 2].min()


def test_plots(recorded):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from palpate import plot

    for draw, num in ((plot.wrench, 3), (plot.torque, 3), (plot.volume, 1), (plot.latency, 2)):
        axes = draw(recorded)
        assert len(axes.lines) == num
        assert axes.lines[0].get_xdata() == pytest.approx(recorded.times)
        assert "time, s" in axes.get_xlabel() and axes.get_ylabel()
    again = plot.volume(recorded, axes=axes)
    assert again is axes


def test_bad_requests(cube, tmp_path):
    def refused(error, words, *arguments, **keywords):
        with pytest.raises(error, match=words):
            palpate.touch(cube, *arguments, **keywords)

    refused(palpate.Error, "no scene 'nowhere'", "scene:nowhere", PATH)
    for cameras in (None, 3, b"scene:wall"):
        refused(TypeError, "cameras: a camera as text, .* is taken, not", cameras, PATH)
    refused(ValueError, r"path: shape \(2, 7\) is not \(N, 8\)", "scene:wall", PATH[:, :7])
    refused(ValueError, "row 1", "scene:wall", PATH[::-1])
    refused(palpate.Error, "nearest one is 'contact_method'", "scene:wall", PATH, contact_metod="graph")
    refused(palpate.Error, "no setting 'rate'", "scene:wall", PATH, rate=3)
    refused(palpate.Error, "contact_rate", "scene:wall", PATH, contact_rate=0)
    refused(ValueError, "duration", "scene:wall", PATH, duration=0)
    refused(palpate.Error, "method field", ["scene:wall", "scene:hand"], PATH, method="graph")
    refused(ValueError, "one, or several", [], PATH)
    refused(palpate.Error, "no-such", "scene:wall", tmp_path / "no-such.txt")
    refused(palpate.Error, "one device", "scene:wall", "sim", device="sim")
    refused(TypeError, "write", "scene:wall", device=object())
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "letter").write_text("mine")
    refused(palpate.Error, "taken", "scene:wall", PATH, output=tmp_path / "taken")
    for folder, words in ((tmp_path / "none", "no folder"), (tmp_path, "holds no run")):
        with pytest.raises(palpate.Error, match=words):
            palpate.Run.open(folder)
    (tmp_path / "wrench.csv").write_text("time_s\nfour\n")
    with pytest.raises(palpate.Error, match="wrench.csv cannot be read"):
        palpate.Run.open(tmp_path).times
