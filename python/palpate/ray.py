"""Many poses on a cluster: palpate.ray.measure on Ray Datasets.

    poses = ray.data.read_parquet("poses.parquet")
    answers = palpate.ray.measure(poses, "finger.palp", frames)
    answers.write_parquet("answers")
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any, Dict, Mapping, Optional, Union

import numpy as np
from numpy.typing import NDArray

try:
    import ray
    import ray.data
except ImportError as error:
    raise ImportError("palpate.ray needs Ray: pip install 'ray[data]'") from error

from palpate import _core
from palpate.poses import Frames, Measurer

__all__ = ["measure"]


class _Worker:
    """An actor that holds the tool, and computes the surfaces of the frames of its poses."""

    def __init__(self, tool: Any, frames: Any, camera: Mapping[str, Any], poses: Any, how: Mapping[str, Any]) -> None:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "tool.palp"
            file.write_bytes(ray.get(tool))
            loaded = _core.load_tool(file)
        images = ray.get(frames) if isinstance(frames, ray.ObjectRef) else frames
        self._measurer = Measurer(loaded, Frames(images, _core.Camera(**camera), poses), **how)

    def __call__(self, batch: Dict[str, NDArray[Any]]) -> Dict[str, NDArray[Any]]:
        return self._measurer(batch)


def measure(dataset: Any, tool: Union[_core.Tool, str, "os.PathLike[str]"], frames: Frames, *,
            workers: Optional[int] = None, gpus_per_worker: float = 0, batch_size: int = 1 << 16,
            **how: Any) -> Any:
    """Returns the dataset with columns of answers: a ray.data.Dataset, computed when it is consumed.

    dataset: a ray.data.Dataset with the columns palpate.poses.POSE and, with several frames, FRAME;
    others are passed on. Include a column that identifies each row: Ray does not keep the order.
    tool: a Tool or its file, which is sent to the workers. frames: images in memory are sent once;
    files must exist on every machine. workers: maximum number of actors, each with the tool in memory;
    none: as many as the cluster has room for. how: arguments of palpate.poses.Measurer; place defaults
    to "cuda" if gpus_per_worker is above 0.

    A lost worker is replaced, and its batches are measured again, with the same answers.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "tool.palp"
        if isinstance(tool, _core.Tool):
            tool.save(file)
        content = (file if isinstance(tool, _core.Tool) else Path(tool)).read_bytes()
    # Workers read files on demand; a memory map is a file, too.
    is_in_memory = isinstance(frames.images, np.ndarray) and not isinstance(frames.images, np.memmap)
    sent = ray.put(np.ascontiguousarray(frames.images)) if is_in_memory else frames.images
    of = frames.camera
    camera = {"width": of.width, "height": of.height, "fx": of.fx, "fy": of.fy, "cx": of.cx, "cy": of.cy,
              "unit": of.unit, "pose": np.array(of.pose)}
    if len(of.distortion) > 0:
        camera["distortion"] = np.array(of.distortion)
    settings: Dict[str, Any] = {"place": "cuda" if gpus_per_worker > 0 else "cpu", **how}
    # Blocks of one batch: workers share even a single file, and a lost one costs only a batch.
    return dataset.repartition(target_num_rows_per_block=batch_size).map_batches(
        _Worker,
        fn_constructor_args=(ray.put(content), sent, camera, frames.poses, settings),
        batch_format="numpy",
        batch_size=batch_size,
        compute=ray.data.ActorPoolStrategy(min_size=1, max_size=workers),
        num_gpus=gpus_per_worker or None,
    )
