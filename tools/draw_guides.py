#!/usr/bin/env python3
"""Draws the pictures of guides that have no page of the program: their own code is run, and what it leaves is drawn.

usage: PYTHON tools/draw_guides.py FOLDER [NAME ...]

PYTHON has the wheel of `make wheel` (it calls this in `make pictures`), and matplotlib. `library` takes what
build/release holds.
"""

import re
import subprocess
import sys
import tempfile
from contextlib import chdir
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402
from matplotlib.collections import LineCollection  # noqa: E402

import palpate  # noqa: E402
import palpate.plot  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests/docs"))
from python_blocks import FENCE, bring  # noqa: E402

BLUE, ORANGE, GREEN, RED, GRAY = "#6ea8fe", "#ffa066", "#4cc38a", "#ff6b6b", "#9aa4ae"  # as in the reports
LOOK = {
    "axes.facecolor": "#11161b", "figure.facecolor": "#11161b", "savefig.facecolor": "#11161b", "axes.edgecolor": "#3a444d",
    "axes.grid": True, "grid.color": "#252d34", "axes.prop_cycle": matplotlib.cycler(color=[BLUE, ORANGE, GREEN, RED]),
    "font.size": 11, "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False,
}  # fmt: skip


def guide(name, *texts):
    """Runs those blocks in Python of a guide that hold the texts, one after the other, and returns their names."""
    blocks = FENCE.findall((ROOT / f"docs/guide/{name}.md").read_text())
    names = {}
    for text in texts:
        exec(compile(next(block for block in blocks if text in block), f"{name}.md", "exec"), names)
    return names


def axes(num, size=(11, 3.8)):
    figure, drawn = pyplot.subplots(1, num, figsize=size, layout="constrained")
    return figure, drawn


def python(_):
    """Plots the run of the page by palpate.plot, as it says."""
    run = guide("python", 'palpate.touch(tool, "scene:wall", path')["run"]
    figure, (left, right) = axes(2)
    palpate.plot.wrench(run, left)
    palpate.plot.volume(run, right)
    return figure


def planning(_):
    """Shows where the tool of the page is blocked, and how far it is from what the camera sees."""
    names = guide("planning", "render_scene", "contact.any", "batch.clearance.min()")
    camera, x = names["camera"], np.linspace(-0.2, 0.2, 1000)
    blocked, clearance = names["blocked"], names["batch"].clearance
    figure, (left, right) = axes(2)
    left.imshow(names["depth"], cmap="gray_r")
    u = camera.fx * x / names["poses"][0, 2] + camera.cx
    left.scatter(u, np.full(1000, camera.cy), c=np.where(blocked, RED, GREEN), s=9)
    left.set(title="1000 poses in the depth image", xlim=(0, camera.width), xticks=[], yticks=[])
    left.grid(False)
    for mask, color, label in ((~blocked, GREEN, "free"), (blocked, RED, "blocked")):
        right.plot(x[mask] * 1e3, clearance[mask] * 1e3, ".", ms=3, color=color, label=label)
    right.axhline(6, color=GRAY, ls="--", lw=1, label="margin")
    right.set(title="clearance", xlabel="x, mm", ylabel="mm")
    right.legend(markerscale=4)
    return figure


def robots(_):
    """Shows the arm of the page beside what the camera sees, and the motions that are proved, in the space of joints."""
    names = guide("robots", 'Path("arm.urdf")', "robot.remove_from", "robot.any", "robot.free_motions")
    robot, joints, blocked, until = (names[name] for name in ("robot", "joints", "blocked", "until"))
    figure, (left, right) = axes(2, (11, 4.6))
    points = palpate.Sensor(names["camera"]).update(palpate.render_scene("pillar", 0.0)[0]).points.reshape(-1, 3)
    near = points[np.abs(points[:, 0]) < 0.02]
    left.scatter(near[:, 2], -near[:, 1], s=3, color="white")
    left.annotate("pillar", (1.02, 0.32), color="white")
    arms = []
    for place in robot.place(joints[:60]):
        turn = np.array([[0, 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)] for x, y, z, w in place[:, 3:]])  # z of a link, y and z in W
        turn[:, 0] = turn[:, 1]
        start, length = place[:, 1:3], (0.3, 0.2)
        ends = start + np.stack([turn[:, 1], turn[:, 2]], axis=1) * np.array(length)[:, None]
        arms.append([(start[0][1], -start[0][0]), (start[1][1], -start[1][0]), (ends[1][1], -ends[1][0])])
    left.add_collection(LineCollection(arms, colors=[RED if hit else GREEN for hit in blocked[:60]], lw=1, alpha=0.7))
    left.set(title="60 configurations: free and blocked", xlabel="z, m", ylabel="height, m", aspect="equal", xlim=(0.35, 1.15), ylim=(-0.3, 0.4))
    right.plot(*joints[blocked].T, ".", ms=3, color=RED, label="blocked")
    right.plot(*joints[~blocked].T, ".", ms=3, color=GREEN, label="free")
    start, end = joints[:100], joints[100:200]
    reached = start + until[:, None] * (end - start)
    right.add_collection(LineCollection(np.stack([reached, end], 1), colors=GRAY, lw=0.6, ls=":"))
    right.add_collection(LineCollection(np.stack([start, reached], 1), colors=BLUE, lw=0.9, label="proved free"))
    right.set(title="1000 configurations and 100 motions", xlabel=f"{robot.joint_names[0]}, rad", ylabel=f"{robot.joint_names[1]}, rad")
    figure.legend(loc="outside right upper", markerscale=3)
    return figure


