"""Drives the real program: every verb, its files, its exit status and its error lines.

Usage: cli_test.py PATH_OF_PALPATE"""

import contextlib
import importlib.util
import json
import math
import os
import pathlib
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.error
import urllib.request
import zlib

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import contact_truth  # noqa: E402
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../test_util"))
import parts  # noqa: E402

PALPATE = None
INTRINSICS = "200,200,79.5,59.5"


def state_of(program):
    """As ps(1) shows it, e.g. T: stopped."""
    return read(f"/proc/{program.pid}/stat").rsplit(")", 1)[1].split()[0]


def palpate(*arguments, timeout=300):
    return subprocess.run([PALPATE, *map(str, arguments)], capture_output=True, text=True,
                          timeout=timeout)


def read(path, mode="r"):
    with open(path, mode) as file:
        return file.read()


def page_data(path):
    """The JSON inside a report."""
    begin = '<script type="application/json" id="data">'
    return json.loads(read(path).split(begin)[1].split("</script>")[0])


def write_depth_png(path, width, height, value, bits=16):
    """Greyscale; value(u, v) in counts. Labels have 8 bits."""
    of_row = f">{width}" + {8: "B", 16: "H"}[bits]
    rows = b"".join(
        b"\0" + struct.pack(of_row, *(value(u, v) for u in range(width))) for v in range(height))

    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" +
                   chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def bumpy_wall():
    """x y z nx ny nz of a wall at z = 0.5 m with gentle bumps, in single precision."""
    points = []
    for i in range(-40, 41):
        for j in range(-40, 41):
            x, y = i * 0.0015, j * 0.0015
            z = 0.5 + 0.003 * math.sin(60 * x) * math.cos(45 * y)
            n = [60 * 0.003 * math.cos(60 * x) * math.cos(45 * y),
                 -45 * 0.003 * math.sin(60 * x) * math.sin(45 * y), -1.0]
            n = contact_truth.times(n, 1 / math.sqrt(contact_truth.dot(n, n)))
            points.append(struct.unpack("6f", struct.pack("6f", x, y, z, *n)))
    return points


def write_ply(path, points):
    header = ("ply\nformat ascii 1.0\nelement vertex %d\n" % len(points) +
              "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz")) +
              "end_header\n")
    with open(path, "w") as file:
        file.write(header + "".join(" ".join("%.9g" % c for c in p) + "\n" for p in points))


