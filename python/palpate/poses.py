"""Measures many poses of a tool against many frames: columns of numbers in, columns of numbers out.

`Frames` are depth images of one camera, `Measurer` measures poses against them, and `measure_file`
measures a file of poses in parts: it can be interrupted and resumed, and several machines can share
it. palpate.ray does the same on a cluster. The result of a pose has the same bits in every batch
(palpate.Contact.measure_batch), so parts, shards and machines do not change it.
"""

from __future__ import annotations

import collections
import contextlib
import fcntl
import hashlib
import json
import os
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from palpate import __version__, _core

__all__ = ["ANSWERS", "FRAME", "POSE", "Frames", "Measurer", "measure_file"]

_PathLike = Union[str, "os.PathLike[str]"]
_Columns = Dict[str, NDArray[Any]]

#: Columns of a pose X_WT: m, and a quaternion of any length.
POSE = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")
#: Column of the index of a pose's frame, from 0; may be left out if there is one frame.
FRAME = "frame"
#: Columns of an answer, in W, torque about the tool's center of mass. A status other than 0 is the
#: reason why a pose was not measured (palpate.Status).
ANSWERS = ("volume_m3", "potential_m4", "force_x_m3", "force_y_m3", "force_z_m3", "torque_x_m4",
           "torque_y_m4", "torque_z_m4", "status")

_NUM_SURFACES = 8  # in the cache: about 30 MB each at 640 x 480
_ROWS_IN_PART = 1 << 18
_LIBRARY = "files of poses in Parquet need pyarrow: pip install pyarrow"


class Frames:
    """Depth images of one camera, read on access.

    images: an array (F, H, W) of any type with a shape and indexing (NumPy, Zarr, a memory map),
    in counts of `camera.unit` or m; or a list of files: 16-bit PNGs, or .npy with one image each.
    poses: X_WC of each frame, (F, 4, 4) or (F, 7); none: that of the camera.
    """

    def __init__(self, images: Any, camera: _core.Camera, poses: Optional[Any] = None) -> None:
        self.images, self.camera = images, camera
        self.poses = None if poses is None else np.asarray(poses, np.float64)
        if len(self) == 0:
            raise ValueError("frames: there is none")
        if self.poses is not None and len(self.poses) != len(self):
            raise ValueError(f"poses: {len(self.poses)} of {len(self)} frames")

    @staticmethod
    def open(path: _PathLike, camera: _core.Camera) -> Frames:
        """Opens a folder of PNGs in the order of their names, one PNG, an .npy of (F, H, W) or
        (H, W), or a .zarr of (F, H, W). palpate.Error: there is none."""
        where = Path(path)
        if where.suffix == ".zarr":
            try:
                import zarr  # type: ignore[import-not-found,import-untyped,unused-ignore]
            except ImportError as error:
                raise _core.Error("frames in Zarr need its package: pip install zarr") from error
            return Frames(zarr.open_array(where, mode="r"), camera)
        if where.suffix == ".npy":
            try:
                images = np.load(where, mmap_mode="r")
            except (OSError, ValueError) as error:
                raise _core.Error(f"{where} cannot be read: {error}") from error
            return Frames(images[None] if images.ndim == 2 else images, camera)
        files = sorted(where.glob("*.png")) if where.is_dir() else [where]
        if not files or not files[0].is_file():
            raise _core.Error(f"{where} holds no depth images; give a folder of PNGs, a PNG, .npy or .zarr")
        return Frames(files, camera)

    def __len__(self) -> int:
        return int(self.images.shape[0]) if hasattr(self.images, "shape") else len(self.images)

    def image(self, frame: int) -> NDArray[Any]:
        """Returns the image of a frame: (H, W) counts or m."""
        image = self.images[frame]
        if not isinstance(image, (str, os.PathLike)):
            return np.asarray(image)
        if Path(image).suffix == ".npy":
            return np.asarray(np.load(image))
        return np.asarray(_core.load_depth_png(image))


