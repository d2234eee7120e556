"""Fixture of the command line tests: the program, a tool, frames of depth, programs that run and end.

Usage of each: TEST.py PATH_OF_PALPATE"""

import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

from made_files import write_depth_png

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../test_util"))
import parts  # noqa: E402

PALPATE = os.path.abspath(sys.argv.pop(1))
INTRINSICS = "200,200,79.5,59.5"


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


class CommandLineCase(unittest.TestCase):

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

    def report_data(self, run):
        """The data inside the report of a run."""
        path = os.path.join(run, "report.html")
        if not os.path.exists(path):
            self.skipTest("this build has no pages")
        return page_data(path)

    def columns(self, run):
        lines = [line.split(",") for line in read(os.path.join(run, "wrench.csv")).splitlines()]
        return {name: [float(line[i]) for line in lines[1:]] for i, name in enumerate(lines[0])}

    def expect_whole(self, run):
        summary = json.loads(read(os.path.join(run, "summary.json")))
        self.assertTrue(os.path.exists(os.path.join(run, "report.html")))
        self.assertEqual(summary["not_kept"], "")
        self.assertIn("identical: ", self.succeed("replay", run))
        return summary

    def interrupt(self, arguments, is_ready, how=signal.SIGINT):
        """Runs the program and signals it once `is_ready(seconds since it has a handler)`; returns how it ended."""
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
        """True if a program has installed a handler of the signal."""
        caught = re.search(r"^SigCgt:\s*(\w+)", read(f"/proc/{process.pid}/status"), re.MULTILINE)
        return int(caught.group(1), 16) >> (number - 1) & 1 == 1


def main():
    """All tests of the program that calls it, or those of its part."""
    unittest.main(testLoader=parts.Loader())
