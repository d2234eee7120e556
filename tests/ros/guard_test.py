"""palpate ros2 --robot without a tool, among peers: a hand that slides toward a wall, and a finger beside it that turns.
The closed form is that of boxes before a wall.

usage: guard_test.py PALPATE [FASTDDS_PEER]
"""

import os
import subprocess
import sys
import unittest

try:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
except ImportError:
    get_typestore = None

from messages_test import GUARD
from peer_case import PALPATE, PeerCase, has_enough, parts

# The wheel moves nothing that has a shape. At slide = 0.1 the front of the hand is 0.42 m before the camera.
URDF = """<robot name="arm"><link name="base"/><link name="rim"/>
<link name="hand"><collision><geometry><box size="0.04 0.04 0.04"/></geometry></collision></link>
<link name="finger"><collision><origin xyz="0 0.1 0"/><geometry><box size="0.02 0.02 0.02"/></geometry></collision></link>
<joint name="wheel" type="continuous"><parent link="base"/><child link="rim"/></joint>
<joint name="slide" type="prismatic"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/><limit lower="0" upper="0.3"/></joint>
<joint name="turn" type="revolute"><parent link="hand"/><child link="finger"/><axis xyz="1 0 0"/><limit lower="-1" upper="1"/></joint>
</robot>"""
NEAR = 0.07  # m, from the hand to the wall; else 0.28


