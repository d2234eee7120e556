"""palpate ros2 among real peers on this computer: two versions of Cyclone DDS, and Fast DDS.

usage: interop_test.py PALPATE [FASTDDS_PEER]
"""

import os
import subprocess
import sys
import unittest

from peer_case import NEWER, NO_CYCLONE, PALPATE, PeerCase


class InteropTest(PeerCase):
    def test_a_robot_on_another_version_of_cyclone_dds(self):
        seen, _ = self.converse(self.cyclone())
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
        """Of the tool, away from the wall, against that axis; and only along it is it stiff."""
        stiffness = [abs(part) for part in seen["contact"]["stiffness"]]
        for force in (seen["force"], seen["contact"]["force"]):
            self.assertLess(force[axis], 0)
            for other in {0, 1, 2} - {axis}:
                self.assertLess(abs(force[other]), 0.01 * abs(force[axis]))
                self.assertLess(stiffness[other], 0.01 * stiffness[axis])

    def test_with_the_newer_cyclone_dds_itself(self):
        if not NEWER:
            self.skipTest(NO_CYCLONE)
        seen, _ = self.converse(self.cyclone(), PALPATE_DDSC=NEWER[0])
        self.assertGreater(seen["touching"], 100)

    def test_a_tool_by_tf_whose_static_part_was_told_before(self):
        seen, _ = self.converse(self.cyclone("tf"), tool=("--tool-frame", "tool0"))
        self.assertGreater(seen["touching"], 100)
        self.assertEqual(seen["frames"], ["tool0"])
        self.expect_push_along(1, seen)  # it is turned

    def test_a_robot_on_fast_dds_loses_nothing(self):
        if FASTDDS_PEER is None:
            self.skipTest("SKIPPED: scripts/setup.sh --test installs libfastrtps-dev")
        for options in ((), ("--qos", "reliable")):
            seen, _ = self.converse([FASTDDS_PEER, self.domain, 640, 480], *options)
            self.assertGreater(seen["wrenches"], 1000)
            self.assertGreater(seen["touching"], 100)
            self.assertEqual(seen["lost"], 0)

    def test_a_camera_that_falls_silent_is_zero_and_says_why(self):
        seen, said = self.converse(self.cyclone("silent"), duration=6)
        self.assertEqual(seen["wild_touching"], 0)
        self.assertIn(1, seen["states"])
        self.assertIn("the depth image", seen["reasons"])
        self.expect_one_note("sends no images any more", said)

    def test_images_that_are_none_are_told_once(self):
        for behavior, words in (("wrong_encoding", "encoding 'rgb8'"),
                                ("wrong_size", "a depth image is damaged")):
            seen, said = self.converse(self.cyclone(behavior))
            self.assertEqual(seen["wild_touching"], 0)
            self.expect_one_note(words, said)

    def test_stamps_from_tomorrow_are_told_once(self):
        seen, said = self.converse(self.cyclone("tomorrow"))
        self.assertGreater(seen["wild_touching"], 10)
        self.expect_one_note("has started its clock anew", said)

    def test_a_flood_of_images_is_thinned(self):
        seen, _ = self.converse(self.cyclone("flood"))
        self.assertGreater(seen["images"], 500)
        self.assertGreater(seen["wild_touching"], 10)

    def test_nobody_there_is_one_clear_error(self):
        for options, words in ((["--pose", "/tool_pose"], "has sent no depth image within 10 s"),):
            run = subprocess.run(
                [PALPATE, "ros2", self.tool, "--depth", "/nothing", *options, "-o",
                 os.path.join(self.folder.name, "none")], capture_output=True, text=True,
                timeout=120,
                env={**os.environ, "ROS_DOMAIN_ID": str(self.domain), "ROS_LOCALHOST_ONLY": "1"})
            self.assertEqual(run.returncode, 1)
            self.assertEqual(run.stderr.count("\n"), 1, run.stderr)
            self.assertIn(words, run.stderr)
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
    unittest.main()
