"""Drives the real program with files as others leave them: databases that were not closed, and the reports of users.

Usage: recordings_test.py PATH_OF_PALPATE"""

import json
import os
import pathlib
import shutil
import sqlite3
import unittest

import bags_test
from camera_case import CameraCase, palpate

FIELD = pathlib.Path(os.environ.get("PALPATE_DATA") or pathlib.Path(__file__).resolve().parents[3] / "shared/data") / "field"
NOBODY = {"user": 65534, "group": 65534, "extra_groups": []}


def listing(folder):
    """Lists name, size and time of the files; without the time of -shm, which readers of SQLite change."""
    return sorted((each.name, each.stat().st_size, not each.name.endswith("-shm") and each.stat().st_mtime_ns)
                  for each in folder.iterdir())


class Databases(CameraCase):
    """Databases of rosbag2 in WAL mode: messages may lie beside the database, whose folder may be read-only."""
    write_bag = bags_test.Bags.write_bag

    def database(self, name):
        """Writes a closed database in WAL mode; returns its path and its messages."""
        try:
            import rosbags.rosbag2  # noqa: F401
        except ImportError:
            self.skipTest("there is no rosbags; scripts/setup.sh --test installs it")
        path = next(self.write_bag(name, plugin="SQLITE3").glob("*.db3"))
        database = sqlite3.connect(path)
        database.execute("PRAGMA journal_mode = WAL")
        rows = database.execute("SELECT * FROM messages").fetchall()
        database.close()
        return path, rows

    def expect_read(self, path):
        """Expects that a database is read in a read-only folder too, and that no file appears or changes."""
        self.folder.chmod(0o755)
        before = listing(path.parent)
        query = ("query", self.tool, "--camera", f"bag:{path}", "--pose", "0 0 0.49 0 0 0 1", "--json")
        for mode, more in ((0o755, {}), (0o555, NOBODY if os.geteuid() == 0 else {})):
            path.parent.chmod(mode)
            done = palpate(*query, **more)
            path.parent.chmod(0o755)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertGreater(json.loads(done.stdout)["results"][0]["fraction"], 0.1)
            self.assertEqual(listing(path.parent), before)

    def test_closed_ones_are_read_where_nothing_can_be_written(self):
        path, _ = self.database("closed")
        self.assertEqual(path.read_bytes()[18:20], b"\2\2")
        self.expect_read(path)
        strange = path.parent / "100%25 #1.db3"
        path.rename(strange)
        (path.parent / "metadata.yaml").unlink()
        self.expect_read(strange)

    def test_messages_that_were_left_beside_are_read(self):
        path, rows = self.database("left")
        database = sqlite3.connect(path)
        database.execute("DELETE FROM messages")
        database.commit()
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        database.execute("PRAGMA wal_autocheckpoint = 0")
        database.executemany(f"INSERT INTO messages VALUES ({', '.join('?' * len(rows[0]))})", rows)
        database.commit()
        for name, endings in (("killed", ("", "-wal", "-shm")), ("copied", ("", "-wal"))):
            folder = self.folder / name
            folder.mkdir()
            for ending in endings:
                shutil.copy(f"{path}{ending}", folder)
            self.expect_read(folder / path.name)
        database.close()


