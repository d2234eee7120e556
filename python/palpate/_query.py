"""palpate query of poses in Parquet: the part of the program that needs pyarrow."""

from __future__ import annotations

import argparse
import sys
from typing import List, NoReturn, Optional

from palpate import _core
from palpate.poses import Frames, measure_file, parse_shard


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise _core.Error(f"{message}; palpate query --help lists what there is, and of poses in Parquet "
                          "docs/guide/batches.md")


def is_requested(arguments: List[str]) -> bool:
    """Whether these arguments of the program request poses in Parquet."""
    if not arguments or arguments[0] != "query":
        return False
    values = [value.split("=", 1)[1] for value in arguments if value.startswith("--poses=")]
    values += [after for before, after in zip(arguments, arguments[1:]) if before == "--poses"]
    return any(value.endswith((".parquet", ".pq")) for value in values)


def _numbers(text: str, nums: List[int], option: str) -> List[float]:
    try:
        numbers = [float(part) for part in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) not in nums:
        raise _core.Error(f"{option} {text}: give {' or '.join(map(str, nums))} numbers")
    return numbers


def _parse(arguments: List[str]) -> argparse.Namespace:
    parser = _Parser(prog="palpate query", allow_abbrev=False)
    parser.add_argument("tool")
    parser.add_argument("--poses", required=True)
    parser.add_argument("--depth", required=True)
    parser.add_argument("--intrinsics", required=True)
    parser.add_argument("--depth-unit", type=float, default=0.001)
    parser.add_argument("--camera-pose")
    parser.add_argument("--shard", default="1/1")
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--backend", choices=["cpu", "cuda"], default="cpu")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--volumes", choices=["auto", "spheres", "represented"])
    return parser.parse_args(arguments)


def _camera(given: argparse.Namespace) -> _core.Camera:
    fx, fy, cx, cy = _numbers(given.intrinsics, [4], "--intrinsics")
    pose = _numbers(given.camera_pose, [7], "--camera-pose") if given.camera_pose else None
    probe = Frames.open(given.depth, _core.Camera(1, 1, 1, 1, 0, 0))
    shape = probe.image(0).shape
    if len(shape) != 2:
        raise _core.Error(f"--depth {given.depth}: images of shape {shape} are no depth images (H, W)")
    height, width = shape
    return _core.Camera(width, height, fx, fy, cx, cy, unit=given.depth_unit, pose=pose)


def _progress(done: int, num: int) -> None:
    if sys.stderr.isatty():
        print(f"\r{done} of {num} poses", end="\n" if done == num else "", file=sys.stderr, flush=True)


def main(arguments: Optional[List[str]] = None) -> int:
    """The exit status."""
    try:
        given = _parse((sys.argv[1:] if arguments is None else arguments)[1:])
        frames = Frames.open(given.depth, _camera(given))
        options = {"volumes": given.volumes} if given.volumes else {}
        num = measure_file(given.tool, given.poses, given.output, frames, shard=parse_shard(given.shard),
                           progress=_progress, place=given.backend, threads=given.threads, **options)
    except (_core.Error, ValueError, OSError) as error:
        print(f"palpate query: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("palpate query: interrupted; run the same command again to resume", file=sys.stderr)
        return 130
    print(f"{num} poses answered: {given.output}")
    return 0
