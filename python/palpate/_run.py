"""palpate.touch and palpate.Run: live runs and their recordings."""

from __future__ import annotations

import atexit
import csv
import json
import os
import shutil
import tempfile
import warnings
import weakref
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Callable, Dict, List, Mapping, Optional, Sequence, Type, Union

import numpy as np
from numpy.typing import NDArray

from palpate import _core
from palpate._types import Array, Device

if TYPE_CHECKING:
    import pandas

_Floats = NDArray[np.float64]
_PathLike = Union[str, "os.PathLike[str]"]

#: Active runs of this process, by folder.
_going_on: "weakref.WeakValueDictionary[Path, Run]" = weakref.WeakValueDictionary()


class _TemporaryFolder:
    """Removed with its last reference, but not by a child of os.fork: it is the parent's."""

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix="palpate-"))
        weakref.finalize(self, self._remove, self.path, os.getpid())

    @staticmethod
    def _remove(path: Path, process: int) -> None:
        if os.getpid() == process:
            shutil.rmtree(path, ignore_errors=True)


class Run:
    """A run: live, or as it was recorded. Created by `touch` and `Run.open`.

    While it runs, `latest` is its newest tick. Everything recorded (arrays, summary, frames) is read
    from its folder: access waits for the end of the run.
    """

    def __init__(self, folder: _PathLike) -> None:
        self._folder = Path(folder)
        self._loop: Optional[_core.RunInThread] = None
        self._temporary: Optional[_TemporaryFolder] = None  # after the loop, which writes there
        self._table: Optional[Dict[str, _Floats]] = None
        self._recording: Optional[Dict[str, Any]] = None
        self._summary: Optional[Dict[str, Any]] = None

    @staticmethod
    def open(folder: _PathLike) -> Run:
        """Opens the run in a folder that `palpate touch` or `palpate.touch` wrote, complete or truncated.

        palpate.Error: there is no run. Waits for a run of this process that writes there.
        """
        path = Path(folder)
        here = _going_on.get(path.resolve())
        if here is not None:
            here.wait()
        if not path.is_dir():
            raise _core.Error(f"{path} is no folder; give the one that palpate touch wrote")
        if not any((path / name).exists() for name in ("recording.mcap", "wrench.csv", "summary.json")):
            raise _core.Error(
                f"{path} holds no run: neither recording.mcap nor wrench.csv nor summary.json"
            )
        return Run(path)

    # While it runs

    @property
    def is_running(self) -> bool:
        """True while the run is in progress."""
        return self._loop is not None and self._loop.is_running

    @property
    def latest(self) -> Optional[_core.Tick]:
        """The newest tick of a run of this process; None if there was none yet."""
        return self._loop.latest if self._loop is not None else None

    def mark(self, text: str) -> None:
        """Adds a note to the recording, at this moment."""
        if self._loop is None:
            raise _core.Error("only a live run can be marked")
        self._loop.mark(text)

    def wait(self, seconds: Optional[float] = None) -> bool:
        """Waits until the run has ended, at most `seconds`. Returns True if it has ended.

        Ctrl-C ends the run and raises KeyboardInterrupt; the recording is kept. Raises exceptions of
        `on_tick` or of a device in Python again, and palpate.Error if the run ended in a failure.
        """
        if self._loop is None:
            return True
        has_ended = self._loop.wait(seconds)
        if has_ended:
            _going_on.pop(self._folder.resolve(), None)
        return has_ended

    def stop(self) -> None:
        """Fades the force out, ends the run and waits for its end."""
        if self._loop is not None:
            self._loop.stop()
            self.wait()

    def __enter__(self) -> Run:
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        where: Optional[TracebackType],
    ) -> None:
        if error is None:
            self.stop()
        elif self._loop is not None:
            self._loop.stop()
            try:
                self._loop.wait()
            except Exception as also:  # `error`, which is being raised, says more
                warnings.warn(f"the run that was left ended in an error: {also}", stacklevel=2)

    # The recording

    @property
    def folder(self) -> Path:
        """Folder of the recording."""
        return self._folder

    @property
    def times(self) -> _Floats:
        """(N,) times of the ticks, s since the start of the run."""
        return self._columns("time_s")[:, 0]

    @property
    def wrench(self) -> _Floats:
        """(N, 6) force and torque on the tool, N and N m, in W about its center of mass.

        NaN where there is no measurement.
        """
        return self._columns(
            "force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm"
        )

    @property
    def hand_wrench(self) -> _Floats:
        """(N, 6) wrench sent to the device, N and N m, at the handle in its base B."""
        return self._columns(
            "hand_force_x_N", "hand_force_y_N", "hand_force_z_N",
            "hand_torque_x_Nm", "hand_torque_y_Nm", "hand_torque_z_Nm",
        )

    @property
    def poses(self) -> _Floats:
        """(N, 7) X_WT of the tool, tx ty tz qx qy qz qw, m."""
        return self._columns(
            "tool_x_m", "tool_y_m", "tool_z_m", "tool_qx", "tool_qy", "tool_qz", "tool_qw"
        )

    @property
    def volume(self) -> _Floats:
        """(N,) volume of the tool inside the scene, m3; NaN where there is no measurement."""
        return self._columns("volume_m3")[:, 0]

    @property
    def table(self) -> Dict[str, _Floats]:
        """All columns of wrench.csv by their names, which end in their units: (N,) each."""
        if self._table is None:
            self._table = self._read_table()
        return self._table

    @property
    def summary(self) -> Dict[str, Any]:
        """Contents of summary.json: settings, counts, peaks, percentiles of every stage, faults."""
        self.wait()
        if self._summary is None:
            path = self._folder / "summary.json"
            try:
                self._summary = json.loads(path.read_text(encoding="utf-8"))
            except OSError as error:
                raise _core.Error(f"{path} cannot be read: {error.strerror}") from error
            except ValueError as error:
                raise _core.Error(f"{path} is no JSON: {error}") from error
        assert self._summary is not None
        return self._summary

    @property
    def ticks(self) -> Mapping[str, _Floats]:
        """Every number of every tick in the recording, e.g. "device.pose.position.x": (N,) each."""
        return self._read_recording()["ticks"]  # type: ignore[no-any-return]

    @property
    def contacts(self) -> Mapping[str, _Floats]:
        """Every number of every contact query in the recording: (M,) each."""
        return self._read_recording()["contacts"]  # type: ignore[no-any-return]

    @property
    def frame_records(self) -> Mapping[str, _Floats]:
        """Every number of every depth frame in the recording except its image: (F,) each."""
        return self._read_recording()["frames"]  # type: ignore[no-any-return]

    @property
    def notes(self) -> List[str]:
        """Notes in the recording: messages of the run, and marks of the user (`mark`)."""
        return self._read_recording()["notes"]  # type: ignore[no-any-return]

    def frames(self, camera: int = 0) -> _core.RecordedFrames:
        """The depth images of a camera in sequence: time (s) and (H, W) uint16 counts.

        camera: its index, from 0. Its poses are in frame_records["camera_pose.position.x"] and so on,
        in the rows whose "camera" is this index."""
        self.wait()
        return _core.RecordedFrames(self._folder, camera)

    @property
    def camera(self) -> _core.Camera:
        """Model of the first camera, for its depth images."""
        return self.frames().camera

    @property
    def tool(self) -> _core.Tool:
        """The tool of the run."""
        self.wait()
        return _core.recorded_tool(self._folder)

    def to_dataframe(self) -> pandas.DataFrame:
        """Returns `table` as a pandas DataFrame, one row per tick."""
        try:
            import pandas
        except ImportError as error:
            raise _core.Error("to_dataframe needs pandas: pip install pandas") from error
        return pandas.DataFrame(self.table)

    def __repr__(self) -> str:
        return f"<palpate.Run in {self._folder}{', running' if self.is_running else ''}>"

    def _columns(self, *names: str) -> _Floats:
        table = self.table
        missing = [name for name in names if name not in table]
        if missing:
            raise _core.Error(f"{self._folder}/wrench.csv has no column {missing[0]}")
        return np.stack([table[name] for name in names], axis=1)

    def _read_table(self) -> Dict[str, _Floats]:
        self.wait()
        path = self._folder / "wrench.csv"
        if not path.exists():
            return self._table_of_recording()
        try:
            with path.open(newline="", encoding="utf-8") as file:
                names = next(csv.reader(file), [])
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", UserWarning)  # no rows at all
                    rows = np.loadtxt(file, delimiter=",", ndmin=2, comments=None)
        except (OSError, ValueError) as error:
            raise _core.Error(f"{path} cannot be read: {error}") from error
        rows = rows.reshape(-1, len(names))
        return {name: np.ascontiguousarray(rows[:, i]) for i, name in enumerate(names)}

    def _table_of_recording(self) -> Dict[str, _Floats]:
        """Returns the columns for the arrays of a run that was cut off before wrench.csv was finished."""
        ticks = self.ticks
        members = {"time_s": "time", "volume_m3": "penetration.volume"}
        for axis in "xyz":
            members[f"tool_{axis}_m"] = f"coupling.tool.position.{axis}"
            members[f"force_{axis}_N"] = f"coupling.contact.force.{axis}"
            members[f"torque_{axis}_Nm"] = f"coupling.contact.torque.{axis}"
            members[f"hand_force_{axis}_N"] = f"wrench_on_hand.force.{axis}"
            members[f"hand_torque_{axis}_Nm"] = f"wrench_on_hand.torque.{axis}"
        for axis in "xyzw":
            members[f"tool_q{axis}"] = f"coupling.tool.orientation.{axis}"
        return {name: ticks[member] for name, member in members.items()}

    def _read_recording(self) -> Dict[str, Any]:
        self.wait()
        if self._recording is None:
            self._recording = _core.read_recording(self._folder)
        return self._recording


