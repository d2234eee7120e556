"""Usage: options, their errors, and files that are never replaced.

Usage: usage_test.py PATH_OF_PALPATE"""

import json
import os
import shutil
import subprocess

from cli_case import CommandLineCase, INTRINSICS, main, palpate, PALPATE, read
from made_files import bumpy_wall, write_depth_png, write_ply


class Usage(CommandLineCase):

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
            (), ("dance",), ("info",), ("info", tool, "--color"), ("pack", mesh),
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
        self.expect_failure(2, "frobnicate", mentions="'frobnicate'; the verbs are try, help, pack, ")
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
        """Empty values come from unset variables of scripts: the robot would be felt, or another path followed."""
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
            for flag in ("--help", "--help-all"):
                self.assertNotRegex(self.succeed(verb, flag), r"\b(FLOAT|UINT|INT|TEXT)\b|cx,cy x 4")

    def test_what_a_camera_does_not_take_is_refused(self):
        touch = ("touch", self.tool, "-o", self.path("never"))
        for camera in (("--scene", "wall"), ("--camera", "scene:wall")):
            for option, value in (("--depth-unit", 0.002), ("--depth-rate", 10), ("--intrinsics", INTRINSICS)):
                self.expect_failure(2, *touch, *camera, option, value, mentions=f"{option} goes with --depth-sequence")
        self.expect_failure(2, *self.sequence("--no-noise", "-o", self.path("never")), mentions="--no-noise goes with --scene")

        self.expect_failure(1, *touch, "--camera", f"folder:{self.frames}?intrinsics={INTRINSICS}&size=160x120",
                            mentions="leave out 'size': the images of folder say their size themselves")
        for parameter in ("size=160x120", "frame=tool", "latency=0.1", "color=1"):
            for camera in ("scene:wall", f"folder:{self.frames}?intrinsics={INTRINSICS}", f"bag:{self.tool}"):
                if parameter.startswith("size") and not camera.startswith("folder") or parameter[0] == "l" and camera[0] == "b":
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
        # Files of the same kind, and empty ones, are replaced.
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
        self.expect_failure(1, *touch, *(17 * ("--labels", labels)), *wood, mentions="--labels is given 17 times")
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
            self.expect_failure(1, *query, file, mentions=f"{file} is not a PNG file; depth images are 16-bit grayscale "
                                "PNG files, and organized point clouds are read as .pcd files")

    def test_small_inputs_of_large_numbers_are_refused(self):
        frames, out = self.path("far_apart"), self.path("never")
        os.mkdir(frames)
        write_depth_png(os.path.join(frames, "a.png"), 160, 120, lambda u, v: 1000)
        with open(os.path.join(frames, "depth.txt"), "w") as file:
            file.write("0 a.png\n1 a.png\n2 a.png\n1000000 a.png\n")
        self.expect_failure(1, "touch", self.tool, "--depth-sequence", frames, "--intrinsics", INTRINSICS, "-o", out,
                            mentions="are more than a day apart")
        # Took 12 s for 32 kB: each # may be the end of a file's name.
        self.expect_failure(1, "touch", self.tool, "--camera", f"folder:{frames}?urdf={50000 * '#/'}", "-o", out)
        self.assertFalse(os.path.exists(out))

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

    def test_options_that_the_method_does_not_have_are_refused(self):
        write_ply(self.path("wall.ply"), bumpy_wall())
        query = ("query", self.tool, "--cloud", self.path("wall.ply"), "--pose", "0 0 0.478 0 0 0 1")
        for method, option, value in (("field", "--edges", "cut"), ("field", "--priority", "count"),
                                      ("graph", "--priority", "count"), ("weighted", "--inside", "cap")):
            self.expect_failure(2, *query, "--method", method, option, value,
                                mentions=f"{option} does not go with the method {method}")

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

    def test_settings_are_printed_and_read_back(self):
        text = self.succeed("touch", "--print-settings")
        for section in ("contact", "surface", "field", "time", "loop", "coupling", "safety"):
            self.assertIn(f"[{section}]", text)
        self.assertIn("to 10000000 N/s)", text)
        # As it is printed a file sets nothing: a moving camera is taken as without it.
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

    def test_scenes(self):
        scenes = json.loads(self.succeed("scenes", "--json"))["scenes"]
        text = self.succeed("scenes")
        program_help = self.succeed("touch", "--help-all")
        for scene in scenes:
            self.assertEqual(set(scene), {"name", "title", "tool", "duration"})
            self.assertRegex(text, rf"(?m)^{scene['name']} +{scene['tool']['shape']} ")
            self.assertIn(scene["title"], text)
            self.assertIn(scene["name"], program_help)
        hand = {scene["name"]: scene for scene in scenes}["hand"]
        self.assertEqual(hand["tool"], {"shape": "stylus", "size": 0.12})

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


if __name__ == "__main__":
    main()