class Measurer:
    """Measures columns of poses; keeps the surfaces of the last frames.

    tool: a Tool or its file. frames: `Frames`. place, threads and options are those of Contact.
    """

    def __init__(self, tool: Union[_core.Tool, _PathLike], frames: Frames, *, place: str = "cpu",
                 threads: int = 0, **options: str) -> None:
        loaded = tool if isinstance(tool, _core.Tool) else _core.load_tool(tool)
        self._frames = frames
        self._contact = _core.Contact(loaded, place=place, threads=max(1, threads), **options)
        self._place, self._threads = place, threads
        self._surfaces: "collections.OrderedDict[int, _core.Surface]" = collections.OrderedDict()

    def _surface(self, frame: int) -> _core.Surface:
        if frame in self._surfaces:
            self._surfaces.move_to_end(frame)
            return self._surfaces[frame]
        # Each surface has its own sensor, so it stays valid when others are computed.
        sensor = _core.Sensor(self._frames.camera, place=self._place, threads=self._threads)
        pose = None if self._frames.poses is None else self._frames.poses[frame]
        surface = sensor.update(self._frames.image(frame), pose=pose)
        self._surfaces[frame] = surface
        if len(self._surfaces) > _NUM_SURFACES:
            self._surfaces.popitem(last=False)
        return surface

    def __call__(self, columns: Mapping[str, NDArray[Any]]) -> _Columns:
        """Returns the given columns and those of ANSWERS. ValueError: a column of POSE is missing."""
        missing = [name for name in POSE if name not in columns]
        if missing:
            raise ValueError(f"poses: there is no column {', '.join(missing)}; a pose has {', '.join(POSE)}")
        for name in POSE:
            if not np.issubdtype(np.asarray(columns[name]).dtype, np.number):
                raise ValueError(f"poses: the column {name} holds no numbers")
        poses = np.stack([np.asarray(columns[name], np.float64) for name in POSE], axis=1)
        num = len(poses)
        frames = self._frames_of(columns, num)
        taken = [name for name in ANSWERS if name in columns]
        if taken:
            raise ValueError(f"poses: there is a column {taken[0]} already, which is one of the answers")
        answers = np.zeros((num, 8))
        status = np.full(num, int(_core.Status.NO_SURFACE), np.uint32)
        for frame in np.unique(frames):
            if not 0 <= frame < len(self._frames):
                continue
            of_frame = np.flatnonzero(frames == frame)
            batch = self._contact.measure_batch(self._surface(int(frame)), poses[of_frame])
            answers[of_frame, 0], answers[of_frame, 1] = _in_host(batch.volume), _in_host(batch.potential)
            answers[of_frame, 2:5], answers[of_frame, 5:] = _in_host(batch.force), _in_host(batch.torque)
            status[of_frame] = _in_host(batch.status)
        made: _Columns = dict(columns)
        made.update(zip(ANSWERS, answers.T.copy()))
        made["status"] = status
        return made

    def _frames_of(self, columns: Mapping[str, NDArray[Any]], num: int) -> NDArray[np.int64]:
        if FRAME in columns:
            if not np.issubdtype(np.asarray(columns[FRAME]).dtype, np.integer):
                raise ValueError(f"poses: the column {FRAME} holds no whole numbers, or has gaps")
            return np.asarray(columns[FRAME], np.int64)
        if len(self._frames) != 1:
            raise ValueError(f"poses: with {len(self._frames)} frames a column {FRAME} has to say which")
        return np.zeros(num, np.int64)


def _in_host(array: Any) -> NDArray[Any]:
    if isinstance(array, np.ndarray):
        return array
    try:
        import cupy  # type: ignore[import-not-found,import-untyped,unused-ignore]

        return np.asarray(cupy.from_dlpack(array).get())
    except ImportError:
        import torch.utils.dlpack

        return np.asarray(torch.utils.dlpack.from_dlpack(array).cpu().numpy())


# Files ------------------------------------------------------------------------------------------


def _parquet() -> Tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise _core.Error(_LIBRARY) from error
    return pyarrow, pyarrow.parquet


def parse_shard(text: str) -> Tuple[int, int]:
    """Parses K/N: the K-th of N shards, from 1."""
    try:
        k, n = (int(part) for part in text.split("/"))
    except ValueError:
        k, n = 0, 0
    if not 1 <= k <= n:
        raise _core.Error(f"--shard {text}: give K/N, the K-th of N shards, as 3/16")
    return k, n


def _rows(file: Any, begin: int, end: int) -> Iterator[Any]:
    """Yields tables of the rows from `begin` to `end`, in parts that depend on these alone. Row groups are read
    from their first row, as Parquet cannot seek to rows in the middle, but not beyond the last part."""
    pyarrow, _ = _parquet()
    ends = np.cumsum([file.metadata.row_group(group).num_rows for group in range(file.metadata.num_row_groups)])
    groups = np.flatnonzero((ends > begin) & (np.append(0, ends[:-1]) < end))
    if len(groups) == 0:
        return
    at = int(ends[groups[0]] - file.metadata.row_group(int(groups[0])).num_rows)
    waiting: List[Any] = []
    num_waiting = 0
    for batch in file.iter_batches(_ROWS_IN_PART, row_groups=groups.tolist()):
        low, high = max(begin - at, 0), min(end - at, len(batch))
        at += len(batch)
        if low < high:
            waiting.append(pyarrow.Table.from_batches([batch.slice(low, high - low)]))
            num_waiting += high - low
        if num_waiting >= _ROWS_IN_PART:
            table = pyarrow.concat_tables(waiting)
            yield table.slice(0, _ROWS_IN_PART)
            waiting, num_waiting = [table.slice(_ROWS_IN_PART)], num_waiting - _ROWS_IN_PART
        if at >= end:
            break
    if num_waiting > 0:
        yield pyarrow.concat_tables(waiting)


