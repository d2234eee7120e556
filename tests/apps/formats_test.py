"""One recording of a simulated camera with the noise of a real one, in every format that is read: whatever
it came in, the same is felt to the bit. For everybody: no recorded data is asked for.

Usage: formats_test.py PATH_OF_PALPATE"""

import csv
import io
import json
import math
import pathlib
import struct
import subprocess
import sys
import unittest
import zlib

from camera_case import CameraCase, palpate

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "ros"))
import rvl  # noqa: E402

WIDTH, HEIGHT, RATE, UNIT = 160, 120, 20, 0.001
DEBIAN_PYTHON = "/usr/bin/python3"

try:
    import rosbags.highlevel
    import rosbags.rosbag2
    import rosbags.typesys
except ImportError:
    rosbags = None


def png_of(counts):
    """16 bits a pixel, grayscale."""
    rows = b"".join(b"\0" + struct.pack(f">{WIDTH}H", *counts[at:at + WIDTH])
                    for at in range(0, len(counts), WIDTH))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", WIDTH, HEIGHT, 16, 0, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


@unittest.skipUnless(rosbags, "SKIPPED: scripts/setup.sh --test installs rosbags")
class Formats(CameraCase):
    OF_CLOCKS = ("timestamp_s", "sensor_age_s")  # what differs where stamps do

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.recording = cls.folder / "made.mcap"
        cls.size = WIDTH, HEIGHT
        cls.frames, cls.lens = cls.recorded(
            cls.recording, f"scene:hand?size={WIDTH}x{HEIGHT}&rate={RATE}&unit={UNIT}&seed=7", 1)
        cls.intrinsics = ",".join(map(repr, cls.lens))
        # Into the hand and along it.
        nearest = min(count for count in cls.frames[0][1] if 0 < count < 65535) * UNIT
        cls.path.write_text(f"0 0 0 {nearest - 0.06} 0 0 0 1\n0.5 0 0 {nearest + 0.02} 0 0 0 1\n"
                            f"0.9 0.02 0.01 {nearest + 0.03} 0 0.1 0 0.994987437\n")

    @classmethod
    def recorded(cls, path, scene, duration):
        """Records a scene; returns its frames (s, counts) and its lens."""
        cls.check(palpate("record", "--camera", scene, "--duration", duration, "-o", path))
        frames = []
        with rosbags.highlevel.AnyReader([path]) as reader:
            for connection, _, data in reader.messages():
                if connection.topic.endswith("image_rect_raw"):
                    image = reader.deserialize(data, connection.msgtype)
                    stamp = image.header.stamp
                    frames.append((stamp.sec + 1e-9 * stamp.nanosec, image.data.view("<u2").tolist()))
                elif connection.topic.endswith("camera_info"):
                    info = reader.deserialize(data, connection.msgtype)
                    lens = [float(info.k[k]) for k in (0, 4, 2, 5)]
        return frames, lens

    def felt(self, name, camera):
        """The rows of wrench.csv, as text: the same text is the same bits."""
        run = self.folder / f"run {name}"
        self.check(palpate("touch", self.tool, "--camera", camera, "--path", self.path, "--align", "starts",
                           # No tick falls on a frame, whose stamp one format rounds up and another down.
                           "--time", "latest", "--rate", 997, "-o", run))
        replay = self.check(palpate("replay", run, "--json"))
        self.assertTrue(json.loads(replay.stdout)["identical"], name)
        rows = list(csv.DictReader(io.StringIO((run / "wrench.csv").read_text())))
        for row in rows:
            for key in self.OF_CLOCKS:
                row.pop(key)
        return rows

    @property
    def expected(self):
        if not hasattr(type(self), "rows"):
            type(self).rows = self.felt("recording", f"bag:{self.recording}")
            deepest = max(float(row["fraction"]) for row in self.rows)
            self.assertGreater(deepest, 0.05)
            holes = sum(counts.count(0) for _, counts in self.frames)
            self.assertGreater(holes, 100)  # noise, shadows and edges of a real one
            self.assertNotEqual(self.frames[0][1], self.frames[1][1])
        return self.rows

    def expect_same(self, name, camera):
        rows = self.felt(name, camera)
        self.assertEqual(len(rows), len(self.expected), name)
        for row, want in zip(rows, self.expected):
            self.assertEqual(row, want, name)

    def raw(self, name, with_headers):
        path = self.folder / name
        with open(path, "wb") as file:
            for time, counts in self.frames:
                if with_headers:
                    file.write(struct.pack("<8sIIdd", b"PALPDEP1", WIDTH, HEIGHT, time, UNIT))
                file.write(struct.pack(f"<{WIDTH * HEIGHT}H", *counts))
        return path

    def test_the_camera_itself(self):
        self.expect_same("scene", f"scene:hand?size={WIDTH}x{HEIGHT}&rate={RATE}&unit={UNIT}&seed=7")

    def test_folders_of_png(self):
        folder = self.folder / "tum"
        (folder / "depth").mkdir(parents=True)
        lines = ["# timestamp filename"]
        for number, (time, counts) in enumerate(self.frames):
            (folder / "depth" / f"{number}.png").write_bytes(png_of(counts))
            lines.append(f"{time:.9f} depth/{number}.png")
        words = f"intrinsics={self.intrinsics}&unit={UNIT}"
        self.expect_same("plain folder", f"folder:{folder / 'depth'}?{words}&rate={RATE}")
        (folder / "depth.txt").write_text("\n".join(lines) + "\n")
        self.expect_same("TUM folder", f"folder:{folder}?{words}")

    def test_raw_frames(self):
        words = f"intrinsics={self.intrinsics}"
        self.expect_same("headers", f"pipe:{self.raw('headers.raw', True)}?{words}")
        self.expect_same("raw", f"pipe:{self.raw('bare.raw', False)}?{words}&size={WIDTH}x{HEIGHT}&rate={RATE}"
                                f"&unit={UNIT}")

    def write_ros2(self, name, plugin="MCAP", codec=None, encoding="16UC1"):
        """Writes a bag as ROS 2 does, with rosbags."""
        import numpy
        store = rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE)
        make = {key.rsplit("/", 1)[1]: value for key, value in store.types.items()}
        kind = "sensor_msgs/msg/CompressedImage" if codec else "sensor_msgs/msg/Image"
        path = self.folder / name
        with rosbags.rosbag2.Writer(path, version=9, storage_plugin=rosbags.rosbag2.StoragePlugin[plugin]) as writer:
            images = writer.add_connection("/d/image_raw", kind, typestore=store)
            infos = writer.add_connection("/d/camera_info", "sensor_msgs/msg/CameraInfo", typestore=store)
            f = numpy.float64
            fx, fy, cx, cy = self.lens
            for time, counts in self.frames:
                nanoseconds = round(time * 1e9) + 10**18
                header = make["Header"](make["Time"](nanoseconds // 10**9, nanoseconds % 10**9), "cam")
                if codec:
                    image = rvl.compressed(counts, WIDTH, HEIGHT) if codec == "rvl" else png_of(counts)
                    message = make["CompressedImage"](
                        header, f"{encoding}; compressedDepth {codec}",
                        numpy.frombuffer(struct.pack("<iff", 0, 0, 0) + image, dtype="u1"))
                else:
                    pixels = numpy.array(counts, dtype="<u2")
                    if encoding == "32FC1":
                        pixels = (pixels * UNIT).astype("<f4")
                    message = make["Image"](header, HEIGHT, WIDTH, encoding, 0, pixels.itemsize * WIDTH,
                                            numpy.frombuffer(pixels.tobytes(), dtype="u1"))
                writer.write(images, nanoseconds, store.serialize_cdr(message, kind))
                info = make["CameraInfo"](
                    header, HEIGHT, WIDTH, "plumb_bob", numpy.zeros(5), numpy.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], f),
                    numpy.eye(3).ravel(), numpy.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], f), 0, 0,
                    make["RegionOfInterest"](0, 0, 0, 0, False))
                writer.write(infos, nanoseconds, store.serialize_cdr(info, "sensor_msgs/msg/CameraInfo"))
        return path

    def test_recordings_of_ros_2(self):
        for name, options in (("ros2", {}), ("ros2 sqlite", {"plugin": "SQLITE3"}), ("ros2 png", {"codec": "png"}),
                              ("ros2 rvl", {"codec": "rvl"})):
            self.expect_same(name, f"bag:{self.write_ros2(name, **options)}")
        # Meters in single precision, in counts of a millimeter again.
        self.expect_same("ros2 float", f"bag:{self.write_ros2('ros2 float', encoding='32FC1')}?unit={UNIT}")

    def test_recordings_of_ros_1(self):
        if not pathlib.Path("/usr/lib/python3/dist-packages/rosbag").exists():
            self.skipTest("SKIPPED: there is no python3-rosbag; scripts/setup.sh --test installs it")
        for compression in ("none", "bz2", "lz4"):
            bag = self.folder / f"ros1 {compression}.bag"
            subprocess.run([DEBIAN_PYTHON, HERE / "ros1_bag.py", bag, compression, self.raw("ros1.raw", False),
                            str(WIDTH), str(HEIGHT), str(RATE), self.intrinsics], check=True,
                           env={"PATH": "/usr/bin:/bin"})
            self.expect_same(f"ros1 {compression}", f"bag:{bag}")

    def clouds(self, order):
        """The points of each frame: organized, or only the measured ones in any order."""
        import numpy
        fx, fy, cx, cy = self.lens
        width, height = self.size
        v, u = numpy.mgrid[0:height, 0:width]
        for number, (time, counts) in enumerate(self.frames):
            z = numpy.array(counts, float).reshape(height, width) * UNIT
            points = numpy.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], -1)
            points[z == 0] = numpy.nan
            if order == "loose":
                points = points[z > 0]
                numpy.random.default_rng(number).shuffle(points)
            yield time, points

    def write_points(self, kind, order, layout=0):
        """Writes a recording of PointCloud2 in one of three layouts, or a folder of PCD or PLY; returns its URI."""
        import numpy
        path = self.folder / f"{order} {kind} {layout} {self.size[0]}"
        if kind == "bag":
            self.write_point_bag(path, order, layout)
            return f"bag:{path}"
        path.mkdir()
        lines = []
        for number, (time, points) in enumerate(self.clouds(order)):
            width, height = (points.shape[1], points.shape[0]) if points.ndim == 3 else (len(points), 1)
            header = (f"ply\nformat binary_little_endian 1.0\nelement vertex {width * height}\nproperty float x\n"
                      "property float y\nproperty float z\nend_header\n" if kind == "ply" else
                      f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {width}\nHEIGHT {height}\n"
                      f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {width * height}\nDATA binary\n")
            (path / f"{number}.{kind}").write_bytes(header.encode() + points.astype("<f4").tobytes())
            lines.append(f"{time:.9f} {number}.{kind}")
        (path / "depth.txt").write_text("\n".join(lines) + "\n")
        return f"folder:{path}"

    def write_point_bag(self, path, order, layout):
        import numpy
        store = rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE)
        make = {key.rsplit("/", 1)[1]: value for key, value in store.types.items()}
        # As packed floats; as PCL stores them; big-endian doubles in another order, with padded rows.
        names, formats, offsets, size, padding = (
            (("x", "y", "z"), ("<f4",) * 3, (0, 4, 8), 12, 0),
            (("x", "y", "z", "rgb"), ("<f4",) * 4, (0, 4, 8, 16), 32, 0),
            (("intensity", "z", "x", "y"), ("u1", ">f8", ">f8", ">f8"), (0, 1, 9, 17), 29, 7))[layout]
        kinds = {"<f4": 7, "u1": 2, ">f8": 8}
        fields = [make["PointField"](name, offset, kinds[each], 1)
                  for name, each, offset in zip(names, formats, offsets)]
        row = numpy.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})
        with rosbags.rosbag2.Writer(path, version=9, storage_plugin=rosbags.rosbag2.StoragePlugin.MCAP) as writer:
            clouds = writer.add_connection("/points", "sensor_msgs/msg/PointCloud2", typestore=store)
            for time, points in self.clouds(order):
                height, width = points.shape[:2] if points.ndim == 3 else (1, len(points))
                rows = numpy.zeros((height, width), row)
                for axis, name in enumerate("xyz"):
                    rows[name] = points[..., axis].reshape(height, width)
                data = rows.view("u1").reshape(height, width * size)
                data = numpy.pad(data, ((0, 0), (0, padding)), constant_values=255)
                stamp = round(time * 1e9) + 10**18
                header = make["Header"](make["Time"](stamp // 10**9, stamp % 10**9), "cam")
                message = make["PointCloud2"](header, height, width, fields, formats[-1][0] == ">", size,
                                              width * size + padding, data.ravel(), False)
                writer.write(clouds, stamp, store.serialize_cdr(message, message.__msgtype__))

    def test_organized_clouds(self):
        self.expect_same("pcd", self.write_points("pcd", "organized"))
        for layout in range(3):
            self.expect_same(f"points {layout}", self.write_points("bag", "organized", layout))

    ALL_KINDS = (("pcd", 0), ("ply", 0), ("bag", 0), ("bag", 1), ("bag", 2))

    def test_clouds_in_any_order_with_the_camera_of_the_images(self):
        same = f"intrinsics={self.intrinsics}&size={WIDTH}x{HEIGHT}&unit={UNIT}"
        for kind, layout in self.ALL_KINDS:
            self.expect_same(f"same camera {kind} {layout}", f"{self.write_points(kind, 'loose', layout)}?{same}")

    def test_clouds_in_any_order(self):
        """Their own camera is within 1 % of the volume on a ball, which is smooth over pixels."""
        self.size = 320, 240
        ball = self.folder / "ball.mcap"
        self.frames, self.lens = self.recorded(
            ball, f"scene:sphere-out-320?size=320x240&unit={UNIT}&noise=off", 0.1)
        nearest = min(count for count in self.frames[0][1] if 0 < count < 65535) * UNIT
        poses = self.folder / "poses.txt"
        poses.write_text("".join(f"{k} {0.004 * k} {-0.003 * k} {nearest - 0.02 + 0.004 * k} 0 0.1 0 0.994987437\n"
                                 for k in range(6)))

        def query(camera):
            done = self.check(palpate("query", self.tool, "--camera", camera, "--poses", poses, "--json"))
            return json.loads(done.stdout)["results"]

        expected = query(f"bag:{ball}")
        for kind, layout in self.ALL_KINDS:
            for result, want in zip(query(self.write_points(kind, "loose", layout)), expected):
                volume = want["volume"]
                self.assertGreater(volume, 5e-6)
                self.assertAlmostEqual(result["volume"], volume, delta=0.01 * volume)
                self.assertLess(math.dist(result["force"], want["force"]), 0.01 * volume)
                self.assertLess(math.dist(result["torque"], want["torque"]), 0.01 * volume * 0.05)  # its arm

    def test_a_cloud_file(self):
        """One frame as an image and as an organized cloud."""
        _, counts = self.frames[0]
        image, cloud = self.folder / "one.png", self.folder / "one.pcd"
        image.write_bytes(png_of(counts))
        fx, fy, cx, cy = self.lens
        points = b"".join(
            struct.pack("<3f", *((float("nan"),) * 3 if count in (0, 65535) else
                                 ((at % WIDTH - cx) / fx * count * UNIT, (at // WIDTH - cy) / fy * count * UNIT,
                                  count * UNIT)))
            for at, count in enumerate(counts))
        cloud.write_bytes(
            f"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {WIDTH}\n"
            f"HEIGHT {HEIGHT}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {WIDTH * HEIGHT}\nDATA binary\n".encode() + points)
        nearest = min(count for count in counts if 0 < count < 65535) * UNIT
        results = []
        for file in (image, cloud):
            done = self.check(palpate("query", self.tool, "--depth", file, "--intrinsics", self.intrinsics, "--pose",
                                      f"0 0 {nearest + 0.02} 0 0 0 1", "--json"))
            results.append(json.loads(done.stdout)["results"][0])
            results[-1].pop("compute_us")
        self.assertEqual(*results)
        self.assertGreater(results[0]["volume"], 0)


if __name__ == "__main__":
    unittest.main()
