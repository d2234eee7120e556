"""palpate ros2 among real peers on this computer: two versions of Cyclone DDS, and Fast DDS.

usage: interop_test.py PALPATE [FASTDDS_PEER]
"""

import json
import math
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
import unittest

try:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
except ImportError:
    get_typestore = None

from messages_test import CONTACT
from peer_case import NEWER, NO_CYCLONE, PALPATE, PeerCase, has_enough, parts


class InteropTest(PeerCase):
    def lose_nothing(self, peer, *options):
        """Again if the peer stood still: what comes meanwhile may be more than it has room for."""
        for _ in range(3):
            seen, _ = self.converse(peer, *options, until=has_enough)
            if seen["lost"] == 0 or seen["delay_ms"][2] < 200:
                break
        self.assertEqual(seen["lost"], 0, seen["delay_ms"])
        return seen

    def test_a_robot_on_another_version_of_cyclone_dds(self):
        seen = self.lose_nothing(self.cyclone())
        self.assertGreater(seen["wrenches"], 1000)
        self.assertGreater(seen["touching"], 100)
        self.assertEqual(seen["frames"], ["palpate_tool"])
        self.assertEqual(seen["hashes"]["rt/palpate/wrench"],
                         "typehash=RIHS01_"
                         "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77;")
        self.assertEqual(seen["nodes"][0][0], "/palpate")
        self.assertIn("the run has ended", seen["reasons"])
        self.assertGreater(seen["contact"]["fraction"], 0)
        self.assertLess(seen["contact"]["fraction"], 1)
        self.assertLess(seen["contact"]["depth_age"], 0.1)
        self.expect_push_along(2, seen)

    def expect_push_along(self, axis, seen):
        """Expects a force on the tool away from the wall, against that axis, and stiffness only along it."""
        stiffness = [abs(part) for part in seen["contact"]["stiffness"]]
        for force in (seen["force"], seen["contact"]["force"]):
            self.assertLess(force[axis], 0)
            for other in {0, 1, 2} - {axis}:
                self.assertLess(abs(force[other]), 0.01 * abs(force[axis]))
                self.assertLess(stiffness[other], 0.01 * stiffness[axis])

    def test_with_the_newer_cyclone_dds_itself(self):
        if not NEWER:
            self.skipTest(NO_CYCLONE)
        seen, _ = self.converse(self.cyclone(), until=has_enough, PALPATE_DDSC=NEWER[0])
        self.assertGreater(seen["touching"], 100)

    def test_a_tool_by_tf_whose_static_part_was_told_before(self):
        seen, _ = self.converse(self.cyclone("tf"), tool=("--tool-frame", "tool0"), until=has_enough)
        self.assertGreater(seen["touching"], 100)
        self.assertEqual(seen["frames"], ["tool0"])
        self.expect_push_along(1, seen)  # it is turned

    def test_a_tool_that_tf_stops_telling_of_is_stale_whatever_else_tf_tells(self):
        block = os.path.join(self.folder.name, "ball.palp")  # that moves: palpate tells of it by tf, too
        seen, _ = self.converse(self.cyclone("tf_stops"), "--object", f"{block}@0.5 0 0.5 0 0 0 1,moving",
                                tool=("--tool-frame", "tool0"), until=has_enough)
        self.assertIn(0, [state for _, state in seen["turns"]])
        self.assertEqual(seen["wild_touching"], 0)
        self.assertIn("the tool's pose", seen["reasons"])

    def test_max_age_is_that_of_the_tools_pose_too(self):
        seen, _ = self.converse(self.cyclone("slow"), "--max-age", "5", until=has_enough)
        states = [state for _, state in seen["turns"]]
        # At the beginning and at the end there is none.
        self.assertEqual(states[states.index(0):], [0, 2], seen["turns"])
        seen, _ = self.converse(self.cyclone("slow"), until=has_enough)
        self.assertIn("the tool's pose", seen["reasons"])

    def test_a_robot_on_fast_dds_loses_nothing(self):
        if FASTDDS_PEER is None:
            self.skipTest("SKIPPED: scripts/setup.sh --test installs libfastrtps-dev")
        for options in ((), ("--qos", "reliable")):
            seen = self.lose_nothing([FASTDDS_PEER, self.domain, 640, 480], *options)
            self.assertGreater(seen["wrenches"], 1000)
            self.assertGreater(seen["touching"], 100)

    def test_clouds_of_fast_dds_are_felt_as_their_images(self):
        if FASTDDS_PEER is None:
            self.skipTest("SKIPPED: scripts/setup.sh --test installs libfastrtps-dev")
        wrenches = {}
        for case in ("still", "cloud", "loose"):
            depth = "/camera/depth/" + ("image_raw" if case == "still" else "points")
            wrenches[case], said = self.converse([FASTDDS_PEER, self.domain, 160, 120, 30, case], depth=depth,
                                                 until=has_enough)
            self.assertEqual("clouds are projected" in said, case == "loose", said)
        image = wrenches["still"]["force"]
        self.assertLess(image[2], 0)
        for case, limit in (("cloud", 1e-3), ("loose", 1e-2)):
            force = wrenches[case]["force"]
            self.assertLess(math.dist(force, image), limit * math.hypot(*image), (case, force, image))

    def test_an_arm_on_fast_dds_reads_contacts_and_bodies(self):
        """Its tf_static and our markers are there for who comes late; rosbags reads what it got."""
        if FASTDDS_PEER is None or get_typestore is None:
            self.skipTest("SKIPPED: scripts/setup.sh --test installs libfastrtps-dev and rosbags")
        mesh, block = (os.path.join(self.folder.name, f"block.{kind}") for kind in ("obj", "palp"))
        for words in (["shape", "box", "--size", "0.04", "-o", mesh], ["pack", mesh, "-o", block, "--spheres", "100"]):
            subprocess.run([PALPATE, *words], check=True, capture_output=True)
        gravity = 0.02
        store = get_typestore(Stores.ROS2_JAZZY)
        store.register(get_types_from_msg(CONTACT, "palpate_msgs/msg/Contact"))

        def read(name, kind):
            return [store.deserialize_cdr(bytes.fromhex(each), kind) for each in seen["messages"][name]]

        for duration in (4, 30):  # a busy computer may not have enough after the first
            seen, said = self.converse(
                [FASTDDS_PEER, self.domain, 640, 480, 30, "arm"], "--object", f"{block}@0.2 0 0.3 0 0 0.6 0.8,moving",
                "--set", "bodies.gravity_y=0", "--set", f"bodies.gravity_z={-gravity}", "--set", "bodies.damping=0",
                tool=("--tool-frame", "tool0"), duration=duration)
            contacts = read("contact", "palpate_msgs/msg/Contact")
            touching = [each for each in contacts if each.state == 0 and each.volume > 0]
            told = [each for message in read("tf", "tf2_msgs/msg/TFMessage") for each in message.transforms
                    if each.child_frame_id != "tool0"]
            if min(len(touching), len(told)) > 50 and any(each.stiffness[14] > 0 for each in touching):
                break
        self.assertGreater(min(len(touching), len(told)), 50, said)
        for each in touching:
            self.assertEqual(each.header.frame_id, "tool0")
            self.assertTrue(0 < each.fraction < 1)
            self.assertLess(each.wrench.force.z, 0)
            # The wall is flat: there is no force along it, and only against it is the contact stiff.
            self.assertLess(abs(each.wrench.force.x) + abs(each.wrench.force.y), 0.02 * abs(each.wrench.force.z))
            self.assertLessEqual(abs(each.stiffness[0]), 0.01 * abs(each.stiffness[14]))
        # The first of a touch may have none yet: it is of the newest measurement that has been recorded.
        # A computer that is busy leaves some out.
        self.assertTrue(any(each.stiffness[14] > 0 for each in touching))
        self.assertEqual((contacts[-1].state, contacts[-1].reason), (2, "the run has ended"))
        self.assertEqual({(each.header.frame_id, each.child_frame_id) for each in told}, {("camera", "palpate/block")})
        stamps = [each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in told]
        fallen = [(2 * max(0, 0.3 - each.transform.translation.z) / gravity)**0.5 for each in told]
        for k in range(1, len(told)):
            self.assertGreater(stamps[k], stamps[k - 1])
            # A body is where the step before has brought it: one step of 0.05 s at most.
            self.assertLess(fallen[k] - fallen[0], stamps[k] - stamps[0] + 0.05)
        # Steps are short, and a busy computer makes few.
        self.assertGreater(fallen[-1] - fallen[0], 0.2 * (stamps[-1] - stamps[0]))
        [array] = read("markers", "visualization_msgs/msg/MarkerArray")
        self.assertEqual({each.ns: each.header.frame_id for each in array.markers},
                         {"tool": "tool0", "block": "palpate/block"})
        [shape] = [each for each in array.markers if each.ns == "block"]
        self.assertEqual((shape.type, shape.frame_locked), (11, True))
        self.assertEqual({round(abs(point.y), 6) for point in shape.points}, {0.02})

    def test_the_topics_are_where_they_are_wanted(self):
        seen, _ = self.converse(self.cyclone("good", "cyclone_peer.py", "80x60", "rt/arm", "rt/ft/wrench"),
                                "--ros2-namespace", "/arm", "--wrench", "/ft/wrench", until=has_enough)
        self.assertGreater(seen["wrenches"], 1000)
        self.assertGreater(seen["contact"]["fraction"], 0)
        self.assertEqual(set(seen["hashes"]), {"rt/ft/wrench", *("rt/arm/" + name for name in (
            "contact", "tool_pose", "tool_twist", "points", "spheres", "markers"))})

    def test_a_robot_that_dies_is_zero_until_another_one_comes(self):
        victim = self.start(self.cyclone("dies"))
        times, successors = [], []

        def succeed():
            victim.wait()
            times.append(time.time())
            time.sleep(3)
            times.append(time.time())
            successors.append(self.start(self.cyclone()))

        nurse = threading.Thread(target=succeed)
        nurse.start()
        try:
            seen, said = self.converse(self.cyclone("watches"),
                                       until=lambda _: successors and has_enough(successors[0]))
        finally:
            victim.kill()
            nurse.join()
            victim.communicate()
            for each in successors:
                each.communicate(timeout=60)
        died, replaced = times
        turns = seen["turns"]
        before = [state for at, state in turns if at < died]
        between = [state for at, state in turns if died + 1 < at < replaced]
        self.assertIn(0, before, turns)
        self.assertNotIn(0, between, turns)
        self.assertEqual([state for at, state in turns if at < replaced][-1], 1, turns)
        self.assertIn(0, [state for at, state in turns if at > replaced], turns)
        self.expect_one_note("has stopped sending images", said)

    def test_a_camera_that_falls_silent_is_zero_and_says_why(self):
        seen, said = self.converse(self.cyclone("silent"), until=has_enough)
        self.assertEqual(seen["wild_touching"], 0)
        self.assertIn(1, seen["states"])
        self.assertIn("the depth image", seen["reasons"])
        self.expect_one_note("has stopped sending images", said)

    def test_images_that_are_none_are_told_once(self):
        for behavior, words in (("wrong_encoding", "encoding 'rgb8'"),
                                ("wrong_size", "a depth image is damaged")):
            seen, said = self.converse(self.cyclone(behavior), until=has_enough)
            self.assertEqual(seen["wild_touching"], 0)
            self.expect_one_note(words, said)
            self.expect_no_growth()

    def test_what_others_write_is_quoted_once_and_obeyed_by_no_terminal(self):
        seen, said = self.converse(self.cyclone("talks"), until=has_enough)
        self.assertEqual(seen["wild_touching"], 0)
        self.expect_one_note("sends images that are dropped: an image is of the encoding '?[2J", said)
        self.assertNotIn("\x1b", said)

    def test_stamps_from_tomorrow_are_told_once(self):
        seen, said = self.converse(self.cyclone("tomorrow"), until=has_enough)
        self.assertGreater(seen["wild_touching"], 10)
        self.expect_one_note("has restarted its clock", said)

    def test_a_flood_of_images_is_thinned_and_told_once(self):
        # 1000 images per second: 38 MB/s that are kept nowhere.
        seen, said = self.converse(self.cyclone("flood", "cyclone_peer.py", "160x120"), until=has_enough)
        self.assertGreater(seen["images"], 5000)
        self.assertGreater(seen["wild_touching"], 10)
        self.expect_one_note("sends more than 200 images per second", said)
        self.expect_no_growth()

    def expect_no_growth(self):
        """The flood would be 100 MB and more."""
        used = self.megabytes[len(self.megabytes) // 2:]
        self.assertLess(max(used[len(used) // 2:]) - max(used[:len(used) // 2]), 20, self.megabytes)

    def test_whoever_stays_on_this_computer_says_nothing_to_others(self):
        others = [name for _, name in socket.if_nameindex() if name != "lo"]
        try:
            ear = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(3))
        except OSError as why:
            self.skipTest(f"SKIPPED: only root hears what goes over a network: {why}")
        with ear:
            ear.setblocking(False)

            def num_packets(**environment):
                first = 7400 + 250 * self.domain  # the ports of the domain
                clean = {key: value for key, value in os.environ.items() if not key.startswith("ROS_")}
                run = subprocess.run([PALPATE, "cameras"], check=True, capture_output=True,
                                     env={**clean, "ROS_DOMAIN_ID": str(self.domain), **environment})
                self.assertIn(b"ros2", run.stdout)
                num = 0
                while True:
                    try:
                        packet, address = ear.recvfrom(65536)
                    except BlockingIOError:
                        return num
                    port = int.from_bytes(packet[22:24], "big")
                    num += address[0] in others and packet[:1] == b"E" and packet[9] == 17 and first <= port < first + 250

            if num_packets() == 0:
                self.skipTest("SKIPPED: there is no network to speak to")
            self.assertEqual(num_packets(ROS_LOCALHOST_ONLY="1"), 0)
            self.assertEqual(num_packets(ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST"), 0)

    def test_the_library_is_found_by_several_names(self):
        if not NEWER:
            self.skipTest(NO_CYCLONE)
        names = ["libddsc.so", "libddsc.so.11", "libddsc.so.0"]
        for good in names:
            with self.subTest(good):
                folder = os.path.join(self.folder.name, good)
                os.mkdir(folder)
                for name in names:  # one of which is a library
                    if name == good:
                        shutil.copy(NEWER[0], os.path.join(folder, name))
                        break
                    with open(os.path.join(folder, name), "w", encoding="ascii") as file:
                        file.write("no library")
                found = subprocess.run([PALPATE, "cameras", "--json"], check=True, capture_output=True,
                                       env={**os.environ, "LD_LIBRARY_PATH": folder})
                [ros2] = [each for each in json.loads(found.stdout) if each["kind"] == "ros2"]
                self.assertEqual(ros2["library"], os.path.join(folder, good))

    def test_nobody_there_is_one_clear_error(self):
        for options, words in ((["--pose", "/tool_pose"], "has sent no depth image within 10 s"),):
            run = subprocess.run(
                [PALPATE, "ros2", self.tool, "--depth", "/nothing", *options, "-o",
                 os.path.join(self.folder.name, "none")], capture_output=True, text=True,
                timeout=120,
                env={**os.environ, "ROS_DOMAIN_ID": str(self.domain), "ROS_LOCALHOST_ONLY": "1"})
            self.assertEqual(run.returncode, 1)
            *notes, error = run.stderr.splitlines()
            self.assertIn(words, error)
            for note in notes:  # what it waits for
                self.assertIn("note: ros2:/nothing waits up to 10 s for its first depth image", note)
            self.assertFalse(os.path.exists(os.path.join(self.folder.name, "none")))

    def test_without_cyclone_dds_the_reason_is_told(self):
        run = subprocess.run([PALPATE, "ros2", self.tool, "--depth", "/d", "--pose", "/p"],
                             capture_output=True, text=True,
                             env={**os.environ, "PALPATE_DDSC": "/nowhere/libddsc.so"})
        self.assertEqual(run.returncode, 1)
        self.assertIn("/nowhere/libddsc.so", run.stderr)
        self.assertIn("install libddsc0debian", run.stderr)


if __name__ == "__main__":
    FASTDDS_PEER = sys.argv.pop(1) if len(sys.argv) > 1 and "fastdds_peer" in sys.argv[1] else None
    unittest.main(testLoader=parts.Loader())
