"""palpate.poses and palpate query of Parquet: shards, interruptions and invalid files."""

import os
import signal
import subprocess
import time

import numpy as np
import pytest

import palpate

pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
from pyarrow import parquet  # noqa: E402

from palpate import poses as many  # noqa: E402

NUM = 5000
PROGRAM = os.environ.get("PALPATE_PROGRAM")


@pytest.fixture(scope="module")
def task(cube, tmp_path_factory):
    """A folder with a tool, three frames, and poses at their surfaces."""
    folder = tmp_path_factory.mktemp("poses")
    cube.save(folder / "cube.palp")
    images, camera = [], None
    for time_s in (0.0, 0.5, 1.0):
        depth, camera, _ = palpate.render_scene("pillar", time_s, width=160, height=120)
        images.append(depth)
    np.save(folder / "frames.npy", np.stack(images))
    random = np.random.default_rng(3)
    at = palpate.Sensor(camera).update(images[0]).points[30:90, 40:120].reshape(-1, 3)
    X_WT = np.concatenate([at[random.integers(0, len(at), NUM)], random.normal(size=(NUM, 4))], axis=1)
    columns = dict(zip(many.POSE, X_WT.T))
    columns["frame"] = random.integers(0, 3, NUM).astype(np.int32)
    columns["name"] = np.array([f"pose {i}" for i in range(NUM)])
    parquet.write_table(pyarrow.table(columns), folder / "poses.parquet", row_group_size=700)
    return folder, camera, np.stack(images), X_WT, columns["frame"]


@pytest.fixture(autouse=True)
def small_parts(monkeypatch):
    monkeypatch.setattr(many, "_ROWS_IN_PART", 900)


def measured(task, output, **how):
    folder, camera, *_ = task
    frames = many.Frames.open(folder / "frames.npy", camera)
    assert many.measure_file(folder / "cube.palp", folder / "poses.parquet", output, frames, **how) > 0
    return parquet.read_table(output)


def bytes_of(table):
    return [table[name].to_numpy().tobytes() for name in many.ANSWERS]


def test_answers_are_those_of_single_measurements(task, cube, tmp_path):
    _, camera, images, X_WT, frame = task
    table = measured(task, tmp_path / "out.parquet")
    assert table["name"].to_pylist() == [f"pose {i}" for i in range(NUM)]
    contact = palpate.Contact(cube)
    for k in range(3):
        surface = palpate.Sensor(camera).update(images[k])
        for i in np.flatnonzero(frame == k)[:20]:
            one = contact.measure(surface, X_WT[i])
            row = [table[name][int(i)].as_py() for name in many.ANSWERS]
            assert row == [one.volume, one.potential, *one.force, *one.torque, int(one.status)]
    assert (table["volume_m3"].to_numpy() > 0).sum() > NUM / 2
    assert os.listdir(tmp_path) == ["out.parquet"]


def test_shards_are_the_whole(task, tmp_path):
    whole = bytes_of(measured(task, tmp_path / "whole.parquet"))
    for num in (2, 7):
        shards = [measured(task, tmp_path / f"{num}-{k}.parquet", shard=(k, num)) for k in range(1, num + 1)]
        assert bytes_of(pyarrow.concat_tables(shards)) == whole


