"""Writes runs for other viewers: palpate.sinks.to_rerun(run, "run.rrd"), .to_foxglove(run, "run.mcap").

Both show, frame by frame, the cloud that the camera sees, the tool with its spheres by state, and force
and torque, and over all ticks the numbers of `Run.table`. (A run's own recording.mcap opens in Foxglove
as well, with the messages of ROS 2.)
"""

from __future__ import annotations

import contextlib
import os
from typing import Any, Iterator, NamedTuple, Optional, Union

import numpy as np
from numpy.typing import NDArray

from palpate import _core
from palpate._run import Run

__all__ = ["to_foxglove", "to_rerun"]

_PathLike = Union[str, "os.PathLike[str]"]
_Floats = NDArray[np.float64]

#: Outside, boundary and inside: the colors of the viewer.
_STATE_COLORS = np.array([[229, 71, 47, 255], [180, 92, 242, 255], [31, 102, 232, 255]], np.uint8)
_FORCE_COLOR, _TORQUE_COLOR = (255, 176, 0, 255), (18, 184, 134, 255)
_NEWTON, _NEWTON_METER = 0.02, 0.5  # m: length of arrows per N and N m
_CAMERA_POSE = tuple(f"camera_pose.{name}" for name in (
    "position.x", "position.y", "position.z", "orientation.x", "orientation.y", "orientation.z", "orientation.w"))
_COLUMNS = ("volume_m3", "force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm")


class _Moment(NamedTuple):
    """Data shown for one frame; all in W."""

    time: float  # s since the start of the run
    depth: NDArray[np.uint16]
    unit: float  # m per count
    points: _Floats  # (N, 3) of the cloud
    X_WT: _Floats  # (7,)
    states: NDArray[np.uint8]  # of the spheres
    center: _Floats  # of mass
    wrench: _Floats  # (6,) N, N m


def _rotated(X: _Floats, points: _Floats) -> _Floats:
    """Transforms points by a pose (7,)."""
    axis, w = X[3:6], X[6]
    turned = np.cross(axis, points) + w * points
    made: _Floats = points + 2 * np.cross(axis, turned) + X[:3]
    return made


def _moments(run: Run, stride: int) -> Iterator[_Moment]:
    """Yields the frames of the first camera, each at its capture time."""
    frames, tool = run.frames(), run.tool
    sensor, contact = _core.Sensor(frames.camera), _core.Contact(tool)
    times, poses, wrenches = run.times, run.poses, run.wrench
    ticks, records = run.ticks, run.frame_records
    of_first = np.flatnonzero(records["camera"] == 0)
    # Times of frames are on the device's clock; ticks have both this and the time since the start.
    start = float(np.median(ticks["device.time"] - ticks["time"]))
    for row, (_, depth) in zip(of_first, frames):
        time = max(0.0, float(records["capture_time"][row]) - start)
        tick = max(0, int(np.searchsorted(times, time + 1e-9, side="right")) - 1)
        unit = float(records["unit"][row])
        depth = np.where(depth == 65535, 0, depth).astype(np.uint16)  # neither is a measurement
        # The unit may have changed in mid-stream.
        seen = depth if unit == frames.camera.unit else np.where(depth == 0, np.nan, depth * unit).astype(np.float32)
        surface = sensor.update(seen, pose=[float(records[name][row]) for name in _CAMERA_POSE])
        points = np.asarray(surface.points, np.float64)[::stride, ::stride].reshape(-1, 3)
        states = contact.measure(surface, poses[tick], states=True).states
        assert states is not None
        yield _Moment(time, depth, unit, points[np.isfinite(points).all(axis=1)], poses[tick], states,
                      _rotated(poses[tick], np.asarray(tool.center_of_mass)), np.nan_to_num(wrenches[tick]))


