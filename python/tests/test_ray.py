"""palpate.ray on a cluster of several processes, which loses one in the middle."""

import os
import signal

import numpy as np
import pandas
import pytest

import palpate

ray = pytest.importorskip("ray", reason="Ray is not installed")
import ray.data  # noqa: E402

import palpate.ray  # noqa: E402
from palpate.poses import ANSWERS, POSE, Frames, Measurer  # noqa: E402

NUM, BATCH = 24000, 1000


@pytest.fixture(scope="module", autouse=True)
def cluster():
    ray.init(num_cpus=3, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


def test_the_same_bits_when_a_worker_is_lost(cube, tmp_path):
    images = []
    for time_s in (0.0, 0.7):
        depth, camera, _ = palpate.render_scene("pillar", time_s, width=160, height=120)
        images.append(depth)
    frames = Frames(np.stack(images), camera)
    random = np.random.default_rng(4)
    at = palpate.Sensor(camera).update(images[0]).points[30:90, 40:120].reshape(-1, 3)
    X_WT = np.concatenate([at[random.integers(0, len(at), NUM)], random.normal(size=(NUM, 4))], axis=1)
    columns = dict(zip(POSE, X_WT.T))
    columns["frame"] = random.integers(0, 2, NUM)
    columns["number"] = np.arange(NUM)
    wanted = Measurer(cube, frames)(columns)

    killed = tmp_path / "killed"
    pids = tmp_path / "pids"
    pids.mkdir()

    def kill_once(batch):
        """The first of the workers that have measured some."""
        if not killed.exists() and len(os.listdir(pids)) > 0:
            killed.touch()
            os.kill(int(sorted(os.listdir(pids))[0]), signal.SIGKILL)
        return batch

    class Marking(palpate.ray._Worker):
        def __call__(self, batch):
            (pids / str(os.getpid())).touch()
            return super().__call__(batch)

    usual, palpate.ray._Worker = palpate.ray._Worker, Marking
    try:
        answers = palpate.ray.measure(ray.data.from_pandas(pandas.DataFrame(columns)), cube, frames, workers=2, batch_size=BATCH)
        got = answers.map_batches(kill_once, batch_size=BATCH).to_pandas().sort_values("number")
    finally:
        palpate.ray._Worker = usual
    assert killed.exists()
    assert len(os.listdir(pids)) > 1  # another one in its place
    for name in ANSWERS:
        assert got[name].to_numpy().tobytes() == wanted[name].tobytes(), name
