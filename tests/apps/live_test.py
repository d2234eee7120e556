"""One live run in which everything happens at once: two cameras, bodies that move, pages that come and
go, settings that change, a recording in parts. The thread sanitizer looks at it in `make tsan`.

Usage: live_test.py PATH_OF_PALPATE    PALPATE_LIVE_SECONDS=60: as long as that"""

import json
import os
import pathlib
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

from page_client import Page

PALPATE = sys.argv.pop(1)
SECONDS = float(os.environ.get("PALPATE_LIVE_SECONDS", 5))
# Limits so wide that a busy machine does not end the run.
PATIENT = ("[safety]\nmax_contact_age = 60\nmax_sensor_age = 60\nmax_tick = 60\n"
           "max_device_silence = 60\nenergy_tank = 100\n")
CHANGES = [("coupling.stiffness", 300), ("coupling.stiffness", 600), ("time.mode", "predict"),
           ("time.mode", "interpolate"), ("coupling.kind", "proxy"), ("coupling.kind", "virtual"),
           ("loop.binning", 2), ("loop.binning", 1), ("loop.spheres", 60), ("loop.spheres", 0),
           ("bodies.friction", 0.3), ("objects.box.friction", 0.1), ("objects.box.friction", "auto"),
           ("objects.box_3.friction", 0.8)]
OTHERS = ["pause", "step", "resume", "force", {"command": "mark", "text": "a word"},
          {"command": "get", "what": "spheres"}, {"command": "get", "what": "objects"}]


def palpate(*arguments):
    return subprocess.run([PALPATE, *map(str, arguments)], capture_output=True, text=True, timeout=900)


class Live(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="palpate-live-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.tool, self.block = self.pack("octahedron", 0.08, 200), self.pack("box", 0.05, 100)
        self.settings = self.folder / "patient.toml"
        self.settings.write_text(PATIENT)
        self.is_ending, self.is_over = threading.Event(), threading.Event()
        self.answers, self.pages = [], []  # ok or not; all that there were
        self.num_dropped = self.seconds = 0  # pages; of the run, as they were told

    def pack(self, shape, size, spheres):
        mesh, tool = self.folder / f"{shape}.ply", self.folder / f"{shape}.palp"
        for arguments in (("shape", shape, "--size", size, "-o", mesh),
                          ("pack", mesh, "--spheres", spheres, "-o", tool)):
            done = palpate(*arguments)
            self.assertEqual(done.returncode, 0, done.stderr)
        return tool

    def watch(self, address, seed):
        """Pages that look at all there is, turn settings, and go without a word."""
        choose = random.Random(seed)
        while not self.is_over.is_set():
            try:
                with Page(address) as page:
                    self.pages.append(page)
                    page.send({"id": 1, "command": "show", "frames": True, "contacts": True,
                               "surfaces": True, "samples": True})
                    enough = choose.randint(2, 30)
                    while page.num_pictures < enough and not self.is_over.is_set():
                        message = page.receive()
                        if not message:
                            continue
                        if message["type"] == "answer":
                            self.answers.append(message["ok"])
                        if message["type"] == "state" and message["running"]:
                            self.seconds = message["time"]
                            page.send({"id": 2, **self.wish(choose)})
            except (OSError, ValueError):  # the run ends, or this page was too slow
                if not self.is_ending.wait(5):
                    self.num_dropped += 1
                self.is_over.wait(0.1)

    def num_pictures(self):
        return sum(page.num_pictures for page in self.pages)

    def kinds(self):
        return set().union(*(page.kinds for page in self.pages))

    def have_seen_enough(self):
        # Frames, contacts, normals, samples; spheres and objects were asked for.
        return (len(self.pages) - self.num_dropped > 2 and self.num_pictures() > 5
                and self.answers.count(True) > 5 and self.kinds() >= {1, 5, 10, 11, 12, 20})

    def end_in_time(self, program):
        """Once the pages have seen enough, which may take long on a busy machine."""
        while program.poll() is None and not (self.seconds >= SECONDS and self.have_seen_enough()):
            time.sleep(0.05)
        self.is_ending.set()
        program.send_signal(signal.SIGINT)
        program.wait()
        self.is_over.set()

    @staticmethod
    def wish(choose):
        if choose.random() < 0.5:
            key, value = choose.choice(CHANGES)
            return {"command": "set", "key": key, "value": value}
        wish = choose.choice(OTHERS)
        return wish if isinstance(wish, dict) else {"command": wish}

    def test_everything_at_once(self):
        run = self.folder / "run"
        scene = "scene:hand?size=160x120"
        arguments = ["touch", self.tool, "--camera", scene, "--camera",
                     f"{scene}&pose=0.02,0,0,0,0,0,1", "--device", "sim", "--duration", SECONDS + 600,
                     "--settings", self.settings, "--set", "bodies.gravity_y=0", "--set",
                     "bodies.gravity_z=9.81", "--record-split", "1MB", "--view", "--view-port", 0,
                     "-o", run]
        for k in range(4):
            arguments += ["--object", f"{self.block}@{0.1 * k - 0.15} 0.05 0.9 0 0 0 1,moving,mass=0.3"]
        program = subprocess.Popen([PALPATE, *map(str, arguments)], stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, text=True)
        self.addCleanup(program.communicate)
        self.addCleanup(program.kill)
        said = ""
        while not (found := re.search(r"open (http://\S+?)/? in a browser", said)):
            line = program.stdout.readline()
            self.assertTrue(line, said)
            said += line
        failures = []

        def watch(seed):
            try:
                self.watch(found.group(1), seed)
            except BaseException as error:  # told by the test, not by a thread
                failures.append(repr(error))

        pages = [threading.Thread(target=watch, args=(seed,)) for seed in (1, 2)]
        for page in pages:
            page.start()
        threading.Thread(target=self.end_in_time, args=(program,)).start()
        output = program.communicate(timeout=SECONDS + 1800)[0]
        self.is_over.set()
        for page in pages:
            page.join()
        self.assertEqual(program.returncode, 0, output)
        self.assertNotIn("ThreadSanitizer", output)
        self.assertEqual(failures, [], output)
        # Pages that read too slowly are dropped: on two cores under a sanitizer, half of them and more.
        if b"__tsan_init" not in pathlib.Path(PALPATE).read_bytes():
            self.assertLess(2 * self.num_dropped, len(self.pages), output)
        self.assertGreater(len(self.pages) - self.num_dropped, 2, output)
        self.assertTrue(self.have_seen_enough(), (self.num_pictures(), self.answers, self.kinds(), output))
        summary = json.loads((run / "summary.json").read_text())
        self.assertGreaterEqual(summary["seconds"], SECONDS - 0.1)
        parts = list(run.glob("recording*.mcap"))
        replay = palpate("replay", run, "--json")
        self.assertEqual(replay.returncode, 0, replay.stderr)
        verdict = json.loads(replay.stdout)
        self.assertTrue(verdict["identical"], replay.stdout)
        print(f"{SECONDS:.0f} s: {summary['ticks']} ticks, {self.num_pictures()} pictures of {len(self.pages)} pages, "
              f"{self.answers.count(True)} commands of {len(self.answers)} obeyed, {len(parts)} parts, "
              f"{verdict['ticks']} ticks repeated", file=sys.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