class CommandLine(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="palpate-cli-")
        cls.mesh, cls.tool = cls.path("box.ply"), cls.path("box.palp")
        cls.frames = cls.path("frames")
        os.mkdir(cls.frames)
        for k in range(4):
            write_depth_png(os.path.join(cls.frames, f"{k:03d}.png"), 160, 120,
                            lambda u, v, k=k: 5000 - 20 * k + int(30 * math.sin(u / 9)))
        cls.succeed("shape", "octahedron", "--size", 0.08, "-o", cls.mesh)
        cls.packed = cls.succeed("pack", cls.mesh, "-o", cls.tool, "--spheres", 120, "--json")

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    @staticmethod
    def succeed(*arguments):
        result = palpate(*arguments)
        assert result.returncode == 0, (arguments, result.returncode, result.stderr)
        return result.stdout

    def expect_failure(self, status, *arguments, mentions=""):
        result = palpate(*arguments)
        self.assertEqual(result.returncode, status, (arguments, result.stderr))
        self.assertEqual(result.stdout, "", arguments)
        lines = result.stderr.splitlines()
        self.assertEqual(len(lines), 1, result.stderr)
        self.assertTrue(lines[0].startswith("palpate: "), lines)
        self.assertIn(mentions, lines[0])

    def sequence(self, *more):
        return ("touch", self.tool, "--depth-sequence", self.frames, "--intrinsics", INTRINSICS,
                "--depth-unit", 0.0001, *more)

    def patient_settings(self, name, more=""):
        """A settings file for machines that do not hold a rate of 1 kHz."""
        settings = self.path(name)
        with open(settings, "w") as file:
            file.write("[loop]\nreal_time = false\n[safety]\nmax_contact_age = 60\n"
                       "max_sensor_age = 60\nmax_tick = 60\nmax_device_silence = 60\n" + more)
        return settings

    # General

    def test_help_and_version(self):
        self.assertRegex(self.succeed("--version"), r"^palpate \d+\.\d+\.\d+\n$")
        program = self.succeed("--help")
        for verb in ("shape", "pack", "info", "export", "query", "touch", "replay", "view",
                     "scenes", "devices"):
            self.assertIn(verb, program)
            self.assertIn(f"Example: palpate {verb}", self.succeed(verb, "--help"))

    def test_wrong_usage(self):
        tool, mesh = self.tool, self.mesh
        for arguments in (
            (), ("dance",), ("info",), ("info", tool, "--colour"), ("pack", mesh),
            ("pack", mesh, "-o", self.path("x.palp"), "--spheres", 0),
            ("pack", mesh, "-o", self.path("x.palp"), "--unit", "parsec"),
            ("pack", mesh, "-o", self.path("x.palp"), "--max-radius", "nan"),
            ("pack", mesh, "-o", self.path("x.palp"), "--max-fill", 0),
            ("pack", mesh, "-o", self.path("x.palp"), "--max-fill", "nan"),
            ("pack", mesh, "-o", self.path("x.palp"), "--max-seconds", -1),
            ("pack", mesh, "-o", self.path("x.palp"), "--camera-spacing", "1"),
            ("pack", mesh, "-o", self.path("x.palp"), "--camera-spacing", "1,0"),
            ("pack", mesh, "-o", self.path("x.palp"), "--camera-spacing", "1,1", "--max-radius", 0.1),
            ("export", tool), ("export", tool, "--mesh", self.path("x.unknown")),
            ("shape", "box", "-o", self.path("x.xyz")), ("shape", "blob", "--size", 0.1, "-o", self.path("x.ply")),
            ("query", tool), ("query", tool, "--depth", "x.png", "--pose", "0 0 0 0 0 0 1"),
            ("query", tool, "--cloud", "x.ply", "--pose", "0 0 1"),
            ("query", tool, "--cloud", "x.ply", "--pose", "0 0 0 0 0 0 1", "--poses", "y"),
            ("touch", tool, "--scene", "paradise", "-o", self.path("x")),
            ("touch", tool, "--depth-sequence", self.frames, "-o", self.path("x")),
            self.sequence("-o", self.path("x"), "--rate", 0),
            self.sequence("-o", self.path("x"), "--no-noise"),
            self.sequence("-o", self.path("x"), "--probe", "80"),
            self.sequence("-o", self.path("x"), "--probe", "80,60,0.5,1"),
            self.sequence("-o", self.path("x"), "--probe", "80,left"),
            self.sequence("-o", self.path("x"), "--probe", "80,inf"),
            self.sequence("-o", self.path("x"), "--tip", "0,0.01"),
            self.sequence("-o", self.path("x"), "--probe", "80,60", "--path", "y"),
            self.sequence("-o", self.path("x"), "--tip", "0,0,0.04", "--path", "y"),
            ("replay",),
            self.sequence("-o", self.path("x"), "--dead-man"),
            self.sequence("-o", self.path("x"), "--device", "sim", "--coupling", "rigid"),
            self.sequence("-o", self.path("x"), "--view-port", 0),
            self.sequence("-o", self.path("x"), "--view", "--view-port", 70000),
            ("view",), ("view", tool, "--port", "x"), ("view", tool, "--token", "short"),
        ):
            self.expect_failure(2, *arguments)
        self.expect_failure(2, *self.sequence("-o", self.path("x"), "--method", "magic"),
                            mentions="weighted, simplified, graph, field")
        self.expect_failure(2, "shape", "blob", "-o", self.path("x.ply"), mentions="octahedron")

    def test_usage_errors_name_what_is_wrong(self):
        self.expect_failure(2, "frobnicate", mentions="'frobnicate'; the verbs are shape, pack, ")
        self.expect_failure(2, "--bogus", mentions="'--bogus'")
        self.expect_failure(2, mentions="see palpate --help")
        self.expect_failure(2, "shape", "foo", mentions="octahedron")
        self.expect_failure(2, "info", mentions="; see palpate info --help")
        pack = ("pack", self.mesh, "-o", self.path("x.palp"))
        query = ("query", self.tool, "--pose", "0 0 0 0 0 0 1", "--depth", "x.png")
        shape = ("shape", "box", "-o", self.path("x.ply"))
        for verb, option, value in (
            (pack, "--scale", "nan"), (pack, "--scale", 0), (pack, "--spheres", 1.5),
            (pack, "--spheres", 3000000), (pack, "--max-radius", -1),
            (pack, "--max-radius", "inf"), (pack, "--seed", -1), (pack, "--seed", "9" * 30),
            (pack, "--threads", "1e3"), (query, "--depth-unit", "nan"),
            (query, "--normal-radius", 8), (query, "--max-depth", "inf"),
            (query, "--intrinsics", "nan,1,1,1"), (query, "--intrinsics", "1e9,1,1,1"),
            (shape, "--size", "nan"),
        ):
            self.expect_failure(2, *verb, option, value, mentions=f"{option}: must be ")
            self.assertLess(len(palpate(*verb, option, value).stderr), 160)
        for numbers in ("525,525,319.5", "525,525,319.5,239.5,0", "525 525 319.5 239.5", "525,525,319.5,"):
            for verb in (query, self.sequence("-o", self.path("never"))[:4]):
                self.expect_failure(2, *verb, "--intrinsics", numbers,
                                    mentions=f"--intrinsics: give fx,fy,cx,cy, not '{numbers}'")
        record = ("record", "--camera", "scene:wall", "-o", self.path("never.mcap"))
        for length in ("nan", "0x10", "1e400", 0, "1,5", "5s"):
            self.expect_failure(2, *record, "--duration", length,
                                mentions="--duration: must be a number from 0.001 to 86400 s, not ")

    def test_empty_values_are_refused(self):
        """As of a script whose variable is not set: the robot would be felt, or another path followed."""
        touch = self.sequence("-o", self.path("never"), "--duration", 0.1)
        for verb, option in (
                (touch, "--robot"), (touch, "--path"), (touch, "--settings"), (touch, "--wrench-frame"),
                (touch, "--base-frame"), (("replay", self.path("never")), "--output"),
                (("query", self.tool, "--pose", "0 0 0 0 0 0 1", "--camera", "scene:wall"), "--caps")):
            self.expect_failure(2, *verb, option, "", mentions=f"{option}: is empty; give a value")
        self.expect_failure(2, "info", "", mentions="tool: is empty")
        self.assertFalse(os.path.exists(self.path("never")))

    def test_help_names_types_as_people_do(self):
        for verb in ("touch", "query", "ros2", "record", "calibrate", "cameras", "view"):
            self.assertNotRegex(self.succeed(verb, "--help"), r"\b(FLOAT|UINT|INT|TEXT)\b|cx,cy x 4")

    def test_what_a_camera_does_not_take_is_refused(self):
        touch = ("touch", self.tool, "-o", self.path("never"))
        for camera in (("--scene", "wall"), ("--camera", "scene:wall")):
            for option, value in (("--depth-unit", 0.002), ("--depth-rate", 10), ("--intrinsics", INTRINSICS)):
                self.expect_failure(2, *touch, *camera, option, value, mentions=f"{option} goes with --depth-sequence")
        self.expect_failure(2, *self.sequence("--no-noise", "-o", self.path("never")), mentions="--no-noise goes with --scene")

        self.expect_failure(1, *touch, "--camera", f"folder:{self.frames}?intrinsics={INTRINSICS}&size=160x120",
                            mentions="leave out 'size': the images of folder say their size themselves")
        for parameter in ("size=160x120", "frame=tool", "latency=0.1", "colour=1"):
            for camera in ("scene:wall", f"folder:{self.frames}?intrinsics={INTRINSICS}", f"bag:{self.tool}"):
                if parameter.startswith("size") and camera == "scene:wall" or parameter[0] == "l" and camera[0] == "b":
                    continue  # which use it
                mark = "&" if "?" in camera else "?"
                self.expect_failure(1, *touch, "--camera", camera + mark + parameter,
                                    mentions=f"'{parameter.split('=')[0]}'")

    def test_two_ways_to_say_a_thing_must_say_the_same(self):
        query = ("query", self.tool, "--depth", os.path.join(self.frames, "000.png"), "--intrinsics",
                 INTRINSICS, "--depth-unit", 0.0001, "--pose", "0 0 0.49 0 0 0 1", "--json")
        touch = self.sequence("-o", self.path("never"))
        replay = ("replay", self.path("no_run"), "-o", self.path("never"))
        for verb, option, key, value in (
            (query, ("--method", "graph"), "contact.method", "field"),
            (touch, ("--threads", 1), "loop.threads", 2), (query, ("--no-filter",), "surface.filter", "true"),
            (query, ("--min-depth", 0.2), "surface.min_depth", 0.3),
            (query, ("--tcp", "0 0 0.1"), "output.tcp", "0 0 0 0 0 0 1"),
            (query, ("--wrench-frame", "tool"), "output.wrench_frame", "camera"),
            (touch, ("--memory", "on"), "time.memory", "off"), (touch, ("--friction", 0.3), "friction.coefficient", 0.4),
            (touch, ("--rate", 500), "loop.contact_rate", 1000), (touch, ("--backend", "cpu"), "loop.backend", "cuda"),
            (replay, ("--coupling", "direct"), "coupling.kind", "virtual"),
        ):
            self.expect_failure(2, *verb, *option, "--set", f"{key}={value}",
                                mentions=f"{' '.join(map(str, option))} and --set {key}={value} contradict each other")
        self.expect_failure(2, *query, "--set", "surface.min_depth=0.2", "--set", "surface.min_depth=0.3",
                            mentions="--set: surface.min_depth is 0.2 and 0.3")
        for same in (("--method", "graph", "--set", "contact.method=graph"), ("--no-filter", "--set", "surface.filter=false"),
                     ("--min-depth", 0.2, "--set", "surface.min_depth=2e-1", "--set", "surface.min_depth=2e-1"),
                     ("--tcp", "0 0 0.1", "--set", "output.tcp=0 0 0.1 0 0 0 1")):
            self.succeed(*query, *same)

    def test_what_has_no_use_is_refused(self):
        query = ("query", self.tool, "--depth", os.path.join(self.frames, "000.png"), "--intrinsics", INTRINSICS, "--pose",
                 "0 0 0.49 0 0 0 1")
        scene = ("touch", self.tool, "--scene", "wall", "--duration", 0.1, "-o", self.path("never"))
        uri = ("touch", self.tool, "--duration", 0.1, "-o", self.path("never"), "--camera")
        path = self.path("two.tum")
        with open(path, "w") as file:
            file.write("0 0 0 0.3 0 0 0 1\n1 0 0 0.3 0 0 0 1\n")
        for arguments, words in (
            ((*query, "--caps-segments", 10), "--caps-segments goes with --caps"),
            ((*query, "--bodies", "spheres"), "--bodies goes with --object"),
            ((*scene, "--bodies", "spheres"), "--bodies goes with --object"),
            (("ros2", self.tool, "--depth", "/depth", "--tool-frame", "tool", "--bodies", "spheres"),
             "--bodies goes with --object"),
            ((*uri, "scene:wall", "--seed", 4), "--seed goes with --scene"),
            ((*scene, "--align", "starts"), "--align goes with --path"),
            ((*scene, "--path-frame", "camera"), "--path-frame goes with --path"),
            ((*scene, "--base-frame", "camera"), "--base-frame goes with --device"),
            ((*scene, "--average-frames", 9), "--average-frames goes with --average moving"),
            ((*scene, "--average", "moving", "--average-weight", 0.5), "--average-weight goes with --average exponential"),
            ((*scene, "--device", "replay:"), "replay: needs a file of poses"),
            ((*scene, "--texture", "grain"), "--texture goes with friction"),
            ((*scene, "--ros2-camera-frame", "x"), "--ros2-camera-frame goes with --ros2"),
            ((*scene, "--points-rate", 3), "--points-rate goes with --ros2"),
            ((*scene, "--sensing-gpu", 1, "--backend", "cpu"), "--sensing-gpu does not go with --backend cpu"),
            ((*query, "--contact-gpu", 1, "--backend", "cpu"), "--contact-gpu does not go with --backend cpu"),
            ((*query, "--unseen", "free", "--method", "graph"), "--unseen goes with --method field, not graph"),
            ((*scene, "--fill-levels", 3, "--method", "weighted"), "--fill-levels goes with --method field, not weighted"),
        ):
            self.expect_failure(2, *arguments, mentions=words)
        self.expect_failure(1, *scene, "--path", path, "--align", "stamps", mentions="--align stamps goes with recorded frames")
        self.succeed(*scene, "--path", path, "--align", "starts", "--average", "moving", "--average-frames", 9)

    def test_files_of_other_kinds_are_not_replaced(self):
        notes = self.path("notes")
        os.mkdir(notes)
        precious = {name: os.path.join(notes, name) for name in
                    ("a.txt", "a.palp", "a.mcap", "a.ply", "a.stl", "a.obj", "a.csv", "a.html", "a.glb", "b.mcap.partial")}
        for path in precious.values():
            with open(path, "w") as file:
                file.write("# my notes\nx, y\n")
        write_ply(self.path("wall.ply"), bumpy_wall())
        query = ("query", self.tool, "--cloud", self.path("wall.ply"), "--pose", "0 0 0.478 0 0 0 1", "--caps")
        record = ("record", "--camera", "scene:wall?size=32x24", "--duration", 0.2, "-o")
        for arguments, name, kind in (
            (("pack", self.mesh, "-o"), "a.palp", "tool file"), (("pack", self.mesh, "-o"), "a.txt", "tool file"),
            (("pack", self.mesh, "-o", self.path("y.palp"), "--report"), "a.html", "HTML page"),
            (("info", self.tool, "--report"), "a.html", "HTML page"),
            (("shape", "box", "-o"), "a.ply", "mesh of this format"), (("shape", "box", "-o"), "a.stl", "mesh of this format"),
            (("shape", "box", "-o"), "a.obj", "mesh of this format"), (("export", self.tool, "--mesh"), "a.ply", "mesh of this"),
            (("export", self.tool, "--spheres"), "a.csv", "table of spheres"), (("export", self.tool, "--edges"), "a.csv", "table"),
            (query, "a.glb", "mesh of this format"), (query, "a.ply", "mesh of this format"),
            (record, "a.mcap", "recording"), (record, "a.txt", "recording"), (record, "b.mcap", "recording"),
        ):
            self.expect_failure(1, *arguments, os.path.join(notes, name), mentions=f"it is there and is no {kind}")
        for path in precious.values():
            self.assertEqual(read(path), "# my notes\nx, y\n")
        self.assertEqual(sorted(os.listdir(notes)), sorted(precious))
        # What is of its kind, or empty, is replaced.
        for arguments, name in ((("pack", self.mesh, "--spheres", 20, "-o"), "n.palp"), (("shape", "box", "-o"), "n.ply"),
                                (("shape", "box", "-o"), "n.stl"), (("shape", "box", "-o"), "n.obj"),
                                (("info", self.tool, "--report"), "n.html"), (("export", self.tool, "--spheres"), "n.csv"),
                                (("export", self.tool, "--edges"), "e.csv"), (query, "n.glb"), (record, "n.mcap")):
            open(os.path.join(notes, name), "w").close()
            for _ in range(2):
                self.succeed(*arguments, os.path.join(notes, name))

    def test_output_that_cannot_be_written_is_no_success(self):
        for arguments in (("--help",), ("--version",), ("touch", "--help"), ("touch", "--print-settings"),
                          ("info", self.tool), ("scenes",)):
            with open("/dev/full", "w") as full:
                result = subprocess.run([PALPATE, *map(str, arguments)], stdout=full, stderr=subprocess.PIPE, text=True)
            self.assertEqual((result.returncode, result.stderr),
                             (1, "palpate: cannot write to the standard output\n"), arguments)
        closed = subprocess.run(["sh", "-c", '"$0" --version >&-', PALPATE], stderr=subprocess.PIPE, text=True)
        self.assertEqual((closed.returncode, closed.stderr), (1, "palpate: cannot write to the standard output\n"))

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

    def test_materials_that_cannot_be_are_refused(self):
        out, labels, other = self.path("of_wood"), self.path("labels.png"), self.path("other.png")
        write_depth_png(labels, 160, 120, lambda u, v: u // 80, bits=8)
        touch = self.sequence("-o", out, "--probe", "80,60")
        for arguments, mentions in (
            (("--labels", labels), "--labels: no label has a material; add --material"),
            (("--material", "1=wood"), "--material: there is no label image; add --labels"),
            (("--labels", labels, "--material", "wood"), "a label and what it is made of"),
            (("--labels", labels, "--material", "256=wood"), "the label must be a number from 0 to 255"),
            (("--labels", labels, "--material", "1.5=wood"), "a label is a whole number"),
            (("--labels", labels, "--material", "1=cheese"), "'cheese' is none of ice, metal"),
            (("--labels", labels, "--material", "1=friction=11"), "friction must be a number from 0 to 10"),
            (("--labels", labels, "--material", "1=static_ratio=1.2"), "add friction="),
            (("--labels", labels, "--material", "1=wood,ice"), "give one name"),
            (("--labels", labels, "--material", "1=friction=0.1,friction=0.9"), "give friction once"),
            (("--labels", labels, "--material", "1=wood", "--material", "1=ice"), "has a material already"),
            (("--labels", labels, "--material", "1=ridges=0.3"), "add friction="),
            (("--labels", labels, "--material", "1=viscous=2,grain=0.3"), "add friction="),
        ):
            self.expect_failure(2, *touch, *arguments, mentions=mentions)
        wood = ("--material", "1=wood")
        write_depth_png(other, 80, 60, lambda u, v: 1, bits=8)
        self.expect_failure(1, *touch, "--labels", other, *wood,
                            mentions="labels of 80 x 60 pixels do not fit depth images of 160 x 120")
        write_depth_png(other, 160, 120, lambda u, v: 1)
        self.expect_failure(1, *touch, "--labels", other, *wood,
                            mentions="other.png is not a PNG of labels; save it with 8 bits")
        self.assertFalse(os.path.exists(out))
        self.succeed(*touch, "--labels", labels, "--material", "0=viscous=2", *wood)

    def test_outputs_never_replace_inputs(self):
        mesh, tool = self.path("precious.ply"), self.path("precious.palp")
        shutil.copy(self.mesh, mesh)
        shutil.copy(self.tool, tool)
        os.symlink(mesh, self.path("link.palp"))
        before = read(mesh, "rb"), read(tool, "rb")
        for output in (mesh, self.path("link.palp")):
            self.expect_failure(1, "pack", mesh, "-o", output, mentions="it is the input")
        csv = self.path("same.csv")
        self.expect_failure(1, "export", tool, "--spheres", tool, mentions="it is the input")
        self.expect_failure(1, "export", tool, "--spheres", csv, "--edges", csv,
                            mentions="two things")
        self.expect_failure(1, "export", tool, "--spheres", csv, "--edges", "/dev/full",
                            mentions="not a regular file")
        self.assertFalse(os.path.exists(csv))
        relative = subprocess.run([PALPATE, "export", tool, "--spheres", "new.csv", "--edges",
                                   "./new.csv"], cwd=self.folder, capture_output=True, text=True)
        self.assertIn("two things", relative.stderr)
        self.assertEqual(before, (read(mesh, "rb"), read(tool, "rb")))

    def test_sizes_are_told_in_the_unit_given(self):
        large, x = self.path("large.obj"), self.path("x.palp")
        corners = ((0, 0, 0), (4600, 0, 0), (0, 4600, 0), (0, 0, 4600))
        with open(large, "w") as file:
            file.write("".join("v %d %d %d\n" % c for c in corners) +
                       "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
        self.expect_failure(1, "pack", large, "-o", x, "--unit", "mm",
                            mentions="4.6 m long, read in mm, and may have 0.1 mm to 2 m")
        small = palpate("pack", large, "-o", x, "--unit", "mm", "--scale", 1e-3, "--spheres", 5)
        self.assertEqual(small.returncode, 0)
        self.assertIn("4.6 mm long", small.stderr)
        os.remove(x)
        self.expect_failure(1, "pack", self.mesh, "-o", x, "--max-radius", 1e-9,
                            mentions="raise --max-radius")

    def test_names_without_a_folder(self):
        for arguments in (("shape", "box", "-o", "here.ply"), ("pack", "here.ply", "-o", "here.palp",
                                                               "--spheres", "5"),
                          ("export", "here.palp", "--spheres", "here.csv")):
            done = subprocess.run([PALPATE, *arguments], cwd=self.folder, capture_output=True,
                                  text=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn("written ", done.stdout)

    def test_query_of_nothing_is_warned_of(self):
        query = ("query", self.tool, "--depth", os.path.join(self.frames, "000.png"),
                 "--intrinsics", INTRINSICS, "--pose", "0 0 0.49 0 0 0 1", "--json")
        for arguments, usable in (((*query, "--depth-unit", 0.0001), True),
                                  ((*query, "--depth-unit", 0.01), False),
                                  ((*query, "--depth-unit", 0.0001, "--min-depth", 1), False)):
            result = palpate(*arguments)
            self.assertEqual(result.returncode, 0, result.stderr)
            document = json.loads(result.stdout)
            self.assertEqual(document["usable_points"] > 0, usable)
            self.assertEqual(document["results"][0]["volume"] > 0, usable)
            self.assertEqual("0 of 19200 pixels are usable" in result.stderr, not usable)

    def test_bad_input(self):
        tool = self.tool
        for arguments in (
            ("info", self.path("absent.palp")), ("info", self.mesh), ("info", self.folder),
            ("pack", self.path("absent.stl"), "-o", self.path("x.palp")),
            ("pack", tool, "-o", self.path("x.palp")),
            ("pack", self.mesh, "-o", self.path("no/such/folder/x.palp")),
            ("pack", self.mesh, "-o", self.path("x.palp"), "--unit", "mm", "--scale", 0.001),
            ("query", tool, "--cloud", tool, "--pose", "0 0 0 0 0 0 1"),
            ("touch", tool, "--depth-sequence", self.path("absent"), "--intrinsics", INTRINSICS,
             "-o", self.path("x")),
            self.sequence("-o", self.path("x"), "--path", tool),
            ("replay", self.path("absent")), ("replay", self.frames),
        ):
            self.expect_failure(1, *arguments)
        for name in ("x", "x.palp", "x.unknown"):
            self.assertFalse(os.path.exists(self.path(name)), name)
        self.assertFalse([name for name in os.listdir(self.folder) if ".partial" in name])

    def test_a_file_that_is_no_image_is_told_as_such(self):
        text = self.path("text.png")
        with open(text, "w") as file:
            file.write("1 2 3\n" * 20)
        query = ("query", self.tool, "--intrinsics", INTRINSICS, "--pose", "0 0 0.5 0 0 0 1", "--depth")
        for file in (text, self.mesh, self.tool):
            self.expect_failure(1, *query, file, mentions=f"{file} is not a PNG file; depth images are 16-bit greyscale "
                                "PNG files, and organized point clouds are read as .pcd files")

    def test_cuda_is_refused_where_there_is_none(self):
        result = palpate(*self.sequence("-o", self.path("cuda"), "--backend", "cuda"))
        self.assertIn(result.returncode, (0, 1))
        if result.returncode == 1:
            self.assertIn("--backend", result.stderr)

    def test_auto_says_which_backend_it_took_and_why(self):
        result = palpate(*self.sequence("-o", self.path("auto"), "--backend", "auto"))
        self.assertEqual(result.returncode, 0, result.stderr)
        with open(os.path.join(self.path("auto"), "summary.json"), encoding="utf-8") as file:
            summary = json.load(file)
        is_cpu = "why_not_cuda" in summary
        self.assertIn(summary["settings"]["loop"]["backend"], ("cpu", "cuda"))
        self.assertEqual("backend cpu is used: " in result.stderr, is_cpu)

    # Tools

    def test_info(self):
        info = json.loads(self.succeed("info", self.tool, "--json"))
        packed = json.loads(self.packed)
        self.assertEqual(packed.pop("output"), self.tool)
        self.assertGreater(packed.pop("seconds"), 0)
        self.assertEqual(packed, info)
        self.assertEqual(info["spheres"], 120)
        self.assertAlmostEqual(info["mesh_volume"], 0.08**3 / 6, delta=1e-12)
        self.assertAlmostEqual(info["fill"], info["sphere_volume"] / info["mesh_volume"], delta=1e-12)
        self.assertEqual((len(info["inertia"]), len(info["inertia"][0])), (3, 3))
        for value, expected in zip(info["bounds"][0] + info["bounds"][1], [-0.04] * 3 + [0.04] * 3):
            self.assertAlmostEqual(value, expected, delta=1e-9)
        self.assertEqual(set(info["graph"]), {"edges", "bridges", "components_before_bridging"})
        self.assertIn("120", self.succeed("info", self.tool))
        self.assertAlmostEqual(info["represented_volume"] / info["mesh_volume"], 1, delta=1e-6)

    def test_pack_limits(self):
        def pack(*options):
            return json.loads(self.succeed("pack", self.mesh, "-o", self.path("limited.palp"),
                                           "--spheres", 5000, "--json", *options))
        fill = pack("--max-fill", 0.7)["fill"]
        self.assertTrue(0.7 <= fill < 0.72, fill)
        # Points 1 m away are 1 m / 525 apart.
        felt = 1 / 525 / math.sqrt(2)
        self.assertGreaterEqual(pack("--camera-spacing", "1,525")["min_radius"], felt)
        self.assertLess(pack("--camera-spacing", "1,525")["min_radius"], 1.2 * felt)
        self.assertGreaterEqual(
            pack("--camera-spacing", "1,525", "--min-radius", 0.002)["min_radius"], 0.002)
        self.assertIn("apart", self.succeed("pack", self.mesh, "-o", self.path("limited.palp"),
                                            "--camera-spacing", "1,525"))

    # Pages

    def expect_page(self, path, **values):
        page = read(path)
        self.assertTrue(page.startswith("<!doctype html>"), path)
        self.assertTrue(page.endswith("</html>\n"), path)
        data = page_data(path)
        self.assertEqual(data["kind"], "packing")
        self.assertEqual({key: data[key] for key in values}, values)
        return data

    def test_pages(self):
        tool, page, again = self.path("shown.palp"), self.path("shown.html"), self.path("again.html")
        packed = json.loads(self.succeed("pack", self.mesh, "-o", tool, "--spheres", 300,
                                         "--max-radius", 0.012, "--report", page, "--json"))
        self.assertEqual(packed["report"], page)
        data = self.expect_page(page, source="box.ply", stopped="the requested number was reached", num_spheres=300)
        self.assertIn(["--max-radius", "12 mm"], data["options"])
        self.assertIn("packing", [name for name, seconds in data["steps"]])
        self.assertEqual(data["graph"]["edges"], packed["graph"]["edges"])
        plain = self.path("plain.palp")
        self.succeed("pack", self.mesh, "-o", plain, "--spheres", 300, "--max-radius", 0.012)
        self.assertEqual(read(tool, "rb"), read(plain, "rb"))  # the page changes nothing
        info = json.loads(self.succeed("info", tool, "--report", again, "--json"))
        data = self.expect_page(again, source="box.ply", steps=[], options=[])
        self.assertEqual(data["graph"]["edges"], packed["graph"]["edges"])
        self.assertEqual(set(info["standoff"]), {"mean", "p95", "max", "worst"})
        self.assertLess(0, info["standoff"]["mean"])
        self.assertLess(info["standoff"]["mean"], info["standoff"]["p95"])
        self.assertLess(info["standoff"]["p95"], info["standoff"]["max"])

    def test_thin_ends(self):
        """The worst place is named, and an end that stays empty is warned of."""
        mesh, tool, page = (self.path("finger" + ending) for ending in (".ply", ".palp", ".html"))
        self.succeed("shape", "finger", "--size", 0.196, "-o", mesh)
        far = palpate("pack", mesh, "-o", tool, "--spheres", 300, "--json", "--report", page)
        self.assertEqual(far.returncode, 0)
        info = json.loads(far.stdout)
        worst = info["standoff"]["worst"]
        self.assertAlmostEqual(worst[2], 0.098, delta=1e-9)  # a corner of the tip
        self.assertGreater(info["standoff"]["max"], 4 * info["standoff"]["p95"])
        self.assertEqual(len(info["warnings"]), 1)
        warning = info["warnings"][0]
        self.assertIn("stays empty", warning)
        place = " ".join(f"{1000 * x:.4g}" for x in worst) + " mm"
        self.assertIn(f"at {place} the nearest sphere is "
                      f"{1000 * info['standoff']['max']:.4g} mm off", warning)
        self.assertIn(f"palpate: warning: {mesh}: {warning}", far.stderr)
        self.expect_page(page, warning=warning)
        told = palpate("info", tool)
        self.assertIn(f"worst place   {place}, ", told.stdout)
        self.assertIn(f"palpate: warning: {tool}: {warning}", told.stderr)
        self.assertEqual(json.loads(self.succeed("info", tool, "--json"))["warnings"], [warning])

        # From 1000 spheres on the end has some of its own, the first thousand of them included.
        near = palpate("pack", mesh, "-o", tool, "--spheres", 1500, "--json", "--report", page)
        info = json.loads(near.stdout)
        self.assertEqual((info["warnings"], near.stderr), ([], ""))
        self.assertLess(info["standoff"]["max"], 4 * info["standoff"]["p95"])
        self.expect_page(page, warning="")
        # ... unless they would be too small for the camera.
        self.assertIn("stays empty", palpate("pack", mesh, "-o", tool, "--spheres", 1500,
                                             "--min-radius", 0.0008).stderr)

    def test_the_tip_is_felt(self):
        """A finger pushed into a wall, tip first, against the volume of its tip in closed form."""
        mesh, tool, wall = (self.path(name) for name in ("tip.ply", "tip.palp", "wall.png"))
        self.succeed("shape", "finger", "--size", 0.196, "-o", mesh)
        self.succeed("pack", mesh, "-o", tool, "--spheres", 5000)
        write_depth_png(wall, 320, 240, lambda u, v: 5000)  # 0.5 m away
        depths, poses = [0.003, 0.006, 0.01, 0.013], self.path("tip.tum")
        with open(poses, "w") as file:
            for i, depth in enumerate(depths):
                file.write(f"{i} 0 0 {0.5 - 0.098 + depth} 0 0 0 1\n")
        felt = json.loads(self.succeed("query", tool, "--depth", wall, "--depth-unit", 0.0001,
                                       "--intrinsics", "262,262,159.5,119.5", "--poses", poses,
                                       "--json"))["results"]
        for depth, result in zip(depths, felt):
            # The last 14 mm of the finger are 0.25 x 8 mm at the tip and 0.8 x 10 mm at the arm.
            def area(t):
                return (0.25 + 0.55 * t) * (8 + 2 * t) * 1e-6
            t = depth / 0.014
            volume = depth / 6 * (area(0) + 4 * area(t / 2) + area(t))
            self.assertLess(abs(result["volume"] - volume), 0.35 * volume, depth)
            self.assertLess(result["force"][2], -0.9 * result["volume"], depth)

    def test_what_nobody_sees_has_a_policy(self):
        """20 cm behind a wall: solid, free or let go."""
        wall = self.path("policy.png")
        write_depth_png(wall, 320, 240, lambda u, v: 8000)
        query = ("query", self.tool, "--intrinsics", "262,262,159.5,119.5", "--depth-unit", "0.0001",
                 "--json", "--depth", wall, "--pose", "0 0 1.0 0 0 0 1")
        for words, fraction, push in (((), 1, 1), (("--unseen", "free"), 0, 0),
                                      (("--unseen", "free", "--thickness", "0.5"), 1, 1),
                                      (("--unseen", "fade", "--thickness", "0.03"), 1, 0)):
            json_text = json.loads(self.succeed(*query, *words))
            result = json_text["results"][0]
            self.assertEqual(json_text["unseen_is"], words[1] if words else "solid")
            self.assertAlmostEqual(result["fraction"], fraction, places=2, msg=words)
            self.assertAlmostEqual(-result["force"][2] / result["volume"] if push else
                                   result["force"][2], push, delta=0.05, msg=words)
            self.assertAlmostEqual(result["unseen"], 1, places=2, msg=words)
        # A thickness of what is solid.
        self.expect_failure(1, *query, "--thickness", "0.03", mentions="unseen free")

    def test_cameras_are_joined(self):
        """A wall seen from two places, and a hand before it that only one camera sees."""
        def near(u, v):
            return 4000 if 100 <= u < 220 and 60 <= v < 180 else 8000
        front, side = self.path("front.png"), self.path("side.png")
        write_depth_png(front, 320, 240, near)  # 0.4 m, before 0.8 m
        write_depth_png(side, 320, 240, lambda u, v: 8000)
        query = ("query", self.tool, "--intrinsics", "262,262,159.5,119.5", "--depth-unit", "0.0001",
                 "--json", "--depth", front)
        behind, beyond = "0 0 0.6 0 0 0 1", "0 0 0.9 0 0 0 1"

        def fraction(*words):
            return json.loads(self.succeed(*query, *words))["results"][0]
        alone = fraction("--pose", behind)
        self.assertAlmostEqual(alone["fraction"], 1, places=3)
        self.assertGreater(alone["unseen"], 0.5)
        self.assertGreater(alone["decided"]["camera"], 0)
        self.assertEqual(alone["decided"]["none"], 0)
        both = ("--depth", side, "--camera-pose", "0 0 0 0 0 0 1")
        joined = fraction(*both, "--pose", behind)
        self.assertEqual((joined["fraction"], joined["unseen"]), (0, 0))
        self.assertEqual(joined["decided"], {"camera": 0, "camera_2": 0, "none": 0})
        # Only the one from the side sees the wall there.
        at_wall = fraction(*both, "--pose", "0 0 0.8 0 0 0 1")["decided"]
        self.assertGreater(at_wall["camera_2"], 10 * (at_wall["camera"] + at_wall["none"] + 1))
        self.assertAlmostEqual(fraction(*both, "--pose", beyond)["fraction"], 1, places=3)
        # Moved together with its camera, all is the same.
        moved = ("--camera-pose", "1 2 3 0 0 0 1", "--pose", "1 2 3.6 0 0 0 1")
        self.assertAlmostEqual(fraction(*moved)["fraction"], 1, places=3)
        for wrong in (("--depth", side, "--pose", behind),
                      ("--depth", side, "--camera-pose", "0 0 1", "--pose", behind)):
            self.expect_failure(2, *query, *wrong, mentions="--camera-pose")
        self.expect_failure(2, *query, "--intrinsics", "1,1,1,1", "--intrinsics", "1,1,1,1",
                            *both, "--pose", behind, mentions="--intrinsics")

    def test_as_many_spheres_as_needed(self):
        mesh, tool = self.path("stylus.ply"), self.path("auto.palp")
        self.succeed("shape", "stylus", "--size", 0.1, "-o", mesh)
        info = json.loads(self.succeed("pack", mesh, "-o", tool, "--spheres", "auto", "--json"))
        self.assertLess(1000, info["spheres"])
        self.assertLess(info["spheres"], 5000)
        self.assertLessEqual(info["standoff"]["p95"], 0.0005)
        # The same spheres as that many of them.
        again = self.path("again.palp")
        self.succeed("pack", mesh, "-o", again, "--spheres", info["spheres"])
        spheres = [self.path(name) for name in ("auto.csv", "again.csv")]
        for packed, table in zip((tool, again), spheres):
            self.succeed("export", packed, "--spheres", table)
        self.assertEqual(read(spheres[0]), read(spheres[1]))
        self.assertIn("stopped       95 % of the surface", self.succeed(
            "pack", mesh, "-o", tool, "--spheres", "auto"))
        for text in ("Auto", "automatic", "", "1e3"):
            self.expect_failure(2, "pack", mesh, "-o", tool, "--spheres", text, mentions="or auto")
        folder, tools = self.mesh_folder("as_needed")
        packed = json.loads(self.succeed("pack", folder, "-o", tools, "--spheres", "auto", "--json",
                                         "--max-seconds", 0.5))["packed"]
        self.assertEqual([entry["warnings"] for entry in packed], [[], []])
        self.assertGreater(packed[0]["standoff"]["max"], packed[0]["standoff"]["p95"])

    def test_bad_pages(self):
        tool, x = self.path("no_page.palp"), self.path("x.html")
        pack = ("pack", self.mesh, "-o", tool, "--report")
        self.expect_failure(2, *pack, mentions="give the name of the page")
        self.expect_failure(1, *pack, tool, mentions="two things")
        self.expect_failure(1, *pack, self.mesh, mentions="it is the input")
        self.expect_failure(1, *pack, self.path("no/such/x.html"), mentions="make it first")
        self.expect_failure(1, "info", self.tool, "--report", self.tool, mentions="it is the input")
        self.expect_failure(1, "info", self.mesh, "--report", x)
        self.assertFalse(os.path.exists(tool) or os.path.exists(x))

    # Folders of meshes

    def mesh_folder(self, name):
        folder = self.path(name)
        os.mkdir(folder)
        self.succeed("shape", "box", "--size", 0.05, "-o", os.path.join(folder, "b.ply"))
        self.succeed("shape", "octahedron", "--size", 0.05, "-o", os.path.join(folder, "a.STL.obj"))
        os.mkdir(os.path.join(folder, "c.obj"))
        for other in ("notes.txt", ".hidden.stl"):
            with open(os.path.join(folder, other), "w") as file:
                file.write("no mesh")
        return folder, os.path.join(self.folder, name + "_tools")

    def pack_folder(self, status, folder, tools, *options):
        """The names of what was packed, skipped and failed."""
        result = palpate("pack", folder, "-o", tools, "--spheres", 20, "--json", *options)
        self.assertEqual(result.returncode, status, result.stderr)
        self.assertEqual(len(result.stderr.splitlines()), status, result.stderr)
        document = json.loads(result.stdout)
        self.assertFalse(document["interrupted"])
        self.failures = document["failed"]
        return tuple([os.path.basename(entry["mesh"]) for entry in document[key]]
                     for key in ("packed", "skipped", "failed"))

    def test_pack_a_folder(self):
        folder, tools = self.mesh_folder("shelf")
        both = ["a.STL.obj", "b.ply"]
        self.assertEqual(self.pack_folder(0, folder, tools), (both, [], []))
        self.assertEqual(sorted(os.listdir(tools)),
                         ["a.STL.pack.json", "a.STL.palp", "b.pack.json", "b.palp"])
        alone = self.path("alone.palp")
        self.succeed("pack", os.path.join(folder, "b.ply"), "-o", alone, "--spheres", 20)
        made = read(os.path.join(tools, "b.palp"), "rb")
        self.assertEqual(made, read(alone, "rb"))

        # Only what is made from counts, not dates.
        os.utime(os.path.join(folder, "b.ply"))
        self.assertEqual(self.pack_folder(0, folder, tools), ([], both, []))
        self.assertEqual(self.pack_folder(0, folder, tools, "--threads", 1), ([], both, []))
        self.assertEqual(self.pack_folder(0, folder, tools, "--seed", 1), (both, [], []))
        self.assertEqual(self.pack_folder(0, folder, tools, "--scale", 2), (both, [], []))
        self.assertEqual(self.pack_folder(0, folder, tools), (both, [], []))
        self.assertEqual(read(os.path.join(tools, "b.palp"), "rb"), made)
        shutil.copy(self.mesh, os.path.join(folder, "b.ply"))
        os.utime(os.path.join(folder, "b.ply"), (0, 0))
        self.assertEqual(self.pack_folder(0, folder, tools), (["b.ply"], ["a.STL.obj"], []))
        shutil.copy(alone, os.path.join(tools, "a.STL.palp"))
        os.remove(os.path.join(tools, "b.pack.json"))
        self.assertEqual(self.pack_folder(0, folder, tools), (both, [], []))

        # Pages are wanted or not.
        self.assertEqual(self.pack_folder(0, folder, tools, "--report"), (both, [], []))
        self.expect_page(os.path.join(tools, "b.html"), source="b.ply")
        self.assertEqual(self.pack_folder(0, folder, tools, "--report"), ([], both, []))
        self.assertEqual(self.pack_folder(0, folder, tools), ([], both, []))
        os.remove(os.path.join(tools, "b.html"))
        self.assertEqual(self.pack_folder(0, folder, tools, "--report"),
                         (["b.ply"], ["a.STL.obj"], []))

        text = self.succeed("pack", folder, "-o", tools, "--spheres", 30)
        self.assertRegex(text, r"(?m)^packed +\S*a.STL.palp: 30 spheres, fill ")
        self.assertRegex(self.succeed("pack", folder, "-o", tools, "--spheres", 30),
                         r"(?m)^up to date +\S*b.palp$")

    def test_bad_meshes_of_a_folder(self):
        folder, tools = self.mesh_folder("mixed")
        with open(os.path.join(folder, "a_hole.obj"), "w") as file:
            file.write("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
        with open(os.path.join(folder, "a_lie.stl"), "w") as file:
            file.write("no mesh at all")
        shutil.copy(os.path.join(folder, "b.ply"), os.path.join(folder, "b.PLY"))
        bad = ["a_hole.obj", "a_lie.stl", "b.ply"]  # upper case comes first
        packed, skipped, failed = self.pack_folder(1, folder, tools)
        self.assertEqual((packed, skipped, failed), (["a.STL.obj", "b.PLY"], [], bad))
        self.assertIn("b.PLY already makes b.palp", self.failures[2]["reason"])
        for failure in self.failures:
            self.assertIn(failure["mesh"], failure["reason"])
        self.assertEqual(self.pack_folder(1, folder, tools), ([], packed, bad))
        result = palpate("pack", folder, "-o", tools, "--spheres", 20)
        self.assertEqual(result.returncode, 1)
        self.assertEqual(len(re.findall(r"(?m)^failed ", result.stdout)), 3, result.stdout)
        self.assertEqual(result.stderr.splitlines(),
                         ["palpate: 3 of 5 meshes could not be packed; the list above says why"])

    def test_folders_that_cannot_be_packed(self):
        folder, tools = self.mesh_folder("stuck")
        pack = ("pack", folder, "-o")
        self.expect_failure(1, *pack, self.mesh, mentions="cannot write tools into")
        self.expect_failure(1, *pack, self.path("no/such/folder"), mentions="cannot write tools")
        self.expect_failure(2, *pack, tools, "--report", "page.html", mentions="leave out the name")
        self.expect_failure(1, "pack", os.path.join(folder, "c.obj"), "-o", tools,
                            mentions="there is no mesh in")
        self.assertFalse(os.path.exists(tools))
        locked = self.path("locked")
        os.mkdir(locked, 0o555)
        if not os.access(locked, os.W_OK):  # for root everything is writable
            self.expect_failure(1, *pack, locked, mentions="cannot write tools into")
        # What stands in the way of one tool is no reason to stop.
        os.makedirs(os.path.join(tools, "a.STL.palp"))
        self.assertEqual(self.pack_folder(1, folder, tools), (["b.ply"], [], ["a.STL.obj"]))
        self.assertIn("it is a folder", self.failures[0]["reason"])

    def test_query_with_fewer_spheres(self):
        write_ply(self.path("wall.ply"), bumpy_wall())
        self.succeed("pack", self.mesh, "-o", self.path("coarse.palp"), "--spheres", 40)
        def query(tool, *options):
            results = json.loads(self.succeed(
                "query", tool, "--cloud", self.path("wall.ply"), "--pose", "0 0 0.478 0 0 0 1",
                "--json", *options))["results"]
            return [{key: value for key, value in result.items() if key != "compute_us"}
                    for result in results]
        self.assertEqual(query(self.tool, "--spheres", 40), query(self.path("coarse.palp")))
        self.assertEqual(query(self.tool, "--spheres", 120), query(self.tool))
        self.expect_failure(1, "query", self.tool, "--cloud", self.path("wall.ply"), "--pose",
                            "0 0 0.478 0 0 0 1", "--spheres", 121, mentions="120 spheres")

    def read_export(self):
        spheres, edges = self.path("spheres.csv"), self.path("edges.csv")
        self.succeed("export", self.tool, "--spheres", spheres, "--edges", edges)
        sphere_lines = read(spheres).splitlines()
        edge_lines = read(edges).splitlines()
        self.assertEqual((sphere_lines[0], edge_lines[0]), ("x,y,z,r", "a,b"))
        # The tool holds single precision; nine digits find the same numbers again.
        return ([list(struct.unpack("4f", struct.pack("4f", *map(float, line.split(",")))))
                 for line in sphere_lines[1:]],
                [tuple(int(x) for x in line.split(",")) for line in edge_lines[1:]])

    def test_export(self):
        info = json.loads(self.succeed("info", self.tool, "--json"))
        spheres, edges = self.read_export()
        self.assertEqual((len(spheres), len(edges)), (info["spheres"], info["graph"]["edges"]))
        volume = sum(4 / 3 * math.pi * s[3]**3 for s in spheres)
        self.assertAlmostEqual(volume / info["sphere_volume"], 1, delta=1e-9)
        self.assertAlmostEqual(min(s[3] for s in spheres), info["min_radius"], delta=1e-12)
        for a, b in zip(contact_truth.centre_of_mass(spheres), info["centre_of_mass"]):
            self.assertAlmostEqual(a, b, delta=1e-12)
        mesh = self.path("again.ply")
        self.succeed("export", self.tool, "--mesh", mesh)
        again = json.loads(
            self.succeed("pack", mesh, "-o", self.path("again.palp"), "--spheres", 120, "--json"))
        self.assertEqual(again["sphere_volume"], info["sphere_volume"])

    def test_units(self):
        packed = json.loads(self.succeed("pack", self.mesh, "-o", self.path("scaled.palp"), "--unit",
                                         "cm", "--scale", 200, "--spheres", 10, "--json"))
        self.assertAlmostEqual(packed["bounds"][1][0], 0.08, delta=1e-9)

    # Measurements

    def test_query_agrees_with_brute_force(self):
        cloud = bumpy_wall()
        write_ply(self.path("wall.ply"), cloud)
        spheres, edges = self.read_export()
        a = math.sin(0.2)
        pose = [0.004, -0.003, 0.478, a * 0.6, a * 0.8, 0.0, math.cos(0.2)]
        for method, priority, inside in (("weighted", "distance", "full"),
                                         ("weighted", "count", "full"),
                                         ("simplified", "distance", "full"),
                                         ("simplified", "count", "full"),
                                         ("graph", "distance", "full"), ("graph", "distance", "cap")):
            document = json.loads(
                self.succeed("query", self.tool, "--cloud", self.path("wall.ply"), "--pose",
                             " ".join(map(repr, pose)), "--method", method, "--priority", priority,
                             "--inside", inside, "--json"))
            self.assertEqual((document["method"], len(document["results"])), (method, 1))
            result = document["results"][0]
            volume, force, torque, boundary, points = contact_truth.measure(
                spheres, edges, cloud, pose, method, priority, inside)
            self.assertGreater(boundary, 5)
            self.assertEqual((result["boundary_spheres"], result["points"]), (boundary, points))
            self.assertAlmostEqual(result["volume"] / volume, 1, delta=1e-5)
            for got, expected in ((result["force"], force), (result["torque"], torque)):
                scale = math.sqrt(contact_truth.dot(expected, expected))
                error = contact_truth.sub(got, expected)
                self.assertLess(math.sqrt(contact_truth.dot(error, error)) / scale, 1e-5, method)
            total = sum(4 / 3 * math.pi * s[3]**3 for s in spheres)
            self.assertAlmostEqual(result["fraction"], result["volume"] / total, delta=1e-9)

    def test_options_that_the_method_does_not_have_are_refused(self):
        write_ply(self.path("wall.ply"), bumpy_wall())
        query = ("query", self.tool, "--cloud", self.path("wall.ply"), "--pose", "0 0 0.478 0 0 0 1")
        for method, option, value in (("field", "--edges", "cut"), ("field", "--priority", "count"),
                                      ("graph", "--priority", "count"), ("weighted", "--inside", "cap")):
            self.expect_failure(2, *query, "--method", method, option, value,
                                mentions=f"{option} does not go with the method {method}")

    def test_query_in_volumes_of_the_mesh(self):
        write_ply(self.path("wall.ply"), bumpy_wall())
        def query(volumes):
            return json.loads(self.succeed(
                "query", self.tool, "--cloud", self.path("wall.ply"), "--pose",
                "0 0 0.478 0 0 0 1", "--volumes", volumes, "--json"))["results"][0]
        spheres, mesh = query("spheres"), query("represented")
        info = json.loads(self.succeed("info", self.tool, "--json"))
        self.assertAlmostEqual(mesh["fraction"], mesh["volume"] / info["mesh_volume"], delta=1e-9)
        self.assertGreater(mesh["volume"], spheres["volume"])
        self.assertLess(abs(mesh["fraction"] - spheres["fraction"]), 0.1)

    def test_query_many_poses_from_depth(self):
        poses = self.path("poses.txt")
        with open(poses, "w") as file:
            file.write("# t tx ty tz qx qy qz qw\n0 0 0 0.2 0 0 0 1\n1 0 0 0.49 0 0 0 1\n")
        arguments = ("query", self.tool, "--depth", os.path.join(self.frames, "000.png"),
                     "--intrinsics", INTRINSICS, "--depth-unit", 0.0001, "--poses", poses)
        results = json.loads(self.succeed(*arguments, "--json"))["results"]
        self.assertEqual(results[0]["volume"], 0)
        self.assertGreater(results[1]["volume"], 0)
        self.assertGreater(results[1]["compute_us"], 0)
        self.assertLess(results[1]["force"][2], 0)  # out of the wall, towards the camera
        self.assertEqual(len(self.succeed(*arguments).splitlines()), 3)
        unfiltered = json.loads(self.succeed(*arguments, "--json", "--no-filter"))["results"]
        self.assertNotEqual(unfiltered[1]["volume"], results[1]["volume"])

    # Pictures of what is inside

    def query_caps(self, tool, picture, *options):
        """The volume that the query reports."""
        document = json.loads(self.succeed(
            "query", tool, "--cloud", self.path("wall.ply"), "--pose", "0 0 0.478 0.2 0.1 0 1",
            "--caps", picture, "--json", *options))
        self.assertEqual(document["caps"], picture)
        return document["results"][0]["volume"]

    def solid_volume(self, picture):
        """Of a picture: packing reads it (glTF by Assimp) and refuses what is not closed."""
        packed = json.loads(self.succeed("pack", picture, "-o", self.path("caps.palp"), "--spheres",
                                         1, "--json"))
        return packed["mesh_volume"]

    def test_caps_have_the_volume_of_the_query(self):
        write_ply(self.path("wall.ply"), bumpy_wall())
        tool = self.path("fine.palp")  # spheres so small that the field feels each as one
        self.succeed("pack", self.mesh, "-o", tool, "--spheres", 300, "--max-radius", 0.006)
        ply, glb = self.path("caps.ply"), self.path("caps.glb")
        for method in (("field", "--volumes", "spheres"), ("simplified",), ("graph",),
                       ("graph", "--inside", "cap")):
            for picture in (ply, glb):
                volume = self.query_caps(tool, picture, "--method", *method, "--caps-segments", 60)
                missing = 1 - self.solid_volume(picture) / volume
                # Of a ball 16.4 / 60^2 are missing, of a cap up to 20 / 60^2.
                self.assertTrue(3e-3 < missing < 20 / 60**2, (method, picture, missing))
        coarse = self.query_caps(tool, ply, "--method", "simplified")
        missing = 1 - self.solid_volume(ply) / coarse
        self.assertTrue(3e-3 * 60**2 < missing * 24**2 < 20, missing)
        # Averages of many planes are drawn whole, spheres that stand for more as they are.
        volume = self.query_caps(tool, ply, "--method", "weighted")
        self.assertGreater(self.solid_volume(ply), volume)
        volume = self.query_caps(tool, ply, "--volumes", "represented")
        self.assertLess(self.solid_volume(ply), volume)

    def test_caps_that_cannot_be_written(self):
        wall = self.path("wall.ply")
        write_ply(wall, bumpy_wall())
        before = read(wall)
        query = ("query", self.tool, "--cloud", wall, "--pose", "0 0 0.478 0 0 0 1", "--caps")
        self.assertRegex(self.succeed(*query, self.path("told.ply")),
                         r"(?m)^written +\S*told.ply, \d+ triangles$")
        x = self.path("x.ply")
        self.expect_failure(2, *query, self.path("x.stl"), mentions="must end in .ply or .glb")
        self.expect_failure(2, *query, x, "--caps-segments", 2, mentions="from 3 to 1000")
        self.expect_failure(2, "query", self.tool, "--cloud", wall, "--poses", x, "--caps", x,
                            mentions="one --pose")
        self.expect_failure(1, *query, wall, mentions="it is the input")
        self.expect_failure(1, *query, self.path("no/such/x.glb"), mentions="make it first")
        self.expect_failure(1, *query, x, "--caps-segments", 1000, "--method", "graph",
                            mentions="lower --caps-segments")
        self.expect_failure(1, "query", self.tool, "--cloud", wall, "--pose", "0 0 0.2 0 0 0 1",
                            "--caps", x, mentions="no part of the tool is inside")
        self.assertFalse(os.path.exists(x))
        self.assertEqual(read(wall), before)

    # Runs

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

    def report_data(self, run):
        """The data inside the report of a run."""
        path = os.path.join(run, "report.html")
        if not os.path.exists(path):
            self.skipTest("this build has no pages")
        return page_data(path)

    def columns(self, run):
        lines = [line.split(",") for line in read(os.path.join(run, "wrench.csv")).splitlines()]
        return {name: [float(line[i]) for line in lines[1:]] for i, name in enumerate(lines[0])}

    def test_replay_tries_other_settings(self):
        run, tried, direct = self.path("try"), self.path("tried"), self.path("try_direct")
        self.succeed(*self.sequence("-o", run))
        told = json.loads(self.succeed("replay", run, "-o", tried, "--method", "graph", "--time",
                                       "latest", "--no-filter", "--json"))
        self.succeed(*self.sequence("-o", direct, "--method", "graph", "--time", "latest",
                                    "--no-filter"))
        before, after, same = map(self.columns, (run, tried, direct))
        self.assertEqual(after, same)
        off = [math.dist([before[f"force_{x}_N"][k] for x in "xyz"],
                         [after[f"force_{x}_N"][k] for x in "xyz"])
               for k in range(told["ticks"])]
        self.assertAlmostEqual(told["force_difference_max_N"], max(off), delta=1e-9)
        self.assertAlmostEqual(told["force_difference_rms_N"] ** 2,
                               sum(x * x for x in off) / len(off), delta=1e-9)
        # What another method does not have is left out, and said; what is asked for is refused.
        edges, field = self.path("try_edges"), self.path("tried_field")
        self.succeed(*self.sequence("-o", edges, "--method", "simplified", "--priority", "count",
                                    "--continuity", "both"))
        result = palpate("replay", edges, "-o", field, "--method", "field")
        self.assertEqual(result.returncode, 0, result.stderr)
        notes = [line for line in result.stderr.splitlines() if "dropped" in line]
        self.assertEqual(notes, ["palpate: note: dropped options of the run that the method field "
                                 "does not have: priority, continuity"])
        self.succeed(*self.sequence("-o", direct))
        self.assertEqual(self.columns(field), self.columns(direct))
        self.expect_failure(1, "replay", edges, "-o", field, "--method", "field", "--continuity",
                            "entry", mentions="continuity does not go with the method field")
        self.expect_failure(2, "replay", run, "--method", "graph", mentions="-o RUN2")
        self.expect_failure(1, "replay", run, "-o", run, mentions="another folder")
        self.expect_failure(2, "replay", run, "-o", tried, "--method", "magic", mentions="graph")

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
                self.assertEqual(tick.felt.force.z, felt["hand_force_z_N"][k])
                # A tool that is not turned, about its own origin: its centre of mass.
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
            file.write("0 0 0 0.45 0 0 0 1\n0.5 0.003 0 0.49 0 0.1 0 0.995\n0.9 0.003 0 0.49 0 0.1 0 0.995\n")
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
            self.assertAlmostEqual(a[name][deepest] / b["told_" + name][deepest], 1, delta=1e-6)
        with open(os.path.join(turned, "summary.json")) as file:
            settings = json.load(file)["settings"]
        self.assertEqual(settings["bodies"]["gravity_z"], -9.81)
        # A tool centre point: poses are its, and a frame of the rig's own.
        self.succeed(*touch, "--path-frame", "corner", "--wrench-frame", "corner", "--tcp", "0 0 0.1",
                     "--wrench-point", "tcp")
        c = self.columns(turned)
        for name, value in (("told_y_m", 0), ("told_z_m", 0.45), ("tool_y_m", 2), ("tool_z_m", 0.35)):
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
        # So it is with a device that plays the path: it feels the frame of that moment first.
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

    # The page

    @contextlib.contextmanager
    def page(self, *arguments):
        """A program that serves one, and its address; ended by Ctrl-C unless it has ended."""
        program = subprocess.Popen([PALPATE, *map(str, arguments)], stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, text=True)
        self.addCleanup(program.kill)
        with program:
            try:
                seen = ""
                while not (found := re.search(r"open (http://\S+?)/? in a browser", seen)):
                    line = program.stdout.readline()
                    self.assertTrue(line, seen)
                    seen += line
                yield program, found.group(1)
            except BaseException:
                program.kill()  # else nobody would ever end it
                raise
            program.send_signal(signal.SIGINT)

    def ask(self, address, what, command=None):
        data = None if command is None else json.dumps(command).encode()
        try:
            with urllib.request.urlopen(f"{address}/api/{what}", data, timeout=60) as answer:
                return json.loads(answer.read())
        except urllib.error.HTTPError as error:
            return json.loads(error.read())

    def test_view_of_a_tool_and_of_a_run(self):
        run = self.path("run_seen")
        self.succeed(*self.sequence("-o", run))
        with self.page("view", self.tool, "--port", 0) as (program, address):
            hello = self.ask(address, "hello")
            self.assertEqual((hello["kind"], hello["controls"], hello["streams"]), ("tool", [], []))
            self.assertEqual(hello["tool"]["spheres"], json.loads(
                self.succeed("info", self.tool, "--json"))["spheres"])
            program.send_signal(signal.SIGINT)
            self.assertEqual(program.wait(20), 0)
        with self.page("view", run, "--port", 0) as (program, address):
            hello = self.ask(address, "hello")
            self.assertEqual((hello["kind"], hello["title"]), ("recording", "run_seen"))
            answer = self.ask(address, "command", {"id": 1, "command": "seek", "time": 0.05})
            self.assertTrue(answer["ok"], answer)
            answer = self.ask(address, "command", {"id": 2, "command": "set",
                                                   "key": "contact.method", "value": "magic"})
            self.assertFalse(answer["ok"])
            self.assertIn("graph", answer["error"])
            state = self.ask(address, "state")
            self.assertEqual(state["settings"]["contact.method"], "field")
            self.assertAlmostEqual(state["time"], 0.05)
            program.send_signal(signal.SIGINT)
            self.assertEqual(program.wait(20), 0)
        self.expect_failure(1, "view", self.path("nothing"), mentions="palpate touch wrote")
        self.expect_failure(1, "view", self.folder, mentions="palpate touch wrote")
        self.expect_failure(1, "view", self.mesh, mentions="not a tool file")
        self.expect_failure(1, "view", self.tool, "--port", 0, "--address", "192.0.2.1",
                            mentions="with --address")

    def test_names_that_lead_nowhere(self):
        circle = self.path("circle")
        os.symlink("circle", circle)
        for arguments in (("export", self.tool, "--spheres", circle), ("view", circle),
                          ("export", self.tool, "--spheres", os.path.join(circle, "s.csv")),
                          self.sequence("-o", circle)):
            self.expect_failure(1, *arguments, mentions="Too many levels of symbolic links"
                                if "s.csv" not in arguments[-1] else "no folder " + circle)
        self.expect_failure(1, "export", self.tool, "--spheres", "/dev/stdout",
                            mentions="not a regular file")
        self.expect_failure(2, *self.sequence("-o", ""), mentions="--output: is empty; give a value; see")

    def test_touch_seen_in_a_browser(self):
        run = self.path("run_watched")
        plain = json.loads(self.succeed(*self.sequence("-o", run, "--json")))
        before = read(os.path.join(run, "wrench.csv"))
        start = time.monotonic()
        with self.page(*self.sequence("-o", run, "--json", "--view", "--view-port", 0)) as (
                program, address):
            for _ in range(1000):
                if self.ask(address, "state")["running"]:
                    break
                time.sleep(0.01)
            self.assertTrue(self.ask(address, "command", {"id": 1, "command": "resume"})["ok"])
            output = program.stdout.read()
            self.assertEqual(program.wait(60), 0)
        self.assertGreater(time.monotonic() - start, plain["ticks"] / 1000)
        self.assertEqual(json.loads(output[output.index("{"):])["ticks"], plain["ticks"])
        self.assertEqual(read(os.path.join(run, "wrench.csv")), before)

    def test_a_live_run_is_turned_and_ended_by_a_script(self):
        run = self.path("live_watched")
        settings = self.patient_settings("patient_watched.toml", "energy_tank = 100\n")
        with self.page("touch", self.tool, "--scene", "wall", "--device", "sim", "--duration", 60,
                       "--settings", settings, "-o", run, "--view", "--view-port", 0) as (
                program, address):
            self.assertEqual(self.ask(address, "hello")["kind"], "live")
            for _ in range(1000):
                if self.ask(address, "state")["ticks"] > 100:
                    break
                time.sleep(0.02)
            for command in ({"command": "set", "key": "contact.method", "value": "graph"},
                            {"command": "pause"}, {"command": "step"}, {"command": "resume"},
                            {"command": "mark", "text": "a word"}, {"command": "end"}):
                answer = self.ask(address, "command", {"id": 1, **command})
                self.assertTrue(answer["ok"], answer)
            output = program.stdout.read()
            self.assertEqual(program.wait(60), 0, output)
        self.assertIn("identical: ", self.succeed("replay", run))

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

    def test_a_run_that_cannot_be_kept_says_so(self):
        """A disk that fills up: here a limit on the size of files."""
        run = self.path("no_space")

        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            most = os.path.getsize(self.tool) + 100000  # a recording begins with the tool
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
        # A minute of the clock of the path: more than so many bytes of wrench.csv.
        path = self.path("no_space.txt")
        with open(path, "w", encoding="utf-8") as file:
            file.write("0 0 0 0.4 0 0 0 1\n60 0 0 0.45 0 0 0 1\n")
        result = subprocess.run(
            [PALPATE, *map(str, self.sequence("-o", run, "--path", path, "--duration", 60))],
            capture_output=True, text=True, preexec_fn=limit, restore_signals=False, timeout=120)
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertIn("palpate: not all of the run could be kept: ", result.stderr)
        self.assertFalse(os.path.exists(os.path.join(run, "wrench.csv")))
        if not os.path.exists(os.path.join(run, "report.html")):
            self.assertNotIn("report:", result.stdout)

    def test_touch_live_and_replay(self):
        # Ages that no busy machine reaches.
        settings = self.patient_settings("patient.toml", "energy_tank = 100\n")
        run = self.path("live")
        live = (*self.sequence("-o", run), "--depth-rate", 2, "--device", "sim", "--settings",
                settings)
        summary = json.loads(self.succeed(*live, "--duration", 3, "--coupling", "proxy", "--json"))
        self.assertGreater(summary["ticks"], 100)
        self.assertEqual(summary["failure"], "")
        self.assertEqual(summary["settings"]["coupling"]["kind"], "proxy")
        self.assertEqual(summary["settings"]["safety"]["max_tick"], 60)
        for name in ("recording.mcap", "wrench.csv", "summary.json", "report.html"):
            self.assertTrue(os.path.exists(os.path.join(run, name)), name)
        self.assertIn("hand_force_x_N", self.report_data(run)["series"])
        self.assertRegex(self.succeed("replay", run), r"^identical: \d+ ticks, \d+ contact queries\n$")
        self.assertTrue(json.loads(self.succeed("replay", run, "--json"))["identical"])
        again = self.path("live-again")
        told = json.loads(self.succeed("replay", run, "-o", again, "--time", "latest", "--json"))
        self.assertGreater(told["ticks"], 100)
        self.assertRegex(self.succeed("replay", again), r"^identical: \d+ ticks, \d+ contact")

    def test_long_runs_keep_what_was_asked_for(self):
        run = self.path("parts")
        touch = ("touch", self.tool, "--scene", "wall", "-o", run, "--duration", 5)

        def parts():
            return sorted(name for name in os.listdir(run) if name.endswith(".mcap"))
        self.succeed(*touch, "--record-split", "1MB")
        self.assertEqual(parts(), [f"recording-000{k}.mcap" for k in (2, 3, 4, 5)] + ["recording.mcap"])
        self.assertIn("identical: 5000 ticks", self.succeed("replay", run))
        whole = self.columns(run)
        self.assertEqual(len(whole["time_s"]), 5000)
        self.succeed(*touch, "--record-keep", "1s")  # parts of two seconds, of which the first is too old
        self.assertEqual(parts(), ["recording-0002.mcap", "recording-0003.mcap"])
        self.assertIn("identical: 3000 ticks", self.succeed("replay", run))
        kept = self.columns(run)
        self.assertEqual(kept["time_s"], whole["time_s"][2000:])
        self.assertEqual(kept["volume_m3"], whole["volume_m3"][2000:])
        for option, value in (("--record-keep", "0.5s"), ("--record-keep", "10 weeks"), ("--record-keep", "-1"),
                              ("--record-split", "1kB"), ("--record-split", "GB"), ("--record-split", "1e999GB")):
            self.expect_failure(2, *touch, option, value, mentions=f"{option}: a ")

    def test_a_short_live_run_is_not_over_before_it_begins(self):
        settings = self.path("short.toml")
        with open(settings, "w") as file:
            file.write("[safety]\nmax_contact_age = 60\nmax_sensor_age = 60\nmax_tick = 60\n"
                       "max_device_silence = 60\nenergy_tank = 100\n")
        summary = json.loads(self.succeed(
            "touch", self.tool, "--scene", "wall", "--device", "sim", "--duration", 0.2,
            "--settings", settings, "-o", self.path("short"), "--json"))
        self.assertEqual(summary["ending"], "")
        self.assertGreater(summary["ticks"], 0)
        self.assertGreaterEqual(summary["seconds"], 0.19)  # from its first tick on

    @contextlib.contextmanager
    def live_run(self, run, *options, **streams):
        """A live run that has begun, to be ended by the caller."""
        shutil.rmtree(run, ignore_errors=True)
        program = subprocess.Popen([PALPATE, *map(str, (
            "touch", self.tool, "--scene", "wall", "--device", "sim", "-o", run, *options))],
            stdin=subprocess.DEVNULL, **streams)
        try:
            self.wait_for(lambda: os.path.exists(os.path.join(run, "recording.mcap")), program)
            time.sleep(0.5)
            yield program
        finally:
            program.kill()
            program.wait()

    def wait_for(self, condition, program=None):
        deadline = time.monotonic() + 120
        while not condition():
            self.assertTrue(time.monotonic() < deadline and (program is None or program.poll() is None))
            time.sleep(0.02)

    def stand_still(self, program):
        """Long enough for a fault, of which there is something to say."""
        program.send_signal(signal.SIGSTOP)
        time.sleep(0.7)
        program.send_signal(signal.SIGCONT)

    def full_pipe(self):
        """The ends of a pipe that takes no byte more."""
        ends = os.pipe()
        os.set_blocking(ends[1], False)
        with self.assertRaises(BlockingIOError):
            while True:
                os.write(ends[1], bytes(1))
        os.set_blocking(ends[1], True)
        return ends

    def expect_whole(self, run):
        summary = json.loads(read(os.path.join(run, "summary.json")))
        self.assertTrue(os.path.exists(os.path.join(run, "report.html")))
        self.assertEqual(summary["not_kept"], "")
        self.assertIn("identical: ", self.succeed("replay", run))
        return summary

    def test_impatient_people_get_a_whole_run_and_no_force(self):
        run = self.path("impatient")
        with self.live_run(run, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as program:
            self.wait_for_force(run, program)
            for _ in range(5):  # as a key repeats
                program.send_signal(signal.SIGINT)
                time.sleep(0.03)
            output = program.communicate(timeout=120)[0]
            self.assertEqual(program.returncode, 0, output)
        self.expect_whole(run)
        last = read(os.path.join(run, "wrench.csv")).splitlines()[-1].split(",")
        self.assertEqual(set(last[23:29]), {"0"})  # force and torque on the hand
        # Whoever really wants it ends what does not end: here it waits for a reader.
        reader, full = self.full_pipe()
        with self.live_run(run, stdout=full, stderr=subprocess.DEVNULL) as program:
            program.send_signal(signal.SIGINT)
            self.wait_for(lambda: os.path.exists(os.path.join(run, "report.html")), program)
            time.sleep(2.1)
            self.assertIsNone(program.poll())
            program.send_signal(signal.SIGINT)
            self.assertEqual(program.wait(60), -signal.SIGINT)
        os.close(reader)
        os.close(full)
        self.expect_whole(run)

    def forces(self, run, name="wrench.csv"):
        """The force on the hand at every tick so far, N; a run that has just begun may have no file yet."""
        if not os.path.exists(os.path.join(run, name)):
            return []
        lines = [line.split(",") for line in read(os.path.join(run, name)).split("\n")[:-1]]
        places = [lines[0].index(f"hand_force_{axis}_N") for axis in "xyz"] if lines else []
        return [math.hypot(*(float(line[i]) for i in places)) for line in lines[1:]]

    def wait_for_force(self, run, program):
        self.wait_for(lambda: (self.forces(run, "wrench.csv.part") or [0])[-1] > 0.1, program)

    def test_ctrl_z_takes_the_force_before_the_program_stands_still(self):
        """In contact, with limits that would let the force stay for a minute."""
        settings, run = self.path("suspended.toml"), self.path("suspended")
        with open(settings, "w") as file:
            file.write("[safety]\nmax_contact_age = 60\nmax_sensor_age = 60\nmax_tick = 60\n"
                       "max_device_silence = 60\nenergy_tank = 100\n")
        with self.live_run(run, "--duration", 300, "--settings", settings,
                           stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as program:
            self.wait_for_force(run, program)
            for _ in range(2):
                program.send_signal(signal.SIGTSTP)
                self.wait_for(lambda: state_of(program) == "T", program)
                before = len(self.forces(run, "wrench.csv.part"))
                time.sleep(2)
                program.send_signal(signal.SIGCONT)
                self.wait_for(lambda: len(self.forces(run, "wrench.csv.part")) > before + 800, program)
            program.send_signal(signal.SIGINT)
            output = program.communicate(timeout=120)[0].decode()
            self.assertEqual(program.returncode, 0, output)
        self.assertIn("the program is about to stand still", output)
        summary = self.expect_whole(run)
        self.assertIn("loop", [fault["fault"] for fault in summary["faults"]])
        times, forces = self.columns(run)["time_s"], self.forces(run)
        stands = [k for k in range(1, len(times)) if times[k] - times[k - 1] > 1.9]
        self.assertEqual(len(stands), 2)
        self.assertGreater(max(forces[:stands[0]]), 0.1)
        for k in stands:
            self.assertEqual(forces[k - 1], 0)
        self.assertEqual(set(forces[stands[0]:]), {0})  # the hand stays in the wall, as after any fault

    def test_other_polite_signals_take_the_force_and_keep_the_run(self):
        for how in (signal.SIGTERM, signal.SIGQUIT):
            run = self.path("polite")
            with self.live_run(run, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as program:
                self.wait_for_force(run, program)
                program.send_signal(how)
                output = program.communicate(timeout=120)[0]
                self.assertEqual(program.returncode, 0, output)
            self.expect_whole(run)
            forces = self.forces(run)
            self.assertGreater(max(forces), 0.1, how)
            self.assertEqual(forces[-1], 0, how)

    def unread_run(self, run):
        """Its faults, of which there is something to say that nobody reads in time."""
        reader, full = self.full_pipe()
        with self.live_run(run, "--duration", 3, stdout=subprocess.DEVNULL, stderr=full) as program:
            os.close(full)
            self.stand_still(program)
            self.wait_for(lambda: os.path.exists(os.path.join(run, "report.html")), program)
            faults = self.expect_whole(run)["faults"]
            # What there was to say is kept.
            with open(reader, "rb") as unread:
                told = unread.read()
            if faults:
                self.assertIn(b"the force is off", told)
            self.assertEqual(program.wait(60), 0)
        return faults

    def unheard_run(self, run):
        """Its faults, of which there is something to say to nobody."""
        reader, writer = os.pipe()
        with self.live_run(run, "--duration", 3, stdout=subprocess.DEVNULL, stderr=writer) as program:
            os.close(writer)
            os.close(reader)
            self.stand_still(program)
            self.assertEqual(program.wait(120), 0)
        return self.expect_whole(run)["faults"]

    def test_whoever_does_not_read_holds_up_no_live_run(self):
        # On a busy computer a run may stand still before there is a force, or when it has ended: it has no fault.
        self.assertTrue(any(self.unread_run(self.path("unread")) for _ in range(3)))

    def test_whoever_goes_away_ends_no_live_run(self):
        self.assertTrue(any(self.unheard_run(self.path("unheard")) for _ in range(3)))

    def test_a_driver_that_hangs_ends_the_run_in_a_sentence(self):
        sdk = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(PALPATE))),
                           "tests", "devices", "fake_sdk", "whole")
        if not os.path.isdir(sdk):
            self.skipTest("there is no emulated driver beside the program")
        # Within a tick, the run may end before a second without ticks is over.
        polled, called = "does not return from a call", "does not call back"
        for kind, call, duration, words in (
                ("forcedimension", "dhdGetPositionAndOrientationFrame:100", 60, f"does not tick any more|{polled}"),
                ("forcedimension", "dhdEnableForce:2", 3, polled),
                ("openhaptics", "hdEndFrame:100", 60, f"does not tick any more|{called}"),
                ("openhaptics", "hdStopScheduler", 3, called)):
            run = self.path("run_hung")
            shutil.rmtree(run, ignore_errors=True)
            done = subprocess.run(
                [PALPATE, "touch", self.tool, "--scene", "wall", "--device", kind, "--duration",
                 str(duration), "-o", run], capture_output=True, text=True, timeout=300,
                env=dict(os.environ, FDSDK=sdk, OH_SDK_BASE=sdk, FAKE_SDK_HANG=call))
            self.assertEqual(done.returncode, 1, (call, done.stderr))
            self.assertRegex(done.stderr.splitlines()[-1], words, call)
            self.assertEqual(self.expect_whole(run)["fault"], "device", call)

    def test_touch_live_says_what_is_wrong(self):
        run = self.path("never")
        live = self.sequence("-o", run, "--device", "sim")
        self.expect_failure(2, *live, "--path", "poses.txt", mentions="--path and --device exclude each other")
        self.expect_failure(1, *self.sequence("-o", run, "--device", "lightsabre"),
                            mentions="'lightsabre'; give one of sim")
        self.expect_failure(1, *self.sequence("-o", run, "--device", "sim:wand"), mentions="'wand'")
        bad = self.path("bad.toml")
        for text, words in (("[safety]\nmax_slow = 1\n", "line 2"), ("[safety\n", "not TOML"),
                            ("[coupling]\nkind = 'stiff'\n", "virtual, direct, proxy, none")):
            with open(bad, "w") as file:
                file.write(text)
            self.expect_failure(1, *live, "--settings", bad, mentions=words)
        self.expect_failure(1, *live, "--settings", self.path("absent.toml"), mentions="absent.toml")
        self.assertFalse(os.path.exists(run))

    def test_settings_are_printed_and_read_back(self):
        text = self.succeed("touch", "--print-settings")
        for section in ("contact", "surface", "field", "time", "loop", "coupling", "safety"):
            self.assertIn(f"[{section}]", text)
        self.assertIn("to 10000000 N/s)", text)
        # As it is printed a file gives nothing: a camera that moves is taken as without it.
        for line in text.splitlines():
            self.assertTrue(line == "" or line[0] in "[#", line)
        written = self.path("printed.toml")
        with open(written, "w") as file:
            file.write(text)
        for more, average in (([], "kalman"), (["--average", "none"], "none")):
            run = self.path("printed-" + average)
            self.succeed("touch", self.tool, "--scene", "wall", "--duration", "0.3", "--settings", written, *more, "-o", run)
            with open(os.path.join(run, "summary.json")) as file:
                self.assertEqual(json.load(file)["settings"]["time"]["average"], average)

    def test_devices(self):
        self.assertIn("sim", self.succeed("devices"))
        devices = json.loads(self.succeed("devices", "--json"))["devices"]
        kinds = {device["kind"]: device for device in devices}
        self.assertTrue(kinds["sim"]["usable"])
        for device in devices:
            self.assertTrue(device["usable"] or device["hint"], device)

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

    def test_touch_live_stays_at_the_last_frame(self):
        run = self.path("run_live_probe")
        summary = json.loads(self.succeed(*self.sequence("-o", run, "--json", "--device", "sim")))
        self.assertEqual(set(summary["probe"]), {"pixel", "point", "time", "why_place", "tip",
                                                 "why_tip", "note", "how_to_aim"})
        self.assertGreater(summary["frames"], 4)  # and the last one again, 3 s in all
        self.assertGreater(summary["seconds"], 2.5)
        self.assertGreater(summary["peaks"]["wanted_force_N"], 0)
        self.assertEqual(self.report_data(run)["summary"]["probe"], summary["probe"])
        self.assertIn("identical", self.succeed("replay", run))

    def test_scenes(self):
        scenes = json.loads(self.succeed("scenes", "--json"))["scenes"]
        text = self.succeed("scenes")
        program_help = self.succeed("touch", "--help")
        for scene in scenes:
            self.assertEqual(set(scene), {"name", "title", "tool", "duration"})
            self.assertRegex(text, rf"(?m)^{scene['name']} +{scene['tool']['shape']} ")
            self.assertIn(scene["title"], text)
            self.assertIn(scene["name"], program_help)
        hand = {scene["name"]: scene for scene in scenes}["hand"]
        self.assertEqual(hand["tool"], {"shape": "stylus", "size": 0.12})

    # Objects beside the cloud

    def test_query_of_objects(self):
        query = ("query", self.tool, "--depth", os.path.join(self.frames, "000.png"), "--intrinsics",
                 INTRINSICS, "--depth-unit", 0.0001, "--pose", "0 0 0.49 0 0 0 1", "--json")
        (cloud,) = json.loads(self.succeed(*query))["results"]
        self.assertNotIn("objects", cloud)
        right, left = f"{self.tool}@0.05 0 0.49 0 0 0 1", f"{self.tool}@-0.05 0 0.49 0 0 0 2"
        (one,) = json.loads(self.succeed(*query, "--object", right))["results"]
        (two,) = json.loads(self.succeed(*query, "--object", right, "--object", left))["results"]
        self.assertEqual(set(one["objects"]), {"volume", "force", "torque", "pairs"})
        self.assertLess(one["objects"]["force"][0], 0)
        self.assertGreater(one["objects"]["pairs"], 0)
        self.assertEqual(one["volume"], cloud["volume"] + one["objects"]["volume"])
        self.assertGreater(two["objects"]["volume"], 1.5 * one["objects"]["volume"])
        self.assertEqual(one["boundary_spheres"], cloud["boundary_spheres"])
        table = self.succeed(*query[:-1], "--object", right).splitlines()
        self.assertIn("objects", table[0])

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

    def test_bad_objects(self):
        touch = self.sequence("-o", self.path("x"))
        for value, words in ((self.tool, "TOOL.palp@"), ("@0 0 0 0 0 0 1", "TOOL.palp@"),
                             (f"{self.tool}@0 0 0", "--object"),
                             (f"{self.tool}@0 0 0 0 0 0 0", "--object"),
                             (f"{self.tool}@0 0 nan 0 0 0 1", "--object"),
                             (f"{self.tool}@0 0 0 0 0 0 1,friction=1,friction=2", "give friction once"),
                             (f"{self.tool}@", "--object")):
            self.expect_failure(2, *touch, "--object", value, mentions=words)
        pose = "@0 0 0.5 0 0 0 1"
        self.expect_failure(1, *touch, "--object", self.path("absent.palp") + pose,
                            mentions="absent.palp")
        self.expect_failure(1, *touch, "--object", self.mesh + pose, mentions="not a tool file")
        self.assertFalse(os.path.exists(self.path("x")))
        run = self.path("run_precious")
        self.succeed(*self.sequence("-o", run, "--duration", 0.01))
        shutil.copy(self.tool, os.path.join(self.folder, "run_precious", "summary.json"))
        self.expect_failure(1, *self.sequence("-o", run, "--object", os.path.join(
            run, "summary.json") + pose), mentions="would replace")

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

    def interrupt(self, arguments, is_ready, how=signal.SIGINT):
        """Once it catches such signals and is ready, which depends on for how many seconds it has caught them."""
        process = subprocess.Popen([PALPATE, *map(str, arguments)], stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, text=True)
        deadline, since = time.monotonic() + 120, None
        while process.poll() is None and time.monotonic() < deadline:
            if since is None and self.catches(process, how):
                since = time.monotonic()
            if since is not None and is_ready(time.monotonic() - since):
                break
            time.sleep(0.02)
        process.send_signal(how)
        output, errors = process.communicate(timeout=120)
        return process.returncode, output, errors

    @staticmethod
    def catches(process, number):
        """Whether a program has a handler by now."""
        caught = re.search(r"^SigCgt:\s*(\w+)", read(f"/proc/{process.pid}/status"), re.MULTILINE)
        return int(caught.group(1), 16) >> (number - 1) & 1 == 1

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

    def test_interrupted_pack_writes_nothing(self):
        tool = self.path("endless.palp")
        status, output, _ = self.interrupt(
            ("pack", self.mesh, "-o", tool, "--spheres", 2000000, "--json"), lambda seconds: seconds > 1)
        self.assertEqual((status, output), (1, ""))
        self.assertFalse(any(name.startswith("endless") for name in os.listdir(self.folder)))

    def test_interrupted_folder_tells_what_was_done(self):
        folder, tools = self.mesh_folder("long")
        self.pack_folder(0, folder, tools)
        shutil.copy(self.mesh, os.path.join(folder, "b.ply"))
        os.remove(os.path.join(folder, "a.STL.obj"))
        shutil.copy(self.mesh, os.path.join(folder, "c.ply"))
        before = read(os.path.join(tools, "b.palp"), "rb")
        status, output, errors = self.interrupt(
            ("pack", folder, "-o", tools, "--spheres", 2000000, "--json"), lambda seconds: seconds > 1)
        self.assertEqual(status, 1, errors)
        document = json.loads(output)
        self.assertTrue(document["interrupted"])
        self.assertEqual((document["packed"], document["skipped"], document["failed"]), ([], [], []))
        self.assertIn("interrupted after 0 of 2 meshes", errors)
        self.assertEqual(read(os.path.join(tools, "b.palp"), "rb"), before)
        self.assertFalse([name for name in os.listdir(tools) if ".partial" in name])


if __name__ == "__main__":
    PALPATE = os.path.abspath(sys.argv.pop(1))
    unittest.main(testLoader=parts.Loader())
