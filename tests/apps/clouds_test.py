"""Point clouds as cameras, as a user meets them: messages that lie, too many points, scanners that see all round.

Usage: clouds_test.py PATH_OF_PALPATE"""

import json
import math
import os
import struct
import subprocess
import unittest

from camera_case import PALPATE, CameraCase, palpate

try:
    import numpy
    import rosbags.rosbag2
    import rosbags.typesys
except ImportError:
    numpy = None

XYZ = (("x", 0, 7), ("y", 4, 7), ("z", 8, 7))  # name, offset, type: FLOAT32


def cloud_message(data, num, stamp=1.0, fields=XYZ, step=12, row=None, height=1):
    """sensor_msgs/PointCloud2 as CDR, whatever its header claims."""
    message = bytearray(b"\0\1\0\0")

    def put(form, *values):
        size = struct.calcsize(form[-1])
        message.extend(b"\0" * (-(len(message) - 4) % size) + struct.pack("<" + form, *values))

    def text(word):
        put("I", len(word) + 1)
        message.extend(word.encode() + b"\0")

    put("i", int(stamp))
    put("I", round(stamp % 1 * 1e9))
    text("scanner")
    put("I", height)
    put("I", num)
    put("I", len(fields))
    for name, offset, kind in fields:
        text(name)
        put("I", offset)
        put("B", kind)
        put("I", 1)
    put("B", 0)
    put("I", step)
    put("I", min(step * num, 2**32 - 1) if row is None else row)
    put("I", len(data))
    message.extend(data)
    put("B", 1)
    return bytes(message)


def wall(num=20000, seed=1):
    """A wall at half a meter, x y z as float32."""
    points = numpy.random.default_rng(seed).uniform((-0.2, -0.2, 0.5), (0.2, 0.2, 0.5), (num, 3))
    return points.astype("<f4")


