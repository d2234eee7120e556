"""Depth images over ROS 2, from a peer on another version of Cyclone DDS: compressed, with lens distortion, from
cameras that move or are several, late; and the topics from which a follower hears of the tool.

usage: live_cameras_test.py PALPATE
"""

import csv
import json
import math
import os
import pathlib
import re
import signal
import statistics
import subprocess
import time
import unittest
import urllib.request

try:
    import rosbags.highlevel
    import rosbags.rosbag2
except ImportError:
    rosbags = None

from peer_case import PALPATE, PeerCase, has_enough, parts

COMPRESSED = "/camera/depth/image_raw/compressedDepth"


class LiveCamerasTest(PeerCase):
    def watch(self, behavior, *options, place="0,0,0.5", **more):
        """Runs palpate with a camera peer; returns the peer's observations until it had enough."""
        return self.converse(self.cyclone(behavior, "camera_peer.py", place), *options, until=has_enough, **more)[0]

    def touched(self, seen):
        """The largest share of the tool that was in the wall."""
        self.assertGreater(seen["touching"], 100)
        return max(seen["fractions"])

    def test_all_ways_to_send_a_wall_feel_alike(self):
        plain = self.touched(self.watch("float"))
        plain_png = "/camera/depth/image_raw/compressed"
        for behavior, depth, delta in (("png", COMPRESSED, 0.002), ("rvl", COMPRESSED, 0.002), ("plain", plain_png, 0.002),
                                       ("inverse", COMPRESSED, 0.012)):  # of steps of half a millimeter
            with self.subTest(behavior):
                other = self.touched(self.watch(behavior, depth=depth))
                self.assertAlmostEqual(other, plain, delta=delta)
        with self.subTest("millimeters"):
            scaled = self.touched(self.watch("millimeters", "--depth-scale", "0.001"))
            self.assertAlmostEqual(scaled, plain, delta=0.002)

    def test_each_image_is_seen_by_its_own_lens(self):
        seen = self.watch("bent", place="0.2,0,0.5")
        self.assertGreater(len(seen["fractions"]), 50)
        # The wall ends a centimeter beside the tool. By the other lens 15 % of it would be inside.
        self.assertLess(max(seen["fractions"]), 0.01)
        # An image whose lens is not known in time is not seen by another one: here that is every one, or nearly, if
        # palpate does not come to look for a while.
        seen, said = self.converse(self.cyclone("bent_late", "camera_peer.py", "0.2,0,0.5"), statuses=(0, 1))
        self.assertIn("has a lens that changes", said)
        self.assertLess(max(seen["fractions"], default=0), 0.01)

    def test_a_lens_that_is_told_once_is_that_of_all_images(self):
        self.touched(self.watch("once"))

    def test_a_camera_info_without_intrinsics_is_no_lens(self):
        seen, said = self.converse(self.cyclone("uncalibrated", "camera_peer.py", "0,0,0.5"), until=has_enough)
        self.touched(seen)
        # Through a lens of zeros the tool would be deep in a wall that is not there.
        self.assertLess(max(seen["fractions"]) - min(seen["fractions"]), 0.01)
        self.expect_one_note("camera_info without intrinsics", said)

    def test_a_camera_that_moves_is_where_tf_had_it_at_the_images_stamp(self):
        seen = self.watch("moving", "--world", "base", "--max-age", "0.5")
        self.assertEqual(seen["frames"], ["base"])
        fractions = seen["fractions"][len(seen["fractions"]) // 4:]
        self.assertGreater(len(fractions), 100)
        middle = statistics.median(fractions)
        self.assertGreater(middle, 0.5)
        # An error of 10 ms in the camera's pose would be up to 9 mm and 22 % of the tool.
        self.assertLess(max(fractions) - min(fractions), 0.06)

    def test_two_cameras_are_placed_by_tf(self):
        seen = self.watch("two", "--depth", "/behind/depth/image_raw", "--world", "base")
        self.assertEqual(seen["frames"], ["base"])
        # One sees the wall all the time: what the other sees through is free.
        touching = sum(fraction > 0.5 for fraction in seen["fractions"])
        free = sum(fraction == 0 for fraction in seen["fractions"])
        self.assertGreater(touching, 30)
        self.assertGreater(free, 30)

    def test_a_scene_from_afar_says_how_old_it_is(self):
        seen = self.watch("late", "--max-age", "0.8", "--clock", "shared")
        self.touched(seen)
        self.assertGreater(min(seen["ages"]), 0.2)
        # The youngest scene: how long others have waited is up to the computer.
        self.assertLess(min(seen["ages"]), min(seen["delays"]) + 0.15)
        # A constant delay is invisible without a shared clock.
        seen = self.watch("late", "--max-age", "0.8")
        self.assertLess(min(seen["ages"]), 0.2)

    def bag_of(self, recording):
        """The same as a rosbag2 of SQLite, written by rosbags."""
        bag = pathlib.Path(self.folder.name, "bag")
        with (rosbags.highlevel.AnyReader([recording]) as reader,
              rosbags.rosbag2.Writer(bag, version=9,
                                     storage_plugin=rosbags.rosbag2.StoragePlugin.SQLITE3) as writer):
            into = {each.id: writer.add_connection(each.topic, each.msgtype, typestore=reader.typestore)
                    for each in reader.connections if each.msgtype.startswith(("sensor_msgs", "std_msgs", "tf2_msgs"))}
            for connection, stamp, data in reader.messages():
                if connection.id in into:
                    writer.write(into[connection.id], stamp, data)
        return bag

    @unittest.skipUnless(rosbags, "SKIPPED: scripts/setup.sh --test installs rosbags")
    @unittest.skipUnless(os.environ.get("PALPATE_DATA"), "SKIPPED: PALPATE_DATA names no folder with real frames")
    def test_a_bag_of_real_frames_is_played_by_rosbags_and_felt(self):
        frames = pathlib.Path(self.folder.name, "frames")
        frames.mkdir()
        for k in (1, 2, 3):
            (frames / f"{k}.png").symlink_to(pathlib.Path(os.environ["PALPATE_DATA"], f"frames/pcl_grabber_{k}.png"))
        recording = pathlib.Path(self.folder.name, "frames.mcap")
        subprocess.run([PALPATE, "record", "--camera", f"folder:{frames}?intrinsics=525,525,320,240&rate=4", "-o",
                        recording], check=True, capture_output=True)
        bag = self.bag_of(recording)
        # A tool at what one pixel sees.
        with rosbags.highlevel.AnyReader([bag]) as reader:
            image = next(reader.deserialize(data, connection.msgtype) for connection, _, data in reader.messages()
                         if connection.msgtype.endswith("/Image"))
        z = int(image.data.view("<u2")[640 * 240 + 320]) / 1000
        self.assertGreater(z, 0.3)
        path = pathlib.Path(self.folder.name, "still.txt")
        path.write_text(f"0 0 0 {z} 0 0 0 1\n1 0 0 {z} 0 0 0 1\n", encoding="utf-8")
        run = pathlib.Path(self.folder.name, "of_bag")
        subprocess.run([PALPATE, "touch", self.tool, "--camera", f"bag:{bag}", "--path", path, "--align", "starts", "-o",
                        run], check=True, capture_output=True)
        with open(run / "wrench.csv", encoding="utf-8") as file:
            fractions = [float(row["fraction"]) for row in csv.DictReader(file)]
        self.assertGreater(max(fractions), 0.05)
        seen = self.watch(f"bag:{bag}", "--max-age", "2", place=f"0,0,{z}")
        self.assertAlmostEqual(max(seen["fractions"]) / max(fractions), 1, places=2)

    def test_somebody_draws_the_spheres_by_their_state(self):
        self.tool = os.path.join(self.folder.name, "box.palp")  # a ball is one sphere, but for dust
        mesh = os.path.join(self.folder.name, "box.obj")
        for words in (["shape", "box", "--size", "0.05", "-o", mesh], ["pack", mesh, "-o", self.tool, "--spheres", "300"]):
            subprocess.run([PALPATE, *words], check=True, capture_output=True)
        seen = self.watch("spheres", place="0,0,0.49")
        self.assertEqual(len(seen["spheres"]), 300)
        margin, counts = 0.004, {"free": 0, "touching": 0, "inside": 0, "unseen": 0}
        for state, radius, x, _, z in seen["spheres"]:
            counts[state] += 1
            # The tool's middle is in the wall, whose right half nobody has measured.
            if x > margin or z > 0.02 + margin:
                self.assertEqual(state, "unseen", (x, z))
            elif x < -margin and z < 0.02 - margin:
                may_be = {"free"} if z + radius < -margin else {"inside"} if z - radius > margin else \
                    {"touching"} if abs(z) < radius - margin else {"free", "touching", "inside"}
                self.assertIn(state, may_be, (radius, x, z))
        self.assertGreater(min(counts.values()), 0, counts)

    def test_bodies_that_move_are_frames_of_tf(self):
        mesh, block = (os.path.join(self.folder.name, f"block.{kind}") for kind in ("obj", "palp"))
        path = os.path.join(self.folder.name, "away.txt")
        for words in (["shape", "box", "--size", "0.04", "-o", mesh], ["pack", mesh, "-o", block, "--spheres", "100"]):
            subprocess.run([PALPATE, *words], check=True, capture_output=True)
        with open(path, "w", encoding="utf-8") as file:
            file.write("".join(f"{0.1 * k} 1.3 2.3 3 0 0 0 1\n" for k in range(351)))
        # The camera looks along the world's y; a block falls from before it along -z, another one stays.
        gravity, turned = 0.1, [0, 0, 0.6, 0.8]
        for duration in (4, 30):  # a busy computer needs longer for as many
            seen, said = self.converse(self.cyclone("bodies", "camera_peer.py"), duration=duration, words=[
                "touch", self.tool, "--camera", f"ros2:/camera/depth/image_raw?pose=1,2,3,{-(0.5**0.5)},0,0,{0.5**0.5}",
                "--device", f"replay:{path}", "--ros2", "--ros2-camera-frame", "map", "--ros2-namespace", "/palpate",
                "--object", f"{block}@1 2.3 3 0 0 0.6 0.8,moving", "--object", f"{block}@0 2 1 0 0 0.6 0.8",
                "--set", "bodies.gravity_y=0", "--set", f"bodies.gravity_z={-gravity}", "--set", "bodies.damping=0"])
            told = seen["bodies"]
            if len(told) > 50 and len(seen["shapes"]) == 3:
                break
        self.assertGreater(len(told), 50, said)
        self.assertEqual({tuple(each[1:3]) for each in told}, {("map", "palpate/block")})
        for each in told:
            for part, expected in zip((3, 4, 6, 7, 8, 9), [1, 2.3, *turned]):
                self.assertAlmostEqual(each[part], expected, delta=1e-6)
        # The fallen height gives the time of the fall: as long as the stamps say, and shorter only where
        # the computer was too busy for the run's steps, which are at most 20 ms. 1 ms: of the calendar's clock.
        fallen = [(each[0], math.sqrt(max(2 * (3 - each[5]) / gravity, 0))) for each in told]
        for before, after in zip(fallen, fallen[1:]):
            self.assertGreater(after[0], before[0])
            self.assertLess(after[1] - before[1], after[0] - before[0] + 0.001)
            if after[0] - before[0] < 0.02:
                self.assertGreater(after[1] - before[1], after[0] - before[0] - 0.001)
        self.assertGreater(fallen[-1][1] - fallen[0][1], 0.2 * (fallen[-1][0] - fallen[0][0]))
        shapes = seen["shapes"]
        self.assertEqual({name: shape["frame"] for name, shape in shapes.items()},
                         {"tool": "palpate_tool", "block": "palpate/block", "block_2": "map"})
        self.assertEqual(shapes["block"]["place"], [0, 0, 0, 0, 0, 0, 1])
        for part, expected in zip(shapes["block_2"]["place"], [0, 2, 1, *turned]):
            self.assertAlmostEqual(part, expected, delta=1e-9)
        for name in ("block", "block_2"):
            self.assertEqual((shapes[name]["type"], shapes[name]["locked"]), (11, True))
            self.assertAlmostEqual(shapes[name]["size"], 0.02, delta=1e-6)

    def test_the_clutch_and_the_workspace_hold_the_follower(self):
        path = os.path.join(self.folder.name, "master.txt")
        with open(path, "w", encoding="utf-8") as file:  # to and fro by 50 mm, once a second
            for k in range(6001):
                file.write(f"{0.01 * k} {0.05 * math.sin(0.02 * math.pi * k)} 0 0.3 0 0 0 1\n")

        def change(key, value):
            """When it was asked for, and when it was done."""
            asked = time.time()
            with urllib.request.urlopen(f"{address}/api/command", timeout=60, data=json.dumps(
                    {"command": "set", "key": key, "value": value}).encode()) as answer:
                self.assertTrue(json.load(answer)["ok"])
            return asked, time.time()

        def num_contacts():
            with urllib.request.urlopen(f"{address}/api/state", timeout=60) as answer:
                return json.load(answer)["contacts"]

        robot = self.start(self.cyclone("follow", "camera_peer.py"))
        run = subprocess.Popen(
            [PALPATE, "touch", self.tool, "--camera", "ros2:/camera/depth/image_raw", "--device", f"replay:{path}",
             "--ros2", "--max-age", "10", "--set", "safety.max_sensor_age=10", "--set", "safety.max_contact_age=10",
             "--view", "--view-port", "0", "-o", os.path.join(self.folder.name, "held")],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, "ROS_DOMAIN_ID": str(self.domain), "ROS_LOCALHOST_ONLY": "1"})
        try:
            for line in run.stdout:  # after a note on what it waits for
                if found := re.search(r"open (http://\S+?)/? in a browser", line):
                    address = found.group(1)
                    break
            else:
                self.fail("the run has ended")
            while run.poll() is None and num_contacts() == 0:
                time.sleep(0.05)
            time.sleep(3)
            asked_to_hold, held = change("coupling.clutch", True)
            time.sleep(4)
            asked_to_release, released = change("coupling.clutch", False)
            time.sleep(4)
            asked_for_walls, walled = change("coupling.workspace_x", 0.01)
            time.sleep(4)
        finally:
            run.send_signal(signal.SIGINT)
            said, _ = run.communicate(timeout=60)
            seen = json.loads(robot.communicate(timeout=60)[0])
        self.assertGreater(len(seen["poses"]), 300, said)

        def span(begin, end, of="poses", part=1):
            values = [each[part] for each in seen[of] if begin < each[0] < end]
            self.assertGreater(len(values), 10, said)
            return min(values), max(values)

        low, high = span(0, asked_to_hold)
        self.assertGreater(high - low, 0.06)
        low, high = span(held + 2.5, asked_to_release)  # once it has come to rest
        self.assertLess(high - low, 0.0005)
        low, high = span(held + 2.5, asked_to_release, "twists")
        self.assertLess(max(-low, high), 0.01)
        low, high = span(released, asked_for_walls)
        self.assertGreater(high - low, 0.06)
        low, high = span(walled + 2.5, float("inf"))
        self.assertLess(max(-low, high), 0.012)

    def test_a_topic_that_is_none_or_silent_is_told_at_once(self):
        environment = {**os.environ, "ROS_DOMAIN_ID": str(self.domain), "ROS_LOCALHOST_ONLY": "1"}
        words = [PALPATE, "touch", self.tool, "-o", os.path.join(self.folder.name, "never"), "--camera"]
        for topic, *more in (("ros2:bad topic!",), ("ros2:/1a",), ("ros2:/a?info=/b c",), ("scene:wall", "--device", "ros2:/a b")):
            refused = subprocess.run([*words, topic, *more], capture_output=True, text=True, env=environment, timeout=60)
            self.assertEqual(refused.returncode, 1, refused.stderr)
            self.assertRegex(refused.stderr, r"^palpate: no ROS topic can be called '/[^']*': give [^\n]*image_raw\n$")
        begin = time.monotonic()
        waiting = subprocess.Popen([*words, "ros2:x"], stderr=subprocess.PIPE, text=True, env=environment)
        note = waiting.stderr.readline()
        self.assertRegex(note, "note: ros2:/x waits up to 10 s for its first depth image: there is no publisher")
        self.assertIn("ros2:/x has sent no depth image within 10 s", waiting.communicate(timeout=60)[1])
        self.assertGreater(time.monotonic() - begin, 9)
        self.assertEqual(waiting.returncode, 1)

    def test_a_follower_hears_of_the_tool(self):
        path = os.path.join(self.folder.name, "path.txt")
        with open(path, "w", encoding="utf-8") as file:
            for k in range(12001):  # to and fro in front of the wall, and turning
                t = 0.01 * k
                file.write(f"{t} {0.1 * (t % 2 if t % 4 < 2 else 2 - t % 2) - 0.05} 0 0.3 0 0 "
                           f"{math.sin(0.1 * t)} {math.cos(0.1 * t)}\n")
        words = ["touch", self.tool, "--camera", "ros2:/camera/depth/image_raw", "--device", f"replay:{path}", "--ros2",
                 "--max-age", "0.5"]
        seen, _ = self.converse(self.cyclone("follow", "camera_peer.py"), words=words, until=has_enough)
        poses = sorted(seen["poses"])
        self.assertGreater(len(poses), 100)
        # Twists lead from one pose to the next one.
        told = {twist[0]: twist for twist in seen["twists"]}
        errors = []
        for before, after in zip(poses, poses[1:]):
            twist = told.get(after[0])
            if twist is None or not any(twist[1:]):
                continue
            seconds = after[0] - before[0]
            ways = [after[1 + axis] - before[1 + axis] for axis in range(3)]
            ways.append(2 * (before[7] * after[6] - before[6] * after[7]))  # turned about z alone
            errors.append(max(abs(way - seconds * speed) for way, speed in zip(ways, (*twist[1:4], twist[6]))))
        self.assertGreater(len(errors), 100)
        # But for those where one was lost between them, or a stamp was made while others ran.
        self.assertLess(statistics.quantiles(errors, n=10)[-2], 1e-5)


if __name__ == "__main__":
    unittest.main(testLoader=parts.Loader())
