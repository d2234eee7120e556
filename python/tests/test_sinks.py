"""palpate.sinks: their files, read back by the vendors' own readers."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate import sinks


@pytest.fixture(scope="module")
def run(cube, tmp_path_factory):
    """Half a second before and in a wall."""
    folder = tmp_path_factory.mktemp("sinks")
    path = np.array([[0.1 * k, 0, 0, 0.95 + 0.012 * k, 0, 0, 0, 1] for k in range(6)])
    np.savetxt(folder / "path.tum", path)
    with palpate.touch(cube, "scene:wall", folder / "path.tum", output=folder / "run") as one:
        one.wait()
    return one


def test_states_of_spheres(cube):
    depth, camera, _ = palpate.render_scene("wall")
    surface, contact = palpate.Sensor(camera).update(depth), palpate.Contact(cube)
    assert contact.measure(surface, [0, 0, 1, 0, 0, 0, 1]).states is None
    far, there, behind = (contact.measure(surface, [0, 0, z, 0, 0, 0, 1], states=True).states for z in (0.9, 1, 1.1))
    assert (far == 0).all() and (behind == 2).all() and len(there) == len(cube)
    z, r = cube.spheres[:, 2], cube.spheres[:, 3]
    clear = np.abs(np.abs(z) - r) > 1e-3  # not just touching
    wanted = np.where(z + r < 0, 0, np.where(z - r > 0, 2, 1))
    assert (there[clear] == wanted[clear]).all() and set(there) == {0, 1, 2}


def test_what_is_no_measurement_is_no_point(run, cube):
    """0 and 65535, also where the unit of a frame is not that of the camera."""
    records = dict(run.frame_records)
    records["unit"] = np.full_like(records["unit"], 0.0001)
    records["unit"][0] = 0.001

    class Frames:
        camera = run.camera

        def __iter__(self):
            for number, (at, image) in zip(range(3), run.frames()):
                image = image * (1 if number == 0 else 10)  # the wall at 1 m
                image[:, :200], image[:, -200:] = 0, 65535
                yield at, image.astype(np.uint16)

    class Changed:
        frames, frame_records, tool = staticmethod(Frames), records, cube
        times, poses, wrench, ticks = run.times, run.poses, run.wrench, run.ticks

    moments = list(sinks._moments(Changed, 1))
    assert len(moments) == 3
    for moment in moments:
        assert len(moment.points) > 480 * 200 and moment.points[:, 2] == pytest.approx(1, abs=0.02)
        assert np.abs(moment.points[:, 0]).max() < 0.3
        assert (moment.depth[:, -200:] == 0).all()


def test_rerun(run, cube, tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    file = tmp_path / "run.rrd"
    sinks.to_rerun(run, file)
    read = subprocess.run([Path(sys.executable).parent / "rerun", "rrd", "print", "-vvv", file], capture_output=True,
                          text=True, check=True).stdout
    for entity in ("/world/cloud", "/world/tool/spheres", "/world/tool/mesh", "/world/force", "/depth", "/ticks/volume_m3"):
        assert entity in read, entity
    verified = subprocess.run([Path(sys.executable).parent / "rerun", "rrd", "verify", file], capture_output=True, text=True)
    assert verified.returncode == 0, verified.stderr


def test_frames_of_a_live_run_are_where_they_were_felt(cube, tmp_path):
    """The camera has its own clock here: contacts, which store their frame, locate the frames in time."""
    with palpate.touch(cube, "scene:hand", device="sim", duration=1.5, output=tmp_path / "run",
                       max_sensor_age=30, max_contact_age=30) as live:
        live.wait()
    moments = list(sinks._moments(live, 16))
    assert len(moments) > 2
    contacts, records = live.contacts, live.frame_records
    offset = np.median(live.ticks["device.time"] - live.ticks["time"])
    for moment, number in zip(moments, records["number"]):
        felt = np.flatnonzero(contacts["frame_number"] == number)
        if len(felt) == 0:
            continue
        # Captured before the contact, by at most the age that the contact reports.
        first = contacts["time"][felt[0]]
        age = first + offset - contacts["capture_time"][felt[0]]
        assert moment.time == pytest.approx(max(0, first - age), abs=1e-6)
        tick = np.searchsorted(live.times, moment.time + 1e-9, side="right") - 1
        assert np.array_equal(moment.X_WT, live.poses[max(tick, 0)])


def test_foxglove(run, cube, tmp_path):
    pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    file = tmp_path / "run.mcap"
    sinks.to_foxglove(run, file)
    decoder = pytest.importorskip("mcap_protobuf.decoder", reason="mcap-protobuf-support is not installed")
    topics = {}
    with open(file, "rb") as stream:
        read = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        for schema, channel, message in read.iter_messages():
            decode = decoder.DecoderFactory().decoder_for(channel.message_encoding, schema) or json.loads
            topics.setdefault(channel.topic, []).append((message.log_time, decode(message.data)))
    times = [int(1e9 * time) for time, _ in run.frames()]  # on the clock of a path they are the same
    for topic in ("/cloud", "/tool", "/wrench", "/tf"):
        assert [when for when, _ in topics[topic]] == times, topic
        stamps = [getattr(message, "entities", [message])[0].timestamp for _, message in topics[topic]]
        assert [stamp.ToNanoseconds() for stamp in stamps] == times, topic

    cloud = topics["/cloud"][-1][1]
    points = np.frombuffer(cloud.data, "<f4").reshape(-1, 3)
    assert len(points) > 10000 and np.abs(points[:, 2] - 1).max() < 0.02  # the wall
    place = topics["/tf"][-1][1].translation
    tick = np.searchsorted(run.times, times[-1] * 1e-9 + 1e-9) - 1
    assert (place.x, place.y, place.z) == pytest.approx(tuple(run.poses[tick, :3]), abs=1e-9)
    spheres = topics["/tool"][-1][1].entities[0].spheres
    assert np.array([[s.pose.position.x, s.pose.position.y, s.pose.position.z, s.size.x / 2] for s in spheres]) == \
        pytest.approx(cube.spheres, abs=1e-7)
    colors = {(round(255 * s.color.r), round(255 * s.color.g), round(255 * s.color.b)) for s in spheres}
    assert colors == {(229, 71, 47), (180, 92, 242), (31, 102, 232)}  # outside, boundary, inside
    arrow = topics["/wrench"][-1][1].entities[0].arrows[0]
    force = run.wrench[tick, :3]
    assert (arrow.shaft_length + arrow.head_length) == pytest.approx(0.02 * np.linalg.norm(force), rel=1e-9)
    q = arrow.pose.orientation
    along = np.array([1 - 2 * (q.y**2 + q.z**2), 2 * (q.x * q.y + q.w * q.z), 2 * (q.x * q.z - q.w * q.y)])
    assert along == pytest.approx(force / np.linalg.norm(force), abs=1e-9)

    volumes = [tick.get("volume_m3") for _, tick in topics["/ticks"]]
    assert volumes == [None if np.isnan(volume) else volume for volume in run.volume.tolist()]
    with pytest.raises(palpate.Error, match="is there already"):
        sinks.to_foxglove(run, file)
    assert os.listdir(tmp_path) == ["run.mcap"]
    with pytest.raises(ValueError, match="stride"):
        sinks.to_foxglove(run, tmp_path / "other.mcap", stride=0)
