"""A typical program of a user, for mypy --strict; never run."""

from pathlib import Path
from typing import List, Optional

import numpy as np
from numpy.typing import NDArray

import palpate


class Device:
    rate = 100.0

    def read(self) -> NDArray[np.float64]:
        return np.zeros(7)

    def write(self, wrench: NDArray[np.float64]) -> None:
        print(wrench)


def use(depth: NDArray[np.uint16], vertices: NDArray[np.float64], triangles: List[List[int]]) -> float:
    tool: palpate.Tool = palpate.pack(vertices, triangles, 100, progress=lambda n, fill, r: n < 50)
    palpate.pack_file(Path("a.stl"), unit="mm", max_fill=0.8).save("a.palp")
    camera = palpate.Camera(640, 480, 525.0, 525.0, 319.5, 239.5, pose=np.eye(4))
    sensor = palpate.Sensor(camera, place="cuda", max_depth=3.0, unknown="solid")
    surface: palpate.Surface = sensor.update(depth, time=1.0)
    contact = palpate.Contact(tool, "field")
    result = contact.measure([surface], [0, 0, 1, 0, 0, 0, 1], stiffness=True)
    stiffness: Optional[NDArray[np.float64]] = result.stiffness
    status: palpate.Status = result.status
    phi: NDArray[np.float64] = surface.phi(vertices, 0.01)
    with palpate.touch(tool, "scene:wall", Device(), duration=1.0, coupling_stiffness=300) as run:
        latest: Optional[palpate.Tick] = run.latest
    for at, image in palpate.Run.open(run.folder).frames():
        print(at, image.shape)
    print(stiffness, status, phi, latest, run.wrench, run.summary["ticks"])
    return result.volume
