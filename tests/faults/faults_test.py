"""The real program while the system fails it, and killed at any moment.

Whatever happens: an end within its time; exit status 0 with whole results, or 1 with a sentence; no
file under its final name that is not whole; what was recorded repeats to the bit.

usage: faults_test.py PALPATE FAULTS_LIBRARY    PALPATE_KILLS=200: as many moments to be killed at
                                                PALPATE_PLANS=200: as many plans made by chance;
                                                100-200: of these, those from the 100th on
                                                PALPATE_KEEP=1: leaves what a failed test worked on"""

import collections
import contextlib
import csv
import itertools
import json
import os
import pathlib
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.request

import inputs

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../test_util"))
import parts  # noqa: E402

PALPATE = FAULTS = None
KILLS = int(os.environ.get("PALPATE_KILLS", 6))
FIRST_PLAN, _, END_OF_PLANS = ("0-" + os.environ.get("PALPATE_PLANS", "6")).rpartition("-")
FIRST_PLAN, END_OF_PLANS = int(FIRST_PLAN.split("-")[-1]), int(END_OF_PLANS)
# Limits so wide that a busy machine causes no fault.
PATIENT = ("[safety]\nmax_contact_age = 60\nmax_sensor_age = 60\nmax_tick = 60\n"
           "max_device_silence = 60\nenergy_tank = 100\n")


def under(faults, told="/dev/null"):
    """An environment with these faults; `told`: where the names of those that came are written."""
    more = dict(LD_PRELOAD=FAULTS, PALPATE_FAULTS=faults, PALPATE_FAULTS_TOLD=str(told)) if faults else {}
    return dict(os.environ, **more)


def run(*arguments, environment=None, timeout=300):
    return subprocess.run([PALPATE, *map(str, arguments)], capture_output=True, text=True,
                          timeout=timeout, env=environment)


def force(row):
    """On the hand, at this row of wrench.csv; N."""
    return max(abs(float(row[f"hand_force_{axis}_N"])) for axis in "xyz")


class Case(unittest.TestCase):
    LARGE_WALL = ("--scene", "wall")
    WALL = ("--camera", "scene:wall?size=160x120")  # little to compute, and few writes

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

    def path_run(self, output, duration=0.3, wall=None):
        return ("touch", self.tool, *(wall or self.WALL), "--duration", duration, "-o", output)

    def live_run(self, output, duration=0.5, is_patient=True, wall=None):
        settings = ("--settings", self.settings) if is_patient else ()
        return ("touch", self.tool, *(wall or self.WALL), "--device", "sim", "--duration", duration,
                *settings, "-o", output)

    def check(self, arguments, faults, may_fail=True, timeout=300):
        """Runs it; returns the exit status. Then `came` has the faults that came."""
        told = self.folder / "told"
        told.unlink(missing_ok=True)
        result = run(*arguments, environment=under(faults, told), timeout=timeout)
        self.last_error, self.last_output = result.stderr, result.stdout
        self.came = set(told.read_text().split()) if told.exists() else set()
        self.assertLessEqual(self.came, set(re.findall("[a-z]+", faults)))
        self.assertNotIn("LD_PRELOAD", result.stderr)  # the library is there
        told = f"{arguments[0]} under {faults}, of which {self.came} came: {result.returncode}, {result.stderr}"
        self.assertIn(result.returncode, (0, 1) if may_fail else (0,), told)
        if result.returncode == 1:
            last = result.stderr.strip().splitlines()[-1:]
            self.assertTrue(last and last[0].startswith("palpate: "), told)
            self.assertGreater(len(last[0]), 20, told)
            self.assertTrue(self.came, told)  # an error has a reason
        return result.returncode

    def check_touch(self, arguments, faults, **more):
        """Checks a run, and its folder if the run succeeded or left one. Returns the status."""
        status, output = self.check(arguments, faults, **more), arguments[-1]
        self.num_ticks = self.check_run(output, is_whole=status == 0) if status == 0 or output.exists() else 0
        return status

    def check_run(self, folder, is_whole=False):
        """Checks that the files of a run's folder are whole, and repeat. Returns the number of ticks."""
        if is_whole:
            self.assertLessEqual({"recording.mcap", "wrench.csv", "summary.json", "report.html"},
                                 {path.name for path in folder.iterdir()})
        if (folder / "summary.json").exists():
            self.summary(folder)
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
            if is_whole and self.summary(folder)["lost_records"] == 0:
                self.assertEqual(verdict["ticks"], self.summary(folder)["ticks"])
            return verdict["ticks"]
        self.assertFalse(is_whole, replay.stderr)
        # Ended before its first half second was written: there is nothing yet.
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
            self.check_touch(self.live_run(output, 6, is_patient=False, wall=self.LARGE_WALL), "", may_fail=False)
        finally:
            for process in busy:
                process.kill()
                process.wait()
        summary = self.summary(output)
        self.assertGreaterEqual(summary["seconds"], 5.9)
        self.assertLess(summary["seconds"], 12)
        self.assertEqual(summary["ending"], "")
        self.assertGreater(self.num_ticks, 0)


