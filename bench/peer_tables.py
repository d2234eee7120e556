#!/usr/bin/env python3
"""Writes the tables of docs/compare.md and docs/guide/simulators.md that have a mark from the rows in bench/results.

A mark is `<!-- rows: TABLE -->`, then an empty line and the table. Where rows are not there yet, the text below the mark says so.
usage: bench/peer_tables.py [--check]     --check: changes nothing, and fails where a table is not that of its rows"""

import csv
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "bench/results"
SCENES = ("wall", "sphere-out-160", "ridge-90")
# Name in the rows, with what tells it from others in `facts`; what the page calls it; what is behind the surface to it.
PEERS = (
    ("palpate measure", "", "**Palpate**, 1,000 spheres", "solid, free, fading"),
    ("palpate measure_batch", "", "the same, {batch} poses in a batch", "the same"),
    ("projective look-up", "", "look-up in the image", "solid"),
    ("projective look-up, cosine", "", "the same, with cosine", "solid"),
    ("distance grid 5 mm", "", "distance grid, 5 mm", "solid, as built here"),
    ("distance grid 10 mm", "", "10 mm", "the same"),
    ("distance grid 20 mm", "", "20 mm", "the same"),
    ("Warp 1.19.0 nearest point", "", "Warp 1.19, nearest point", "solid, 0.2 m deep"),
    ("thesis, weighted", "", "thesis, weighted", "solid"),
    ("thesis, simplified", "", "thesis, simplified", "solid"),
    ("thesis, graph", "", "thesis, graph", "solid"),
    ("coal 3.0.3 contacts", "", "coal 3.0, triangles", "free"),
    ("coal 3.0.3 octree, yes or no", "", "coal 3.0, octree, yes or no", "free"),
    ("VAMP, fetch-planning 0.3.2, yes or no", "points=4800", "VAMP, a whole robot, yes or no", "free"),
    ("MuJoCo 4.0.0 height field", "", "MuJoCo 4.0, height field", "solid"),
    ("MuJoCo 4.0.0 SDF", "", "MuJoCo 4.0, SDF", "solid, 0.3 m deep"),
    ("Drake 1.51.1 hydroelastic", "", "Drake 1.51, hydroelastic", "free"))
ON_GPU = (
    ("palpate measure", "palpate measure_batch", "**Palpate**, 1,000 spheres"),
    (None, "palpate measure_batch, stiffness", "the same, with stiffness"),
    *((name, name, label) for name, _, label, _ in PEERS[2:8]),
    ("MuJoCo Warp 4.0.0 height field",) * 2 + ("MuJoCo Warp 4.0, height field",),
    ("Newton 1.8.0 height field",) * 2 + ("Newton 1.8, height field",))


def rows_of(name):
    """Returns the rows of a file in bench/results, none if it is not there."""
    path = RESULTS / name
    if not path.exists():
        return []
    with open(path) as file:
        return list(csv.DictReader(file))


def short(number):
    """Two digits, and all of those before the point."""
    value = float(number)
    return f"{value:.0f}" if value >= 10 else f"{float(f'{value:.2g}'):g}"


def table(head, lines):
    return "\n".join([f"| {' | '.join(head)} |", "|" + "---|" * len(head), *(f"| {' | '.join(line)} |" for line in lines)])


def of_scenes(rows, column, factor=1.0):
    """Values of wall, ball and ridge; nothing if a row has none."""
    values = [row[column] for scene in SCENES for row in rows if row["scene"] == scene]
    return " / ".join(short(factor * float(value)) for value in values) if values and all(values) else "none"


def noisy(name, peer, facts=""):
    return [row for row in rows_of(name) if row["peer"] == peer and float(row["noise_mm"]) > 0 and facts in row["facts"]]


def peers_on_cpu():
    lines = []
    for peer, facts, label, behind in PEERS:
        rows = noisy("contact-peers-2-cores.csv", peer, facts)
        batch = re.search(r"batch=(\d+)", rows[0]["facts"])
        columns = ("frame_ms", "volume_rms_percent", "force_rms_percent", "direction_rms_deg", "jump_percent")
        lines.append([label.format(batch=batch and batch[1]), f"{of_scenes(rows, 'pose_us')} ({of_scenes(rows, 'pose_p99_us')})",
                      *(of_scenes(rows, column) for column in columns), behind])
    return table(["", "a pose, µs", "ready for a frame, ms", "volume, %", "force, %", "its direction, °", "largest jump in 1 mm, %",
                  "behind the surface"], lines)


