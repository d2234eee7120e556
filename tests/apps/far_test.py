"""Backgrounds that are measured as farther than the limit, from every kind of source: beside an object in front of
them there is nothing to feel.

Usage: far_test.py PATH_OF_PALPATE"""

import json
import math
import os
import pathlib
import struct
import unittest

from camera_case import CameraCase, palpate
from made_files import write_depth_png

WIDTH, HEIGHT, LENS = 160, 120, (131.25, 131.25, 79.5, 59.5)
INTRINSICS = ",".join(map(str, LENS))
NEAR = 1.0  # m, of a square of 0.3 m
DATA = pathlib.Path(os.environ.get("PALPATE_DATA") or pathlib.Path(__file__).resolve().parents[3] / "shared/data")

try:
    import numpy
    import rosbags.rosbag2
    import rosbags.typesys
except ImportError:
    rosbags = None


def depth_at(u, v, far):
    """m"""
    inside = abs(u - LENS[2]) < 20 and abs(v - LENS[3]) < 20
    return NEAR if inside else far


class Far(CameraCase):
    BESIDE = "0.215 0 0.99 0 0 0 1"  # 3 cm from the edge: the box is 6 cm wide
    OVER_THE_EDGE = "0.15 0 0.99 0 0 0 1"

    def fractions(self, source, *options):
        results = []
        for pose in (self.BESIDE, self.OVER_THE_EDGE):
            done = self.check(palpate("query", self.tool, *source, "--pose", pose, "--json", *options))
            results.append(json.loads(done.stdout)["results"][0]["fraction"])
        return results

    def expect_free(self, name, source, *options):
        """As in front of a background that is near enough to be a surface."""
        beside, over = self.fractions(source, *options)
        self.assertEqual(beside, 0, name)
        self.assertLess(abs(over - self.expected), 0.01, name)

    def expect_hole(self, name, source, *options):
        """Filled with the object."""
        self.assertGreater(self.fractions(source, *options)[0], 0.1, name)

    @property
    def expected(self):
        if not hasattr(type(self), "over_the_edge"):
            beside, type(self).over_the_edge = self.fractions(self.png("near", lambda u, v: self.count(9.5, u, v)))
            self.assertEqual(beside, 0)
            self.assertGreater(self.over_the_edge, 0.1)
            self.assertLess(self.over_the_edge, 0.6)
        return self.over_the_edge

    @staticmethod
    def count(far, u, v):
        return min(round(1000 * depth_at(u, v, far)), 65535) if math.isfinite(far) else \
            round(1000 * NEAR) if depth_at(u, v, far) == NEAR else 65535

    def png(self, name, count):
        file = self.folder / f"{name}.png"
        write_depth_png(file, WIDTH, HEIGHT, count)
        return "--depth", file, "--intrinsics", INTRINSICS

    def test_images(self):
        for far in (9.99, 10.01, 12, 30, 65.534, 65.535, math.inf):
            self.expect_free(far, self.png(f"far {far}", lambda u, v, far=far: self.count(far, u, v)))
        self.expect_hole("no measurement", self.png("hole", lambda u, v: 1000 if depth_at(u, v, 0) == NEAR else 0))
        # A background that is cut away.
        self.expect_free("cut", self.png("wall", lambda u, v: self.count(1.5, u, v)), "--max-depth", 1.2)

    def test_the_largest_count_by_kind_of_sensor(self):
        image = self.png("largest", lambda u, v: self.count(math.inf, u, v))
        folder = self.folder / "largest"
        folder.mkdir()
        image[1].rename(folder / "0.png")
        image = ("--depth", folder / "0.png", *image[2:])
        uri = f"folder:{folder}?intrinsics={INTRINSICS}"
        for kind, is_far in (("none", True), ("active_stereo", True), ("structured_light", False), ("tof", False)):
            expect = self.expect_free if is_far else self.expect_hole
            expect(kind, (*image, "--sensor", kind))
            expect(kind, ("--camera", f"{uri}&sensor={kind}"))
        image = self.png("far of any kind", lambda u, v: self.count(30, u, v))
        for kind in ("structured_light", "tof"):
            self.expect_free(kind, (*image, "--sensor", kind))

    def test_folders_and_pipes(self):
        folder = self.folder / "frames"
        folder.mkdir()
        for number, far in enumerate((12, math.inf)):
            write_depth_png(folder / f"{number}.png", WIDTH, HEIGHT, lambda u, v, far=far: self.count(far, u, v))
            raw = self.folder / f"{number}.raw"
            raw.write_bytes(struct.pack(f"<{WIDTH * HEIGHT}H", *(self.count(far, u, v) for v in range(HEIGHT)
                                                                 for u in range(WIDTH))))
            self.expect_free(f"pipe {far}", ("--camera", f"pipe:{raw}?size={WIDTH}x{HEIGHT}&intrinsics={INTRINSICS}"))
        self.expect_free("folder", ("--camera", f"folder:{folder}?intrinsics={INTRINSICS}"))

    def test_organized_clouds(self):
        def points(far):
            for v in range(HEIGHT):
                for u in range(WIDTH):
                    z = depth_at(u, v, far)
                    yield from ((u - LENS[2]) / LENS[0] * z, (v - LENS[3]) / LENS[1] * z, z)

        for far, expect in ((12, self.expect_free), (80, self.expect_free), (math.inf, self.expect_free),
                            (math.nan, self.expect_hole), (-math.inf, self.expect_hole)):
            file = self.folder / f"{far}.pcd"
            file.write_bytes(
                f"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {WIDTH}\n"
                f"HEIGHT {HEIGHT}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {WIDTH * HEIGHT}\nDATA binary\n".encode() +
                struct.pack(f"<{3 * WIDTH * HEIGHT}f", *points(far)))
            expect(far, ("--depth", file, "--intrinsics", INTRINSICS))

    @unittest.skipUnless(rosbags, "SKIPPED: scripts/setup.sh --test installs rosbags")
    def test_recordings_of_ros_2(self):
        for encoding, far, expect in (("16UC1", 12, self.expect_free), ("16UC1", math.inf, self.expect_free),
                                      ("32FC1", 9.99, self.expect_free), ("32FC1", 10.01, self.expect_free),
                                      ("32FC1", 20, self.expect_free), ("32FC1", 1e30, self.expect_free),
                                      ("32FC1", math.inf, self.expect_free), ("32FC1", math.nan, self.expect_hole),
                                      ("32FC1", 0, self.expect_hole), ("32FC1", -math.inf, self.expect_hole)):
            for plugin in ("MCAP", "SQLITE3") if far == math.inf else ("MCAP",):
                name = f"{encoding} {far} {plugin}"
                expect(name, ("--camera", f"bag:{self.write_bag(name, encoding, far, plugin)}"))

    def write_bag(self, name, encoding, far, plugin):
        store = rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE)
        make = {key.rsplit("/", 1)[1]: value for key, value in store.types.items()}
        path = self.folder / name
        if encoding == "16UC1":
            pixels = numpy.array([self.count(far, u, v) for v in range(HEIGHT) for u in range(WIDTH)], "<u2")
        else:
            pixels = numpy.array([depth_at(u, v, far) for v in range(HEIGHT) for u in range(WIDTH)], "<f4")
        header = make["Header"](make["Time"](1, 0), "cam")
        f, (fx, fy, cx, cy) = numpy.float64, LENS
        messages = (("image_raw", make["Image"](header, HEIGHT, WIDTH, encoding, 0, pixels.itemsize * WIDTH,
                                                numpy.frombuffer(pixels.tobytes(), "u1"))),
                    ("camera_info", make["CameraInfo"](
                        header, HEIGHT, WIDTH, "plumb_bob", numpy.zeros(5),
                        numpy.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], f), numpy.eye(3).ravel(),
                        numpy.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], f), 0, 0,
                        make["RegionOfInterest"](0, 0, 0, 0, False))))
        plugin = rosbags.rosbag2.StoragePlugin[plugin]
        with rosbags.rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
            for topic, message in messages:
                connection = writer.add_connection(f"/d/{topic}", message.__msgtype__, typestore=store)
                writer.write(connection, 10**9, store.serialize_cdr(message, message.__msgtype__))
        return path

    def test_averages_follow_at_once(self):
        """An object that goes away before what is far, seen by a camera at rest: the space is free with the image."""
        folder = self.folder / "going"
        folder.mkdir()
        for number in range(24):
            write_depth_png(folder / f"{number:02}.png", WIDTH, HEIGHT,
                            lambda u, v: self.count(math.inf, u, v) if number < 12 else 65535)
        path = self.folder / "still.txt"
        path.write_text("0 0 0 1 0 0 0 1\n0.76 0 0 1 0 0 0 1\n")
        for average in ("none", "moving", "exponential", "kalman"):
            run = self.folder / f"run {average}"
            self.check(palpate("touch", self.tool, "--camera", f"folder:{folder}?intrinsics={INTRINSICS}&rate=30",
                               "--path", path, "--average", average, "--time", "latest", "-o", run))
            rows = [line.split(",") for line in (run / "wrench.csv").read_text().splitlines()]
            time, fraction = rows[0].index("time_s"), rows[0].index("fraction")
            felt = [(float(row[time]), float(row[fraction])) for row in rows[1:]]
            self.assertGreater(min(f for t, f in felt if 0.05 < t < 0.35), 0.2, average)
            self.assertEqual(max(f for t, f in felt if t > 12 / 30 + 0.04), 0, average)

    def test_recorded_inputs(self):
        folder = DATA / "field/30-far-background"
        if not folder.is_dir():
            self.skipTest("SKIPPED: no real data for 30-far-background (set PALPATE_DATA)")
        mesh, tool = self.folder / "large.ply", self.folder / "large.palp"
        self.check(palpate("shape", "box", "--size", 0.1, "-o", mesh))
        self.check(palpate("pack", mesh, "--spheres", 2000, "-o", tool))
        for name in ("far_9.99", "far_10.01", "far_1.5"):
            options = ("--max-depth", 1.2) if name == "far_1.5" else ()
            for x, most in ((0.105, 0.005), (0.13, 0)):
                done = self.check(palpate("query", tool, "--depth", folder / f"{name}.png", "--intrinsics",
                                          "525,525,319.5,239.5", "--pose", f"{x} 0 0.99 0 0 0 1", "--json", *options))
                self.assertLessEqual(json.loads(done.stdout)["results"][0]["fraction"], most, (name, x))


if __name__ == "__main__":
    unittest.main()