class Reports(CameraCase):
    """The inputs of users' reports, each with what is right about it."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.box = cls.folder / "box.palp"
        mesh = cls.folder / "box.ply"
        cls.check(palpate("shape", "box", "--size", 0.1, "-o", mesh))
        cls.check(palpate("pack", mesh, "--spheres", 2000, "-o", cls.box))

    def file(self, name):
        if not (FIELD / name).exists():
            self.skipTest(f"SKIPPED: no real data for {name} (set PALPATE_DATA)")
        return FIELD / name

    def query(self, *arguments):
        done = self.check(palpate("query", self.box, *arguments, "--json"))
        return json.loads(done.stdout)["results"][0], done.stderr.decode()

    def test_recordings_are_read(self):
        pose = ("--pose", "0.05 0 0.99 0 0 0 1")
        expected = self.query(*pose, "--camera", f"bag:{self.file('32-zstd-without-size/e.mcap')}")[0]["fraction"]
        self.assertAlmostEqual(expected, 0.22, delta=0.001)
        for name in ("32-zstd-without-size/a.mcap", "32-zstd-without-size/b.mcap", "03-message-zstd/message_mcap",
                     "04-fisheye-beside-depth/both", "05-info-of-color-only/a", "06-png-by-compressed/a",
                     "28-database-not-closed/d", "33-ros1-in-mcap/a.mcap"):
            result, said = self.query(*pose, "--camera", f"bag:{self.file(name)}")
            self.assertEqual(result["fraction"], expected, name)
            self.assertNotIn("left out", said, name)
        result, said = self.query(*pose, "--camera", f"bag:{self.file('35-first-message-bad/a')}")
        self.assertEqual(result["fraction"], expected)
        self.assertIn("a message is left out: a depth image is damaged", said)

    def test_parts_are_one_recording(self):
        folder, all_of_it = self.file("01-split-recording/split_mcap"), self.folder / "all.mcap"
        done = self.check(palpate("record", "--camera", f"bag:{folder}?world=base", "-o", all_of_it, "--json"))
        self.assertEqual(json.loads(done.stdout)["frames_of"], [9])

    def test_recordings_are_refused_by_what_they_are(self):
        for name, words in (("02-mcap-zstd/folder", "compressed as a whole; unpack it with 'zstd -d'"),
                            ("02-mcap-zstd/folder/whole_0.mcap.zstd", "compressed as a whole"),
                            ("05-info-of-color-only/b", "pass ?info=/TOPIC (/camera/color/camera_info) or ?intrinsics="),
                            ("06-png-by-compressed/c", "is a JPEG, which keeps 8 bits and so has lost the depth"),
                            ("10-odd-quaternions/c?world=base", "its quaternion is not 1 long, as 0 0 0 0")):
            self.file(name.split("?")[0])
            self.refused(words, "query", self.box, "--camera", f"bag:{FIELD / name}", "--pose", "0 0 1 0 0 0 1")

    def test_normals_are_turned(self):
        pose = ("--pose", "0 0 0.99 0 0 0 1", "--method", "weighted")
        right, said = self.query("--cloud", self.file("21-clouds/g.pcd"), *pose)
        self.assertIn("its VIEWPOINT is (0, 0, 0.2)", said)
        turned, said = self.query("--cloud", self.file("21-clouds/j.ply"), *pose)
        self.assertIn("% of its normals pointed away from the camera", said)
        self.assertEqual(turned["fraction"], right["fraction"])
        self.assertLess(turned["force"][2], 0)

    def test_meshes_and_paths(self):
        for name in ("empty_second", "upper"):
            done = self.check(palpate("pack", self.file(f"31-odd-stl/{name}.stl"), "-o", self.folder / "x.palp",
                                      "--spheres", 100, "--json"))
            self.assertAlmostEqual(json.loads(done.stdout)["mesh_volume"], 125e-6, delta=1e-9)
        self.refused("needs the extension KHR_mesh_quantization", "pack",
                     self.file("19-gltf-mirrored/q_short_norm.glb"), "-o", self.folder / "never.palp")
        self.refused("needs the extension KHR_mesh_quantization", "record", "--camera", "scene:wall", "--robot",
                     self.file("19-gltf-mirrored/q.urdf"), "--duration", 0.1, "-o", self.folder / "never.mcap")
        self.refused("as if in nanoseconds", "touch", self.tool, "--camera", "scene:wall", "--path",
                     self.file("29-trajectories/c.txt"), "-o", self.folder / "never")


if __name__ == "__main__":
    unittest.main()