def test_a_shard_reads_its_rows_of_one_large_group(task, tmp_path, monkeypatch):
    """Files of other programs have row groups of a million rows."""
    folder, *_ = task
    whole = bytes_of(measured(task, tmp_path / "whole.parquet"))
    table = parquet.read_table(folder / "poses.parquet")
    parquet.write_table(table, tmp_path / "one.parquet", row_group_size=NUM)
    file = parquet.ParquetFile(tmp_path / "one.parquet")
    monkeypatch.setattr(many, "_ROWS_IN_PART", 200)
    for begin, end in ((0, NUM), (0, 1000), (1300, 1750), (4900, NUM), (300, 300)):
        parts = list(many._rows(file, begin, end))
        assert [len(part) for part in parts] == [min(200, end - at) for at in range(begin, end, 200)]
        if parts:
            assert pyarrow.concat_tables(parts).equals(table.slice(begin, end - begin))
    # Rows after a shard are not read.
    taken = []

    class Counted:
        metadata = file.metadata

        def iter_batches(self, *asked, **how):
            for batch in file.iter_batches(*asked, **how):
                taken.append(len(batch))
                yield batch

    assert sum(len(part) for part in many._rows(Counted(), 1300, 1750)) == 450
    assert sum(taken) == 1800
    frames = many.Frames.open(folder / "frames.npy", task[1])
    monkeypatch.setattr(many, "_ROWS_IN_PART", 900)
    shards = []
    for k in range(1, 4):
        output = tmp_path / f"{k}.parquet"
        many.measure_file(folder / "cube.palp", tmp_path / "one.parquet", output, frames, shard=(k, 3))
        shards.append(parquet.read_table(output))
    assert bytes_of(pyarrow.concat_tables(shards)) == whole


def test_frames_in_zarr(task, tmp_path):
    zarr = pytest.importorskip("zarr", reason="zarr is not installed")
    folder, camera, images, *_ = task
    zarr.save_array(tmp_path / "frames.zarr", images)
    frames = many.Frames.open(tmp_path / "frames.zarr", camera)
    assert len(frames) == 3 and np.array_equal(frames.image(1), images[1])
    many.measure_file(folder / "cube.palp", folder / "poses.parquet", tmp_path / "out.parquet", frames)
    whole = measured(task, tmp_path / "whole.parquet")
    assert bytes_of(parquet.read_table(tmp_path / "out.parquet")) == bytes_of(whole)


def test_what_is_interrupted_goes_on(task, tmp_path, monkeypatch):
    whole = bytes_of(measured(task, tmp_path / "whole.parquet"))
    output = tmp_path / "out.parquet"

    def stop(done, num):
        if done > 2000:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measured(task, output, progress=stop)
    parts = sorted((tmp_path / "out.parquet.parts").glob("*.parquet"))
    assert len(parts) == 3 and not output.exists()
    before = [part.stat().st_mtime_ns for part in parts]
    seen = []

    def look(done, num):
        seen.append([part.stat().st_mtime_ns for part in parts])

    assert bytes_of(measured(task, output, progress=look)) == whole
    assert seen[0] == before  # not made again
    assert not (tmp_path / "out.parquet.parts").exists()
    # A finished task is not repeated; the output of another task is not overwritten.
    when = output.stat().st_mtime_ns
    measured(task, output)
    assert output.stat().st_mtime_ns == when
    with pytest.raises(palpate.Error, match="is there already, with other answers"):
        measured(task, output, shard=(1, 2))


def test_parts_of_another_task_are_not_mixed(task, tmp_path):
    output = tmp_path / "out.parquet"

    def stop(done, num):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measured(task, output, progress=stop)
    with pytest.raises(palpate.Error, match="parts of another task"):
        measured(task, output, volumes="spheres")


