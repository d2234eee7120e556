"""Drives the real program with recordings of other programs: MCAP, bags of ROS 1 and ROS 2, RealSense.

Usage: bags_test.py PATH_OF_PALPATE"""

import json
import os
import pathlib
import struct
import subprocess
import sys
import unittest

from camera_case import HEIGHT, WIDTH, CameraCase, header, palpate, wall
from made_files import write_depth_png

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "ros"))
import rvl  # noqa: E402

# As scripts/setup.sh --test leaves them.
PYTHON = HERE.parent.parent / "build/python"
OLD_REALSENSE = HERE.parent.parent / "build/python-realsense-bag"
DEBIAN_PYTHON = "/usr/bin/python3"


class Bags(CameraCase):
    def test_rosbags_reads_a_recording(self):
        try:
            import rosbags.highlevel
        except ImportError:
            self.skipTest("there is no rosbags; scripts/setup.sh --test installs it")
        folder = self.folder / "scene_bag"
        folder.mkdir()
        bag = folder / "scene.mcap"
        self.check(palpate("record", "--camera", "scene:wall?noise=off&unit=0.001", "--duration",
                           0.5, "-o", bag))
        with rosbags.highlevel.AnyReader([bag]) as reader:
            topics = {each.topic: each.msgcount for each in reader.connections}
            self.assertEqual(topics["/camera/depth/image_rect_raw"],
                             topics["/camera/depth/camera_info"])
            for connection, stamp, data in reader.messages():
                if connection.topic == "/camera/depth/image_rect_raw":
                    image = reader.deserialize(data, connection.msgtype)
                    self.assertEqual((image.width, image.height, image.encoding),
                                     (640, 480, "16UC1"))
                    break

    def test_several_cameras_are_recorded_together(self):
        raw = self.images(20)
        cameras = ["scene:wall?size=160x120&rate=20&seed=3&pose=0.1,0,0,0,0,0,1",
                   f"pipe:{raw}?size=160x120&intrinsics=200,200,79.5,59.5&unit=0.0002&rate=15"]
        both, again = self.folder / "both.mcap", self.folder / "again.mcap"
        arguments = [part for camera in cameras for part in ("--camera", camera)]
        for file in (both, again):
            done = json.loads(self.check(palpate("record", *arguments, "--duration", 1, "-o", file,
                                                 "--json")).stdout)
            self.assertEqual(done["frames_of"], [20, 16])
        self.refused("several depth streams", "record", "--camera", f"bag:{both}", "-o", self.folder / "never.mcap")
        for k, camera in enumerate(cameras):
            topic = f"/camera{'_2' * k}/depth/image_rect_raw"
            alone = self.taken(camera, options=("--duration", 1))
            for file in (both, again):  # a busy computer ends their chunks elsewhere
                joined = self.taken(f"bag:{file}?topic={topic}&world=world")
                self.assertEqual(alone, joined)
            self.assertEqual(joined[2], {(0.1, 0, 0)} if k == 0 else {(0, 0, 0)})
            said = self.check(palpate("cameras", "--selftest", f"bag:{both}?topic={topic}")).stdout
            self.assertIn(b"0.0002 m per count" if k == 1 else b"m per count", said)
        # All or nothing.
        self.refused("cannot open", "record", *arguments, "--camera",
                     f"pipe:{self.folder}/none?size=8x8&intrinsics=1,1,1,1", "-o",
                     self.folder / "never.mcap")
        self.refused("has no frames", "record", *arguments, "--camera",
                     f"pipe:/dev/null?size=8x8&rate=1&intrinsics=1,1,4,4", "-o",
                     self.folder / "never.mcap")
        self.assertFalse((self.folder / "never.mcap").exists())

    def write_bag(self, name, encoding="16UC1", topic="/cam/depth/image_raw", model="plumb_bob",
                  d=(0.1, -0.05, 0.001, 0.002, 0.0), compressed=False, num=31, extra=None,
                  info=True, more=None, plugin="MCAP"):
        """Writes a bag as ROS 2 does, with rosbags."""
        import numpy
        import rosbags.rosbag2
        import rosbags.typesys
        store = rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE)
        types = store.types
        make = {key.rsplit("/", 1)[1]: value for key, value in types.items()}
        path = self.folder / name
        plugin = rosbags.rosbag2.StoragePlugin[plugin]
        with rosbags.rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
            def connect(topic, kind):
                return writer.add_connection(topic, kind, typestore=store)

            def send(connection, kind, stamp, message):
                writer.write(connection, stamp, store.serialize_cdr(message, kind))

            image_type = f"sensor_msgs/msg/{'CompressedImage' if compressed else 'Image'}"
            info_type = "sensor_msgs/msg/CameraInfo"
            image = connect(topic, image_type)
            beside = topic.removesuffix("/compressedDepth").rsplit("/", 1)[0] + "/camera_info"
            infos = [connect(each, info_type) for each in ((more,) if more else ()) + (beside,)
                     if info]
            other = connect(extra, "sensor_msgs/msg/Image") if extra else None
            for k in range(num):
                stamp = 1_700_000_000_000_000_000 + k * 33_333_333
                header = make["Header"](make["Time"](stamp // 10**9, stamp % 10**9), "cam")
                counts = numpy.frombuffer(wall(k), dtype="<u2").reshape(HEIGHT, WIDTH)
                if compressed:
                    codec = "rvl" if compressed == "rvl" else "png"
                    png = self.folder / "frame.png"
                    a, b = 500.0, 20.0  # of depth in meters: count = a / depth + b
                    if encoding == "32FC1":
                        counts = numpy.round(a / (counts / 1000) + b)
                    write_depth_png(png, WIDTH, HEIGHT, lambda u, v: int(counts[v, u]))
                    image_bytes = (rvl.compressed(counts.ravel(), WIDTH, HEIGHT) if codec == "rvl"
                                   else png.read_bytes())
                    data = struct.pack("<iff", 0, a, b) + image_bytes
                    message = make["CompressedImage"](header, f"{encoding}; compressedDepth {codec}",
                                                      numpy.frombuffer(data, dtype="u1"))
                else:
                    pixels = {"16UC1": counts, "32FC1": counts.astype("f4") / 1000,
                              "8UC1": counts.astype("u1")}[encoding]
                    rows = numpy.frombuffer(pixels.tobytes(), dtype="u1")
                    message = make["Image"](header, HEIGHT, WIDTH, encoding, 0,
                                            pixels.itemsize * WIDTH, rows)
                send(image, image_type, stamp, message)
                if other:
                    send(other, "sensor_msgs/msg/Image", stamp, message)
                for number, camera in enumerate(reversed(infos)):
                    f, c = numpy.float64, numpy.array
                    send(camera, info_type, stamp, make["CameraInfo"](
                        header, HEIGHT, WIDTH, model, c(d, f),
                        c([200 + 100 * number, 0, 79.5, 0, 200, 59.5, 0, 0, 1], f), c(numpy.eye(3).ravel(), f),
                        c([210, 0, 80, 0, 0, 210, 60, 0, 0, 0, 1, 0], f), 0, 0,
                        make["RegionOfInterest"](0, 0, 0, 0, False)))
        return path

    def test_bags_of_ros(self):
        try:
            import rosbags.rosbag2  # noqa: F401
        except ImportError:
            self.skipTest("there is no rosbags; scripts/setup.sh --test installs it")

        def touched(bag, parameters=""):
            run = self.folder / f"run_{bag.name}"
            self.check(palpate("touch", self.tool, "--camera", f"bag:{bag}{parameters}", "--path",
                               self.path, "--align", "starts", "-o", run))
            return self.summary(run)

        plain = touched(self.write_bag("plain", d=(0, 0, 0, 0, 0)))
        self.assertEqual((plain["stream"]["fx"], plain["stream"]["cx"]), (200, 79.5))
        self.assertEqual(plain["stream"]["unit"], 0.001)
        self.assertAlmostEqual(plain["stream"]["rate"], 30, places=3)
        compressed = "/cam/depth/image_raw/compressedDepth"
        for name, places, options in (
                ("float", 6, {"encoding": "32FC1"}), ("png", 6, {"compressed": True}),
                ("transport", 6, {"compressed": True, "topic": compressed,
                                   "more": "/cam/color/camera_info"}),
                ("rvl", 6, {"compressed": "rvl"}),
                ("inverse rvl", 2, {"compressed": "rvl", "encoding": "32FC1"}),
                ("inverse", 2, {"compressed": True, "encoding": "32FC1"}),
                ("database", 6, {"plugin": "SQLITE3"})):
            other = touched(self.write_bag(name, d=(0, 0, 0, 0, 0), **options))
            self.assertEqual(other["frames"], plain["frames"])
            self.assertAlmostEqual(other["peaks"]["volume_m3"] / plain["peaks"]["volume_m3"], 1,
                                   places=places)
        # A rectified topic has the intrinsics of P, and no distortion any more.
        rectified = touched(self.write_bag("rectified", topic="/cam/depth/image_rect_raw"))
        self.assertEqual((rectified["stream"]["fx"], rectified["stream"]["cx"]), (210, 80))
        bent = touched(self.write_bag("bent", d=(20, 0, 0, 0, 0)))
        self.assertNotEqual(bent["peaks"]["volume_m3"], plain["peaks"]["volume_m3"])
        touched(self.write_bag("rational", model="rational_polynomial",
                               d=(0.1, 0.01, 0, 0, 0.001, 0.1, 0.01, 0.001)))

        touch = ["touch", self.tool, "--path", self.path, "-o", self.folder / "never"]
        self.refused("equidistant", *touch, "--camera", "bag:" + str(self.write_bag(
            "fisheye", model="equidistant", d=(0.1, 0, 0, 0), num=2)))
        self.refused("/cam/depth/camera_info: a camera_info has the distortion model 'plumb_bob' with 3 coefficients",
                     *touch, "--camera", "bag:" + str(self.write_bag("three", d=(0.1, 0, 0), num=2)))
        self.refused("distortion coefficient k2 must be a number", *touch, "--camera", "bag:" + str(self.write_bag(
            "no lens", d=(0.1, float("nan"), 0, 0, 0), num=2)))
        self.refused("several depth streams", *touch, "--camera", "bag:" + str(self.write_bag(
            "two", extra="/other/depth", num=2)))
        self.refused("no depth images", *touch, "--camera", "bag:" + str(self.write_bag(
            "color", encoding="8UC1", num=2)))
        self.refused("no depth images on /x", *touch, "--camera",
                     f"bag:{self.folder}/color?topic=/x")
        self.refused("intrinsics=", *touch, "--camera", "bag:" + str(self.write_bag(
            "bare", info=False, num=2)))
        (self.folder / "no.mcap").write_bytes(b"no recording")
        self.refused("is not a recording", *touch, "--camera", f"bag:{self.folder}/no.mcap")

    def images(self, count=31):
        raw = self.folder / f"images_{count}.raw"
        raw.write_bytes(b"".join(wall(k) for k in range(count)))
        return raw

    def taken(self, camera, options=(), **more):
        """Records a camera; returns size and intrinsics, (time stamp, counts) of every frame, and positions."""
        import rosbags.highlevel
        self.number = getattr(self, "number", 0) + 1
        copy = self.folder / f"{self.id().rsplit('.', 1)[1]}_{self.number}.mcap"
        self.check(palpate("record", "--camera", camera, "-o", copy, *options, **more))
        frames, places = [], set()
        with rosbags.highlevel.AnyReader([copy]) as reader:
            for connection, _, data in reader.messages():
                message = reader.deserialize(data, connection.msgtype)
                if connection.topic == "/camera/depth/image_rect_raw":
                    stamp = message.header.stamp
                    frames.append((stamp.sec + 1e-9 * stamp.nanosec, message.data.tobytes()))
                elif connection.topic.endswith("camera_info"):
                    camera_info = (message.width, message.height, *message.k[[0, 4, 2, 5]])
                elif connection.topic.startswith("/tf"):
                    at = message.transforms[0].transform.translation
                    places.add((at.x, at.y, at.z))
        return camera_info, frames, places

    def expect_walls(self, frames, count=31, period=1 / 30):
        self.assertEqual([data for _, data in frames], [wall(k) for k in range(count)])
        for k, (stamp, _) in enumerate(frames):
            self.assertAlmostEqual(stamp - frames[0][0], k * period, delta=1e-4)

    def debian_bag(self, name, compression):
        if not pathlib.Path("/usr/lib/python3/dist-packages/rosbag").exists():
            self.skipTest("there is no python3-rosbag; scripts/setup.sh --test installs it")
        path = self.folder / name
        subprocess.run([DEBIAN_PYTHON, HERE / "ros1_bag.py", path, compression, self.images(),
                        str(WIDTH), str(HEIGHT)], check=True, env={"PATH": os.environ["PATH"]})
        return path

    def test_bags_of_ros_1(self):
        for compression in ("none", "bz2", "lz4"):
            bag = self.debian_bag(f"{compression}.bag", compression)
            info, frames, _ = self.taken(f"bag:{bag}")
            self.assertEqual(info, (WIDTH, HEIGHT, 200, 200, 79.5, 59.5))
            self.expect_walls(frames)
            _, _, places = self.taken(f"bag:{bag}?world=table")
            self.assertEqual(places, {(0.1, 0, 0.02)})
        # A bag that the rosbag tool itself has filtered.
        few = self.folder / "few.bag"
        subprocess.run([DEBIAN_PYTHON, "/usr/bin/rosbag", "filter", bag, few,
                        "topic.startswith('/camera') and t.to_sec() < 1500000000.5"], check=True,
                       capture_output=True, env={"PATH": os.environ["PATH"], "HOME": "/nowhere"})
        self.expect_walls(self.taken(f"bag:{few}")[1], 15)
        self.refused("no depth images on /camera/color", "record", "--camera",
                     f"bag:{bag}?topic=/camera/color", "-o", self.folder / "never.mcap")

    def test_bags_of_ros_1_that_are_damaged(self):
        bag = self.debian_bag("whole.bag", "lz4")
        whole = bag.read_bytes()
        broken = self.folder / "broken.bag"
        never = self.folder / "never.mcap"

        def refused(words, data):
            broken.write_bytes(data)
            self.refused(words, "record", "--camera", f"bag:{broken}", "-o", never)
            self.assertFalse(never.exists())

        refused("is not a recording", whole[:10])
        refused("has no depth images", whole[:20])
        refused("before 2010", b"#ROSBAG V1.1\n" + whole[13:])
        refused("compressed by 'zip'", whole.replace(b"compression=lz4", b"compression=zip", 1))
        huge = whole.find(b"size=", whole.find(b"compression=lz4") - 30)
        for size in (b"\xff\xff\xff\xff", b"\xff\xff\xff\x3f", b"\x00\x10\x00\x00"):
            refused("a compressed chunk", whole[:huge + 5] + size + whole[huge + 9:])
        refused("a chunk has no size field", whole[:huge] + b"sice=" + whole[huge + 5:])
        middle = whole.find(b"compression=lz4") + 600
        refused("is damaged at byte", whole[:middle] + bytes(400) + whole[middle + 400:])
        # A bag that is cut off is read up to the cut.
        broken.write_bytes(whole[:len(whole) * 2 // 3])
        done = self.check(palpate("record", "--camera", f"bag:{broken}", "-o", never))
        self.assertIn(b"was cut off", done.stderr)
        never.unlink()

    def test_a_unit_that_changes_is_followed(self):
        import rosbags.highlevel
        raw, once, twice = (self.folder / name for name in ("changing.raw", "once.mcap", "twice.mcap"))
        raw.write_bytes(b"".join(header(5 + k / 30, 0.001 if k < 10 else 0.0005) + wall(k) for k in range(20)))
        for camera, copy in ((f"pipe:{raw}?intrinsics=200,200,79.5,59.5", once), (f"bag:{once}", twice)):
            self.check(palpate("record", "--camera", camera, "-o", copy))
            told = []
            with rosbags.highlevel.AnyReader([copy]) as reader:
                for connection, _, data in reader.messages():
                    if connection.topic.endswith("/unit"):
                        told.append(reader.deserialize(data, connection.msgtype))
                    elif connection.topic.endswith("image_rect_raw"):
                        told.append("image")
            units = [next(value for value in vars(each).values() if isinstance(value, float)) for each in told
                     if each != "image"]
            self.assertEqual(units, [0.001, 0.0005], copy)
            self.assertEqual([each == "image" for each in told].index(False, 2), 11, copy)

    def test_databases_whose_rows_are_computed_are_refused(self):
        import sqlite3
        topics = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
        columns = "topic_id INTEGER, timestamp INTEGER, data BLOB"
        for number, (statement, words) in enumerate((
                ("CREATE VIEW messages AS SELECT 1 AS id, 1 AS topic_id, 1 AS timestamp, "
                 "zeroblob(1000000000) AS data", "not a bag of ROS 2"),
                (f"CREATE TABLE messages(id INTEGER PRIMARY KEY, {columns}, "
                 "more BLOB AS (zeroblob(1000000000)))", "not a bag of ROS 2"),
                ("CREATE TABLE other(id INTEGER PRIMARY KEY)", "not a bag of ROS 2"),
                (f"CREATE TABLE messages(id INTEGER PRIMARY KEY, {columns})", "numbers a topic 70000"))):
            path = self.folder / f"computed{number}.db3"
            with sqlite3.connect(path) as database:
                database.execute(topics)
                database.execute("INSERT INTO topics VALUES (70000, '/d', 'sensor_msgs/msg/Image', 'cdr')")
                database.execute(statement)
            self.refused(words, "record", "--camera", f"bag:{path}", "-o", self.folder / "never.mcap")

    def test_recordings_compressed_by_lz4(self):
        try:
            from mcap.reader import make_reader
            from mcap.writer import CompressionType, Writer
        except ImportError:
            self.skipTest("there is no mcap; scripts/setup.sh --test installs it")
        bag = self.folder / "zstd.mcap"
        self.check(palpate("record", "--camera", f"bag:{self.debian_bag('of.bag', 'none')}", "-o",
                           bag))
        other = self.folder / "lz4.mcap"
        with open(bag, "rb") as source, open(other, "wb") as to:
            reader, writer = make_reader(source), Writer(to, compression=CompressionType.LZ4)
            writer.start("ros2", "")
            channels = {}
            for schema, channel, message in reader.iter_messages():
                if channel.id not in channels:
                    number = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.id] = writer.register_channel(channel.topic, "cdr", number)
                writer.add_message(channels[channel.id], message.log_time, message.data,
                                   message.publish_time)
            writer.finish()
        self.assertIn(b"lz4", other.read_bytes()[:2000])
        self.expect_walls(self.taken(f"bag:{other}")[1])

    def realsense_recording(self, name, unit=0.001):
        module = OLD_REALSENSE if name.endswith(".bag") else next(
            PYTHON.glob("lib/python*/site-packages"))
        if not (module / "pyrealsense2").exists():
            self.skipTest("there is no pyrealsense2; scripts/setup.sh --test installs it")
        path = self.folder / name
        subprocess.run([sys.executable, HERE / "realsense_bag.py", module, path, self.images(),
                        str(WIDTH), str(HEIGHT), str(unit)], check=True)
        return path

    def test_recordings_of_realsense(self):
        for ending in ("bag", "db3"):
            recording = self.realsense_recording(f"camera.{ending}")
            for kind in ("realsense", "bag"):
                info, frames, _ = self.taken(f"{kind}:{recording}",
                                             env={**os.environ, "VIRTUAL_ENV": str(PYTHON)})
                self.assertEqual(info, (WIDTH, HEIGHT, 200, 200, 79.5, 59.5))
                self.assertEqual([data for _, data in frames], [wall(k) for k in range(31)])
                stamps = [stamp for stamp, _ in frames]
                self.assertEqual(stamps, sorted(set(stamps)))
        done = self.check(palpate("cameras", "--selftest",
                                  f"bag:{self.realsense_recording('unit.bag', 0.0001)}"))
        self.assertIn(b"0.0001 m per count", done.stdout)


if __name__ == "__main__":
    unittest.main()
