"""Where would a gripper's finger touch? Ten million poses against 150 depth frames, on all machines there are.

    python candidate_poses.py --poses 1e7                   # this machine
    python candidate_poses.py --poses 1e7 --shard 3/16      # one of sixteen, e.g. of a Slurm array
    python candidate_poses.py --poses 1e7 --ray             # a Ray cluster (pip install 'ray[data]')

Makes finger.palp, frames.npy and poses.parquet where it is started, answers.parquet and candidate_poses.png. Needs
pyarrow and matplotlib.
"""

import argparse
from pathlib import Path

import numpy as np
import pyarrow
from pyarrow import parquet

import palpate
from palpate.poses import POSE, Frames, measure_file, parse_shard

NUM_FRAMES, ROWS = 150, 1 << 18


def finger():
    """20 x 16 x 80 mm, its tip at the origin, pointing along +z."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-2, 0)]) * [0.01, 0.008, 0.04]
    triangles = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                 [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return palpate.pack(corners, triangles, 100)


def camera():
    return palpate.render_scene("hand", 0.0, width=320, height=240)[1]


def make_inputs(num):
    """Tips at points of the image, up to 4 cm behind and 4 cm before what is seen, turned by up to 40 degrees."""
    finger().save("finger.palp")
    frames = np.stack([palpate.render_scene("hand", k / 30, width=320, height=240)[0] for k in range(NUM_FRAMES)])
    np.save("frames.npy", frames)
    eye, random = camera(), np.random.default_rng(1)
    writer = None
    for begin in range(0, num, ROWS):
        n = min(ROWS, num - begin)
        frame, u, v = random.integers(NUM_FRAMES, size=n), random.integers(320, size=n), random.integers(240, size=n)
        z = np.nan_to_num(frames[frame, v, u], nan=1.0) + random.uniform(-0.04, 0.04, n)
        axis = random.normal(size=(n, 3))
        axis /= np.linalg.norm(axis, axis=1)[:, None]
        half = np.radians(random.uniform(0, 40, n)) / 2
        pose = [(u - eye.cx) / eye.fx * z, (v - eye.cy) / eye.fy * z, z, *(axis.T * np.sin(half)), np.cos(half)]
        table = pyarrow.table({**dict(zip(POSE, pose)), "frame": frame, "u": u, "v": v, "number": begin + np.arange(n)})
        writer = writer or parquet.ParquetWriter("poses.parquet", table.schema)
        writer.write_table(table)
    writer.close()


def draw(answers):
    """The share of the finger that is inside, on average over all poses at a pixel."""
    from matplotlib import pyplot

    table = parquet.read_table(answers, columns=["u", "v", "volume_m3"])
    u, v, volume = (table[name].to_numpy() for name in ("u", "v", "volume_m3"))
    whole = palpate.load_tool("finger.palp").volume
    cells = (np.arange(0, 321, 4), np.arange(0, 241, 4))
    num = np.histogram2d(u, v, cells)[0].T
    inside = np.histogram2d(u, v, cells, weights=100 * volume / whole)[0].T / np.maximum(num, 1)
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    left.imshow(np.load("frames.npy", mmap_mode="r")[0], cmap="gray_r")
    left.set_title("the first of the frames, m")
    shown = right.imshow(inside, cmap="viridis", extent=(0, 320, 240, 0))
    right.set_title("finger inside, % of its volume, mean of all frames")
    figure.colorbar(shown)
    figure.savefig("candidate_poses.png", dpi=110)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--poses", type=float, default=1e5)
    parser.add_argument("--shard", default="1/1")
    parser.add_argument("--ray", action="store_true")
    given = parser.parse_args()
    if not Path("poses.parquet").exists():
        make_inputs(int(given.poses))
    frames = Frames.open("frames.npy", camera())
    k, n = parse_shard(given.shard)
    answers = "answers.parquet" if n == 1 else f"answers-{k}-of-{n}.parquet"
    if given.ray:
        import ray.data

        import palpate.ray

        palpate.ray.measure(ray.data.read_parquet("poses.parquet"), "finger.palp", frames).write_parquet("answers")
        answers = "answers"
    else:
        num = measure_file("finger.palp", "poses.parquet", answers, frames, shard=(k, n))
        print(f"{num} poses answered: {answers}")
    if n == 1:
        draw(answers)


if __name__ == "__main__":
    main()