@contextlib.contextmanager
def _new_file(path: _PathLike) -> Iterator[str]:
    """A temporary name to write to; the complete file gets the final name."""
    if os.path.exists(path):
        raise _core.Error(f"{os.fspath(path)} is there already; remove it or give another name")
    temporary = os.fspath(path) + ".new"
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)


def _check_stride(stride: int) -> None:
    if stride < 1:
        raise ValueError(f"stride: {stride} is not 1 or more")


def to_rerun(run: Run, path: Optional[_PathLike] = None, *, stride: int = 4) -> None:
    """Writes a run as Rerun's .rrd; without a path, opens it in Rerun's viewer.

    stride: the cloud has every stride-th pixel in both directions. palpate.Error: rerun-sdk is missing,
    the file exists already, or the run has no frames.
    """
    _check_stride(stride)
    try:
        import rerun
    except ImportError as error:
        raise _core.Error("palpate.sinks.to_rerun needs Rerun: pip install rerun-sdk") from error
    stream = rerun.RecordingStream("palpate")
    if path is None:
        stream.spawn()
        _send_to_rerun(rerun, stream, run, stride)
        return
    with _new_file(path) as file:
        stream.save(file)
        _send_to_rerun(rerun, stream, run, stride)


def _send_to_rerun(rerun: Any, stream: Any, run: Run, stride: int) -> None:
    tool, camera = run.tool, run.camera
    spheres = np.asarray(tool.spheres)
    vertices, triangles = tool.mesh
    stream.log("world", rerun.ViewCoordinates.RDF, static=True)
    stream.log("world/tool/mesh", rerun.Mesh3D(vertex_positions=vertices, triangle_indices=triangles,
                                               albedo_factor=[200, 205, 214, 60]), static=True)
    stream.log("depth", rerun.Pinhole(focal_length=[camera.fx, camera.fy], principal_point=[camera.cx, camera.cy],
                                      resolution=[camera.width, camera.height]), static=True)
    for moment in _moments(run, stride):
        stream.set_time("time", duration=moment.time)
        stream.log("depth", rerun.DepthImage(moment.depth, meter=1 / moment.unit))
        stream.log("world/cloud", rerun.Points3D(moment.points))
        X_WT = moment.X_WT
        stream.log("world/tool", rerun.Transform3D(translation=X_WT[:3], quaternion=X_WT[3:]))
        stream.log("world/tool/spheres", rerun.Points3D(spheres[:, :3], radii=spheres[:, 3],
                                                        colors=_STATE_COLORS[moment.states]))
        for name, vector, length, color in (("force", moment.wrench[:3], _NEWTON, _FORCE_COLOR),
                                            ("torque", moment.wrench[3:], _NEWTON_METER, _TORQUE_COLOR)):
            stream.log(f"world/{name}", rerun.Arrows3D(vectors=[length * vector], origins=[moment.center], colors=[color]))
    times = rerun.TimeColumn("time", duration=run.times)
    for name in _COLUMNS:
        stream.send_columns(f"ticks/{name}", indexes=[times], columns=rerun.Scalars.columns(scalars=run.table[name]))
    stream.disconnect()


