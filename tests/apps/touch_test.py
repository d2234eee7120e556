"""Touching along paths, and what is made of the recordings.

Usage: touch_test.py PATH_OF_PALPATE"""

import importlib.util
import json
import math
import os
import pathlib
import shutil
import signal
import struct
import unittest

from cli_case import CommandLineCase, INTRINSICS, main, page_data, palpate, read
from made_files import write_depth_png


class Touching(CommandLineCase):

    def test_a_recording_without_a_tick_is_not_identical(self):
        """Cut off where a run can be killed: before its first tick there is nothing to repeat."""
        whole, cut = self.path("whole"), self.path("cut")
        self.succeed(*self.sequence("-o", whole))
        recording = read(os.path.join(whole, "recording.mcap"), "rb")
        os.mkdir(cut)
        num_empty = 0
        for share in range(0, 11):
            with open(os.path.join(cut, "recording.mcap"), "wb") as file:
                file.write(recording[:len(recording) * share // 10])
            result = palpate("replay", cut, "--json")
            ticks = json.loads(result.stdout)["ticks"] if result.returncode == 0 else 0
            self.assertEqual(result.returncode, 0 if ticks > 0 else 1, result.stderr)
            num_empty += ticks == 0
        self.assertGreater(num_empty, 1)
        self.assertLess(num_empty, 10)

    def test_touch_and_replay(self):
        run, again = self.path("run"), self.path("run2")
        summary = json.loads(self.succeed(*self.sequence("-o", run, "--json", "--method", "graph")))
        self.assertEqual(summary, json.loads(read(os.path.join(run, "summary.json"))))
        self.assertEqual(summary["frames"], 4)
        self.assertGreater(summary["peaks"]["volume_m3"], 0)
        self.assertLess(summary["peaks"]["fraction"], 0.3)
        self.assertGreater(summary["peaks"]["force_N"], 0)
        self.assertEqual((summary["fault"], summary["ending"]), ("none", "the path has ended"))
        lines = read(os.path.join(run, "wrench.csv")).splitlines()
        self.assertEqual(len(lines), summary["ticks"] + 1)
        self.assertEqual({len(line.split(",")) for line in lines}, {len(lines[0].split(","))})
        self.assertIn("</html>", read(os.path.join(run, "report.html")))
        identical = f"identical: {summary['ticks']} ticks, {summary['ticks']} contact queries\n"
        self.assertEqual(self.succeed("replay", run), identical)
        self.assertEqual(self.succeed("replay", run, "--threads", 2), identical)
        self.succeed("replay", run, "-o", again)
        self.assertEqual(read(os.path.join(run, "wrench.csv")),
                         read(os.path.join(again, "wrench.csv")))
        self.succeed(*self.sequence("-o", run, "--method", "graph", "--threads", 1))
        self.assertEqual(read(os.path.join(run, "wrench.csv")).splitlines(), lines)

        recording = os.path.join(again, "recording.mcap")
        content = bytearray(read(recording, "rb"))
        content[len(content) // 2] ^= 255
        with open(recording, "wb") as file:
            file.write(content)
        self.expect_failure(1, "replay", again, mentions="recording.mcap")

    def test_standard_deviations_are_asked_for(self):
        plain, run, tried = self.path("plain"), self.path("std"), self.path("std_tried")
        self.succeed(*self.sequence("-o", plain))
        self.succeed(*self.sequence("-o", run, "--std"))
        self.assertTrue(self.succeed("replay", run).startswith("identical: "))
        self.succeed("replay", plain, "-o", tried, "--std")
        before, said, again = map(self.columns, (plain, run, tried))
        names = ["volume_std_m3"] + [f"measure_std_{x}_m{3 + len(x) - 1}" for x in ("x", "y", "z", "mx", "my", "mz")]
        self.assertEqual([name for name in said if name not in before], names)
        self.assertEqual(said, again)
        # It changes nothing else, and says something where the tool touches.
        self.assertEqual({name: said[name] for name in before}, before)
        deepest = max(range(len(said["volume_m3"])), key=said["volume_m3"].__getitem__)
        self.assertGreater(said["volume_std_m3"][deepest], 0)
        self.assertLess(said["volume_std_m3"][deepest], said["volume_m3"][deepest])
        page = read(os.path.join(run, "report.html"))
        self.assertIn("force_covariance_N2", page)
        self.assertNotIn("force_covariance_N2\":", read(os.path.join(plain, "report.html")))
        self.expect_failure(1, *self.sequence("-o", self.path("graph"), "--std", "--method", "graph"),
                            mentions="--std is for the method field: graph")

    def test_replay_tries_other_settings(self):
        run, tried, direct = self.path("try"), self.path("tried"), self.path("try_direct")
        self.succeed(*self.sequence("-o", run))
        told = json.loads(self.succeed("replay", run, "-o", tried, "--method", "graph", "--time",
                                       "latest", "--no-filter", "--json"))
        self.succeed(*self.sequence("-o", direct, "--method", "graph", "--time", "latest",
                                    "--no-filter"))
        before, after, same = map(self.columns, (run, tried, direct))
        self.assertTrue(after == same)
        off = [math.dist([before[f"force_{x}_N"][k] for x in "xyz"],
                         [after[f"force_{x}_N"][k] for x in "xyz"])
               for k in range(told["ticks"])]
        self.assertAlmostEqual(told["force_difference_max_N"], max(off), delta=1e-9)
        self.assertAlmostEqual(told["force_difference_rms_N"] ** 2,
                               sum(x * x for x in off) / len(off), delta=1e-9)
        # Options of the run that another method lacks are dropped with a note; given ones are refused.
        edges, field = self.path("try_edges"), self.path("tried_field")
        self.succeed(*self.sequence("-o", edges, "--method", "simplified", "--priority", "count",
                                    "--continuity", "both"))
        result = palpate("replay", edges, "-o", field, "--method", "field")
        self.assertEqual(result.returncode, 0, result.stderr)
        notes = [line for line in result.stderr.splitlines() if "dropped" in line]
        self.assertEqual(notes, ["palpate: note: dropped options of the run that the method field "
                                 "does not have: priority, continuity; surface.smoothing is "
                                 "adaptive, as is usual with this method"])
        self.succeed(*self.sequence("-o", direct))
        self.assertTrue(self.columns(field) == self.columns(direct))
        self.expect_failure(1, "replay", edges, "-o", field, "--method", "field", "--continuity",
                            "entry", mentions="continuity does not go with the method field")
        self.expect_failure(2, "replay", run, "--method", "graph", mentions="-o RUN2")
        self.expect_failure(1, "replay", run, "-o", run, mentions="another folder")
        self.expect_failure(2, "replay", run, "-o", tried, "--method", "magic", mentions="graph")

    def test_report_of_two_runs(self):
        one, other, both = self.path("one"), self.path("other"), self.path("both.html")
        self.succeed(*self.sequence("-o", one))
        self.succeed("replay", one, "-o", other, "--method", "graph")
        self.assertEqual(self.succeed("report", one, other + "/", "-o", both), f"report: {both}\n")
        data = page_data(both)
        self.assertEqual([data["kind"], data["names"]], ["two_runs", ["one", "other"]])
        for run, folder in zip(data["runs"], (one, other)):
            self.assertEqual(run, page_data(os.path.join(folder, "report.html")))
        # The names tell two runs of one name apart.
        same = os.path.join(self.path("elsewhere"), "one")
        shutil.copytree(other, same)
        self.succeed("report", one, same, "-o", both)
        self.assertEqual(page_data(both)["names"], [one, same])
        # Errors say the fault, and the remedy.
        before = read(os.path.join(one, "report.html"))
        self.expect_failure(1, "report", one, other, "-o", os.path.join(one, "report.html"), mentions="another file")
        self.assertEqual(read(os.path.join(one, "report.html")), before)
        self.expect_failure(1, "report", one, self.path("nowhere"), "-o", both, mentions="not the folder of a run")
        self.expect_failure(2, "report", one, "-o", both, mentions="second_run is required")
        for damage in ("", "<html></html>", before.replace('"kind":"run"', '"kind":"packing"'),
                       before[:before.index('id="data">') + 500], before.replace('"series":', '"series:', 1)):
            with open(os.path.join(same, "report.html"), "w") as file:
                file.write(damage)
            self.expect_failure(1, "report", one, same, "-o", both, mentions="palpate replay")
        os.remove(os.path.join(same, "report.html"))
        self.expect_failure(1, "report", one, same, "-o", both, mentions="no report.html; 'palpate replay")

    @unittest.skipUnless(importlib.util.find_spec("rosbags") and
                         importlib.util.find_spec("mcap_ros2"),
                         "SKIPPED: scripts/setup.sh --test installs rosbags and mcap-ros2-support")
    def test_other_programs_read_the_recording(self):
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
        run = self.path("run_ros")
        self.succeed(*self.sequence("-o", run, "--duration", 0.2, "--coupling", "direct"))
        recording = os.path.join(run, "recording.mcap")
        felt = self.columns(run)
        by_mcap, by_rosbags = {}, {}
        with open(recording, "rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            self.assertEqual(reader.get_header().profile, "ros2")
            for _, channel, _, message in reader.iter_decoded_messages():
                by_mcap.setdefault(channel.topic, []).append(message)
            self.assertEqual([file.name for file in reader.iter_attachments()], ["tool.palp"])
        with AnyReader([pathlib.Path(recording)],
                       default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            for connection, _, raw in reader.messages():
                by_rosbags.setdefault(connection.topic, []).append(
                    reader.deserialize(raw, connection.msgtype))
        for messages in by_mcap, by_rosbags:
            self.assertEqual(len(messages["/tick"]), 200)
            for k in (0, 77, 199):
                tick = messages["/tick"][k]
                self.assertEqual(tick.coupling.contact.force.z, felt["force_z_N"][k])
                self.assertEqual(tick.wrench_on_hand.force.z, felt["hand_force_z_N"][k])
                # A tool that is not turned, about its own origin: its center of mass.
                wrench = messages["/tool/wrench"][k]
                self.assertEqual(wrench.header.frame_id, "tool")
                force = math.hypot(*(getattr(wrench.wrench.force, x) for x in "xyz"))
                self.assertAlmostEqual(force, math.hypot(*(felt[f"force_{x}_N"][k] for x in "xyz")),
                                       delta=1e-9)
            image, info = messages["/depth"][0], messages["/camera_info"][0]
            self.assertEqual((image.width, image.height, image.encoding), (160, 120, "16UC1"))
            counts = struct.unpack("<19200H", bytes(image.data))
            self.assertEqual(counts[160 * 7 + 9], 5000 + int(30 * math.sin(1)))
            self.assertEqual([info.k[0], info.k[2], info.k[5]], [200, 79.5, 59.5])
            # Every measured pixel, where the camera saw it.
            points = messages["/depth/points"][0]
            self.assertEqual(points.header.frame_id, "camera")
            self.assertEqual([(f.name, f.offset, f.datatype) for f in points.fields],
                             [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)])
            measured = [(u, v, 1e-4 * counts[160 * v + u]) for v in range(120)
                        for u in range(160) if counts[160 * v + u] not in (0, 65535)]
            self.assertEqual((points.width, points.row_step), (len(measured), 12 * len(measured)))
            for (u, v, z), point in zip(measured, struct.iter_unpack("<3f", bytes(points.data))):
                for seen, expected in zip(point, ((u - 79.5) / 200 * z, (v - 59.5) / 200 * z, z)):
                    self.assertAlmostEqual(seen, expected, delta=1e-6)
            frames = {t.child_frame_id for m in messages["/tf"] + messages["/tf_static"]
                      for t in m.transforms}
            self.assertEqual(frames, {"camera", "base", "hand", "tool", "tool_in_hand"})
            self.assertEqual(messages["/tf"][0].transforms[0].transform.translation.z,
                             felt["tool_z_m"][0])
            self.assertGreater(len(messages["/tool/marker"][0].points), 20)

    def test_a_path_means_the_same_everywhere(self):
        """Poses are those of the tool in the camera frame, with and without a device."""
        path, along, played = self.path("same.txt"), self.path("along"), self.path("played")
        with open(path, "w") as file:
            file.write("0 0 0 0.45 0 0 0 1\n0.5 0.003 0 0.49 0 0.1 0 0.995\n3 0.003 0 0.49 0 0.1 0 0.995\n")
        settings = self.patient_settings("patient_path.toml")
        touch = (*self.sequence("--settings", settings), "--depth-rate", 0.5)
        self.succeed(*touch, "-o", along, "--path", path)
        result = palpate(*touch, "-o", played, "--device", f"replay:{path}", "--coupling", "none")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("has ended", result.stdout)
        self.assertEqual(self.expect_whole(played)["fault"], "none")
        a, b = self.columns(along), self.columns(played)
        for name, value in (("tool_x_m", 0), ("tool_z_m", 0.45)):
            self.assertAlmostEqual(a[name][0], value, delta=1e-9)
            self.assertAlmostEqual(b[name][0], value, delta=1e-3)
        # It rests where it is deepest, long enough for a busy computer.
        self.assertAlmostEqual(max(b["volume_m3"]) / max(a["volume_m3"]), 1, delta=0.3)
        # Identity is a pose like any other: handles at these poses in the base are tools there.
        with open(settings, "a") as file:
            file.write("[coupling]\nbase_in_scene = [0, 0, 0.1, 0, 0, 0, 1]\n")
        self.succeed(*touch, "-o", played, "--path", path)
        self.assertAlmostEqual(self.columns(played)["tool_z_m"][0], 0.45, delta=1e-12)
        self.succeed(*touch, "-o", played, "--path", path, "--path-frame", "base")
        self.assertAlmostEqual(self.columns(played)["tool_z_m"][0], 0.55, delta=1e-12)

    def test_what_is_given_and_told_in_other_frames(self):
        """A camera turned about z at (1, 0, 0): the same touch, told in the world and in the camera."""
        plain, turned, path = self.path("plain"), self.path("turned"), self.path("frames.txt")
        with open(path, "w") as file:
            file.write("0 0 0 0.45 0 0 0 1\n0.4 0.003 0 0.49 0 0.1 0 0.995\n")
        self.succeed("touch", self.tool, "--depth-sequence", self.frames, "--intrinsics", INTRINSICS,
                     "--depth-unit", 0.0001, "--depth-rate", 5, "--path", path, "-o", plain)
        rig = self.path("frames.toml")
        with open(rig, "w") as file:
            file.write(f"""[world]
gravity = [0, 0, -9.81]
[frames]
corner = [0, 2, 0, 0, 0, 0, 1]
[[camera]]
name = "side"
uri = "folder:{self.frames}?rate=5"
intrinsics = [{INTRINSICS}]
unit = 0.0001
pose = [1, 0, 0, 0, 0, {0.5 ** 0.5}, {0.5 ** 0.5}]
""")
        touch = ("touch", self.tool, "--rig", rig, "--path", path, "-o", turned)
        self.succeed(*touch, "--path-frame", "side", "--wrench-frame", "camera", "--set", "coupling.kind=none")
        a, b = self.columns(plain), self.columns(turned)
        self.assertAlmostEqual(b["tool_x_m"][0], 1, delta=1e-12)
        # A device that stands in that frame: a path in the device's base is the same.
        self.succeed(*touch[:-1], self.path("based"), "--base-frame", "side", "--path-frame", "device", "--set",
                     "coupling.kind=none")
        based = self.columns(self.path("based"))
        for name in ("tool_x_m", "tool_y_m", "tool_z_m"):
            self.assertLess(max(abs(x - y) for x, y in zip(based[name], b[name], strict=True)), 1e-12)
        deepest = a["volume_m3"].index(max(a["volume_m3"]))
        self.assertGreater(a["volume_m3"][deepest], 0)
        # Turned by 90 degrees: x of the camera is y of the world.
        for there, here in (("force_x_N", "force_y_N"), ("torque_z_Nm", "torque_z_Nm")):
            self.assertAlmostEqual(a[there][deepest] / b[here][deepest], 1, delta=1e-6)
        for name in ("force_x_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "measure_x_m3"):
            self.assertAlmostEqual(a[name][deepest] / b["reported_" + name][deepest], 1, delta=1e-6)
        with open(os.path.join(turned, "summary.json")) as file:
            settings = json.load(file)["settings"]
        self.assertEqual(settings["bodies"]["gravity_z"], -9.81)
        # A tool center point: poses are its, and a frame of the rig's own.
        self.succeed(*touch, "--path-frame", "corner", "--wrench-frame", "corner", "--tcp", "0 0 0.1",
                     "--wrench-point", "tcp")
        c = self.columns(turned)
        for name, value in (("reported_y_m", 0), ("reported_z_m", 0.45), ("tool_y_m", 2), ("tool_z_m", 0.35)):
            self.assertAlmostEqual(c[name][0], value, delta=1e-12)
        self.expect_failure(1, *touch, "--path-frame", "cornre", mentions="there are camera, corner, side, world")
        self.expect_failure(1, *touch, "--object", f"{self.tool}@0 0 0 0 0 0 1,frame=nowhere",
                            mentions="there is no frame 'nowhere'")

    def test_clocks_are_taken_at_their_word(self):
        frames, path, run = self.path("stamped"), self.path("stamped.txt"), self.path("stamped_run")
        shutil.copytree(self.frames, frames)
        start = 1600000000.25
        with open(os.path.join(frames, "depth.txt"), "w") as file:
            for k in range(4):
                file.write(f"{start + 0.5 * k:.6f} {k:03d}.png\n")

        def touch(shift, *more):
            with open(path, "w") as file:
                for k in range(2):
                    file.write(f"{start + shift + 0.5 * k:.6f} 0 0 0.49 0 0 0 1\n")
            return ("touch", self.tool, "--depth-sequence", frames, "--intrinsics", INTRINSICS,
                    "--depth-unit", 0.0001, "--path", path, "-o", run, *more)
        self.succeed(*touch(0))
        together = self.columns(run)
        self.assertEqual(together["timestamp_s"][0], start)
        self.succeed(*touch(0.5))
        later = self.columns(run)
        self.assertEqual((later["timestamp_s"][0], later["frame"][0]), (start + 0.5, 0))
        # The frame of that moment is another one.
        self.assertNotEqual(later["volume_m3"][0], together["volume_m3"][0])
        self.assertEqual(later["sensor_age_s"][0], 0)
        # A device that plays the path also feels the frame of that moment first.
        settings = self.patient_settings("patient_clocks.toml")
        played = {}
        for shift in (0, 0.5):
            as_path = touch(shift)
            at = as_path.index("--path")
            self.succeed(*as_path[:at], "--device", f"replay:{path}", "--coupling", "none",
                         "--settings", settings, *as_path[at + 2:])
            columns = self.columns(run)
            self.assertEqual(min(columns["frame"]), 0)
            played[shift] = next(v for v, frame in zip(columns["volume_m3"], columns["frame"]) if v > 0 and frame == 0)
        for shift, before in ((0, together), (0.5, later)):
            self.assertAlmostEqual(played[shift] / before["volume_m3"][0], 1, delta=0.01)
        self.succeed(*touch(-0.25))
        self.assertEqual(self.columns(run)["timestamp_s"][0], start)
        self.expect_failure(1, *touch(100), mentions="--align starts")
        self.succeed(*touch(100, "--align", "starts"))
        self.assertEqual(self.columns(run)["volume_m3"], together["volume_m3"])

    def test_touch_with_fewer_spheres(self):
        run, coarse = self.path("run_prefix"), self.path("prefix.palp")
        self.succeed("pack", self.mesh, "-o", coarse, "--spheres", 40)
        touch = (*self.sequence("-o", run, "--method", "graph", "--duration", 0.1), "--spheres")
        self.succeed(*touch, 40)
        self.assertIn("identical: 100 ticks", self.succeed("replay", run))
        summary = json.loads(read(os.path.join(run, "summary.json")))
        self.assertEqual(summary["tool"]["spheres"], 40)
        lines = read(os.path.join(run, "wrench.csv"))
        self.succeed(*(coarse if argument == self.tool else argument for argument in touch[:-1]))
        self.assertEqual(read(os.path.join(run, "wrench.csv")), lines)
        self.expect_failure(1, *touch, 121, mentions="120 spheres")
        self.expect_failure(2, *touch, 0, mentions="--spheres: must be ")

    def test_replay_keeps_the_contact_options(self):
        run = self.path("run_options")
        options = {"method": "weighted", "volumes": "represented", "edges": "cut",
                   "continuity": "entry"}
        flags = [word for name, value in options.items() for word in (f"--{name}", value)]
        summary = json.loads(self.succeed(*self.sequence("-o", run, "--json", *flags)))
        contact = summary["settings"]["contact"]
        self.assertEqual({name: contact[name] for name in options}, options)
        self.assertIn(f"identical: {summary['ticks']} ticks", self.succeed("replay", run))
        self.expect_failure(2, *self.sequence("-o", run, "--edges", "sideways"),
                            mentions="sideways")

    def test_touch_follows_a_path(self):
        path = self.path("path.txt")
        with open(path, "w") as file:
            file.write("100 0 0 0.3 0 0 0 1\n100.1 0 0 0.5 0 0 0 1\n")
        run = self.path("run_path")
        self.succeed(*self.sequence("-o", run, "--path", path, "--rate", 500))
        lines = read(os.path.join(run, "wrench.csv")).splitlines()
        self.assertEqual(len(lines), 51)  # 0.1 s at 500 Hz and the header
        self.assertAlmostEqual(self.columns(run)["tool_z_m"][25], 0.4, delta=1e-9)
        self.succeed(*self.sequence("-o", run, "--path", path, "--rate", 500, "--duration", 0.2))
        self.assertEqual(len(read(os.path.join(run, "wrench.csv")).splitlines()), 101)

    def test_touch_without_a_path_says_what_it_probes(self):
        run, again = self.path("run_probe"), self.path("run_probe2")
        summary = json.loads(self.succeed(*self.sequence("-o", run, "--json")))
        probe = summary["probe"]
        self.assertEqual(set(probe), {"pixel", "point", "time", "why_place", "tip", "why_tip", "note",
                                      "how_to_aim"})
        for value, middle in zip(probe["pixel"], (79.5, 59.5)):
            self.assertAlmostEqual(value, middle, delta=6)
        self.assertAlmostEqual(probe["point"][2], 0.5, delta=0.01)
        self.assertLess(math.dist(probe["tip"], (0, 0, -0.04)), 0.01)
        self.assertAlmostEqual(summary["seconds"], 3, delta=1e-9)  # the last of four frames stays
        self.assertLess(abs(summary["peaks"]["fraction"] - 0.1), 0.03)
        shown = self.report_data(run)["summary"]["probe"]
        self.assertEqual(shown, probe)
        for words in ("--probe u,v", "--tip x,y,z"):
            self.assertIn(words, shown["how_to_aim"])
        self.assertIn("--probe", self.succeed(*self.sequence("-o", run)))
        self.assertIn(f"identical: {summary['ticks']} ticks", self.succeed("replay", run))
        self.succeed("replay", run, "-o", again)
        self.assertEqual(json.loads(read(os.path.join(again, "summary.json")))["probe"], probe)

        aimed = json.loads(self.succeed(*self.sequence("-o", run, "--json", "--probe", "40, 80",
                                                       "--tip", "0.04,0,0")))["probe"]
        self.assertEqual(aimed["pixel"], [40, 80])
        self.assertEqual(aimed["tip"], [0.04, 0, 0])
        x, y, z = aimed["point"]
        fx, fy, cx, cy = (float(number) for number in INTRINSICS.split(","))
        for value, expected in ((x, (40 - cx) / fx * z), (y, (80 - cy) / fy * z)):
            self.assertAlmostEqual(value, expected, delta=1e-9)
        point = json.loads(self.succeed(*self.sequence("-o", run, "--json", "--probe",
                                                       f"{x},{y},{z}")))["probe"]
        self.assertEqual(point["pixel"], [40, 80])
        self.succeed("touch", self.tool, "--scene", "wall", "--duration", 0.5, "--probe", "300,200",
                     "-o", run)
        self.assertEqual(json.loads(read(os.path.join(run, "summary.json")))["probe"]["pixel"],
                         [300, 200])

        absent = self.path("run_probe_absent")
        for option, value, words in (
            ("--probe", "160,60", "outside the image, whose columns u are 0 to 159"),
            ("--probe", "0,0,-0.5", "not in front of the camera"),
            ("--probe", "0,0,0.3", "to probe is not on a surface"),
            ("--tip", "1,0,0", "away from the tool"),
        ):
            self.expect_failure(1, *self.sequence("-o", absent, option, value), mentions=words)
            self.assertFalse(os.path.exists(absent))

    def test_what_counts_more_than_once_is_told(self):
        query = ("query", self.tool, "--depth", os.path.join(self.frames, "000.png"), "--intrinsics",
                 INTRINSICS, "--depth-unit", 0.0001, "--pose", "0 0 0.3 0 0 0 1", "--json")
        big, mesh = self.path("big.palp"), self.path("big.ply")
        self.succeed("shape", "box", "--size", 0.3, "-o", mesh)
        self.succeed("pack", mesh, "-o", big, "--spheres", 100)
        around = ("--object", f"{big}@0 0 0.3 0 0 0 1")
        once = palpate(*query, *around)
        self.assertAlmostEqual(json.loads(once.stdout)["results"][0]["fraction"], 1, places=2)
        self.assertNotIn("overlap", once.stderr)
        twice = palpate(*query, *around, *around)
        self.assertAlmostEqual(json.loads(twice.stdout)["results"][0]["fraction"], 2, places=2)
        self.assertIn("note: 200 % of the tool is inside: depth images and objects overlap", twice.stderr)
        path = self.path("still.txt")
        with open(path, "w") as file:
            file.write("0 0 0 0.3 0 0 0 1\n0.05 0 0 0.3 0 0 0 1\n")
        run = self.path("run_twice")
        told = palpate(*self.sequence("--path", path, "-o", run), *around, *around)
        self.assertIn("note: 200 % of the tool is inside", told.stderr)
        # One alone is more than the spheres of a point method, which count less than the mesh.
        points = palpate(*query, *around, "--method", "simplified")
        self.assertGreater(json.loads(points.stdout)["results"][0]["fraction"], 1.2)
        self.assertIn("objects count its whole mesh, the method simplified only its spheres", points.stderr)
        points = palpate(*query, *around, "--method", "simplified", "--volumes", "represented")
        self.assertNotIn("of the tool is inside", points.stderr)
        self.assertTrue(any("200 %" in text for text in json.loads(read(os.path.join(run, "summary.json")))["warnings"]))

    def test_touch_with_objects_and_replay(self):
        run, at_name = self.path("run_objects"), self.path("a@b.palp")
        shutil.copy(self.tool, at_name)
        touch = self.sequence("-o", run, "--path", self.still_pose(), "--duration", 0.05)
        self.succeed(*touch)
        plain = read(os.path.join(run, "wrench.csv")).splitlines()
        summary = json.loads(self.succeed(
            *touch, "--json", "--object", f"{self.tool}@0.05 0 0.48 0 0 0 1", "--object",
            f"{at_name}@0 0.05 0.48 0 0 0 1"))
        self.assertGreater(summary["peaks"]["objects_volume_m3"], 0)
        felt = self.columns(run)
        self.assertGreater(max(felt["object_pairs"]), 0)
        self.assertGreater(max(felt["volume_m3"]), max(float(
            line.split(",")[plain[0].split(",").index("volume_m3")]) for line in plain[1:]))
        self.assertEqual(len(self.report_data(run)["summary"]["objects"]), 2)
        self.assertIn("identical: 50 ticks", self.succeed("replay", run))
        again = self.path("run_objects_again")
        self.succeed("replay", run, "-o", again)
        self.assertEqual(self.columns(again), felt)
        # A hand feels them, too.
        live = self.sequence("-o", again, "--device", "sim", "--duration", 0.3, "--json", "--object",
                             f"{self.tool}@0.02 0 0.42 0 0 0 1")
        self.assertIn("objects_volume_m3", json.loads(self.succeed(*live))["peaks"])

    def test_touch_a_scene(self):
        run = self.path("run_scene")
        self.succeed("touch", self.tool, "--scene", "wall", "--no-noise", "--duration", 0.2, "-o", run)
        self.assertIn("identical: 200 ticks", self.succeed("replay", run))

    def test_touch_a_scene_with_tools_of_any_size(self):
        mesh, tool = self.path("any.ply"), self.path("any.palp")
        for size in (0.001, 1.5):
            self.succeed("shape", "sphere", "--size", size, "-o", mesh)
            self.succeed("pack", mesh, "-o", tool, "--spheres", 20)
            self.succeed("touch", tool, "--scene", "hand", "--duration", 0.05, "-o",
                         self.path("run_any"))

    def test_probing_follows_the_frames(self):
        frames, run = self.path("leaving"), self.path("run_leaving")
        os.mkdir(frames)
        with open(os.path.join(frames, "depth.txt"), "w") as file:
            for k in range(12):  # away from the camera by 11 cm in 3.3 s
                write_depth_png(os.path.join(frames, f"{k}.png"), 160, 120,
                                lambda u, v, k=k: 4000 + 100 * k)
                file.write(f"{50 + 0.3 * k} {k}.png\n")
        summary = json.loads(self.succeed(
            "touch", self.tool, "--depth-sequence", frames, "--intrinsics", INTRINSICS,
            "--depth-unit", 0.0001, "-o", run, "--json"))
        self.assertEqual(summary["frames"], 12)
        self.assertAlmostEqual(summary["ticks"], 3600, delta=1)  # 0.3 s is no binary fraction
        rows = read(os.path.join(run, "wrench.csv")).splitlines()
        column = rows[0].split(",").index("volume_m3")
        total = summary["peaks"]["volume_m3"] / summary["peaks"]["fraction"]
        for k, row in enumerate(rows[1:]):
            fraction = float(row.split(",")[column]) / total
            self.assertLess(fraction, 0.3, k)
            if 1400 < k < 2600:
                self.assertGreater(fraction, 0.01, k)
        with open(os.path.join(run, "report.html")) as file:
            self.assertNotIn(self.folder, file.read())
        self.assertIn("identical", self.succeed("replay", run))

    def test_a_broken_frame_ends_the_run(self):
        frames, run = self.path("broken_frames"), self.path("broken_run")
        shutil.copytree(self.frames, frames)
        with open(os.path.join(frames, "002.png"), "r+b") as file:
            file.truncate(200)
        touch = ("touch", self.tool, "--depth-sequence", frames, "--intrinsics", INTRINSICS, "-o",
                 run)
        self.expect_failure(1, *touch, mentions="002.png")  # no path without all frames
        self.assertFalse(os.path.exists(run))
        result = palpate(*touch, "--path", self.still_pose(), "--json")
        self.assertEqual((result.returncode, result.stdout), (1, ""))
        self.assertIn("002.png", result.stderr)
        self.assertIn("identical: ", self.succeed("replay", run))  # up to there
        self.assertFalse([name for name in os.listdir(self.folder) if ".partial" in name])

    def test_other_folders_are_not_replaced(self):
        folder = self.path("precious")
        os.mkdir(folder)
        with open(os.path.join(folder, "thesis.tex"), "w") as file:
            file.write("years of work")
        self.expect_failure(1, *self.sequence("-o", folder))
        self.assertEqual(os.listdir(folder), ["thesis.tex"])

    def test_runs_with_other_things_are_not_replaced(self):
        run = self.path("run_with_notes")
        self.succeed(*self.sequence("-o", run, "--duration", 0.01))
        notes = os.path.join(run, "notes.txt")
        with open(notes, "w") as file:
            file.write("years of work")
        self.expect_failure(1, *self.sequence("-o", run), mentions="notes.txt")
        self.assertEqual(read(notes), "years of work")

    def test_runs_do_not_replace_their_inputs(self):
        run = self.path("run_again")
        self.succeed(*self.sequence("-o", run, "--duration", 0.01))
        inside = os.path.join(run, "recording.mcap")
        frames = ("--intrinsics", INTRINSICS, "--depth-unit", 0.0001, "-o", run + "/")
        for arguments in (
            ("touch", self.tool, "--depth-sequence", inside, *frames),
            ("touch", inside, "--depth-sequence", self.frames, *frames),
            ("touch", self.tool, "--depth-sequence", self.frames, "--path", inside, *frames),
            ("touch", self.tool, "--depth-sequence", self.frames, "--device", "replay:" + inside,
             *frames),
            ("replay", run, "-o", run),
        ):
            self.expect_failure(1, *arguments, mentions="would replace")

    def test_touch_warns_of_a_wrong_unit(self):
        result = palpate("touch", self.tool, "--depth-sequence", self.frames, "--intrinsics",
                         INTRINSICS, "--depth-unit", 0.00001, "--path", self.still_pose(), "-o",
                         self.path("run_unit"), "--duration", 0.01)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("0 of 19200 pixels are usable", result.stderr)
        self.assertIn("is 1e-05 m per count the right unit?", result.stderr)
        self.assertEqual(len(result.stderr.splitlines()), 2)
        self.assertIn("report: " + os.path.join(self.path("run_unit"), "report.html"), result.stdout)

    def test_interrupted_touch_keeps_the_run_so_far(self):
        for how in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
            self.interrupted_touch(how)

    def interrupted_touch(self, how):
        run = self.path("run_interrupted")
        shutil.rmtree(run, ignore_errors=True)

        def has_ticked(_):
            rows = os.path.join(run, "wrench.csv.part")
            return os.path.exists(rows) and read(rows).count("\n") > 1
        status, output, errors = self.interrupt(
            self.sequence("-o", run, "--json", "--duration", 40, "--rate", 100000, "--path",
                          self.still_pose()), has_ticked, how)
        self.assertEqual((status, output), (1, ""), errors)
        self.assertIn("interrupted", errors.splitlines()[-1])
        summary = json.loads(read(os.path.join(run, "summary.json")))
        self.assertTrue(summary["interrupted"])
        self.assertIn(f"identical: {summary['ticks']} ticks", self.succeed("replay", run))

    def still_pose(self):
        path = self.path("still.txt")
        with open(path, "w") as file:
            file.write("0 0 0 0.48 0 0 0 1\n")
        return path


if __name__ == "__main__":
    main()