def test_another_camera_is_another_task(task, tmp_path):
    folder, camera, images, *_ = task
    of = {"width": 160, "height": 120, "fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy, "unit": 0.001}
    output = tmp_path / "out.parquet"

    def answer(**changed):
        frames = many.Frames(images, palpate.Camera(**{**of, **changed}))
        many.measure_file(folder / "cube.palp", folder / "poses.parquet", output, frames)

    answer()
    for name, value in (("unit", 0.0002), ("fx", camera.fx + 1e-9), ("cy", 60.0), ("pose", [0, 0, 1, 0, 0, 0, 1])):
        with pytest.raises(palpate.Error, match="with other answers"):
            answer(**{name: value})
    answer()


def test_what_is_refused_leaves_nothing(task, tmp_path):
    folder, camera, images, X_WT, frame = task
    columns = {**dict(zip(many.POSE, X_WT[:5].T)), "frame": frame[:5]}
    for changed, words in (({"frame": frame[:5] + 0.5}, "no whole numbers"), ({"status": frame[:5]}, "one of the answers"),
                           ({"tx": ["a"] * 5}, "holds no numbers"), ({"frame": None}, "column frame has to say")):
        given = {name: value for name, value in {**columns, **changed}.items() if value is not None}
        parquet.write_table(pyarrow.table(given), tmp_path / "poses.parquet")
        with pytest.raises(ValueError, match=words):
            many.measure_file(folder / "cube.palp", tmp_path / "poses.parquet", tmp_path / "out.parquet",
                              many.Frames(images, camera))
        assert os.listdir(tmp_path) == ["poses.parquet"]
    parquet.write_table(pyarrow.table(columns), tmp_path / "poses.parquet")
    for there in ("poses.parquet", "text"):
        (tmp_path / "text").write_text("no table")
        with pytest.raises(palpate.Error, match="is there already"):
            many.measure_file(folder / "cube.palp", tmp_path / "poses.parquet", tmp_path / there,
                              many.Frames(images, camera))


def test_frames_in_many_forms(task, tmp_path):
    folder, camera, images, *_ = task
    counts = np.round(np.nan_to_num(images) * 1000).astype(np.uint16)
    np.save(tmp_path / "one.npy", counts[0])
    assert np.array_equal(many.Frames.open(tmp_path / "one.npy", camera).image(0), counts[0])
    frames = many.Frames([tmp_path / "one.npy"], camera, poses=[[1, 0, 0, 0, 0, 0, 1]])
    assert len(frames) == 1 and np.array_equal(frames.image(0), counts[0])
    with pytest.raises(palpate.Error, match="no depth images"):
        many.Frames.open(tmp_path, camera)
    with pytest.raises(palpate.Error, match="cannot be read"):
        many.Frames.open(tmp_path / "none.npy", camera)
    with pytest.raises(ValueError, match="1 of 3 frames"):
        many.Frames(images, camera, poses=[[1, 0, 0, 0, 0, 0, 1]])


def test_poses_without_a_place(task, tmp_path):
    folder, camera, images, X_WT, frame = task
    frames = many.Frames(images, camera)
    measurer = many.Measurer(folder / "cube.palp", frames)
    columns = dict(zip(many.POSE, X_WT[:4].T))
    with pytest.raises(ValueError, match="3 frames a column frame"):
        measurer(columns)
    answers = measurer({**columns, "frame": np.array([0, 1, 3, -1])})
    assert list(answers["status"] == int(palpate.Status.NO_SURFACE)) == [False, False, True, True]
    del columns["qw"]
    with pytest.raises(ValueError, match="no column qw"):
        measurer(columns)


def test_files_that_are_none(task, tmp_path):
    folder, camera, *_ = task
    frames = many.Frames.open(folder / "frames.npy", camera)

    def refused(poses, match, output="out.parquet"):
        with pytest.raises(palpate.Error, match=match):
            many.measure_file(folder / "cube.palp", poses, tmp_path / output, frames)
        assert not (tmp_path / output).exists() and not (tmp_path / (output + ".parts")).exists()

    refused(tmp_path / "none.parquet", "cannot be read as Parquet")
    (tmp_path / "text.parquet").write_text("no table")
    refused(tmp_path / "text.parquet", "cannot be read as Parquet")
    parquet.write_table(pyarrow.table({"tx": [1.0]}), tmp_path / "short.parquet")
    refused(tmp_path / "short.parquet", "has no column ty, tz, qx, qy, qz, qw")
    for text in ("0/3", "4/3", "1", "a/b", "1/0"):
        with pytest.raises(palpate.Error, match="give K/N"):
            many.parse_shard(text)


@pytest.mark.skipif(not PROGRAM, reason="the program is not installed")
class TestProgram:
    def query(self, task, *more):
        folder, camera, *_ = task
        intrinsics = ",".join(repr(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy))
        return [PROGRAM, "query", str(folder / "cube.palp"), "--poses", str(folder / "poses.parquet"), "--depth",
                str(folder / "frames.npy"), "--intrinsics", intrinsics, *map(str, more)]

    def test_it_is_the_same(self, task, tmp_path):
        run = subprocess.run(self.query(task, "-o", tmp_path / "out.parquet", "--shard", "2/3"), capture_output=True,
                             text=True)
        assert run.returncode == 0, run.stderr
        begin, end = NUM // 3, NUM * 2 // 3
        assert run.stdout == f"{end - begin} poses answered: {tmp_path / 'out.parquet'}\n"
        whole = measured(task, tmp_path / "whole.parquet")
        assert bytes_of(parquet.read_table(tmp_path / "out.parquet")) == bytes_of(whole.slice(begin, end - begin))

    def test_auto_is_the_cpu_where_there_is_no_gpu(self, task, tmp_path):
        try:
            palpate.Sensor(task[1], place="cuda")
            pytest.skip("there is a GPU")
        except palpate.Error:
            pass
        run = subprocess.run(self.query(task, "-o", tmp_path / "out.parquet", "--backend", "auto"), capture_output=True,
                             text=True)
        assert run.returncode == 0 and run.stderr.startswith("palpate: note: backend cpu is used: "), run.stderr
        assert bytes_of(parquet.read_table(tmp_path / "out.parquet")) == bytes_of(measured(task, tmp_path / "b.parquet"))

    def test_it_goes_on_after_a_kill(self, task, tmp_path):
        output = tmp_path / "out.parquet"
        command = self.query(task, "-o", output)
        for _ in range(3):
            run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            while run.poll() is None and not (tmp_path / "out.parquet.parts").exists():
                time.sleep(0.001)
            run.send_signal(signal.SIGKILL)
            run.wait()
        assert subprocess.run(command, stdout=subprocess.DEVNULL).returncode == 0
        assert bytes_of(parquet.read_table(output)) == bytes_of(measured(task, tmp_path / "whole.parquet"))

    def test_one_clear_error(self, task, tmp_path):
        for more, words in (
                (["-o", tmp_path / "out.parquet", "--shard", "9/3"], "give K/N"),
                (["-o", tmp_path / "out.parquet", "--pose", "1"], "unrecognized arguments"),
                ([], "-o/--output"),
                (["-o", tmp_path / "out.parquet", "--intrinsics", "1,2"], "give fx,fy,cx,cy, not '1,2'"),
                (["-o", tmp_path / "out.parquet", "--intrinsics", "525 525 319.5 239.5"], "give fx,fy,cx,cy"),
                (["-o", tmp_path / "out.parquet", "--intrinsics", "525,525 319.5,239.5"], "give fx,fy,cx,cy"),
                (["-o", tmp_path / "out.parquet", "--intrinsics", "0.5,525,319.5,239.5"], "at least 1 pixel"),
                (["-o", tmp_path / "out.parquet", "--depth-unit", "5"], "--depth-unit: must be a number from 1e-6 to 1 m"),
                (["-o", tmp_path / "out.parquet", "--depth-unit", "nan"], "--depth-unit: must be"),
                (["-o", tmp_path / "out.parquet", "--camera-pose", "0 0 0 0 0 0 0"], "give 'tx ty tz qx qy qz qw'"),
                (["-o", tmp_path / "out.parquet", "--threads", "-1"], "--threads: must be a whole number from 0 to 256"),
                (["-o", tmp_path / "out.parquet", "--backend", "gpu"], "--backend")):
            run = subprocess.run(self.query(task, *more), capture_output=True, text=True)
            assert run.returncode == 2 and words in run.stderr, run.stderr
            assert len(run.stderr.splitlines()) == 1 and run.stdout == ""
            assert os.listdir(tmp_path) == []
