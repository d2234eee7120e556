"""Queries: volumes and wrenches of poses, against brute force and solids.

Usage: query_test.py PATH_OF_PALPATE"""

import json
import math
import os
import struct

import contact_truth
from cli_case import CommandLineCase, INTRINSICS, main, palpate, read
from made_files import bumpy_wall, write_depth_png, write_ply


class Queries(CommandLineCase):

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

    def test_standard_deviations_by_the_noise(self):
        query = ("query", self.tool, "--depth", os.path.join(self.frames, "000.png"), "--depth-unit", 0.0001,
                 "--intrinsics", INTRINSICS, "--pose", "0 0 0.49 0 0 0 1")
        plain = json.loads(self.succeed(*query, "--json"))["results"][0]
        noise = ("--set", "surface.noise_at_zero=0.001")
        said = json.loads(self.succeed(*query, *noise, "--std", "--json"))["results"][0]
        self.assertNotIn("volume_std", plain)
        self.assertEqual([said[key] for key in ("volume", "force", "torque")],
                         [plain[key] for key in ("volume", "force", "torque")])
        self.assertGreater(said["volume_std"], 0)
        self.assertLess(said["volume_std"], said["volume"])
        for key in ("force_std", "torque_std"):
            self.assertEqual(len(said[key]), 3)
            self.assertTrue(all(number > 0 for number in said[key]))
        twice = json.loads(self.succeed(*query, "--set", "surface.noise_at_zero=0.002", "--std", "--json"))
        self.assertGreater(twice["results"][0]["volume_std"], 1.5 * said["volume_std"])
        self.assertIn("+-", self.succeed(*query, "--std"))
        refused = palpate(*query, "--std", "--method", "graph")
        self.assertEqual(refused.returncode, 2)
        self.assertIn("--std is for the method field: graph does not", refused.stderr)

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

    def test_clearance_before_a_wall(self):
        """The distance to a wall, its sphere and its gradient; not with points."""
        wall = self.path("clear.png")
        write_depth_png(wall, 320, 240, lambda u, v: 8000)
        query = ("query", self.tool, "--intrinsics", "262,262,159.5,119.5", "--depth-unit", "0.0001",
                 "--depth", wall, "--clearance", "--json", "--pose")
        spheres = json.loads(self.succeed(*query, "0 0 0.7 0 0 0 1"))["results"][0]
        nearer = json.loads(self.succeed(*query, "0 0 0.71 0 0 0 1"))["results"][0]
        self.assertAlmostEqual(spheres["clearance"] - nearer["clearance"], 0.01, places=5)
        self.assertEqual(spheres["nearest"], nearer["nearest"])
        for value, desired in zip(spheres["clearance_gradient"][:3], (0, 0, -1)):
            self.assertAlmostEqual(value, desired, places=4)
        self.assertEqual(len(spheres["clearance_gradient"]), 6)
        self.expect_failure(1, *query, "0 0 0.7 0 0 0 1", "--method", "graph", mentions="not with graph")

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

    def test_points_in_millimeters_are_doubted(self):
        meters, millimeters = (self.path(f"{name}.ply") for name in ("meters", "millimeters"))
        write_ply(meters, bumpy_wall())
        write_ply(millimeters, [(*(1000 * c for c in p[:3]), *p[3:]) for p in bumpy_wall()])
        query = ("query", self.tool, "--pose", "0 0 0.478 0 0 0 1", "--method", "weighted", "--cloud")
        for cloud, is_doubted in ((meters, False), (millimeters, True)):
            result = palpate(*query, cloud)
            self.assertEqual(result.returncode, 0, result.stderr)
            for words in ("m away in the middle: are they in meters?", "--camera 'folder:FOLDER?scale=METERS'"):
                self.assertEqual(words in result.stderr, is_doubted, result.stderr)

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
        for a, b in zip(contact_truth.center_of_mass(spheres), info["center_of_mass"]):
            self.assertAlmostEqual(a, b, delta=1e-12)
        mesh = self.path("again.ply")
        self.succeed("export", self.tool, "--mesh", mesh)
        again = json.loads(
            self.succeed("pack", mesh, "-o", self.path("again.palp"), "--spheres", 120, "--json"))
        self.assertEqual(again["sphere_volume"], info["sphere_volume"])

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

    def query_caps(self, tool, picture, *options):
        """The volume that the query reports."""
        document = json.loads(self.succeed(
            "query", tool, "--cloud", self.path("wall.ply"), "--pose", "0 0 0.478 0.2 0.1 0 1",
            "--caps", picture, "--json", *options))
        self.assertEqual(document["caps"], picture)
        return document["results"][0]["volume"]

    def solid_volume(self, picture):
        """Returns the volume of a mesh file: packing reads it and refuses open meshes."""
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
                # The facets of a ball miss a share of 16.4 / 60^2, those of a cap up to 20 / 60^2.
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


if __name__ == "__main__":
    main()
