"""Packing: tools, their pages, and whole folders.

Usage: pack_test.py PATH_OF_PALPATE"""

import json
import math
import os
import re
import shutil

from cli_case import CommandLineCase, main, page_data, palpate, read


class Packing(CommandLineCase):

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
        # A tool that cannot be written does not stop the others.
        os.makedirs(os.path.join(tools, "a.STL.palp"))
        self.assertEqual(self.pack_folder(1, folder, tools), (["b.ply"], [], ["a.STL.obj"]))
        self.assertIn("it is a folder", self.failures[0]["reason"])

    def test_units(self):
        packed = json.loads(self.succeed("pack", self.mesh, "-o", self.path("scaled.palp"), "--unit",
                                         "cm", "--scale", 200, "--spheres", 10, "--json"))
        self.assertAlmostEqual(packed["bounds"][1][0], 0.08, delta=1e-9)

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


URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><collision><origin xyz="0 0 0.15"/><geometry><box size="0.06 0.08 0.3"/></geometry></collision></link>
<link name="hand"><collision><geometry><box size="0.05 0.05 0.05"/></geometry></collision></link>
<link name="sail"><collision><geometry><mesh filename="sail.obj"/></geometry></collision></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><limit lower="-2" upper="2"/></joint>
<joint name="wrist" type="fixed"><origin xyz="0 0 0.3"/><parent link="upper"/><child link="hand"/></joint>
<joint name="mast" type="fixed"><parent link="upper"/><child link="sail"/></joint>
</robot>"""


class RobotPacking(CommandLineCase):

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.urdf, cls.robot = cls.path("arm.urdf"), cls.path("arm.palprobot")
        with open(cls.urdf, "w") as file:
            file.write(URDF)
        with open(cls.path("sail.obj"), "w") as file:
            file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")

    def pack(self, *options, output=None):
        result = palpate("pack", "--robot", self.urdf, "-o", output or self.robot, *options)
        self.assertEqual(result.returncode, 0, result.stderr)
        return result

    def test_links_are_filled_and_what_is_missed_is_said(self):
        result = self.pack("--standoff", 0.02, "--json")
        info = json.loads(result.stdout)
        self.assertEqual(info["joints"], ["shoulder"])
        self.assertEqual([link["name"] for link in info["links"]], ["upper", "hand"])
        self.assertEqual(sum(link["spheres"] for link in info["links"]), info["spheres"])
        self.assertTrue(0 < info["standoff"] <= 0.0202, info["standoff"])
        (note,) = info["notes"]
        self.assertIn("link 'sail' is left out", note)
        self.assertEqual(result.stderr, f"palpate: warning: {note}\n")
        packed = read(self.robot, "rb")
        self.assertTrue(packed.startswith(b"\x89PALPROBOT\r\n"))
        self.assertEqual(packed.count(b"\x89PALP\r\n"), 2)  # tools
        again = self.path("again.palprobot")
        told = self.pack("--standoff", 0.02, output=again).stdout
        self.assertEqual(read(again, "rb"), packed)
        self.assertIn(f"upper: {info['links'][0]['spheres']} spheres", told)

        finer = json.loads(self.pack("--standoff", 0.01, "--robot-skip", "hand,sail", "--json").stdout)
        self.assertEqual((len(finer["links"]), finer["notes"]), (1, []))
        self.assertLessEqual(finer["standoff"], 0.0101)
        self.assertGreater(finer["links"][0]["spheres"], info["links"][0]["spheres"])
        # The box is thinner there than spheres reach: its corners are farther than that.
        missed = self.pack("--standoff", 0.0005, "--robot-skip", "upper,sail").stderr
        self.assertRegex(missed, r"^palpate: warning: link 'hand' has surface [\d.]+ mm from .*, not within 0.5 mm")
        packed = json.loads(self.pack("--robot-skip", "upper,sail", "--json").stdout)
        self.assertEqual(packed.pop("output"), self.robot)
        self.assertEqual(json.loads(self.succeed("info", self.robot, "--json")), packed)
        self.assertIn("joints        1\n", self.succeed("info", self.robot))
        self.expect_failure(1, "export", self.robot, "--mesh", self.path("never.ply"), mentions="is not a tool file")

    def test_refused(self):
        output = self.path("refused.palprobot")
        for option, *value in (("--spheres", 100), ("--unit", "mm"), ("--scale", 2), ("--seed", 1), ("--threads", 2),
                               ("--report", self.path("refused.html")), ("--min-radius", 0.001), ("--gap-rule", "relative"),
                               ("--camera-spacing", "1,525")):
            self.expect_failure(2, "pack", "--robot", self.urdf, "-o", output, option, *value, mentions=option)
        self.expect_failure(2, "pack", self.mesh, "--robot", self.urdf, "-o", output, mentions="either a mesh")
        self.expect_failure(2, "pack", self.mesh, "-o", output, "--standoff", 0.01, mentions="goes with --robot")
        self.pack()
        self.expect_failure(1, "pack", "--robot", self.robot, "--standoff", 0.005, "-o", output,
                            mentions="is not packed again")
        self.expect_failure(1, "pack", "--robot", self.path("none.urdf"), "-o", output, mentions="none.urdf")
        self.expect_failure(1, "pack", "--robot", self.urdf, "--robot-skip", "uper", "-o", output, mentions="'upper'")
        self.assertFalse([name for name in os.listdir(self.folder) if name.startswith("refused")])


if __name__ == "__main__":
    main()
