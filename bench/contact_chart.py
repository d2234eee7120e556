"""Draws the rows of contact_peers.py: error of the direction against time, for a pose and for a frame, on log axes.

usage: contact_chart.py FILE.csv FILE.svg"""

import csv
import sys

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402

MARKS = {"wall": "o", "sphere-out-160": "s", "ridge-90": "^"}
NAMES = {"wall": "wall", "sphere-out-160": "ball", "ridge-90": "ridge"}


def main():
    with open(sys.argv[1]) as file:
        rows = [row for row in csv.DictReader(file) if row["direction_rms_deg"] and float(row["noise_mm"]) > 0]
    peers = list(dict.fromkeys(row["peer"] for row in rows))
    figure, axes = pyplot.subplots(1, 2, figsize=(11, 5.5), sharey=True, layout="constrained")
    for axis, key, label in zip(axes, ("pose_us", "frame_ms"), ("one pose, µs of one core", "ready for a frame, ms of the processor")):
        for i, peer in enumerate(peers):
            for row in (row for row in rows if row["peer"] == peer):
                axis.plot(max(float(row[key]), 0.1), max(float(row["direction_rms_deg"]), 0.05), MARKS[row["scene"]],
                          color=pyplot.cm.tab20(i % 20), markersize=9 if peer.startswith("palpate") else 6,
                          label=peer if row["scene"] == "wall" and key == "pose_us" else None)
        axis.set(xscale="log", yscale="log", xlabel=label)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("rms error of the force's direction, degrees")
    marks = ", ".join(f"{NAMES[scene]} {mark}" for scene, mark in zip(MARKS, ("●", "■", "▲")))
    figure.suptitle(f"A box in {marks}; 1.5 mm of noise")
    figure.legend(loc="outside lower center", ncols=4, fontsize=8)
    figure.savefig(sys.argv[2], metadata={"Date": None})


if __name__ == "__main__":
    main()