@unittest.skipUnless(numpy, "SKIPPED: scripts/setup.sh --test installs rosbags")
class Clouds(CameraCase):
    def bag(self, name, *messages):
        path = self.folder / name
        store = rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE)
        with rosbags.rosbag2.Writer(path, version=9, storage_plugin=rosbags.rosbag2.StoragePlugin.MCAP) as writer:
            points = writer.add_connection("/points", "sensor_msgs/msg/PointCloud2", typestore=store)
            for number, message in enumerate(messages):
                writer.write(points, 10**9 + number, message)
        return f"bag:{path}"

    def query(self, camera, *poses):
        path = self.folder / "poses.txt"
        path.write_text("".join(f"{number} {pose}\n" for number, pose in enumerate(poses)))
        done = self.check(palpate("query", self.tool, "--camera", camera, "--poses", path, "--json"))
        return json.loads(done.stdout)["results"], done.stderr.decode()

    def test_a_message_that_lies_is_one_sentence(self):
        points = wall(1000)
        data, num = points.tobytes(), len(points)
        for number, (words, message) in enumerate((
                ("has a point_step of 11 bytes, and its field 'z' lies beyond", cloud_message(data, num, step=11)),
                ("has a row_step of 100 bytes", cloud_message(data, num // 2, row=100, height=2)),
                ("claims more bytes than the 12000", cloud_message(data, 10**7)),
                ("has more than 16777216", cloud_message(data, 2**31)),
                ("has no points", cloud_message(b"", 0)),
                ("has no points", cloud_message(data, num, height=0)),
                ("has the field 'x' twice", cloud_message(data, num, fields=(*XYZ, XYZ[0]))),
                ("has no field 'z' but x, y", cloud_message(data, num, fields=XYZ[:2])),
                ("is damaged", cloud_message(data, num)[:40]))):
            with self.subTest(words):
                camera = self.bag(f"lie {number}", message)
                self.refused(words, "query", self.tool, "--camera", camera, "--pose", "0 0 0.49 0 0 0 1")
                # Among good ones it is left out.
                camera = self.bag(f"lie {number} among others", cloud_message(data, num, 1), message,
                                  cloud_message(data, num, 1.1))
                run = self.folder / f"run {number}"
                done = self.check(palpate("touch", self.tool, "--camera", camera, "--path", self.path, "--align",
                                          "starts", "--duration", 0.2, "-o", run))
                told = [line for line in done.stderr.decode().splitlines() if "a message is left out" in line]
                self.assertEqual(len(told), 1, told)
                self.assertIn(words, told[0])

    def test_stamps_that_jump_are_told(self):
        data = wall().tobytes()
        stamps = (1, 1.1, 0.2, 1.2, 1.3, 61.3)
        camera = self.bag("jumps", *(cloud_message(data, 20000, stamp) for stamp in stamps))
        _, said = self.query(camera, "0 0 0.49 0 0 0 1")
        self.assertEqual(said.count("1 of its 6 frames are left out, as their stamps are not later"), 1, said)
        self.assertEqual(said.count("60 s lie between two of its frames"), 1, said)

    def test_ten_million_points_take_bounded_memory(self):
        num = 10**7
        camera = self.bag("many", cloud_message(wall(num).tobytes(), num))
        process = subprocess.Popen([PALPATE, "query", self.tool, "--camera", camera + "?size=640x480", "--pose",
                                    "0 0 0.49 0 0 0 1", "--json"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        said = process.stdout.read()
        process.stdout.close()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        self.assertEqual(process.returncode, 0)
        expected, _ = self.query(self.bag("few", cloud_message(wall(300000, 2).tobytes(), 300000)) + "?size=640x480",
                                 "0 0 0.49 0 0 0 1")
        result = json.loads(said)["results"][0]
        self.assertGreater(result["volume"], 0)
        self.assertAlmostEqual(result["volume"] / expected[0]["volume"], 1, delta=0.01)
        # The message of 120 MB, its chunk, and 12 bytes for each point.
        self.assertLess(usage.ru_maxrss / 1024, 900)

    def test_a_scanner_that_sees_all_round_is_felt_as_one_scene(self):
        """In a pipe of 1 m radius: the same box at the middle of an image and where two meet, and the closed form."""
        rng = numpy.random.default_rng(3)
        angle, height = rng.uniform(-math.pi, math.pi, 300000), rng.uniform(-0.4, 0.4, 300000)
        points = numpy.stack((numpy.cos(angle), numpy.sin(angle), height), -1).astype("<f4")
        messages = [cloud_message(points.tobytes(), len(points), 1 + 0.1 * k) for k in range(3)]
        camera = self.bag("pipe", *messages)
        self.refused("give ?look=round", "query", self.tool, "--camera", camera, "--pose", "0.98 0 0 0 0 0 1")
        far = 0.98

        def pose(degrees):
            a = math.radians(degrees)
            return f"{far * math.cos(a)} {far * math.sin(a)} 0 0 0 {math.sin(a / 2)} {math.cos(a / 2)}"

        degrees = (0, 20, 44, 45, 46, 90, 135, 180, 225, 300, 315)
        results, _ = self.query(camera + "?look=round", *map(pose, degrees))
        # The box of 60 mm beyond the pipe.
        steps = [-0.03 + 0.06 * (k + 0.5) / 1000 for k in range(1000)]
        exact = 0.06 * sum(far + 0.03 - math.sqrt(1 - y * y) for y in steps) * 0.06 / 1000
        for each, result in zip(degrees, results):
            self.assertAlmostEqual(result["volume"] / exact, 1, delta=0.03, msg=each)
            self.assertLess(result["unseen"], 0.01, each)
        # Felt along the wall, over the edge between two images.
        path = self.folder / "round.txt"
        path.write_text("".join(f"{0.01 * k} {pose(30 + k)}\n" for k in range(31)))
        run = self.folder / "round"
        self.check(palpate("touch", self.tool, "--camera", camera + "?look=round", "--path", path, "--align", "starts",
                           "-o", run))
        self.assertTrue(json.loads(self.check(palpate("replay", run, "--json")).stdout)["identical"])

    def test_the_noise_of_projected_clouds_is_not_that_of_a_camera(self):
        camera = self.bag("still", *(cloud_message(wall().tobytes(), 20000, 1 + 0.03 * k) for k in range(30)))
        self.refused("whose noise is not that of a sensor", "calibrate", "--noise", camera, "-o",
                     self.folder / "sensor.toml")


if __name__ == "__main__":
    unittest.main()