class GuardTest(PeerCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.urdf = os.path.join(cls.folder.name, "arm.urdf")
        cls.packed = os.path.join(cls.folder.name, "arm.palprobot")
        with open(cls.urdf, "w", encoding="ascii") as file:
            file.write(URDF)
        subprocess.run([PALPATE, "pack", "--robot", cls.urdf, "--standoff", "0.005", "-o", cls.packed], check=True,
                       capture_output=True)

    def words(self, robot, *more):
        return ["ros2", "--robot", robot, "--depth", "/camera/depth/image_raw", "--robot-pose", "0 0 0.3 0 0 0 1", *more]

    def guard(self, robot, *more):
        """Returns the messages that an arm on Fast DDS got, and the notes of palpate."""
        if FASTDDS_PEER is None or get_typestore is None:
            self.skipTest("SKIPPED: scripts/setup.sh --test installs libfastrtps-dev and rosbags")
        store = get_typestore(Stores.ROS2_JAZZY)
        store.register(get_types_from_msg(GUARD, "palpate_msgs/msg/Guard"))
        seen, said = self.converse([FASTDDS_PEER, self.domain, 80, 60, 30, "joints"], until=has_enough, writes=False,
                                   words=self.words(robot, "--velocity-scale", "/servo/scale", "--margin", "0.02", *more))

        def read(name, kind):
            return [store.deserialize_cdr(bytes.fromhex(each), kind) for each in seen["messages"][name]]
        return (read("guard", "palpate_msgs/msg/Guard"), [each.data for each in read("clearance", "std_msgs/msg/Float64")],
                [each.data for each in read("scale", "std_msgs/msg/Float64")], said)

    def test_a_whole_arm_is_slowed_down_before_a_wall(self):
        guards, clearances, scales, said = self.guard(self.packed, "--approach", "4")
        valid = [each for each in guards if each.state == 0]
        near = [each for each in valid if abs(each.clearance - NEAR) < 0.003]
        far = [each for each in valid if each.clearance == 0.2]
        # Nothing else: the arm itself, which the images show, is not in the way.
        self.assertEqual(len(near) + len(far), len(valid))
        self.assertGreater(min(len(near), len(far)), 20, said)
        for each in near:
            self.assertEqual((each.link, each.joints, sorted(each.links)), ("hand", ["wheel", "slide", "turn"], ["finger", "hand"]))
            self.assertAlmostEqual(each.scale, (each.clearance - 0.02) / 0.08, 12)
            self.assertFalse(each.held)
            rows = each.rows.reshape(2, 3)
            for link, row, clearance, bound in zip(each.links, rows, each.clearances, each.bounds):
                self.assertEqual(row[0], 0)
                self.assertAlmostEqual(row[1], 1, 2)
                self.assertAlmostEqual(bound, 4 * (clearance - 0.02), 12)
                self.assertAlmostEqual(clearance, NEAR if link == "hand" else NEAR + 0.01, delta=0.003)
                # The finger, 9 to 11 cm beside the axis, turns to the wall; the hand stays.
                self.assertAlmostEqual(row[2], 0 if link == "hand" else 0.1, delta=0.012)
        for each in far:
            self.assertEqual((each.scale, each.link, len(each.rows), each.links), (1, "", 0, []))
        self.assertTrue({each.clearance for each in valid} >= set(clearances) - {0})
        self.assertTrue({each.scale for each in valid} >= set(scales) - {0})
        # While the joints are silent, and at the end, it stands still.
        silent = [each for each in guards if each.state == 1 and "no state for joint" in each.reason]
        self.assertGreater(len(silent), 10)
        self.assertEqual((guards[-1].state, guards[-1].reason), (2, "the run has ended"))
        for each in silent + guards[-1:]:
            self.assertEqual((each.scale, each.clearance, len(each.rows)), (0, 0, 0))
        self.assertEqual(scales[-1], 0)
        for text in (guards[0].assumes, said):
            self.assertIn("pixels without depth count as free, holes of up to about 16 pixels as the surface at their border, "
                          "space behind surfaces as occupied", text)

    def test_a_joint_beyond_its_limits_stops_the_arm(self):
        short = os.path.join(self.folder.name, "short.urdf")
        with open(short, "w", encoding="ascii") as file:
            file.write(URDF.replace('upper="0.3"', 'upper="0.05"'))
        guards, _, scales, said = self.guard(short)
        beyond = [each for each in guards if each.state == 2 and "joint slide is at 0.1, beyond its limits" in each.reason]
        self.assertGreater(len(beyond), 20, said)
        self.assertEqual({each.state for each in guards} - {1, 2}, set())
        self.assertEqual(set(scales), {0})

    def test_a_urdf_is_packed_first_and_unseen_space_may_be_blocked(self):
        guards, _, scales, said = self.guard(self.urdf, "--unknown", "blocked", "--fill-levels", "0")
        valid = [each for each in guards if each.state == 0]
        self.assertGreater(len(valid), 100, said)
        # Nobody has seen the space that the arm hides.
        for each in valid:
            self.assertLess(each.clearance, 0)
            self.assertIn("space outside of all images as occupied", each.assumes)
        self.assertEqual(set(scales), {0})

    def test_wrong_use_is_one_sentence(self):
        wrong = [(["ros2", "--depth", "/d"], 2, "give a TOOL.palp, or --robot"),
                 (["ros2", "--depth", "/d", "--robot", self.packed], 2, "--robot needs the pose of its base"),
                 (self.words(self.packed, "--pose", "/p"), 2, "--pose is for a tool"),
                 (self.words(self.packed, "--set", "time.average=kalman"), 2, "--set time.average is for a tool"),
                 (self.words(self.packed, "--joints", "ros2:?world=base"), 2, "positions of its joints, not tf"),
                 (["ros2", self.tool, "--depth", "/d", "--pose", "/p", "--margin", "0.1"], 2, "--margin is for a robot without"),
                 (self.words(self.tool), 1, "is a tool, not a robot"),
                 (self.words(os.path.join(self.folder.name, "none.palprobot")), 1, "none.palprobot"),
                 (self.words(self.packed, "--margin", "0.1"), 1, "--slow-from 0.1 is not above the margin of 0.1 m"),
                 (self.words(self.packed, "--robot-skip", "hand"), 1, "is packed already: give --robot-skip to palpate pack"),
                 (self.words(self.urdf, "--robot-skip", "hnad"), 1, "no link 'hnad'; the nearest one is 'hand'")]
        for words, status, text in wrong:
            with self.subTest(text):
                run = subprocess.run([PALPATE, *words], capture_output=True, text=True, timeout=120,
                                     env={**os.environ, "ROS_DOMAIN_ID": str(self.domain), "ROS_LOCALHOST_ONLY": "1"})
                self.assertEqual(run.returncode, status, run.stderr)
                self.assertIn(text, run.stderr)

    def test_joints_that_nobody_tells_are_named(self):
        run = subprocess.run([PALPATE, *self.words(self.packed)], capture_output=True, text=True, timeout=120,
                             env={**os.environ, "ROS_DOMAIN_ID": str(self.domain), "ROS_LOCALHOST_ONLY": "1"})
        self.assertEqual(run.returncode, 1)
        self.assertIn("ros2:/joint_states has no states for joints of arm: slide, turn", run.stderr)


if __name__ == "__main__":
    FASTDDS_PEER = sys.argv.pop(1) if len(sys.argv) > 1 and "fastdds_peer" in sys.argv[1] else None
    unittest.main(testLoader=parts.Loader())