def _leave_to_parent() -> None:
    """Detaches all runs after os.fork: they continue in the parent, which has their threads."""
    for run in list(_going_on.values()):
        if run._loop is not None:
            run._loop.leave()
            run._loop = None
    _going_on.clear()


os.register_at_fork(after_in_child=_leave_to_parent)


@atexit.register
def _end_all() -> None:
    """Ends all runs when Python exits; their recordings are kept."""
    for run in list(_going_on.values()):
        if run._loop is not None:
            run._loop.stop()
            try:
                run._loop.wait()
            except Exception as error:
                warnings.warn(f"{run} ended in an error: {error}", stacklevel=1)
    _core.wait_for_interrupted_work()


def _is_device(given: object) -> bool:
    if isinstance(given, str):
        # Any other string is a path file.
        return given.split(":", 1)[0] in _core.device_kinds() and not Path(given).is_file()
    return hasattr(given, "read") and hasattr(given, "write") and not hasattr(given, "__array__")


def touch(
    tool: _core.Tool,
    cameras: Union[str, _core.PushedCamera, Sequence[Union[str, _core.PushedCamera]]],
    path_or_device: Union[Array, _PathLike, Device, None] = None,
    *,
    duration: Optional[float] = None,
    on_tick: Optional[Callable[[_core.Tick], Optional[bool]]] = None,
    device: Union[str, Device, None] = None,
    output: Optional[_PathLike] = None,
    settings_file: Optional[_PathLike] = None,
    **settings: Any,
) -> Run:
    """Runs a tool through depth images; the loop is in C++ and continues while Python does other things.

    cameras: a camera as `palpate touch --camera` takes it ("scene:hand", "folder:frames", ...),
        or a PushedCamera of your own; several are combined, each at its pose
        ("scene:hand?pose=tx,ty,tz,qx,qy,qz,qw", Camera(..., pose=)).
    path_or_device: the motion of the tool: (N, 8) rows time tx ty tz qx qy qz qw (s, X_WT) or a file
        with them, on a simulated clock as fast as possible (in real time from a PushedCamera);
        or a device: "sim", "haply", ... or an object with read(), which returns the handle's pose
        X_BH, (4, 4) or (7,), and write(wrench), which gets (6,) N and N m. It may have `rate`
        (Hz), `max_force` (N), `max_stiffness` (N/m) and so on. None: the path of the scene.
    duration: s; None: until path, frames or device end.
    on_tick: called with each palpate.Tick from the thread that records; False ends the run. The
        loop does not wait for it.
    device: with a path as well: a simulated hand ("sim") that follows it.
    output: folder of the recording; None: a temporary one, deleted with the Run.
    settings: of docs/settings.md by name: contact_rate=500, coupling_stiffness=800.

    The Run continues in the background. Access to its arrays waits for its end;
    `with palpate.touch(...) as run:` ends it with the block. Set-up errors are raised here, later
    ones by Run.wait and everything that waits.
    """
    if isinstance(cameras, (str, _core.PushedCamera)):
        cameras = [cameras]
    elif isinstance(cameras, bytes) or not hasattr(cameras, "__iter__"):
        raise TypeError(
            "cameras: a camera as text, a palpate.PushedCamera or a list of them is taken, "
            f"not {type(cameras).__name__}"
        )
    path: Any = path_or_device
    if _is_device(path_or_device):
        if device is not None:
            raise _core.Error("touch takes one device: give it once")
        device, path = path_or_device, None  # type: ignore[assignment]
    temporary = _TemporaryFolder() if output is None else None
    folder = temporary.path / "run" if temporary is not None else Path(output or "")
    run = Run(folder)
    run._temporary = temporary
    run._loop = _core.start_run(
        tool, list(cameras), path, device, duration, on_tick, folder, settings_file, settings
    )
    _going_on[folder.resolve()] = run
    return run