LIBRARY = """#include <cstdio>
#include <vector>
{include}
int main() {{
  std::vector<std::uint16_t> image(640 * 480, 500);
  const std::uint16_t* counts = image.data();
  for (int i = 0; i <= 120; ++i) {{
    const palpate::Pose X_WT{{.translation = {{0, 0, 0.38 + 0.001 * i}}}};
    {block}
    std::printf("%g %g %g\\n", X_WT.translation.z, measured.volume, F_W.force.z);
  }}
}}
"""


def library(folder):
    """Compiles the C++ of the page around a wall 0.5 m away, and moves its pen into it."""
    page = (ROOT / "docs/guide/link-the-library.md").read_text()
    block = next(code for code in re.findall(r"```cpp\n(.*?)```", page, re.S) if "Sensor::create" in code)
    include, code = block.split("\n\n", 1)
    (folder / "page.cpp").write_text(LIBRARY.format(include=include, block=code))
    palpate.pack_file(folder / "stylus.stl", 5000).save(folder / "stylus.palp")
    build = ROOT / "build/release/lib/libpalpate.a"
    subprocess.run(["c++", "-std=c++20", "-O1", f"-I{ROOT}/include", "page.cpp", build, "-lpthread", "-o", "page"], cwd=folder, check=True)
    said = subprocess.run(["./page"], cwd=folder, check=True, capture_output=True, text=True).stdout
    z, volume, force = np.array([line.split() for line in said.splitlines()], float).T
    figure, (left, right) = axes(2)
    left.plot(z * 1e3, volume * 1e6)
    left.set(title="measured.volume", xlabel="z of the pen, mm", ylabel="cm³")
    right.plot(z * 1e3, force, color=ORANGE)
    right.set(title="F_W.force.z", xlabel="z of the pen, mm", ylabel="N")
    return figure


def table(page, figure):
    """The rows of a table that the evaluation has written into a page, each a dictionary."""
    text = (ROOT / page).read_text()
    lines = re.search(rf"<!-- eval {figure}: .*?-->\s*(.*?)\n\n", text, re.S).group(1).splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [dict(zip(rows[0], row)) for row in rows[2:]]


def gpu(_):
    """Draws the measured times of queries on a CPU core and on a GPU, which the reference has as tables."""
    figure, drawn = axes(1, (8, 4.2))
    methods = (("field", BLUE), ("simplified", ORANGE), ("graph", GREEN))
    for where, name, marker in (("one CPU core", "spheres", "o-"), ("GPU", "gpu", "s--")):
        rows = table("docs/reference.md", name)
        spheres = [float(row["spheres"]) for row in rows]
        for method, color in methods:
            times = [float(row[method]) for row in rows]
            drawn.plot(spheres, times, marker, color=color, ms=5, label=f"{method}, {where}")
    drawn.axhline(1000, color=RED, lw=1)
    drawn.text(1000, 1080, "one tick, 1 ms", color=RED, va="bottom")
    drawn.set(xscale="log", yscale="log", xlabel="spheres", ylabel="median of a query, µs",
              xticks=(1e3, 1e4, 1e5, 1e6), xticklabels=("1,000", "10,000", "100,000", "1,000,000"), yticks=(10, 100, 1e3, 1e4), yticklabels=("10", "100", "1,000", "10,000"))
    drawn.legend(fontsize=9)
    return figure


def alternatives(_):
    """Draws the table of alternatives: the error of the direction against the time of a query."""
    figure, drawn = axes(1, (9, 4.6))
    places = {}  # grids that lie at one place have one name
    for row in table("docs/guide/what-for.md", "others"):
        kind, *cells = row["method"].split(", ")
        time, error = float(row["a query, µs"]), float(row["direction, ° rms"])
        places.setdefault((kind, *cells[1:], round(np.log10(error), 1)), []).append((time, error, cells))
    for (kind, *_, _), found in places.items():
        for time, error, _ in found:
            drawn.plot(time, error, "*" if kind == "field" else "o", ms=16 if kind == "field" else 7,
                       color=BLUE if kind == "field" else GRAY if "grid" in kind else ORANGE)
        sizes, rest = " and ".join(cells[0] for *_, cells in found if cells), found[0][2][1:]
        drawn.annotate(", ".join([kind, *[sizes][: len(rest)], *rest]), found[0][:2], xytext=(8, 3), textcoords="offset points", fontsize=8.5)
    drawn.set(xscale="log", yscale="log", xlabel="a query, µs of one core", ylabel="rms error of the force's direction, °", xlim=(0.7, 200), ylim=(0.6, 14),
              xticks=(1, 3, 10, 30, 100), xticklabels=(1, 3, 10, 30, 100), yticks=(1, 3, 10), yticklabels=(1, 3, 10))
    return figure


PICTURES = {draw.__name__: draw for draw in (python, planning, robots, library, gpu, alternatives)}


def main():
    output, chosen = Path(sys.argv[1]).resolve(), sys.argv[2:] or PICTURES
    for name in chosen:
        with tempfile.TemporaryDirectory() as temporary, pyplot.style.context(["dark_background", LOOK]), chdir(temporary):
            bring(Path(temporary))
            drawn = PICTURES[name](Path(temporary))
            drawn.savefig(output / f"{name}.png", dpi=90)
        print(f"{name}.png")


if __name__ == "__main__":
    main()
