"""Drives the real program with depth streams from elsewhere: --camera and palpate cameras.

Usage: cameras_test.py PATH_OF_PALPATE"""

import json
import math
import os
import pathlib
import shutil
import struct
import subprocess
import threading
import time
import unittest

from camera_case import HEIGHT, INTRINSICS, PALPATE, WIDTH, CameraCase, header, palpate, parts, wall
from made_files import write_depth_png


class Cameras(CameraCase):
    def test_list(self):
        for verb in ("cameras", "sensors"):
            found = json.loads(self.check(palpate(verb, "--json")).stdout)
            kinds = {each["kind"]: each for each in found}
            self.assertLessEqual({"scene", "folder", "pipe"}, set(kinds))
            for each in found:
                self.assertLessEqual({"kind", "usable", "library", "version", "devices", "reason"},
                                     set(each))
                self.assertTrue(each["reason"])
        self.assertIn(b"pipe:[FILE|-]", self.check(palpate("cameras", "-v")).stdout)

    def test_self_test(self):
        raw = self.folder / "self.raw"
        raw.write_bytes(b"".join(header(k / 30) + wall(k) for k in range(31)))
        camera = f"pipe:{raw}?intrinsics={INTRINSICS}"
        said = self.check(palpate("cameras", "--selftest", camera)).stdout.decode()
        self.assertIn("160 x 120 at 30 Hz, intrinsics 200,200,79.5,59.5", said)
        self.assertIn("31 frames in 1.00 s", said)
        self.assertIn("100.0 % measured, 0.504 m away", said)
        done = palpate("cameras", "--selftest", camera, f"pipe:{self.folder}/no?size=8x8")
        self.assertEqual(done.returncode, 1)
        self.assertIn(b"31 frames", done.stdout)
        self.assertIn(b"cannot open", done.stderr)
        self.refused("--json goes with the list", "cameras", "--selftest", "--json", status=2)

    def test_wrong_usage(self):
        touch = ["touch", self.tool, "-o", self.run_folder()]
        self.refused("give one of --camera", *touch, "--camera", "pipe:-", "--scene", "hand",
                     status=2)
        self.refused("several cameras are joined by the method field", *touch, "--camera",
                     "scene:hand", "--camera", "scene:hand?pose=0.1,0,0,0,0,0,1", "--method", "graph")
        self.refused("--ros2-camera-frame FRAME", *touch, "--camera", "scene:hand?pose=1,0,0,0,0,0,1",
                     "--device", "sim", "--ros2", status=2)
        self.refused("no path is made up", *touch, "--probe", "80,60", "--camera",
                     f"scene:hand?poses={self.orbit()}")
        self.refused("needs uri", *touch, "--rig", self.rig("[[camera]]\nname = 'a'\n"))
        self.refused("'size' must be", *touch, "--camera", "pipe:-?size=big", status=2)
        self.refused("goes with --depth-sequence", *touch, "--camera", "pipe:-", "--intrinsics",
                     INTRINSICS, status=2)
        self.refused("--memory-thickness goes with --memory on", *touch, "--camera", "scene:hand",
                     "--memory-thickness", "0.03", status=2)
        self.refused("no kind of camera is called 'webcam'", *touch, "--camera", "webcam:0")
        self.refused("no such folder", *touch, "--camera",
                     f"folder:{self.folder}/none?intrinsics={INTRINSICS}")
        self.refused("?size=", *touch, "--camera", f"pipe:-?intrinsics={INTRINSICS}", input=wall())
        self.refused("has no frames", *touch, "--camera",
                     f"pipe:-?size=160x120&intrinsics={INTRINSICS}", input=b"")
        self.assertFalse(self.run_folder().exists())

    def orbit(self):
        """Poses of a camera on an arc around 0, 0, 0.8 m."""
        path = self.folder / "orbit.tum"
        lines = []
        for k in range(81):
            t, angle = k / 20, 0.3 * math.sin(k / 20)
            lines.append(f"{t} {0.8 * math.sin(angle)} 0 {0.8 - 0.8 * math.cos(angle)} "
                         f"0 {-math.sin(angle / 2)} 0 {math.cos(angle / 2)}\n")
        path.write_text("".join(lines))
        return path

    def rig(self, text):
        path = self.folder / "rig.toml"
        path.write_text(text)
        return path

    def test_several_cameras_of_which_one_moves(self):
        orbit = self.orbit()
        side = "0.4 0 0.107180 0 -0.258819 0 0.965926".replace(" ", ",")
        scene = "scene:sphere-out-320?noise=off&size=160x120"
        one, two, rig = (self.folder / name for name in ("one_camera", "two_cameras", "rigged"))
        self.check(palpate("touch", self.tool, "--camera", scene, "-o", one))
        self.check(palpate("touch", self.tool, "--camera", f"{scene}&poses={orbit}", "--camera",
                           f"{scene}&pose={side}", "-o", two))
        self.check(palpate("touch", self.tool, "--rig", self.rig(
            f"[[camera]]\nuri = '{scene}'\npose_from = 'orbit.tum'\n"
            f"[[camera]]\nuri = '{scene}'\npose = [{side}]\n"), "-o", rig))
        self.assertEqual((two / "wrench.csv").read_bytes(), (rig / "wrench.csv").read_bytes())
        self.assertIn(b"identical: 4000 ticks", self.check(palpate("replay", two)).stdout)
        # The same ball, wherever it is seen from.
        def volumes(run):
            lines = (run / "wrench.csv").read_text().splitlines()
            column = lines[0].split(",").index("fraction")
            return [float(line.split(",")[column]) for line in lines[1:]]
        for alone, joined in list(zip(volumes(one), volumes(two)))[::100]:
            self.assertAlmostEqual(alone, joined, delta=0.01)
        self.assertEqual(self.summary(two)["frames"], 2 * self.summary(one)["frames"])
        live = self.folder / "live_two"
        self.check(palpate("touch", self.tool, "--camera", scene, "--camera",
                           f"{scene}&pose={side}", "--device", "sim", "--duration", 2,
                           "--set", "safety.max_sensor_age=10", "--set",
                           "safety.max_contact_age=10", "-o", live))
        self.assertIn(b"identical", self.check(palpate("replay", live)).stdout)

    def test_memory_of_a_camera_that_moves(self):
        camera = f"scene:sphere-out-320?noise=off&size=160x120&poses={self.orbit()}"
        path = self.folder / "through.tum"  # through the ball and the shadow that it has at first
        path.write_text("".join(f"{k / 50} 0.05 0 {0.5 + 0.01 * k} 0 0 0 1\n" for k in range(60)))
        walked = ["touch", self.tool, "--camera", camera, "--path", path, "--align", "starts"]
        runs = {}
        for name, memory in (("off", ["--memory", "off"]), ("on", ["--memory", "on"]),
                             ("few", ["--memory", "on", "--memory-frames", "1"])):
            runs[name] = self.folder / f"memory_{name}"
            self.check(palpate(*walked, *memory, "-o", runs[name]))
        on, off = ((runs[name] / "wrench.csv").read_bytes() for name in ("on", "off"))
        self.assertFalse(on == off)
        self.assertIn(b"identical", self.check(palpate("replay", runs["on"])).stdout)
        live = self.folder / "live_memory"
        self.check(palpate("touch", self.tool, "--camera", camera, "--device", "sim", "--memory",
                           "on", "--duration", 2, "--set", "safety.max_sensor_age=10", "--set",
                           "safety.max_contact_age=10", "-o", live))
        self.assertIn(b"identical", self.check(palpate("replay", live)).stdout)

    def test_poses_of_a_bag(self):
        """Camera poses that `record` writes are read back from the bag."""
        scene = "scene:sphere-out-320?noise=off&size=160x120"
        for name, camera in (("moving", f"{scene}&poses={self.orbit()}"),
                             ("still", f"{scene}&pose=0.1,0,0.02,0,0,0,1")):
            bag = self.folder / f"{name}.mcap"
            self.check(palpate("record", "--camera", camera, "-o", bag))
            runs = [self.folder / f"{name}_{k}" for k in range(2)]
            for run, source in zip(runs, (camera, f"bag:{bag}?world=world")):
                self.check(palpate("touch", self.tool, "--camera", source, "--path", self.path,
                                   "--align", "starts", "-o", run))
            one, two = ((run / "wrench.csv").read_text().splitlines()[1:] for run in runs)
            self.assertEqual(len(one), len(two))
            for a, b in list(zip(one, two))[::50]:
                for x, y in zip(a.split(",")[2:30], b.split(",")[2:30]):
                    self.assertAlmostEqual(float(x), float(y), delta=1e-6 + 1e-4 * abs(float(x)))
            self.refused("no transform joins the world 'table' and the camera 'camera'", "touch",
                         self.tool, "--camera", f"bag:{bag}?world=table", "--path", self.path, "-o",
                         self.folder / "nowhere")
        two = ["--camera", f"bag:{bag}?world=world", "--camera", f"bag:{bag}?world=table"]
        for words in (["touch", self.tool, *two, "--path", self.path, "-o", self.folder / "nowhere"],
                      ["record", *two, "-o", self.folder / "nowhere.mcap"]):
            self.refused("different worlds, 'world' and 'table'", *words)
        self.refused("different worlds, 'world' and 'table'", "query", self.tool, *two, "--pose",
                     "0 0 0.8 0 0 0 1", status=2)
        (self.folder / "cell.urdf").write_text(self.CELL)
        self.refused("--robot is placed in the world 'table' and a camera in 'world'", "touch",
                     self.tool, *two[:2], "--robot", self.folder / "cell.urdf", "--joints",
                     f"bag:{bag}?world=table", "--path", self.path, "-o", self.folder / "nowhere")

    def test_calibrate(self):
        true = [(0, 0, 0, 0, 0, 0, 1), (0.3420, -0.08, 0.0603, 0, -0.17365, 0, 0.98481)]
        wrong = [true[0], (0.3520, -0.088, 0.0543, 0.005, -0.18, 0.004, 0.983604)]
        # The images are those of the true poses: a camera of a scene stands where its pose says.
        for k in range(2):
            self.check(palpate("record", "--camera", f"scene:mannequin?size=320x240&seed={k}&pose=" +
                               ",".join(map(str, true[k])), "--duration", 0.5, "-o",
                               self.folder / f"eye{k}.mcap"))
        rig = self.rig("[world]\nframe = 'table'\n" + "".join(
            f"[[camera]]\nname = '{name}'\nuri = 'bag:eye{k}.mcap'\npose = {list(pose)}\n"
            for k, (name, pose) in enumerate(zip(("front", "side"), wrong))))
        better = self.folder / "better.toml"
        told = json.loads(self.check(palpate("calibrate", "--rig", rig, "-o", better,
                                             "--json")).stdout)
        pair = told["pairs"][0]
        self.assertEqual((pair["a"], pair["b"]), ("front", "side"))
        self.assertLess(pair["residual_mm"], 3)
        self.assertLess(pair["residual_mm"], pair["residual_before_mm"])
        pose = told["cameras"][1]["pose"]
        self.assertEqual(told["cameras"][0]["pose"], list(true[0]))
        self.assertAlmostEqual(2 * math.degrees(math.asin(-pose[4])),
                               2 * math.degrees(math.asin(0.17365)), delta=0.15)
        for got, want in zip(pose[:3], true[1][:3]):
            self.assertAlmostEqual(got, want, delta=0.003)
        text = better.read_text()
        self.assertIn("frame = 'table'", text.replace('"', "'"))
        # It is taken as it was, and a second time nothing moves much.
        again = json.loads(self.check(palpate("calibrate", "--rig", better, "-o", better,
                                              "--json")).stdout)
        self.assertLess(again["pairs"][0]["moved_mm"], 0.5)
        self.check(palpate("touch", self.tool, "--rig", better, "--path", self.path, "-o",
                           self.folder / "calibrated"))
        self.refused("relative to it", "calibrate", "--rig", rig, "-o", "/tmp/elsewhere.toml")
        walls = self.rig("".join(
            f"[[camera]]\nuri = 'scene:wall?size=160x120&seed={k}'\npose = [{0.1 * k}, 0, 0, 0, 0, 0, 1]"
            "\n" for k in range(2)))
        self.refused("too flat", "calibrate", "--rig", walls, "-o", self.folder / "none.toml")
        self.assertFalse((self.folder / "none.toml").exists())

    CELL = ("<robot name='cell'><link name='table'/><link name='bench'/><joint name='mount' "
            "type='fixed'><parent link='table'/><child link='bench'/><origin xyz='0.1 -0.05 0.2' "
            "rpy='0 0 1.5707963267948966'/></joint></robot>")
    BENCH = "0.1,-0.05,0.2,0,0,0.7071067811865476,0.7071067811865476"  # X_WC that it gives

    def test_a_made_up_probe_wherever_it_is_said_that_the_camera_stands(self):
        urdf, line = self.folder / "cell.urdf", self.folder / "still.tum"
        urdf.write_text(self.CELL)
        line.write_text("0 " + self.BENCH.replace(",", " ") + "\n")
        scene = "scene:wall?noise=off&size=160x120&"
        probes = []
        for k, place in enumerate((f"pose={self.BENCH}", f"urdf={urdf}#bench#table",
                                   f"poses={line}")):
            run = self.folder / f"placed_{k}"
            self.check(palpate("touch", self.tool, "--camera", scene + place, "--probe", "80,60",
                               "--duration", 2, "-o", run))
            summary = self.summary(run)
            self.assertGreater(summary["peaks"]["volume_m3"], 0)
            probes.append(summary["probe"]["point"])
        for probe in probes[1:]:
            for a, b in zip(probe, probes[0]):
                self.assertAlmostEqual(a, b, delta=1e-9)

    def test_calibrate_refines_a_camera_on_a_link(self):
        """The pose that is written is on the link, which the rig keeps."""
        (self.folder / "cell.urdf").write_text(self.CELL)
        for k in range(2):
            self.check(palpate("record", "--camera",
                               f"scene:mannequin?size=320x240&seed={k}&pose={0.03 * k},0,0,0,0,0,1",
                               "--duration", 0.3, "-o", self.folder / f"link{k}.mcap"))
        # The inverse of the link, and 3 cm beside that.
        half = math.sqrt(0.5)
        on_link = [[0.05, 0.1, -0.2, 0, 0, -half, half], [0.05, 0.072, -0.2, 0, 0, -half, half]]
        rig = self.rig("".join(
            f"[[camera]]\nname = 'eye{k}'\nuri = 'bag:link{k}.mcap'\n"
            f"pose_from = 'urdf:cell.urdf#bench#table'\npose = {pose}\n"
            for k, pose in enumerate(on_link)))
        better = self.folder / "better.toml"
        told = json.loads(self.check(palpate("calibrate", "--rig", rig, "-o", better,
                                             "--json")).stdout)
        self.assertAlmostEqual(told["cameras"][1]["pose"][0], 0.03, delta=0.002)
        again = json.loads(self.check(palpate("calibrate", "--rig", better, "-o", better,
                                              "--json")).stdout)
        self.assertLess(again["pairs"][0]["moved_mm"], 0.5)
        for old, new in zip(told["cameras"][1]["pose"], again["cameras"][1]["pose"]):
            self.assertAlmostEqual(old, new, delta=1e-3)

    def test_names_of_frames_mean_one_thing(self):
        scene = "uri = 'scene:wall?noise=off&size=160x120'"
        for rig, why in (
                (f"[[camera]]\nname = 'front'\n{scene}\n[[camera]]\nname = 'camera'\n{scene}\n"
                 "pose = [0.1, 0, 0, 0, 0, 0, 1]\n", "two frames are called 'camera'"),
                (f"[frames]\ntool = [0, 0, 1, 0, 0, 0, 1]\n[[camera]]\n{scene}\n",
                 "two frames are called 'tool'")):
            self.refused(why, "touch", self.tool, "--rig", self.rig(rig), "--path", self.path,
                         "-o", self.run_folder())
        self.refused("over ROS 2 a wrench refers to the origin",
                     "ros2", self.tool, "--depth", "/depth", "--tool-frame", "hand", "--tcp",
                     "0 0 0.1", status=2)
        self.refused("over ROS 2 --wrench-frame must be", "ros2", self.tool, "--depth", "/depth",
                     "--tool-frame", "hand", "--set", "output.wrench_frame=device", status=2)

    def test_rosbags_reads_several_cameras(self):
        try:
            import rosbags.highlevel
        except ImportError:
            self.skipTest("there is no rosbags; scripts/setup.sh --test installs it")
        run = self.run_folder()
        scene = "scene:wall?noise=off&size=64x48"
        self.check(palpate("touch", self.tool, "--camera", f"{scene}&poses={self.orbit()}",
                           "--camera", f"{scene}&pose=0.1,0,0,0,0,0,1", "-o", run))
        with rosbags.highlevel.AnyReader([run / "recording.mcap"]) as reader:
            counts = {each.topic: each.msgcount for each in reader.connections}
            self.assertEqual(counts["/depth"], counts["/camera_2/depth"])
            places = {"camera": [], "camera_2": []}
            for connection, _, data in reader.messages():
                if connection.topic not in ("/tf", "/tf_static"):
                    continue
                for tf in reader.deserialize(data, connection.msgtype).transforms:
                    if tf.child_frame_id in places:
                        self.assertEqual(tf.header.frame_id, "world")
                        places[tf.child_frame_id].append(
                            (connection.topic, tf.transform.translation.x))
            self.assertEqual(places["camera_2"], [("/tf_static", 0.1)])
            self.assertEqual(len(places["camera"]), counts["/depth"])
            self.assertEqual({topic for topic, _ in places["camera"]}, {"/tf"})
            self.assertAlmostEqual(max(x for _, x in places["camera"]), 0.8 * math.sin(0.3),
                                   delta=1e-3)

    @staticmethod
    def no_libraries(**more):
        """An environment in which no library of a maker can be loaded."""
        folder = Cameras.folder / "no_libraries"
        folder.mkdir(exist_ok=True)
        for name in ("libOpenNI2.so.0", "libOpenNI2.so", "librealsense2.so", "librealsense2.so.2",
                     "libk4a.so", "libk4a.so.1.4", "libk4a.so.1.3", "libfreenect.so.0.5",
                     "libfreenect.so.0", "libfreenect.so", "libOrbbecSDK.so", "libOrbbecSDK.so.2"):
            (folder / name).write_bytes(b"no library")
        of_sanitizers = {name: value for name, value in os.environ.items() if name.endswith("SAN_OPTIONS")}
        return {"PATH": os.environ["PATH"], "HOME": str(folder), "LD_LIBRARY_PATH": str(folder),
                **of_sanitizers, **more}

    def test_missing_libraries_are_told_with_what_was_tried(self):
        environment = self.no_libraries(FREENECT_LIBRARY="/nowhere/libfreenect.so")
        found = {each["kind"]: each for each in json.loads(self.check(
            palpate("cameras", "--json", env=environment)).stdout)}
        for kind, words in {"openni2": ("libOpenNI2.so.0", "install libopenni2-0"),
                            "realsense": ("librealsense2.so", "pip install pyrealsense2"),
                            "k4a": ("libk4a.so", "pip install pyk4a-bundle"),
                            "freenect": ("/nowhere/libfreenect.so", "install libfreenect0.5"),
                            "orbbec": ("libOrbbecSDK.so", "pip install pyorbbecsdk2")}.items():
            each = found[kind]
            if each["usable"] and each["library"].startswith("/usr"):
                continue  # as a Python package of the machine
            self.assertFalse(each["usable"], each)
            for word in words:
                self.assertIn(word, each["reason"])
            self.refused(words[0], "record", "--camera", kind, "-o", self.folder / "never.mcap",
                         env=environment)

    def test_nobody_names_a_source(self):
        touch = ["touch", self.tool, "-o", self.run_folder()]
        environment = self.no_libraries()
        self.refused("no camera is plugged in", *touch, env=environment)
        self.refused("no haptic device is there", *touch, "--scene", "wall", "--device",
                     env=environment)
        self.assertFalse(self.run_folder().exists())

    def test_the_camera_that_is_there_is_taken(self):
        redist = pathlib.Path(PALPATE).parent.parent / "tests/cameras/openni2"
        if not (redist / "OpenNI2/Drivers/libPalpate.so.0").exists():
            self.skipTest("there is no libopenni2-dev; scripts/setup.sh --test installs it")
        raw = self.folder / "plugged.raw"
        raw.write_bytes(struct.pack("<640H", *(600 + (u - 320) ** 2 // 4000 for u in range(640)))
                        * 480)
        run = self.run_folder()
        environment = self.no_libraries(OPENNI2_REDIST=str(redist), PALPATE_FAKE_OPENNI2=str(raw))
        done = self.check(palpate("touch", self.tool, "--device", "sim", "--duration", 2, "--set",
                                  "loop.real_time=false", "-o", run, env=environment))
        self.assertIn(b"taking the camera openni2:fake:0", done.stderr)
        summary = self.summary(run)
        self.assertEqual((summary["stream"]["width"], summary["stream"]["rate"]), (640, 30))
        self.assertEqual(summary["stream"]["sensor"], "structured_light")
        self.assertIn(b"for sensor kind structured_light", done.stderr)
        self.assertGreater(summary["peaks"]["volume_m3"], 0)
        said = self.check(palpate("cameras", "--selftest", "--seconds", 1,
                                  env=environment)).stdout.decode()
        self.assertIn("openni2:fake:0: 640 x 480 at 30 Hz", said)
        self.assertIn("% of a core", said)

    def test_a_query_takes_the_first_frame_of_a_stream(self):
        query = ["query", self.tool, "--pose", "0 0 0.49 0 0 0 1", "--json"]
        frames = self.folder / "query"
        frames.mkdir()
        write_depth_png(frames / "0.png", WIDTH, HEIGHT,
                        lambda u, v: 500 + (u - 80) ** 2 // 400 + v % 2)
        raw = self.folder / "query.raw"
        raw.write_bytes(wall(0) + wall(1))

        def volume(*source):
            return json.loads(self.check(palpate(*query, *source)).stdout)["results"][0]["volume"]

        of_image = volume("--depth", frames / "0.png", "--intrinsics", INTRINSICS)
        self.assertGreater(of_image, 0)
        self.assertEqual(volume("--camera", f"pipe:{raw}?size=160x120&intrinsics={INTRINSICS}"),
                         of_image)
        self.assertEqual(volume("--camera", f"folder:{frames}?intrinsics={INTRINSICS}"), of_image)
        self.refused("give one of --cloud, --depth and --camera", *query, "--camera", "scene:wall",
                     "--depth", frames / "0.png", "--intrinsics", INTRINSICS, status=2)
        self.refused("there is no scene", *query, "--camera", "scene:nowhere")

    def test_a_scene_is_the_same_by_both_names(self):
        a, b = self.folder / "scene_a", self.folder / "scene_b"
        for run, source in ((a, ("--scene", "wall")), (b, ("--camera", "scene:wall"))):
            self.check(palpate("touch", self.tool, *source, "--duration", 0.3, "-o", run))
        self.assertEqual((a / "wrench.csv").read_bytes(), (b / "wrench.csv").read_bytes())

    def test_every_frame_of_a_pipe_counts_along_a_path(self):
        run = self.run_folder()
        frames = b"".join(wall(k) for k in range(31))
        self.check(palpate("touch", self.tool, "--camera",
                           f"pipe:-?size=160x120&intrinsics={INTRINSICS}&rate=30", "--path",
                           self.path, "-o", run, input=frames))
        summary = self.summary(run)
        self.assertEqual(summary["frames"], 30)
        self.assertGreater(summary["peaks"]["volume_m3"], 0)
        self.assertEqual(palpate("replay", run).returncode, 0)
        # Without a path, a place is chosen among the first frames.
        probe = self.folder / "probe"
        done = self.check(palpate("touch", self.tool, "--camera",
                                  f"pipe:-?size=160x120&intrinsics={INTRINSICS}", "-o", probe,
                                  input=frames))
        self.assertIn(b"probed the pixel", done.stdout)
        self.assertGreater(self.summary(probe)["peaks"]["volume_m3"], 0)

    def test_the_kind_of_sensor_chooses_what_nobody_gives(self):
        raw = self.folder / "sensor.raw"
        raw.write_bytes(b"".join(wall(k) for k in range(31)))
        file = self.folder / "sensor.toml"
        file.write_text("[surface]\nfilter_radius = 2\n")

        def surface(sensor, *options, uri=""):
            run = self.folder / "sensor_run"
            done = self.check(palpate("touch", self.tool, "--camera",
                                      f"pipe:{raw}?size=160x120&intrinsics={INTRINSICS}{uri}", "--path",
                                      self.path, "-o", run, *options))
            self.assertEqual(b"for sensor kind" in done.stderr, sensor != "none", done.stderr)
            summary = self.summary(run)
            self.assertEqual(summary["stream"]["sensor"], sensor)
            self.assertEqual(palpate("replay", run).returncode, 0)
            made = summary["settings"]["surface"]
            return made["flying_pixel_gap"], made["filter_radius"]

        self.assertEqual(surface("none"), (0, 2))
        self.assertEqual(surface("tof", uri="&sensor=tof"), (0.015, 2))
        self.assertEqual(surface("active_stereo", "--sensor", "active_stereo", uri="&sensor=tof"),
                         (0.03, 3))
        self.assertEqual(surface("none", "--sensor", "none", uri="&sensor=tof"), (0, 2))
        # Explicit settings take precedence over the sensor's, even if they equal the defaults.
        self.assertEqual(surface("active_stereo", "--sensor", "active_stereo", "--set",
                                 "surface.filter_radius=2"), (0.03, 2))
        self.assertEqual(surface("active_stereo", "--sensor", "active_stereo", "--settings", file),
                         (0.03, 2))
        self.refused("must be one of none, structured_light", "touch", self.tool, "--camera",
                     "pipe:-?sensor=laser", "-o", self.folder / "never", status=2)

    def test_ffmpeg(self):
        if shutil.which("ffmpeg") is None:
            self.skipTest("there is no ffmpeg; scripts/setup.sh --test installs it")
        run = self.run_folder()
        # ffmpeg copies the wall from a file into the pipe, exact to the last count.
        raw = self.folder / "wall.raw"
        raw.write_bytes(b"".join(wall(k) for k in range(31)))
        by_ffmpeg = subprocess.run(
            ["ffmpeg", "-v", "error", "-f", "rawvideo", "-pix_fmt", "gray16le", "-s", "160x120",
             "-r", "30", "-i", raw, "-pix_fmt", "gray16le", "-f", "rawvideo", "-"],
            capture_output=True, check=True).stdout
        camera = f"size=160x120&intrinsics={INTRINSICS}"
        self.check(palpate("touch", self.tool, "--camera", f"pipe:-?{camera}", "--path", self.path,
                           "-o", run, input=by_ffmpeg))
        other = self.folder / "ffmpeg_file"
        self.check(palpate("touch", self.tool, "--camera", f"pipe:{raw}?{camera}", "--path",
                           self.path, "-o", other))
        self.assertEqual((run / "wrench.csv").read_bytes(), (other / "wrench.csv").read_bytes())

    def live_run(self, run, frames, *options, uri="header=on", duration=60):
        """Frames: (seconds to wait, bytes). Ends with the frames."""
        pipe = self.folder / f"{run.name}.fifo"
        os.mkfifo(pipe)

        def write():
            with open(pipe, "wb", buffering=0) as to:
                for seconds, data in frames:
                    time.sleep(seconds)
                    try:
                        to.write(data)
                    except BrokenPipeError:
                        return

        writer = threading.Thread(target=write)
        writer.start()
        done = palpate("touch", self.tool, "--camera", f"pipe:{pipe}?{uri}", "--device",
                       f"replay:{self.path}", "--duration", duration, "--set",
                       "loop.real_time=false", "--set", "safety.max_contact_age=0.5",
                       "--set", "safety.max_sensor_age=0.5", "-o", run, *options)
        writer.join()
        return self.check(done)

    def test_live(self):
        run = self.run_folder()
        frames = [(1 / 30, header(5e4 + k / 30) + wall(k)) for k in range(60)]
        # A black frame, one from the past, and a gap that fades the force.
        frames[20] = (1 / 30, header(5e4 + 20 / 30) + bytes(2 * WIDTH * HEIGHT))
        frames[30] = (1 / 30, header(5e4 + 25 / 30) + wall(30))
        frames[45] = (1.5, header(5e4 + 45 / 30 + 1.5) + wall(45))
        for k in range(46, 60):
            frames[k] = (1 / 30, header(5e4 + k / 30 + 1.5) + wall(k))
        # The path lasts longer than the frames last.
        self.path.write_text("0 0 0 0.45 0 0 0 1\n0.5 0 0 0.49 0 0 0 1\n30 0 0 0.49 0 0 0 1\n")
        self.live_run(run, frames, uri=f"intrinsics={INTRINSICS}&rate=30&latency=0.02")
        summary = self.summary(run)
        warnings = "\n".join(summary["warnings"])
        self.assertIn("frames with old timestamps", warnings)
        self.assertIn("1 had no measurement", warnings)
        self.assertIn("capture times are from its clock", warnings)
        self.assertGreater(summary["peaks"]["volume_m3"], 0)
        self.assertTrue(summary["faults"], summary)
        self.assertEqual(palpate("replay", run).returncode, 0)

    def test_live_without_time_stamps(self):
        run = self.run_folder()
        frames = [(1 / 30, wall(k)) for k in range(30)]
        self.live_run(run, frames, uri=f"size=160x120&intrinsics={INTRINSICS}", duration=20)
        self.assertIn("has no timestamps", "\n".join(self.summary(run)["warnings"]))

    def test_wrong_by_a_factor_is_told(self):
        run = self.run_folder()
        fivefold = struct.pack(f"<{WIDTH * HEIGHT}H", *(
            5 * int(500 + 150 * math.sin(u / 9) * math.cos(v / 7)) for v in range(HEIGHT)
            for u in range(WIDTH)))
        done = self.check(palpate("touch", self.tool, "--camera",
                                  "pipe:-?size=160x120&intrinsics=525,525,319.5,239.5", "--path",
                                  self.path, "-o", run, input=5 * fivefold))
        self.assertIn("unit=0.0002", done.stderr.decode())
        self.assertIn("131.25,131.25,79.5,59.5", done.stderr.decode())

    def test_a_unit_is_doubted_where_the_tool_meets_nothing(self):
        """Counts of 1/5000 m that are no multiples of anything, read as millimeters."""
        raw = self.folder / "far.raw"
        raw.write_bytes(31 * struct.pack(f"<{WIDTH * HEIGHT}H", *(
            2500 + (u - 80) ** 2 // 40 + v % 7 for v in range(HEIGHT) for u in range(WIDTH))))
        for unit, doubted in (("", True), ("&unit=0.0002", False)):
            run = self.folder / f"doubt{unit}"
            done = self.check(palpate("touch", self.tool, "--camera",
                                      f"pipe:{raw}?size=160x120&intrinsics={INTRINSICS}{unit}",
                                      "--path", self.path, "-o", run))
            for told in (done.stderr.decode(), "\n".join(self.summary(run)["warnings"])):
                self.assertEqual("--depth-unit 0.0002 (of a --camera ?unit=0.0002) would fit" in told, doubted, told)

    def test_an_image_is_cropped_to_what_the_lens_sees(self):
        raw = self.folder / "bent.raw"
        raw.write_bytes(b"".join(wall(k) for k in range(31)))
        lens = f"pipe:{raw}?size=160x120&intrinsics={INTRINSICS}&distortion=0.3,0,0,0"
        whole = self.check(palpate("cameras", "--selftest", lens)).stdout.decode()
        self.assertIn("160 x 120", whole)
        self.assertNotIn("100.0 % measured", whole)
        part = self.check(palpate("cameras", "--selftest", lens + "&crop=valid")).stdout.decode()
        self.assertNotIn("160 x 120", part)
        self.assertIn("100.0 % measured", part)

    def test_record_and_play(self):
        raw = self.folder / "record.raw"
        raw.write_bytes(b"".join(header(5 + k / 15, 0.0002) + wall(k) for k in range(20)))
        bag = self.folder / "record.mcap"
        done = json.loads(self.check(palpate(
            "record", "--camera", f"pipe:{raw}?intrinsics={INTRINSICS}&sensor=tof", "-o", bag,
            "--json")).stdout)
        self.assertEqual(done["frames"], 20)
        self.assertAlmostEqual(done["seconds"], 19 / 15)
        runs = self.folder / "of_raw", self.folder / "of_bag"
        for run, camera in zip(runs, (f"pipe:{raw}?intrinsics={INTRINSICS}&sensor=tof", f"bag:{bag}")):
            self.check(palpate("touch", self.tool, "--camera", camera, "--path", self.path,
                               "--align", "starts", "-o", run))
        first, second = (self.summary(run) for run in runs)
        self.assertEqual(first["stream"]["sensor"], "tof")
        for key in ("width", "height", "fx", "fy", "cx", "cy", "unit", "sensor"):
            self.assertEqual(first["stream"][key], second["stream"][key])
        self.assertEqual(first["frames"], second["frames"])
        self.assertAlmostEqual(first["peaks"]["force_N"] / second["peaks"]["force_N"], 1, places=6)
        self.refused("cannot open", "record", "--camera",
                     f"pipe:{self.folder}/none?size=8x8&intrinsics={INTRINSICS}", "-o",
                     self.folder / "none.mcap")
        self.assertFalse((self.folder / "none.mcap").exists())


if __name__ == "__main__":
    unittest.main(testLoader=parts.Loader())