def to_foxglove(run: Run, path: _PathLike, *, stride: int = 4) -> None:
    """Writes a run as an MCAP file with Foxglove's own messages: /cloud, /tool, /wrench, /tf, /ticks.

    stride: as for `to_rerun`. palpate.Error: foxglove-sdk is missing, the file exists already, or the
    run has no frames.
    """
    _check_stride(stride)
    try:
        import foxglove
        from foxglove import channels, messages
    except ImportError as error:
        raise _core.Error("palpate.sinks.to_foxglove needs Foxglove's package: pip install foxglove-sdk") from error
    context = foxglove.Context()
    sent = {name: getattr(channels, kind)(f"/{name}", context=context) for name, kind in (
        ("cloud", "PointCloudChannel"), ("tool", "SceneUpdateChannel"), ("wrench", "SceneUpdateChannel"),
        ("tf", "FrameTransformChannel"))}
    ticks = foxglove.Channel("/ticks", message_encoding="json", context=context, schema={
        "type": "object", "properties": {name: {"type": "number"} for name in ("time_s", *_COLUMNS)}})
    spheres = np.asarray(run.tool.spheres, np.float64)
    floats = messages.PackedElementFieldNumericType.Float32
    fields = [messages.PackedElementField(name=name, offset=4 * i, type=floats) for i, name in enumerate("xyz")]
    still = messages.Pose(position=messages.Vector3(), orientation=messages.Quaternion(w=1))
    colors = [messages.Color(r=r / 255, g=g / 255, b=b / 255, a=1) for r, g, b, _ in _STATE_COLORS.tolist()]

    def entity(stamp: Any, frame: str, name: str, **primitives: Any) -> Any:
        return messages.SceneUpdate(entities=[messages.SceneEntity(timestamp=stamp, frame_id=frame, id=name,
                                                                   frame_locked=True, **primitives)])

    with _new_file(path) as file, foxglove.open_mcap(file, context=context):
        for moment in _moments(run, stride):
            now = int(1e9 * moment.time)
            stamp = messages.Timestamp(sec=now // 10**9, nsec=now % 10**9)
            x, y, z, qx, qy, qz, qw = moment.X_WT.tolist()
            sent["tf"].log(messages.FrameTransform(
                timestamp=stamp, parent_frame_id="world", child_frame_id="tool", translation=messages.Vector3(x=x, y=y, z=z),
                rotation=messages.Quaternion(x=qx, y=qy, z=qz, w=qw)), log_time=now)
            sent["cloud"].log(messages.PointCloud(timestamp=stamp, frame_id="world", pose=still, point_stride=12,
                                                  fields=fields, data=moment.points.astype("<f4").tobytes()), log_time=now)
            sent["tool"].log(entity(stamp, "tool", "spheres", spheres=[
                messages.SpherePrimitive(
                    pose=messages.Pose(position=messages.Vector3(x=a, y=b, z=c), orientation=messages.Quaternion(w=1)),
                    size=messages.Vector3(x=2 * r, y=2 * r, z=2 * r), color=colors[state])
                for (a, b, c, r), state in zip(spheres.tolist(), moment.states.tolist())]), log_time=now)
            sent["wrench"].log(entity(stamp, "world", "wrench", arrows=[
                _arrow(messages, moment.center, length * vector, color)
                for vector, length, color in ((moment.wrench[:3], _NEWTON, _FORCE_COLOR),
                                              (moment.wrench[3:], _NEWTON_METER, _TORQUE_COLOR))]), log_time=now)
        table = run.table
        for row in zip(run.times.tolist(), *(table[name].tolist() for name in _COLUMNS)):
            # JSON knows no NaN: nothing was measured.
            numbers = {name: value for name, value in zip(("time_s", *_COLUMNS), row) if value == value}
            ticks.log(numbers, log_time=int(1e9 * row[0]))


def _arrow(messages: Any, tail: _Floats, vector: _Floats, color: Any) -> Any:
    """Returns an arrow for a vector; Foxglove's arrows point along their own x."""
    length = float(np.linalg.norm(vector))
    way = vector / length if length > 0 else np.array([1.0, 0, 0])
    q = np.array([1 + way[0], 0, -way[2], way[1]]) if way[0] > -0.999999 else np.array([0, 0, 0, 1.0])
    w, x, y, z = (q / np.linalg.norm(q)).tolist()
    r, g, b, a = (value / 255 for value in color)
    return messages.ArrowPrimitive(
        pose=messages.Pose(position=messages.Vector3(x=tail[0], y=tail[1], z=tail[2]),
                           orientation=messages.Quaternion(x=x, y=y, z=z, w=w)),
        shaft_length=0.8 * length, head_length=0.2 * length, shaft_diameter=0.004, head_diameter=0.008,
        color=messages.Color(r=r, g=g, b=b, a=a))