def peers_on_gpu():
    name, lines = "contact-peers-nvidia-h200.csv", []
    for alone, batch, label in ON_GPU:
        ones, many = (noisy(name, peer, facts) for peer, facts in ((alone, "batch=1"), (batch, "batch=16384")))
        ones = [row for row in ones if re.search(r"batch=1\b", row["facts"])]
        if many:
            lines.append([label, f"{of_scenes(ones, 'pose_us')} ({of_scenes(ones, 'pose_p99_us')})" if ones else "",
                          of_scenes(many, "pose_us", 1e3), of_scenes(many, "frame_ms"), of_scenes(many, "direction_rms_deg")])
    head = ["", "one query, µs", "of 16,384 at once, ns a pose", "ready for a frame, ms", "direction, °"]
    return table(head, lines) if lines else "No rows of a GPU are there yet: `scripts/gpu_peers.sh` writes them."


def flat_places():
    rows, lines = rows_of("flat-peers-2-cores.csv"), []
    balls = sorted({row["ball_mm"] for row in rows}, key=int, reverse=True)
    for peer in dict.fromkeys(row["peer"] for row in rows):
        both = [row for ball in balls for row in rows if row["peer"] == peer and row["ball_mm"] == ball]
        label = next((label for name, _, label, _ in PEERS if name == peer), peer)
        if peer.startswith("palpate measure_batch") or len(both) != len(balls):
            continue
        if peer.startswith("distance grid"):
            label = f"distance grid, {peer.split()[2]} mm"
        values = lambda column: " / ".join(short(row[column]) if row[column] else "none" for row in both)  # noqa: E731
        lines.append([label.replace("the same, with cosine", "look-up in the image, with cosine"), both[0]["places"],
                      f"{values('direction_median_deg')} ({values('direction_rms_deg')})", values("volume_rms_percent"),
                      values("ripple_percent"), f"{values('sideways_percent')} ({values('sideways_p90_percent')})"])
    head = [" / ".join(f"{ball} mm" for ball in balls), "places", "direction, °: median (rms)", "volume, %", "ripple in sliding, %", "false sideways force, %: median (90th percentile)"]
    return table(head, lines) if lines else "No rows are there yet: `bench/flat_peers.py` writes them."


def pegs_on_gpu():
    rows = {row["quantity"]: row for row in rows_of("simulators-nvidia-h200.csv") if row["figure"] == "batch"}
    if not rows:
        return "No rows of a GPU are there yet: `scripts/gpu_peers.sh` writes them."
    value = lambda name: short(rows[name]["value"])  # noqa: E731
    lines = [[label, f"{value(f'contact part{image}, median')} / {value(f'contact part{image}, p99')}",
              f"{value(f'batch alone{image}, median')} / {value(f'batch alone{image}, p99')}",
              f"{float(rows[f'contact part over batch alone{image}']['value']):.2f}"]
             for label, image in (("a step", ""), ("a step with a new image", ", new image"))]
    return table(["", "contact part, ms: median / p99", "batch alone, ms", "ratio"], lines)


TABLES = {"peers-cpu": peers_on_cpu, "peers-gpu": peers_on_gpu, "flat-places": flat_places, "pegs-gpu": pegs_on_gpu}


def main():
    is_check, stale = sys.argv[1:] == ["--check"], []
    for path in (ROOT / "docs/compare.md", ROOT / "docs/guide/simulators.md"):
        page = path.read_text()
        made = re.sub(r"(<!-- rows: ([\w-]+) -->\n\n).*?(?=\n\n)", lambda mark: mark[1] + TABLES[mark[2]](), page, flags=re.S)
        if made != page and is_check:
            stale.append(path)
        elif made != page:
            path.write_text(made)
    for path in stale:
        print(f"{path.relative_to(ROOT)}: a table is not that of its rows: run bench/peer_tables.py", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