def _checksum(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _checksum_of_frames(frames: Frames) -> str:
    of = frames.camera
    digest = hashlib.sha256(np.array([of.width, of.height, of.fx, of.fy, of.cx, of.cy, of.unit], np.float64).tobytes())
    digest.update(np.asarray(of.pose).tobytes() + np.asarray(of.distortion).tobytes())
    if frames.poses is not None:
        digest.update(frames.poses.tobytes())
    for frame in range(len(frames)):
        image = frames.images[frame]
        is_file = isinstance(image, (str, os.PathLike))
        digest.update(Path(image).read_bytes() if is_file else np.ascontiguousarray(image).tobytes())
    return digest.hexdigest()


@contextlib.contextmanager
def _alone(folder: Path, output: Path) -> Iterator[None]:
    """Locks the output against other processes."""
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise _core.Error(f"another process writes {output}; give another name or wait for it") from error
        yield


def measure_file(tool: _PathLike, poses: _PathLike, output: _PathLike, frames: Frames, *,
                 shard: Tuple[int, int] = (1, 1), progress: Optional[Callable[[int, int], Any]] = None,
                 **how: Any) -> int:
    """Measures the poses of a Parquet file and writes another one. Returns the number of its rows.

    poses: columns of POSE and, with several frames, FRAME; others are copied. shard: (K, N), the
    K-th of N parts of about equal size, counted from 1: concatenated, the files of all shards equal
    that of (1, 1). how: as for Measurer.

    Finished parts are in OUTPUT.parts until all are finished: the same call resumes after an
    interruption. palpate.Error: not a file of poses, or parts of another task are there.
    """
    pyarrow, parquet = _parquet()
    target, source, tool_file = Path(output), Path(poses), Path(tool)
    try:
        file = parquet.ParquetFile(source)
    except (OSError, pyarrow.ArrowInvalid) as error:
        raise _core.Error(f"{source} cannot be read as Parquet: {error}") from error
    names = file.schema_arrow.names
    if len(set(names)) < len(names):
        raise _core.Error(f"{source} has two columns of one name; rename one of them")
    missing = [name for name in POSE if name not in names]
    if missing:
        raise _core.Error(f"{source} has no column {', '.join(missing)}; a pose has {', '.join(POSE)}")
    num, (k, n) = file.metadata.num_rows, shard
    begin, end = num * (k - 1) // n, num * k // n
    measurer = Measurer(tool, frames, **how)
    task = json.dumps({"poses": _checksum(source), "tool": _checksum(tool_file),
                       "frames": _checksum_of_frames(frames), "rows": [begin, end],
                       "how": repr(sorted((name, value) for name, value in how.items() if name != "threads")),
                       "program": __version__})
    # Measuring an empty table checks the columns before anything is written.
    schema = _answered(pyarrow, measurer, file.schema_arrow.empty_table()).schema
    folder = target.with_name(target.name + ".parts")
    if _is_done(pyarrow, parquet, target, task):
        return int(end - begin)
    with _alone(folder, target):
        if _is_done(pyarrow, parquet, target, task):
            return int(end - begin)
        key = folder / "task.json"
        if key.exists() and key.read_text() != task:
            raise _core.Error(f"{folder} holds parts of another task; remove it or give another name")
        _write(key, lambda to: to.write_text(task))
        parts = []
        for index, table in enumerate(_rows(file, begin, end)):
            part = folder / f"{index:06}.parquet"
            parts.append(part)
            if not part.exists():
                answered = _answered(pyarrow, measurer, table)
                _write(part, lambda to: parquet.write_table(answered, to))
            if progress:
                progress(min(end - begin, (index + 1) * _ROWS_IN_PART), end - begin)
        _write(target, lambda to: _join(parquet, schema, parts, to, task))
        for done in [*parts, key, folder / "lock"]:
            done.unlink()
        folder.rmdir()
    return int(end - begin)


def _answered(pyarrow: Any, measurer: Measurer, table: Any) -> Any:
    """Returns the table with the columns of the answers appended; other columns are kept."""
    names = [name for name in (*POSE, FRAME, *ANSWERS) if name in table.column_names]
    answers = measurer({name: table[name].to_numpy() for name in names})
    for name in ANSWERS:
        table = table.append_column(name, pyarrow.array(answers[name]))
    return table


def _is_done(pyarrow: Any, parquet: Any, target: Path, task: str) -> bool:
    """True if the output of this task is complete. palpate.Error: another file is there."""
    if not target.exists():
        return False
    with contextlib.suppress(OSError, pyarrow.ArrowInvalid):
        if (parquet.ParquetFile(target).schema_arrow.metadata or {}).get(b"palpate") == task.encode():
            return True
    raise _core.Error(f"{target} is there already, with other answers; remove it or give another name")


def _join(parquet: Any, schema: Any, parts: Sequence[Path], to: Path, task: str) -> None:
    with parquet.ParquetWriter(to, schema.with_metadata({b"palpate": task.encode()})) as writer:
        for part in parts:
            writer.write_table(parquet.read_table(part).replace_schema_metadata(None).cast(schema))


def _write(path: Path, fill: Callable[[Path], Any]) -> None:
    """Writes a file completely or not at all."""
    temporary = path.with_name(path.name + ".new")
    try:
        fill(temporary)
        os.replace(temporary, path)
    finally:  # Ctrl-C
        temporary.unlink(missing_ok=True)
