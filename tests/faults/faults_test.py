"""The real program while the system fails it, and killed at any moment.

Whatever happens: an end within its time; exit status 0 with whole results, or 1 with a sentence; no
file under its final name that is not whole; what was recorded repeats to the bit.

usage: faults_test.py PALPATE FAULTS_LIBRARY    PALPATE_KILLS=200: as many moments to be killed at
                                                PALPATE_PLANS=200: as many plans made by chance;
                                                100-200: of these, those from the 100th on
                                                PALPATE_KEEP=1: leaves what a failed test worked on"""

import collections
import contextlib
import json
import os
import pathlib
import random
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
import urllib.request
import zlib

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../test_util"))
import parts  # noqa: E402

PALPATE = FAULTS = None
KILLS = int(os.environ.get("PALPATE_KILLS", 6))
FIRST_PLAN, _, END_OF_PLANS = ("0-" + os.environ.get("PALPATE_PLANS", "6")).rpartition("-")
FIRST_PLAN, END_OF_PLANS = int(FIRST_PLAN.split("-")[-1]), int(END_OF_PLANS)
# What a busy machine must not end is no fault here.
PATIENT = ("[safety]\nmax_contact_age = 60\nmax_sensor_age = 60\nmax_tick = 60\n"
           "max_device_silence = 60\nenergy_tank = 100\n")


def run(*arguments, faults="", timeout=300):
    environment = dict(os.environ)
    if faults:
        environment.update(LD_PRELOAD=FAULTS, PALPATE_FAULTS=faults)
    return subprocess.run([PALPATE, *map(str, arguments)], capture_output=True, text=True,
                          timeout=timeout, env=environment)


class Case(unittest.TestCase):

    def setUp(self):
        self.maxDiff = None
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="palpate-faults-"))
        if not os.environ.get("PALPATE_KEEP"):
            self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.mesh, self.tool = self.folder / "box.ply", self.folder / "box.palp"
        self.settings = self.folder / "patient.toml"
        self.settings.write_text(PATIENT)
        for arguments in (("shape", "octahedron", "--size", 0.08, "-o", self.mesh),
                          ("pack", self.mesh, "-o", self.tool, "--spheres", 200)):
            self.assertEqual(run(*arguments).returncode, 0)

    def path_run(self, output, duration=0.3):
        return ("touch", self.tool, "--scene", "wall", "--duration", duration, "-o", output)

    def live_run(self, output, duration=0.5, is_patient=True):
        settings = ("--settings", self.settings) if is_patient else ()
        return ("touch", self.tool, "--scene", "wall", "--device", "sim", "--duration", duration,
                *settings, "-o", output)

    def check(self, arguments, faults, may_fail=True, timeout=300):
        """Runs it; returns the exit status."""
        result = run(*arguments, faults=faults, timeout=timeout)
        self.last_error, self.last_output = result.stderr, result.stdout
        self.assertNotIn("LD_PRELOAD", result.stderr)  # the library is there
        told = f"{arguments[0]} under {faults}: {result.returncode}, {result.stderr}"
        self.assertIn(result.returncode, (0, 1) if may_fail else (0,), told)
        if result.returncode == 1:
            last = result.stderr.strip().splitlines()[-1:]
            self.assertTrue(last and last[0].startswith("palpate: "), told)
            self.assertGreater(len(last[0]), 20, told)
        return result.returncode

    def check_run(self, folder):
        """What lies in the folder of a run is whole, and repeats. Returns the number of ticks."""
        for name in ("summary.json",):
            if (folder / name).exists():
                json.loads((folder / name).read_text())
        if (folder / "report.html").exists():
            self.assertTrue((folder / "report.html").read_text().rstrip().endswith("</html>"))
        if (folder / "wrench.csv").exists():
            self.assertTrue((folder / "wrench.csv").read_text().endswith("\n"))
        if not list(folder.glob("recording*.mcap")):
            return 0
        replay = run("replay", folder, "--json")
        if replay.returncode == 0:
            verdict = json.loads(replay.stdout)
            self.assertTrue(verdict["identical"])
            return verdict["ticks"]
        # Killed before its first half second: there is nothing yet.
        self.assertRegex(replay.stderr, "no tick|not an MCAP file|cut off|no settings|not the recording"
                         "|is empty|holds no|has no frames", folder)
        return 0

    def summary(self, folder):
        return json.loads((folder / "summary.json").read_text())


