"""Fixture of the tests of --camera: the program, a tool, a path, a bent wall.

Usage of each: TEST.py PATH_OF_PALPATE"""

import json
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "test_util"))
import parts  # noqa: E402, F401

PALPATE = sys.argv.pop(1)
WIDTH, HEIGHT = 160, 120
INTRINSICS = "200,200,79.5,59.5"


def palpate(*arguments, timeout=300, **more):
    return subprocess.run([PALPATE, *map(str, arguments)], capture_output=True, timeout=timeout,
                          **more)


def wall(number=0):
    """A wall at half a meter, bent a little, as counts of a millimeter."""
    return struct.pack(f"<{WIDTH * HEIGHT}H", *(500 + (u - 80) ** 2 // 400 + (v + number) % 2
                                                for v in range(HEIGHT) for u in range(WIDTH)))


def header(time_stamp, unit=0.001):
    return struct.pack("<8sIIdd", b"PALPDEP1", WIDTH, HEIGHT, time_stamp, unit)


class CameraCase(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="palpate_cameras_"))
        cls.tool = cls.folder / "tool.palp"
        mesh = cls.folder / "box.stl"
        cls.check(palpate("shape", "box", "--size", 0.06, "-o", mesh))
        cls.check(palpate("pack", mesh, "--spheres", 200, "-o", cls.tool))
        cls.path = cls.folder / "path.txt"
        cls.path.write_text("0 0 0 0.45 0 0 0 1\n0.5 0 0 0.49 0 0 0 1\n1 0 0 0.49 0 0 0 1\n")

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    @staticmethod
    def check(done):
        if done.returncode != 0:
            raise AssertionError(done.stderr.decode())
        return done

    def refused(self, words, *arguments, status=1, **more):
        done = palpate(*arguments, **more)
        self.assertEqual(done.returncode, status, done.stderr)
        message = done.stderr.decode()
        self.assertEqual(message.count("\n"), 1, message)
        self.assertIn(words, message)
        self.assertEqual(done.stdout, b"")

    def run_folder(self):
        return self.folder / self.id().rsplit(".", 1)[1]

    def summary(self, run):
        return json.loads((run / "summary.json").read_text())