class Faults(Case):

    def test_interruptions_and_short_steps_change_nothing(self):
        for faults in ("short", "interrupted", "short,interrupted"):
            tool, output = self.folder / "again.palp", self.folder / faults.replace(",", "-")
            self.check(("pack", self.mesh, "-o", tool, "--spheres", 200), faults, may_fail=False)
            self.assertEqual(tool.read_bytes(), self.tool.read_bytes())
            self.check_touch(self.path_run(output), faults, may_fail=False)
            self.assertGreater(self.num_ticks, 200)
            self.check(("replay", output), faults, may_fail=False)
            self.assertEqual(self.came, set(faults.split(",")))

    def test_files_that_cannot_be_given_a_name_have_one_from_the_beginning(self):
        tool, output = self.folder / "again.palp", self.folder / "nameless"
        for _ in range(2):  # new, then in place of another
            self.check(("pack", self.mesh, "-o", tool, "--spheres", 200), "nameless", may_fail=False)
            self.assertEqual(tool.read_bytes(), self.tool.read_bytes())
        self.check_touch(self.path_run(output), "nameless", may_fail=False)
        self.assertTrue(self.came)
        self.assertGreater(self.num_ticks, 200)
        self.assertEqual([*self.folder.rglob("*.part")], [])

    def test_disks_that_fail(self):
        for kind in ("full", "broken"):
            for begin in (1, 2, 3, 5, 9):
                faults, tool = f"{kind}@{begin}", self.folder / "never.palp"
                # A tool is written at once.
                status = self.check(("pack", self.mesh, "-o", tool, "--spheres", 50), faults)
                self.assertEqual((status, self.came), (1, {kind}) if begin == 1 else (0, set()))
                self.assertEqual(tool.exists(), status == 0)
                tool.unlink(missing_ok=True)
                output = self.folder / f"{kind}-{begin}"
                self.assertEqual(self.check_touch(self.path_run(output, wall=self.LARGE_WALL), faults), 1)
                self.assertEqual(list(self.folder.glob("*.part")), [])

    def test_whatever_cannot_be_read_is_no_end_of_a_file(self):
        """Each read in turn, and all that follow."""
        run_folder, tape, lens = self.folder / "run", self.folder / "tape.mcap", "intrinsics=200,200,79.5,59.5"
        self.check_touch(self.path_run(run_folder), "", may_fail=False)
        bag = inputs.write_ros1_bag(self.folder / "ros1.bag", 160, 120, 6) + lens
        self.check(("record", "--camera", bag, "-o", tape), "", may_fail=False)
        copy = self.folder / "copy.mcap"
        cameras = (bag, f"bag:{tape}", inputs.write_sqlite_bag(self.folder / "ros2.db3", 32, 24, 3) + lens,
                   inputs.write_folder(self.folder / "images", 160, 120, 3) + lens,
                   inputs.write_raw(self.folder / "images.raw", 160, 120, 3) + lens)
        for arguments, place, least in (
                (("info", self.tool), self.tool, 1), (("replay", run_folder), run_folder, 4),
                *((("record", "--camera", camera, "-o", copy), re.split("[:?]", camera)[1], 4) for camera in cameras)):
            for begin in itertools.count(1):
                copy.unlink(missing_ok=True)
                status = self.check(arguments, f"unreadable@{begin}")
                if not self.came:
                    break
                self.assertEqual(status, 1, f"{arguments} read no further than {begin} and said {self.last_output}")
                self.assertRegex(self.last_error, f"cannot read .*{place}|{place}.* cannot be read")
            self.assertEqual(status, 0)
            self.assertGreater(begin, least)

    def test_a_live_run_on_a_disk_that_fails_goes_on(self):
        num_in_the_middle = 0
        for faults, status in (("full@9", 1), ("full@12", 1), ("broken@9", 1), ("broken@12", 1), ("sluggish", 0)):
            for duration in (2, 30):  # a busy computer may not come to the twelfth write in 2 s
                output = self.folder / f"{faults}-{duration}"
                ended = self.check_touch(self.live_run(output, duration, wall=self.LARGE_WALL), faults)
                if self.came:
                    break
            # A run that could not be kept is no success, and names no report that is not there.
            self.assertEqual((ended, bool(self.came)), (status, True), self.last_error)
            self.assertGreater(self.num_ticks, 0)
            told = "report: " in self.last_output
            self.assertEqual(told, (output / "report.html").exists(), self.last_output)
            ticks, seconds = re.search(r"(\d+) ticks, .* in (\S+) s$", self.last_output, re.M).groups()
            self.assertGreaterEqual(float(seconds), duration)
            self.assertGreaterEqual(int(ticks), self.num_ticks)
            num_in_the_middle += "nothing was recorded from" in self.last_error
        if num_in_the_middle == 0:  # on a busy computer all of these may be the run's end
            self.check_touch(self.live_run(self.folder / "later", 30, wall=self.LARGE_WALL), "full@12")
            self.assertIn("nothing was recorded from", self.last_error)

    def test_a_disk_that_takes_seconds_holds_up_no_record(self):
        def is_whole():
            self.check_touch(self.live_run(self.folder / "lazy", 4), "lazy", may_fail=False)
            self.assertTrue(self.came)
            return "records were lost" not in self.last_error
        # A computer that is busy itself may lose some.
        self.assertTrue(any(is_whole() for _ in range(3)), self.last_error)

    def test_nor_does_it_where_a_part_of_a_recording_ends(self):
        def is_whole(duration):
            output = self.folder / f"lazy-parts-{duration}"
            self.check(self.live_run(output, duration) + ("--record-keep", "20s"), "lazy", may_fail=False)
            self.assertGreater(self.check_run(output), 0)
            return len(list(output.glob("recording*.mcap"))) > 1 and "records were lost" not in self.last_error
        # A computer that is busy itself may lose some, or not come to a second part.
        self.assertTrue(any(is_whole(duration) for duration in (4.5, 6, 30)), self.last_error)

    def test_what_does_not_reach_a_disk_is_told_and_kept(self):
        num_ticks = 0
        for begin, run_of, duration in ((1, self.path_run, 3), (1, self.live_run, 3), (2, self.live_run, 3),
                                        (4, self.live_run, 8)):
            output = self.folder / f"{run_of.__name__}-unsynced-{begin}"
            self.assertEqual(self.check(run_of(output, duration), f"unsynced@{begin}"), 1)
            self.assertRegex(self.last_error, "cannot bring .* to the disk: Input/output error")
            if begin > 1:  # until then it may not even have begun
                self.assertIn("it is not certain that anything was recorded from ", self.last_error)
                num_ticks += self.check_run(output)  # the first time may come before the first tick
        self.assertGreater(num_ticks, 0)
        stream, partial = self.folder / "stream.mcap", self.folder / "stream.mcap.partial"
        self.assertEqual(self.check(("record", "--camera", "scene:wall?size=32x24", "--duration", 0.2, "-o", stream),
                                    "unsynced@1"), 1)
        self.assertIn(f"what was recorded before is in {partial}", self.last_error)
        self.assertFalse(stream.exists())
        partial.rename(stream)
        self.check(("cameras", "--selftest", f"bag:{stream}"), "", may_fail=False)

    def test_what_was_written_on_a_disk_that_takes_seconds_outlives_a_kill(self):
        output, told = self.folder / "lazy", self.folder / "told"
        process = subprocess.Popen([PALPATE, *map(str, self.live_run(output, 300))], stdout=subprocess.DEVNULL,
                                   stderr=subprocess.DEVNULL, env=under("lazy", told))
        self.wait_for(told, process)
        before = self.wait_for_ticks(output, process)
        process.kill()
        self.assertEqual(process.wait(), -signal.SIGKILL)
        self.assertGreaterEqual(self.check_run(output), before)

    def test_no_threads_and_no_memory(self):
        for begin in (1, 2, 3, 4, 5):
            self.check_touch(self.live_run(self.folder / f"threadless-{begin}", 0.2), f"threadless@{begin}")
            self.assertTrue(self.came)
        for begin in (1, 2, 3):
            self.check_touch(self.path_run(self.folder / f"threadless-path-{begin}", 0.05), f"threadless@{begin}")
        for begin in (1, 2, 5, 10, 20):  # while things are set up
            self.assertEqual(
                self.check_touch(self.path_run(self.folder / f"memoryless-{begin}", 0.05), f"memoryless@{begin}"), 1)

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
                env=under(fault))
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
        for run_of in (self.path_run, self.live_run):
            num_in_the_middle = 0
            for begin in (45, 80, 120, 170, 230, 300):
                status = self.check_touch(run_of(self.folder / f"{run_of.__name__}-{begin}", 3), f"memoryless@{begin}")
                num_in_the_middle += status == 1 and "out of memory" in self.last_error and self.num_ticks > 0
            self.assertGreater(num_in_the_middle, 0, run_of.__name__)

    def test_a_recording_goes_on_when_the_disk_has_space_again(self):
        for duration in (8, 60):  # a busy computer may not come to the tenth write in 8 s
            output = self.folder / f"gap-{duration}"
            self.assertEqual(self.check_touch(self.live_run(output, duration), "full@8-9"), 1)
            self.assertIn("nothing was recorded from", self.last_error)
            if len(list(output.glob("recording*.mcap"))) >= 2:
                break
        self.assertGreaterEqual(len(list(output.glob("recording*.mcap"))), 2)
        self.assertGreater(self.num_ticks, 1000)
        self.check_viewable(output)
        # A part that is not seen is not left out.
        for arguments in (("replay", output), ("view", output, "--port", 0),
                          ("record", "--camera", f"bag:{output}", "-o", self.folder / "never.mcap")):
            self.assertEqual(self.check(arguments, "unlisted", timeout=60), 1)
            self.assertRegex(self.last_error, f"cannot (list|look into) {output}: Input/output error")

    def test_a_calendar_that_jumps_is_not_felt(self):
        plain, jumped = self.folder / "plain", self.folder / "jumped"
        self.check_touch(self.path_run(plain), "", may_fail=False)
        self.check_touch(self.path_run(jumped), "yesterday@1", may_fail=False)
        self.assertFalse(self.came)  # along a path nobody looks at it
        self.assertEqual((plain / "wrench.csv").read_bytes(), (jumped / "wrench.csv").read_bytes())
        self.check_touch(self.live_run(self.folder / "live", 2), "yesterday@2", may_fail=False)
        self.assertTrue(self.came)
        self.assertGreater(self.num_ticks, 0)

    def test_a_process_that_stands_still_fades_and_can_be_repeated(self):
        """SIGSTOP in contact: there is no force afterwards, and the run goes on."""
        def has_faded(pause):
            output = self.folder / "stopped"
            shutil.rmtree(output, ignore_errors=True)
            process = subprocess.Popen([PALPATE, *map(str, self.live_run(output, 60))],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            self.wait_until(lambda: process.poll() is not None or any(force(row) > 0.5 for row in self.rows(output)),
                            process)
            if process.poll() is not None:  # before there was a force
                self.assertEqual(process.returncode, 0, process.stderr.read())
                return False
            process.send_signal(signal.SIGSTOP)
            stopped = float(self.rows(output)[-1]["time_s"])
            time.sleep(pause)
            process.send_signal(signal.SIGCONT)
            self.wait_until(lambda: float(self.rows(output)[-1]["time_s"]) > stopped + pause + 1, process)
            process.send_signal(signal.SIGINT)
            told = process.communicate(timeout=120)[1]
            self.assertEqual(process.returncode, 0, told)
            self.assertGreater(self.check_run(output, is_whole=True), 0)
            rows = self.rows(output)
            after = next(k for k in range(1, len(rows))
                         if float(rows[k]["time_s"]) > max(stopped, float(rows[k - 1]["time_s"]) + 0.9 * pause))
            # A computer that stands still itself may have taken the force before.
            if force(rows[after - 1]) == 0:
                return False
            back = float(rows[after]["time_s"])
            soon = [row for row in rows[after:] if back + 0.1 < float(row["time_s"]) < back + 0.5]
            if not soon:
                return False
            self.assertEqual({force(row) for row in soon}, {0})
            self.assertIn("loop", [each["fault"] for each in self.summary(output)["faults"]])
            return True

        for pause, max_tick in ((0.3, 0.2), (3, 1)):  # a busy computer stands still for 0.1 s by itself
            self.settings.write_text(PATIENT.replace("max_tick = 60", f"max_tick = {max_tick}"))
            self.assertTrue(any(has_faded(pause) for _ in range(5)))

    def test_little_address_space_is_a_sentence(self):
        """As under `ulimit -v`: every request for more memory is refused."""
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
        """Two faults and more at once, each from a call that is chosen by chance."""
        choose = random.Random(11)
        num_ticks, endings, kinds = 0, collections.Counter(), collections.Counter()
        for number in range(END_OF_PLANS):
            plan = []
            while len(plan) < 2:
                plan = [f"{kind}@{choose.randint(1, most)}" for kind, most in
                        (("short", 1), ("interrupted", 1), ("full", 40), ("broken", 40), ("unreadable", 8),
                         ("slow", 1), ("threadless", 12), ("memoryless", 200), ("yesterday", 2))
                        if choose.random() < 0.25]
            plan = [each + f"-{int(each.split('@')[1]) + choose.randint(0, 3)}"
                    if each.startswith(("full", "broken")) and choose.random() < 0.5 else each for each in plan]
            run_of, seconds = choose.choice((self.path_run, self.live_run)), choose.uniform(0.1, 2)
            if number < FIRST_PLAN:
                continue
            output = self.folder / f"chance-{number}"
            with self.subTest(plan=",".join(plan), run=run_of.__name__):
                # Short writes on a slow disk take 200 ms for a third of what is left.
                failed = self.check_touch(run_of(output, seconds), ",".join(plan), timeout=1800)
                kinds.update(self.came)
                num_ticks += self.num_ticks
                for folder in self.folder.glob(f"chance-{number}*"):
                    self.check_run(folder)
                    shutil.rmtree(folder)
                # The last message, without the parts that differ from run to run.
                last = self.last_error.strip().splitlines()[-1] if failed else "whole"
                endings[re.sub(r"/\S*|[0-9.]+", "...", last)] += 1
        print(f"{endings.total()} plans, of which {dict(kinds)} came: {endings['whole']} runs ended with all results, "
              f"{endings.total() - endings['whole']} with a sentence; {num_ticks} ticks repeated", file=sys.stderr)
        for said, num in endings.most_common():
            print(f"{num:6d}  {said}", file=sys.stderr)

    def wait_until(self, is_so, process):
        """Returns the first true `is_so()`; fails if the process ends before."""
        deadline = time.monotonic() + 120
        while True:
            status = process.poll()
            if found := is_so():
                return found
            self.assertIsNone(status)
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.01)

    def wait_for(self, path, process):
        self.wait_until(path.exists, process)

    def wait_for_ticks(self, folder, process):
        """Waits until some ticks can be replayed; returns how many."""
        return self.wait_until(lambda: self.check_run(folder) if folder.exists() else 0, process)

    def rows(self, folder):
        """Returns the rows of wrench.csv so far, without a last one that is half written."""
        for name in ("wrench.csv", "wrench.csv.part"):
            with contextlib.suppress(FileNotFoundError), open(folder / name) as file:
                return list(csv.DictReader(line for line in file if line.endswith("\n")))
        return []

    def test_whoever_is_ended_while_writing_leaves_what_was_there(self):
        wall = self.folder / "wall.png"
        wall.write_bytes(inputs.png(160, 120))
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
                    stderr=subprocess.PIPE, env=under("stuck"))
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
        # Half of them when there is something to keep, the others from the first moment on.
        for number in range(KILLS):
            is_live = number % 2 == 0
            output = self.folder / f"killed-{number}"
            arguments = self.live_run(output, 60) if is_live else self.path_run(output, 20)
            process = subprocess.Popen([PALPATE, *map(str, arguments)], stdout=subprocess.DEVNULL,
                                       stderr=subprocess.DEVNULL)
            before = self.wait_for_ticks(output, process) if number % 4 < 2 else 0
            time.sleep(choose.uniform(0, 2))
            process.kill()
            process.wait()
            if before > 0:
                self.assertGreaterEqual(self.check_run(output), before)
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
