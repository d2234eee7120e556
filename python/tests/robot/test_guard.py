"""The arm of examples/guard_arm.py, against the closed form of a box on a block."""

import pathlib
import sys

import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("quadprog")
sys.path.insert(0, str(pathlib.Path(__file__).parents[3] / "examples"))
import guard_arm  # noqa: E402

import palpate  # noqa: E402

MOST = 2e-8  # m4
BOTTOM, HALF = 0.06 * 0.06, 0.03  # m2 and m, of the guard


@pytest.fixture(scope="module")
def scene():
    depth, camera = guard_arm.seen()
    return guard_arm.guard_body(), palpate.Sensor(camera).update(depth)


def above_the_block(path):
    """Height of the guard's bottom above the top of the block, m, while all of it is over the block."""
    over = path[abs(path[:, 1] - 0.6) < 0.06]
    return over[:, 3] - HALF - 0.1


def test_without_a_guard_the_arm_goes_through(scene):
    path, met = guard_arm.go(*scene, [(0, guard_arm.START), (4, [0.76, 0, 0.06])])
    assert met[:, 0].max() > 10 * MOST
    assert above_the_block(path).min() < -0.02


def test_with_it_the_arm_slides_along_and_arrives(scene):
    goal = np.array([0.76, 0, 0.06])
    path, met = guard_arm.go(*scene, [(0, guard_arm.START), (4, goal), (6, goal)], most=MOST)
    assert met[:, 0].max() < 1.02 * MOST
    deepest = np.sqrt(2 * MOST / BOTTOM)  # U = A d^2 / 2
    assert above_the_block(path).min() > -1.3 * deepest
    assert above_the_block(path).min() < -0.5 * deepest  # it did get there
    assert np.linalg.norm(path[-1, 1:4] - goal) < 0.002


def test_it_keeps_to_the_block_when_it_is_pulled_up(scene):
    way = [(0, guard_arm.START), (2, [0.58, 0, 0.12]), (6, [0.65, 0.05, 0.2])]
    path, met = guard_arm.go(*scene, way, MOST / 4, MOST)
    there = np.argmax(met[:, 0] > MOST / 4)
    assert 0 < there < len(met) / 2
    assert met[there:, 0].min() > 0.9 * MOST / 4
    assert met[there:, 0].max() < 1.02 * MOST
    free, _ = guard_arm.go(*scene, way, most=MOST)
    assert free[-1, 3] > 0.19 > 0.14 > path[-1, 3]


def test_it_does_not_go_where_nothing_was_measured():
    depth, camera = guard_arm.seen()
    dark = guard_arm.dark_strip(depth)
    tool, surface = guard_arm.guard_body(), palpate.Sensor(camera).update(dark)
    way = [(0, guard_arm.START), (4, guard_arm.START + [0.3, 0, 0])]
    # One row of the unseen share allows it.
    _, met = guard_arm.go(tool, surface, way, most=MOST)
    assert met[:, 2].max() == 1
    path, met = guard_arm.go(tool, surface, way, most=MOST, unseen=guard_arm.not_seen_free(dark, camera))
    assert met[:, 2].max() < 0.02
    # The strip begins half-way between two columns, 31 pixels from the middle; its side leans by as much.
    bottom = 1 - (path[:, 3] - HALF)  # m, from the camera
    inside = path[:, 1] + HALF - (0.6 - 31 / 280 * bottom)
    pixel, deepest = bottom.max() / 280, np.sqrt(2 * MOST / BOTTOM)
    assert -pixel < inside.max() < 1.5 * deepest + pixel


def test_it_stops_where_it_cannot_know_the_way_out():
    depth, camera = guard_arm.seen()
    nothing = guard_arm.not_seen_free(np.zeros_like(depth), camera)
    way = [(0, guard_arm.START), (2, guard_arm.START + [0.1, 0, 0])]
    path, _ = guard_arm.go(guard_arm.guard_body(), nothing, way, most=MOST, unseen=nothing)
    assert np.abs(path[:, 1:4] - path[0, 1:4]).max() < 1e-6


def test_the_recording_can_be_read(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["guard_arm.py", "-o", "out"])
    guard_arm.main()
    assert "keeps away" in capsys.readouterr().out
    run = palpate.Run.open("out/run")
    path = np.loadtxt("out/path.txt")
    # The last tick comes before the end of the path.
    assert np.abs(run.poses[:, :3].max(axis=0) - path[:, 1:4].max(axis=0)).max() < 0.002
    assert run.volume.max() > 0
