"""palpate query of poses in Parquet: the part of the program that needs pyarrow."""

from __future__ import annotations

import argparse
import math
import re
import sys
from typing import List, NoReturn, Optional, Tuple

from palpate import _core
from palpate.poses import Frames, measure_file, parse_shard


class _WrongUsage(Exception):
    """Error in the arguments: exit status 2, as everywhere in the program."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise _WrongUsage(f"{message}; palpate query --help lists what there is, and of poses in Parquet "
                          "docs/guide/batches.md")


def is_requested(arguments: List[str]) -> bool:
    """True if these arguments of the program request poses in Parquet."""
    if not arguments or arguments[0] != "query":
        return False
    values = [value.split("=", 1)[1] for value in arguments if value.startswith("--poses=")]
    values += [after for before, after in zip(arguments, arguments[1:]) if before == "--poses"]
    return any(value.endswith((".parquet", ".pq")) for value in values)


# Options are as strict as those of the program (apps/options.cpp).


def _number(text: str) -> float:
    """Parses a number; NaN if it is none."""
    return float(text) if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", text, re.ASCII) else math.nan


def _depth_unit(text: str) -> float:
    number = _number(text)
    if not 1e-6 <= number <= 1:
        raise _WrongUsage(f"--depth-unit: must be a number from 1e-6 to 1 m, not {text}")
    return number


def _intrinsics(text: str) -> List[float]:
    numbers = [_number(part) for part in text.split(",")]
    if len(numbers) != 4 or any(map(math.isnan, numbers)):
        raise _WrongUsage(f"--intrinsics: give fx,fy,cx,cy, not '{text}'")
    if max(map(abs, numbers)) > 1e6 or min(numbers[:2]) < 1:
        raise _WrongUsage("--intrinsics: must be fx,fy,cx,cy, numbers of pixels up to a million, "
                          "with fx and fy of at least 1 pixel")
    return numbers


def _camera_pose(text: str) -> List[float]:
    numbers = [_number(part) for part in text.split()]
    if len(numbers) != 7 or not all(map(math.isfinite, numbers)) or not any(numbers[3:]):
        raise _WrongUsage(f"--camera-pose: give 'tx ty tz qx qy qz qw', a position in m and a quaternion, not '{text}'")
    return numbers


def _threads(text: str) -> int:
    if not re.fullmatch(r"\d+", text, re.ASCII) or int(text) > 256:
        raise _WrongUsage(f"--threads: must be a whole number from 0 to 256, not {text}")
    return int(text)


def _shard(text: str) -> Tuple[int, int]:
    try:
        return parse_shard(text)
    except _core.Error as error:
        raise _WrongUsage(str(error)) from error


def _parse(arguments: List[str]) -> argparse.Namespace:
    parser = _Parser(prog="palpate query", allow_abbrev=False)
    parser.add_argument("tool")
    parser.add_argument("--poses", required=True)
    parser.add_argument("--depth", required=True)
    parser.add_argument("--intrinsics", type=_intrinsics, required=True)
    parser.add_argument("--depth-unit", type=_depth_unit, default=0.001)
    parser.add_argument("--camera-pose", type=_camera_pose)
    parser.add_argument("--shard", type=_shard, default=(1, 1))
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--backend", choices=["cpu", "cuda", "auto"], default="cpu")
    parser.add_argument("--threads", type=_threads, default=0)
    parser.add_argument("--volumes", choices=["auto", "spheres", "represented"])
    return parser.parse_args(arguments)


def _camera(given: argparse.Namespace) -> _core.Camera:
    probe = Frames.open(given.depth, _core.Camera(1, 1, 1, 1, 0, 0))
    shape = probe.image(0).shape
    if len(shape) != 2:
        raise _core.Error(f"--depth {given.depth}: images of shape {shape} are no depth images (H, W)")
    height, width = shape
    return _core.Camera(width, height, *given.intrinsics, unit=given.depth_unit, pose=given.camera_pose)


def _place(backend: str, camera: _core.Camera) -> str:
    """Resolves the backend auto: a GPU if one is usable, else the CPU, with a note."""
    if backend != "auto":
        return backend
    try:
        _core.Sensor(camera, place="cuda")
    except _core.Error as error:
        print(f"palpate: note: backend cpu is used: {error}", file=sys.stderr)
        return "cpu"
    return "cuda"


def _progress(done: int, num: int) -> None:
    if sys.stderr.isatty():
        print(f"\r{done} of {num} poses", end="\n" if done == num else "", file=sys.stderr, flush=True)


def main(arguments: Optional[List[str]] = None) -> int:
    """Runs the query and returns the exit status."""
    try:
        given = _parse((sys.argv[1:] if arguments is None else arguments)[1:])
        camera = _camera(given)
        frames = Frames.open(given.depth, camera)
        options = {"volumes": given.volumes} if given.volumes else {}
        num = measure_file(given.tool, given.poses, given.output, frames, shard=given.shard, progress=_progress,
                           place=_place(given.backend, camera), threads=given.threads, **options)
    except _WrongUsage as error:
        print(f"palpate query: {error}", file=sys.stderr)
        return 2
    except (_core.Error, ValueError, OSError) as error:
        print(f"palpate query: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("palpate query: interrupted; run the same command again to resume", file=sys.stderr)
        return 130
    print(f"{num} poses answered: {given.output}")
    return 0
