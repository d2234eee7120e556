"""Fixture of the tests of palpate among peers of ROS 2."""

import fcntl
import glob
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest

PALPATE = sys.argv.pop(1)
HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
HAS_CYCLONE = importlib.util.find_spec("cyclonedds") is not None
NO_CYCLONE = "SKIPPED: scripts/setup.sh --test installs the Python package cyclonedds"
NEWER = glob.glob(f"{ROOT}/build/python/lib/python3*/site-packages/cyclonedds/.libs/libddsc.so")
sys.path.insert(0, os.path.join(ROOT, "tests/test_util"))
import parts  # noqa: E402, F401


def domains():
    """Domains that no test beside this one has: each stays locked until the process ends."""
    locked = []
    for number in range(80):
        domain = 10 + (os.getpid() + number) % 80
        locked.append(open(f"{tempfile.gettempdir()}/palpate-domain-{domain}", "w", encoding="ascii"))
        try:
            fcntl.flock(locked[-1], fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            continue
        yield domain


def heard(robot):
    """Returns the notes of a robot so far: that it has begun, that it has seen enough."""
    return os.pread(robot.notes.fileno(), 65536, 0).decode(errors="replace").splitlines()


def has_enough(robot):
    return "enough" in heard(robot)


class PeerCase(unittest.TestCase):
    free_domains = domains()

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.tool = os.path.join(cls.folder.name, "ball.palp")
        mesh = os.path.join(cls.folder.name, "ball.obj")
        for words in (["shape", "sphere", "--size", "0.05", "-o", mesh],
                      ["pack", mesh, "-o", cls.tool, "--spheres", "300"]):
            subprocess.run([PALPATE, *words], check=True, capture_output=True)
        found = subprocess.run([PALPATE, "cameras", "--json"], check=True, capture_output=True,
                               env={key: value for key, value in os.environ.items()
                                    if not key.startswith("ROS_")})
        cls.reason = next((each["reason"] for each in json.loads(found.stdout)
                           if each["kind"] == "ros2" and not each["usable"]), None)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def setUp(self):
        if self.reason:
            self.skipTest("SKIPPED: " + self.reason)
        # Tests that overlap do not hear each other.
        self.domain = next(self.free_domains)

    def start(self, peer):
        """A robot that is there: on a busy computer it takes long to load what it needs."""
        notes = tempfile.TemporaryFile()
        self.addCleanup(notes.close)
        robot = subprocess.Popen([str(word) for word in peer], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                 stderr=notes, text=True)
        self.addCleanup(robot.kill)
        robot.notes = notes
        deadline = time.monotonic() + 120
        while "begun" not in heard(robot):
            self.assertTrue(robot.poll() is None and time.monotonic() < deadline, heard(robot))
            time.sleep(0.02)
        return robot

    def converse(self, peer, *options, depth="/camera/depth/image_raw", tool=("--pose", "/tool_pose"),
                 duration=4, until=None, words=None, writes=True, statuses=(0,), **environment):
        """Runs palpate with a peer; returns the peer's observations and palpate's errors. `until`: condition on the
        peer that ends the run, instead of a duration. `words`: instead of palpate ros2. `writes`: takes a folder of
        output. `statuses`: allowed exit statuses of palpate. Leaves palpate's memory in use, MB, every tenth of a second."""
        robot = self.start(peer)
        try:
            run = subprocess.Popen(
                [PALPATE, *(words or ["ros2", self.tool, "--depth", depth, *tool]),
                 *(["-o", os.path.join(self.folder.name, "run")] if writes else []), "--duration", str(120 if until else duration), *options],
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                env={**os.environ, "ROS_DOMAIN_ID": str(self.domain), "ROS_LOCALHOST_ONLY": "1",
                     **environment})
            notes = self.watch_memory(run, lambda: until and until(robot))
        finally:
            said, _ = robot.communicate(timeout=60)
        self.assertIn(run.returncode, statuses, notes)
        self.assertTrue(said, heard(robot))
        return json.loads(said), notes

    def watch_memory(self, run, is_enough):
        """Returns a program's standard error; interrupts the program once `is_enough` is true."""
        self.megabytes, was_asked = [], False
        for _ in range(3000):
            try:
                return run.communicate(timeout=0.1)[1]
            except subprocess.TimeoutExpired:
                with open(f"/proc/{run.pid}/status", encoding="ascii") as status:
                    used = [int(line.split()[1]) / 1024 for line in status if line.startswith("VmRSS")]
                self.megabytes += used
            if not was_asked and is_enough():
                was_asked = True
                run.send_signal(signal.SIGINT)
        run.kill()
        return run.communicate()[1]

    def cyclone(self, behavior="good", peer="cyclone_peer.py", *more):
        if not HAS_CYCLONE:
            self.skipTest(NO_CYCLONE)
        return [sys.executable, os.path.join(HERE, peer), self.domain, behavior, *more]

    def expect_one_note(self, words, said):
        self.assertEqual(said.count(words), 1, said)