class BusyComputer(Case):

    def test_a_computer_whose_cores_are_all_busy_does_not_end_a_run(self):
        """Two loops for every core; half of them walk through 64 MB each, so that caches are of no use."""
        compute = "while True: pass"
        walk = "b = bytearray(1 << 26)\nwhile True:\n for i in range(0, len(b), 64): b[i] ^= 1"
        busy = [subprocess.Popen([sys.executable, "-c", body])
                for _ in range(os.cpu_count()) for body in (compute, walk)]
        try:
            output = self.folder / "busy"
            self.check(self.live_run(output, 6, is_patient=False), "", may_fail=False)
        finally:
            for process in busy:
                process.kill()
                process.wait()
        summary = self.summary(output)
        self.assertGreaterEqual(summary["seconds"], 5.9)
        self.assertEqual(summary["ending"], "")
        self.assertGreater(self.check_run(output), 0)


class Faults(Case):

    def test_interruptions_and_short_steps_change_nothing(self):
        for faults in ("short", "interrupted", "short,interrupted"):
            tool, output = self.folder / "again.palp", self.folder / faults.replace(",", "-")
            self.check(("pack", self.mesh, "-o", tool, "--spheres", 200), faults, may_fail=False)
            self.assertEqual(tool.read_bytes(), self.tool.read_bytes())
            self.check(self.path_run(output), faults, may_fail=False)
            self.assertGreater(self.check_run(output), 200)
            self.check(("replay", output), faults, may_fail=False)

    def test_files_that_cannot_be_given_a_name_have_one_from_the_beginning(self):
        tool, output = self.folder / "again.palp", self.folder / "nameless"
        for _ in range(2):  # new, then in place of another
            self.check(("pack", self.mesh, "-o", tool, "--spheres", 200), "nameless", may_fail=False)
            self.assertEqual(tool.read_bytes(), self.tool.read_bytes())
        self.check(self.path_run(output), "nameless", may_fail=False)
        self.assertGreater(self.check_run(output), 200)
        self.assertEqual([*self.folder.rglob("*.part")], [])

    def test_disks_that_fail(self):
        for kind in ("full", "broken"):
            for begin in (1, 2, 3, 5, 9):
                faults, tool = f"{kind}@{begin}", self.folder / "never.palp"
                if self.check(("pack", self.mesh, "-o", tool, "--spheres", 50), faults) != 0:
                    self.assertFalse(tool.exists())
                tool.unlink(missing_ok=True)
                output = self.folder / f"{kind}-{begin}"
                status = self.check(self.path_run(output), faults)
                if status == 0:
                    self.assertGreater(self.check_run(output), 0)
                elif output.exists():
                    self.check_run(output)
                self.assertEqual(list(self.folder.glob("*.part")), [])
        for begin in (1, 2, 4, 8):
            self.check(("info", self.tool), f"unreadable@{begin}")

    def test_a_live_run_on_a_disk_that_fails_goes_on(self):
        for faults, status in (("full@3", 1), ("full@7", 1), ("broken@3", 1), ("broken@7", 1), ("sluggish", 0)):
            output = self.folder / faults
            # What could not be kept is no success, and nobody is sent to a report that is not there.
            self.assertEqual(self.check(self.live_run(output, 2), faults), status, self.last_error)
            self.check_run(output)
            told = "report: " in self.last_output
            self.assertEqual(told, (output / "report.html").exists(), self.last_output)

    def test_a_disk_that_takes_seconds_holds_up_no_record(self):
        def is_whole():
            output = self.folder / "lazy"
            self.check(self.live_run(output, 4), "lazy", may_fail=False)
            self.check_run(output)
            return "records were lost" not in self.last_error
        # A computer that is busy itself may lose some.
        self.assertTrue(any(is_whole() for _ in range(3)), self.last_error)

    def test_nor_does_it_where_a_part_of_a_recording_ends(self):
        def is_whole():
            output = self.folder / "lazy-parts"
            self.check(self.live_run(output, 4.5) + ("--record-keep", "20s"), "lazy", may_fail=False)
            self.assertGreater(self.check_run(output), 0)
            self.assertGreaterEqual(len(list(output.glob("recording*.mcap"))), 2)
            return "records were lost" not in self.last_error
        self.assertTrue(any(is_whole() for _ in range(3)), self.last_error)

    def test_what_does_not_reach_a_disk_is_told_and_kept(self):
        for begin, run_of in ((1, self.path_run), (1, self.live_run), (2, self.live_run)):
            output = self.folder / f"{run_of.__name__}-unsynced-{begin}"
            self.assertEqual(self.check(run_of(output, 3), f"unsynced@{begin}"), 1)
            self.assertRegex(self.last_error, "cannot bring .* to the disk: Input/output error")
            if begin > 1:  # until then it may not even have begun
                self.assertIn("it is not certain that anything was recorded from ", self.last_error)
                self.assertGreater(self.check_run(output), 0)
        stream, partial = self.folder / "stream.mcap", self.folder / "stream.mcap.partial"
        self.assertEqual(self.check(("record", "--camera", "scene:wall?size=32x24", "--duration", 0.2, "-o", stream),
                                    "unsynced@1"), 1)
        self.assertIn(f"what was recorded before is in {partial}", self.last_error)
        self.assertFalse(stream.exists())
        partial.rename(stream)
        self.check(("cameras", "--selftest", f"bag:{stream}"), "", may_fail=False)

    def test_no_threads_and_no_memory(self):
        for begin in (1, 2, 3, 4, 5):
            output = self.folder / f"threadless-{begin}"
            self.check(self.live_run(output, 0.2), f"threadless@{begin}")
            if output.exists():
                self.check_run(output)
        for begin in (1, 2, 3):
            output = self.folder / f"threadless-path-{begin}"
            self.check(self.path_run(output, 0.05), f"threadless@{begin}")
            if output.exists():
                self.check_run(output)
        for begin in (1, 2, 5, 10, 20):  # while things are set up
            output = self.folder / f"memoryless-{begin}"
            self.check(self.path_run(output, 0.05), f"memoryless@{begin}")
            if output.exists():
                self.check_run(output)

    def test_a_page_without_threads_or_memory_says_so(self):
        output = self.folder / "seen"
        self.assertEqual(run(*self.path_run(output, 1)).returncode, 0)
        num_refused = 0
        faults = [f"threadless@{begin}" for begin in (1, 2, 3, 4, 5)]
        faults += [f"memoryless@{begin}" for begin in (1, 2, 3, 5, 8, 10, 15, 20, 30, 50)]
        for fault in faults:
            process = subprocess.Popen(
                [PALPATE, "view", str(output), "--port", "0"], text=True, stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=dict(os.environ, LD_PRELOAD=FAULTS, PALPATE_FAULTS=fault))
            opened = process.stdout.readline()
            if opened:  # and it goes on: who asks is answered
                page = opened.split()[1]
                with contextlib.suppress(OSError):
                    urllib.request.urlopen(page, timeout=10).read()
                self.assertIsNone(process.poll(), fault)
                process.terminate()
            said = process.communicate(timeout=120)[1]
            self.assertEqual(process.returncode, 0 if opened else 1, f"{fault}: {said}")
            if not opened:
                num_refused += 1
                self.assertRegex(said, "^palpate: .{20,}\n$", fault)
        self.assertGreater(num_refused, 0)

    def test_memory_that_ends_in_the_middle_of_a_run(self):
        num_ended = 0
        for run_of in (self.path_run, self.live_run):
            for begin in (30, 45, 60, 80, 100, 130, 170):
                output = self.folder / f"{run_of.__name__}-{begin}"
                num_ended += self.check(run_of(output, 2), f"memoryless@{begin}")
                if output.exists():
                    self.check_run(output)
        self.assertGreater(num_ended, 0)

    def test_a_recording_goes_on_when_the_disk_has_space_again(self):
        output = self.folder / "gap"
        self.assertEqual(self.check(self.live_run(output, 8), "full@8-9"), 1)
        self.assertIn("nothing was recorded from", self.last_error)
        self.assertGreaterEqual(len(list(output.glob("recording*.mcap"))), 2)
        self.assertGreater(self.check_run(output), 1000)
        self.check_viewable(output)

    def test_a_calendar_that_jumps_is_not_felt(self):
        plain, jumped = self.folder / "plain", self.folder / "jumped"
        self.check(self.path_run(plain), "", may_fail=False)
        self.check(self.path_run(jumped), "yesterday@2", may_fail=False)
        self.assertEqual((plain / "wrench.csv").read_bytes(), (jumped / "wrench.csv").read_bytes())
        self.check(self.live_run(self.folder / "live"), "yesterday@2", may_fail=False)
        self.assertGreater(self.check_run(self.folder / "live"), 0)

    def test_a_process_that_stands_still_fades_and_can_be_repeated(self):
        for is_patient, pauses in ((True, (0.1, 0.5, 1)), (False, (0.3, 3))):
            output = self.folder / f"stopped-{is_patient}"
            process = subprocess.Popen(
                [PALPATE, *map(str, self.live_run(output, 8, is_patient))],
                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            self.wait_for(output / "recording.mcap", process)
            for pause in pauses:
                time.sleep(0.5)
                process.send_signal(signal.SIGSTOP)
                time.sleep(pause)
                process.send_signal(signal.SIGCONT)
            told = process.communicate(timeout=300)[1]
            # It is told and the run goes on: its own time is what ends it.
            self.assertEqual(process.returncode, 0, told)
            self.assertGreater(self.check_run(output), 0)
            if not is_patient:
                self.assertNotEqual(self.summary(output)["faults"], [])

    def test_little_address_space_is_a_sentence(self):
        """As under `ulimit -v`: whoever asks for more is refused, wherever that is."""
        num_refused = num_whole = 0
        for megabytes in (160, 320, 448, 512, 1024):
            def limit(most=megabytes << 20):
                resource.setrlimit(resource.RLIMIT_AS, (most, most))

            def limited(*arguments):
                return subprocess.run([PALPATE, *map(str, arguments)], capture_output=True,
                                      text=True, timeout=300, preexec_fn=limit)

            if limited("--version").returncode != 0:
                continue  # the loader's own end
            for run_of in (self.path_run, self.live_run):
                output = self.folder / f"{run_of.__name__}-{megabytes}"
                done = limited(*run_of(output, 0.2))
                told = f"{run_of.__name__} in {megabytes} MB: {done.returncode}, {done.stderr}"
                self.assertIn(done.returncode, (0, 1), told)
                if done.returncode == 1:
                    num_refused += 1
                    self.assertRegex(done.stderr.strip().splitlines()[-1], "^palpate: .{20,}", told)
                else:
                    num_whole += 1
                    self.assertGreater(self.check_run(output), 0, told)
        self.assertGreater(num_refused, 0)
        self.assertGreater(num_whole, 0)

    def test_plans_made_by_chance(self):
        """Several faults at once, each from a call that is chosen by chance."""
        choose = random.Random(11)
        num_ticks, endings, kinds = 0, collections.Counter(), collections.Counter()
        for number in range(END_OF_PLANS):
            plan = [f"{kind}@{choose.randint(1, most)}" for kind, most in
                    (("short", 1), ("interrupted", 1), ("full", 200), ("broken", 200), ("unreadable", 30),
                     ("slow", 1), ("threadless", 12), ("memoryless", 200), ("yesterday", 20))
                    if choose.random() < 0.25]
            plan = [each + f"-{int(each.split('@')[1]) + choose.randint(0, 3)}"
                    if each.startswith(("full", "broken")) and choose.random() < 0.5 else each for each in plan]
            run_of, seconds = choose.choice((self.path_run, self.live_run)), choose.uniform(0.1, 2)
            if number < FIRST_PLAN:
                continue
            output = self.folder / f"chance-{number}"
            with self.subTest(plan=",".join(plan), run=run_of.__name__):
                # Short writes on a slow disk take 200 ms for a third of what is left.
                failed = self.check(run_of(output, seconds), ",".join(plan), timeout=1800)
                kinds.update(each.split("@")[0] for each in plan)
                for folder in self.folder.glob(f"chance-{number}*"):
                    num_ticks += self.check_run(folder)
                    shutil.rmtree(folder)
                # What was said, without what differs from run to run.
                last = self.last_error.strip().splitlines()[-1] if failed else "whole"
                endings[re.sub(r"/\S*|[0-9.]+", "...", last)] += 1
        print(f"{endings.total()} plans of {dict(kinds)}: {endings['whole']} runs ended with all results, "
              f"{endings.total() - endings['whole']} with a sentence; {num_ticks} ticks repeated", file=sys.stderr)
        for said, num in endings.most_common():
            print(f"{num:6d}  {said}", file=sys.stderr)

    def wait_for(self, path, process):
        deadline = time.monotonic() + 120
        while not path.exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.01)

    def test_whoever_is_ended_while_writing_leaves_what_was_there(self):
        wall = self.folder / "wall.png"
        rows = b"".join(b"\0" + struct.pack(">160H", *[500] * 160) for _ in range(120))
        wall.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(
            struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
            for kind, body in ((b"IHDR", struct.pack(">IIBBBBB", 160, 120, 16, 0, 0, 0, 0)),
                               (b"IDAT", zlib.compress(rows)), (b"IEND", b""))))
        query = ("query", self.tool, "--depth", wall, "--intrinsics", "200,200,79.5,59.5", "--pose",
                 "0 0 0.49 0 0 0 1", "--caps")
        out = self.folder / "out"
        for number, arguments in enumerate((
                ("shape", "box", "-o", out / "m.ply"), (*query, out / "c.ply"), (*query, out / "c.glb"),
                ("export", self.tool, "--spheres", out / "s.csv"), ("export", self.tool, "--mesh", out / "m.stl"),
                ("info", self.tool, "--report", out / "p.html"),
                ("pack", self.mesh, "-o", out / "t.palp", "--spheres", 50))):
            for is_replaced in (False, True):
                shutil.rmtree(out, ignore_errors=True)
                out.mkdir()
                if is_replaced:
                    self.assertEqual(run(*arguments).returncode, 0, arguments)
                before = {path.name: path.read_bytes() for path in out.iterdir()}
                self.assertEqual(len(before), int(is_replaced))
                process = subprocess.Popen(
                    [PALPATE, *map(str, arguments)], text=True, stdout=subprocess.DEVNULL,
                    stderr=subprocess.PIPE, env=dict(os.environ, LD_PRELOAD=FAULTS, PALPATE_FAULTS="stuck"))
                self.assertIn("stuck\n", iter(process.stderr.readline, ""), arguments)
                ending = (signal.SIGINT, signal.SIGTERM)[(number + is_replaced) % 2]
                process.send_signal(ending)
                if arguments[0] == "pack":  # which would end well, but for what holds it up
                    time.sleep(2.2)
                    for _ in range(60):  # its two seconds begin when it gets the first one, however late that is
                        process.send_signal(ending)
                        with contextlib.suppress(subprocess.TimeoutExpired):
                            process.wait(0.5)
                            break
                self.assertEqual(process.wait(120), -ending, arguments)
                process.stderr.close()
                self.assertEqual({path.name: path.read_bytes() for path in out.iterdir()}, before, arguments)

    def test_killed_at_any_moment(self):
        choose = random.Random(5)
        num_ticks, num_folders = 0, 0
        for number in range(KILLS):
            is_live = number % 2 == 0
            output = self.folder / f"killed-{number}"
            arguments = self.live_run(output, 60) if is_live else self.path_run(output, 20)
            process = subprocess.Popen([PALPATE, *map(str, arguments)], stdout=subprocess.DEVNULL,
                                       stderr=subprocess.DEVNULL)
            if number % 4 < 2:
                self.wait_for(output / "recording.mcap", process)
            time.sleep(choose.uniform(0, 2))
            process.kill()
            process.wait()
            for folder in self.folder.glob(f"killed-{number}*"):
                ticks = self.check_run(folder)
                num_ticks += ticks
                num_folders += 1
                if ticks > 0 and folder == output:
                    self.check_viewable(folder)
            for left in self.folder.glob(f"killed-{number}*"):
                shutil.rmtree(left)
        print(f"{KILLS} kills left {num_folders} folders with {num_ticks} ticks, all repeated",
              file=sys.stderr)

    def check_viewable(self, folder):
        process = subprocess.Popen([PALPATE, "view", str(folder), "--port", "0"], text=True,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        opened = process.stdout.readline()
        if not opened:  # it has ended: with what status, and what it said
            told = process.communicate()[1]
            self.fail(f"{process.args} ended with {process.returncode} and said '{told}'")
        process.kill()
        self.assertIn("open http://", opened, process.communicate()[1])


if __name__ == "__main__":
    PALPATE, FAULTS = map(os.path.abspath, sys.argv[1:3])
    unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=2, testLoader=parts.Loader())
