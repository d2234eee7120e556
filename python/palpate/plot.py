"""Plots of runs with matplotlib: palpate.plot.wrench(run), .volume(run), .latency(run)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Optional

import numpy as np

from palpate._core import Error
from palpate._run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def _axes(axes: Optional[Axes]) -> Axes:
    if axes is not None:
        return axes
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise Error("palpate.plot needs matplotlib: pip install matplotlib") from error
    return pyplot.subplots(layout="constrained")[1]


def _lines(axes: Optional[Axes], run: Run, rows: Any, labels: str, unit: str) -> Axes:
    drawn = _axes(axes)
    for values, label in zip(np.atleast_2d(rows.T), labels.split()):
        drawn.plot(run.times, values, label=label, linewidth=1)
    drawn.set_xlabel("time, s")
    drawn.set_ylabel(unit)
    drawn.legend(loc="best")
    return drawn


def wrench(run: Run, axes: Optional[Axes] = None) -> Axes:
    """Force on the tool over time: x, y, z in W, N."""
    return _lines(axes, run, run.wrench[:, :3], "x y z", "force on the tool, N")


def torque(run: Run, axes: Optional[Axes] = None) -> Axes:
    """Torque on the tool over time: x, y, z in W about its center of mass, N m."""
    return _lines(axes, run, run.wrench[:, 3:], "x y z", "torque on the tool, N m")


def volume(run: Run, axes: Optional[Axes] = None) -> Axes:
    """Volume of the tool inside the scene over time, cm3."""
    return _lines(axes, run, run.volume * 1e6, "volume", "volume, cm3")


def latency(run: Run, axes: Optional[Axes] = None) -> Axes:
    """Age of the contact and of the depth image behind each force over time, ms."""
    ages = np.stack([run.table["contact_age_s"], run.table["sensor_age_s"]], axis=1)
    drawn = _lines(axes, run, ages * 1e3, "contact depth", "age, ms")
    drawn.set_yscale("symlog", linthresh=0.1)
    return drawn
