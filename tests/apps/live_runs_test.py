"""Live runs: people, pages, signals and whoever does not read.

Usage: live_runs_test.py PATH_OF_PALPATE"""

import contextlib
import json
import math
import os
import re
import resource
import shutil
import signal
import subprocess
import time
import urllib.error
import urllib.request

from cli_case import CommandLineCase, main, PALPATE, read


def state_of(program):
    """As ps(1) shows it, e.g. T: stopped."""
    return read(f"/proc/{program.pid}/stat").rsplit(")", 1)[1].split()[0]


class LiveRuns(CommandLineCase):
    WALL = ("--camera", "scene:wall?size=160x120")  # little to compute

    @contextlib.contextmanager
    def page(self, *arguments):
        """A program that serves one, and its address; ended by Ctrl-C unless it has ended."""
        program = subprocess.Popen([PALPATE, *map(str, arguments)], stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, text=True)
        self.addCleanup(program.kill)
        with program:
            try:
                seen = ""
                while not (found := re.search(r"open (http://\S+?)/? in a browser", seen)):
                    line = program.stdout.readline()
                    self.assertTrue(line, seen)
                    seen += line
                yield program, found.group(1)
            except BaseException:
                program.kill()  # else nobody would ever end it
                raise
            program.send_signal(signal.SIGINT)

    def ask(self, address, what, command=None):
        data = None if command is None else json.dumps(command).encode()
        try:
            with urllib.request.urlopen(f"{address}/api/{what}", data, timeout=60) as answer:
                return json.loads(answer.read())
        except urllib.error.HTTPError as error:
            return json.loads(error.read())

    def test_view_of_a_tool_and_of_a_run(self):
        run = self.path("run_seen")
        self.succeed(*self.sequence("-o", run))
        with self.page("view", self.tool, "--port", 0) as (program, address):
            hello = self.ask(address, "hello")
            self.assertEqual((hello["kind"], hello["controls"], hello["streams"]), ("tool", [], []))
            self.assertEqual(hello["tool"]["spheres"], json.loads(
                self.succeed("info", self.tool, "--json"))["spheres"])
            program.send_signal(signal.SIGINT)
            self.assertEqual(program.wait(20), 0)
        with self.page("view", run, "--port", 0) as (program, address):
            hello = self.ask(address, "hello")
            self.assertEqual((hello["kind"], hello["title"]), ("recording", "run_seen"))
            answer = self.ask(address, "command", {"id": 1, "command": "seek", "time": 0.05})
            self.assertTrue(answer["ok"], answer)
            answer = self.ask(address, "command", {"id": 2, "command": "set",
                                                   "key": "contact.method", "value": "magic"})
            self.assertFalse(answer["ok"])
            self.assertIn("graph", answer["error"])
            state = self.ask(address, "state")
            self.assertEqual(state["settings"]["contact.method"], "field")
            self.assertAlmostEqual(state["time"], 0.05)
            program.send_signal(signal.SIGINT)
            self.assertEqual(program.wait(20), 0)
        self.expect_failure(1, "view", self.path("nothing"), mentions="palpate touch wrote")
        self.expect_failure(1, "view", self.folder, mentions="palpate touch wrote")
        self.expect_failure(1, "view", self.mesh, mentions="not a tool file")
        self.expect_failure(1, "view", self.tool, "--port", 0, "--address", "192.0.2.1",
                            mentions="0.0.0.0 for all (--port, --address)")

    def test_touch_seen_in_a_browser(self):
        run = self.path("run_watched")
        plain = json.loads(self.succeed(*self.sequence("-o", run, "--json")))
        before = read(os.path.join(run, "wrench.csv"))
        start = time.monotonic()
        with self.page(*self.sequence("-o", run, "--json", "--view", "--view-port", 0)) as (
                program, address):
            self.wait_for(lambda: self.ask(address, "state")["running"], program)
            self.assertTrue(self.ask(address, "command", {"id": 1, "command": "resume"})["ok"])
            output = program.stdout.read()
            self.assertEqual(program.wait(60), 0)
        self.assertGreater(time.monotonic() - start, plain["ticks"] / 1000)
        self.assertEqual(json.loads(output[output.index("{"):])["ticks"], plain["ticks"])
        self.assertEqual(read(os.path.join(run, "wrench.csv")), before)

    def test_a_live_run_is_turned_and_ended_by_a_script(self):
        run = self.path("live_watched")
        settings = self.patient_settings("patient_watched.toml", "energy_tank = 100\n")
        with self.page("touch", self.tool, "--scene", "wall", "--device", "sim", "--duration", 60,
                       "--settings", settings, "-o", run, "--view", "--view-port", 0) as (
                program, address):
            self.assertEqual(self.ask(address, "hello")["kind"], "live")
            # Settings change once something has been felt.
            self.wait_for(lambda: (state := self.ask(address, "state"))["ticks"] > 100 and state["contacts"] > 0, program)
            for command in ({"command": "set", "key": "contact.method", "value": "graph"},
                            {"command": "pause"}, {"command": "step"}, {"command": "resume"},
                            {"command": "mark", "text": "a word"}, {"command": "end"}):
                answer = self.ask(address, "command", {"id": 1, **command})
                self.assertTrue(answer["ok"], answer)
            output = program.stdout.read()
            self.assertEqual(program.wait(60), 0, output)
        self.assertIn("identical: ", self.succeed("replay", run))

    def test_a_run_that_cannot_be_kept_says_so(self):
        """A disk that fills up: here a limit on the size of files."""
        run = self.path("no_space")

        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            most = os.path.getsize(self.tool) + 100000  # a recording begins with the tool
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
        # A minute of the clock of the path: more than so many bytes of wrench.csv.
        path = self.path("no_space.txt")
        with open(path, "w", encoding="utf-8") as file:
            file.write("0 0 0 0.4 0 0 0 1\n60 0 0 0.45 0 0 0 1\n")
        result = subprocess.run(
            [PALPATE, *map(str, self.sequence("-o", run, "--path", path, "--duration", 60))],
            capture_output=True, text=True, preexec_fn=limit, restore_signals=False, timeout=120)
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertIn("palpate: not all of the run could be kept: ", result.stderr)
        self.assertFalse(os.path.exists(os.path.join(run, "wrench.csv")))
        if not os.path.exists(os.path.join(run, "report.html")):
            self.assertNotIn("report:", result.stdout)

    def test_touch_live_and_replay(self):
        # Ages that no busy machine reaches.
        settings = self.patient_settings("patient.toml", "energy_tank = 100\n")
        run = self.path("live")
        live = (*self.sequence("-o", run), "--depth-rate", 2, "--device", "sim", "--settings",
                settings)
        summary = json.loads(self.succeed(*live, "--duration", 3, "--coupling", "proxy", "--json"))
        self.assertGreater(summary["ticks"], 100)
        self.assertEqual(summary["failure"], "")
        self.assertEqual(summary["settings"]["coupling"]["kind"], "proxy")
        self.assertEqual(summary["settings"]["safety"]["max_tick"], 60)
        for name in ("recording.mcap", "wrench.csv", "summary.json", "report.html"):
            self.assertTrue(os.path.exists(os.path.join(run, name)), name)
        self.assertIn("hand_force_x_N", self.report_data(run)["series"])
        self.assertRegex(self.succeed("replay", run), r"^identical: \d+ ticks, \d+ contact queries\n$")
        self.assertTrue(json.loads(self.succeed("replay", run, "--json"))["identical"])
        again = self.path("live-again")
        told = json.loads(self.succeed("replay", run, "-o", again, "--time", "latest", "--json"))
        self.assertGreater(told["ticks"], 100)
        self.assertRegex(self.succeed("replay", again), r"^identical: \d+ ticks, \d+ contact")

    def test_long_runs_keep_what_was_asked_for(self):
        run = self.path("parts")
        touch = ("touch", self.tool, *self.WALL, "-o", run, "--duration", 5)

        def parts():
            return sorted(name for name in os.listdir(run) if name.endswith(".mcap"))
        self.succeed(*touch, "--record-split", "1MB")
        self.assertEqual(parts(), [f"recording-000{k}.mcap" for k in (2, 3, 4, 5)] + ["recording.mcap"])
        self.assertIn("identical: 5000 ticks", self.succeed("replay", run))
        whole = self.columns(run)
        self.assertEqual(len(whole["time_s"]), 5000)
        self.succeed(*touch, "--record-keep", "1s")  # parts of two seconds, of which the first is too old
        self.assertEqual(parts(), ["recording-0002.mcap", "recording-0003.mcap"])
        self.assertIn("identical: 3000 ticks", self.succeed("replay", run))
        kept = self.columns(run)
        self.assertEqual(kept["time_s"], whole["time_s"][2000:])
        self.assertEqual(kept["volume_m3"], whole["volume_m3"][2000:])
        for option, value in (("--record-keep", "0.5s"), ("--record-keep", "10 weeks"), ("--record-keep", "-1"),
                              ("--record-split", "1kB"), ("--record-split", "GB"), ("--record-split", "1e999GB")):
            self.expect_failure(2, *touch, option, value, mentions=f"{option}: a ")

    def test_a_short_live_run_is_not_over_before_it_begins(self):
        summary = json.loads(self.succeed(
            "touch", self.tool, *self.WALL, "--device", "sim", "--duration", 0.2,
            "--settings", self.lasting_force(), "-o", self.path("short"), "--json"))
        self.assertEqual(summary["ending"], "")
        self.assertGreater(summary["ticks"], 0)
        self.assertGreaterEqual(summary["seconds"], 0.19)  # from its first tick on

    @contextlib.contextmanager
    def live_run(self, run, *options, **streams):
        """A live run that ticks, to be ended by the caller."""
        shutil.rmtree(run, ignore_errors=True)
        program = subprocess.Popen([PALPATE, *map(str, (
            "touch", self.tool, *self.WALL, "--device", "sim", "-o", run, *options))],
            stdin=subprocess.DEVNULL, **streams)
        try:
            self.wait_for(lambda: self.forces(run, "wrench.csv.part"), program)
            yield program
        finally:
            program.kill()
            program.wait()

    def lasting_force(self):
        """Settings under which a computer that stands still, as busy ones do, takes no force."""
        settings = self.path("lasting_force.toml")
        with open(settings, "w") as file:
            file.write("[safety]\nmax_contact_age = 60\nmax_sensor_age = 60\nmax_tick = 60\n"
                       "max_device_silence = 60\nenergy_tank = 100\n")
        return settings

    def wait_for(self, condition, program=None):
        deadline = time.monotonic() + 120
        while True:
            has_ended = program is not None and program.poll() is not None
            if condition():
                return
            self.assertTrue(time.monotonic() < deadline and not has_ended)
            time.sleep(0.02)

    def stand_still(self, program):
        """Stops the program for long enough that it reports a fault."""
        program.send_signal(signal.SIGSTOP)
        time.sleep(0.7)
        program.send_signal(signal.SIGCONT)

    def full_pipe(self):
        """The ends of a pipe that takes no byte more."""
        ends = os.pipe()
        os.set_blocking(ends[1], False)
        with self.assertRaises(BlockingIOError):
            while True:
                os.write(ends[1], bytes(1))
        os.set_blocking(ends[1], True)
        return ends

    def test_impatient_people_get_a_whole_run_and_no_force(self):
        run = self.path("impatient")
        with self.live_run(run, "--duration", 300, "--settings", self.lasting_force(),
                           stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as program:
            self.wait_for_force(run, program)
            for _ in range(5):  # as a key repeats
                program.send_signal(signal.SIGINT)
                time.sleep(0.03)
            output = program.communicate(timeout=120)[0]
            self.assertEqual(program.returncode, 0, output)
        self.expect_whole(run)
        last = read(os.path.join(run, "wrench.csv")).splitlines()[-1].split(",")
        self.assertEqual(set(last[23:29]), {"0"})  # force and torque on the hand
        # A second signal ends a program that waits: here for a reader.
        reader, full = self.full_pipe()
        with self.live_run(run, stdout=full, stderr=subprocess.DEVNULL) as program:
            program.send_signal(signal.SIGINT)
            self.wait_for(lambda: os.path.exists(os.path.join(run, "report.html")), program)
            time.sleep(2.1)
            self.assertIsNone(program.poll())
            program.send_signal(signal.SIGINT)
            self.assertEqual(program.wait(60), -signal.SIGINT)
        os.close(reader)
        os.close(full)
        self.expect_whole(run)

    def forces(self, run, name="wrench.csv"):
        """The force on the hand at every tick so far, N; a run that has just begun may have no file yet."""
        if not os.path.exists(os.path.join(run, name)):
            return []
        lines = [line.split(",") for line in read(os.path.join(run, name)).split("\n")[:-1]]
        places = [lines[0].index(f"hand_force_{axis}_N") for axis in "xyz"] if lines else []
        return [math.hypot(*(float(line[i]) for i in places)) for line in lines[1:]]

    def wait_for_force(self, run, program):
        self.wait_for(lambda: (self.forces(run, "wrench.csv.part") or [0])[-1] > 0.1, program)

    def test_ctrl_z_takes_the_force_before_the_program_stands_still(self):
        """In contact, with limits that would let the force stay for a minute."""
        run = self.path("suspended")
        with self.live_run(run, "--duration", 300, "--settings", self.lasting_force(),
                           stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as program:
            self.wait_for_force(run, program)
            for _ in range(2):
                program.send_signal(signal.SIGTSTP)
                self.wait_for(lambda: state_of(program) == "T", program)
                before = len(self.forces(run, "wrench.csv.part"))
                time.sleep(2)
                program.send_signal(signal.SIGCONT)
                self.wait_for(lambda: len(self.forces(run, "wrench.csv.part")) > before + 800, program)
            program.send_signal(signal.SIGINT)
            output = program.communicate(timeout=120)[0].decode()
            self.assertEqual(program.returncode, 0, output)
        self.assertIn("the program is about to stand still", output)
        summary = self.expect_whole(run)
        self.assertIn("loop", [fault["fault"] for fault in summary["faults"]])
        times, forces = self.columns(run)["time_s"], self.forces(run)
        stands = [k for k in range(1, len(times)) if times[k] - times[k - 1] > 1.9]
        self.assertEqual(len(stands), 2)
        self.assertGreater(max(forces[:stands[0]]), 0.1)
        for k in stands:
            self.assertEqual(forces[k - 1], 0)
        self.assertEqual(set(forces[stands[0]:]), {0})  # the hand stays in the wall, as after any fault

    def test_other_polite_signals_take_the_force_and_keep_the_run(self):
        for how in (signal.SIGTERM, signal.SIGQUIT):
            run = self.path("polite")
            with self.live_run(run, "--duration", 300, "--settings", self.lasting_force(),
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as program:
                self.wait_for_force(run, program)
                program.send_signal(how)
                output = program.communicate(timeout=120)[0]
                self.assertEqual(program.returncode, 0, output)
            self.expect_whole(run)
            forces = self.forces(run)
            self.assertGreater(max(forces), 0.1, how)
            self.assertEqual(forces[-1], 0, how)

    def unread_run(self, run):
        """Returns the faults of a run whose standard error nobody reads in time."""
        reader, full = self.full_pipe()
        with self.live_run(run, "--duration", 3, stdout=subprocess.DEVNULL, stderr=full) as program:
            os.close(full)
            self.stand_still(program)
            self.wait_for(lambda: os.path.exists(os.path.join(run, "report.html")), program)
            faults = self.expect_whole(run)["faults"]
            # The unread messages are still in the pipe.
            with open(reader, "rb") as unread:
                told = unread.read()
            if faults:
                self.assertIn(b"the force is off", told)
            self.assertEqual(program.wait(60), 0)
        return faults

    def unheard_run(self, run):
        """Returns the faults of a run whose standard error nobody reads."""
        reader, writer = os.pipe()
        with self.live_run(run, "--duration", 3, stdout=subprocess.DEVNULL, stderr=writer) as program:
            os.close(writer)
            os.close(reader)
            self.stand_still(program)
            self.assertEqual(program.wait(120), 0)
        return self.expect_whole(run)["faults"]

    def test_whoever_does_not_read_holds_up_no_live_run(self):
        # On a busy computer a run may stand still before there is a force, or when it has ended: it has no fault.
        self.assertTrue(any(self.unread_run(self.path("unread")) for _ in range(3)))

    def test_whoever_goes_away_ends_no_live_run(self):
        self.assertTrue(any(self.unheard_run(self.path("unheard")) for _ in range(3)))

    def test_a_driver_that_hangs_ends_the_run_in_a_sentence(self):
        sdk = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(PALPATE))),
                           "tests", "devices", "fake_sdk", "whole")
        if not os.path.isdir(sdk):
            self.skipTest("there is no emulated driver beside the program")
        # Within a tick, the run may end before a second without ticks is over.
        polled, called = "does not return from a call", "does not call back"
        for kind, call, duration, words in (
                ("forcedimension", "dhdGetPositionAndOrientationFrame:100", 60, f"does not tick any more|{polled}"),
                ("forcedimension", "dhdEnableForce:2", 3, polled),
                ("openhaptics", "hdEndFrame:100", 60, f"does not tick any more|{called}"),
                ("openhaptics", "hdStopScheduler", 3, called)):
            run = self.path("run_hung")
            shutil.rmtree(run, ignore_errors=True)
            done = subprocess.run(
                [PALPATE, "touch", self.tool, *self.WALL, "--device", kind, "--duration",
                 str(duration), "-o", run], capture_output=True, text=True, timeout=300,
                env=dict(os.environ, FDSDK=sdk, OH_SDK_BASE=sdk, FAKE_SDK_HANG=call))
            self.assertEqual(done.returncode, 1, (call, done.stderr))
            self.assertRegex(done.stderr.splitlines()[-1], words, call)
            self.assertEqual(self.expect_whole(run)["fault"], "device", call)

    def test_touch_live_says_what_is_wrong(self):
        run = self.path("never")
        live = self.sequence("-o", run, "--device", "sim")
        self.expect_failure(2, *live, "--path", "poses.txt", mentions="--path and --device exclude each other")
        self.expect_failure(1, *self.sequence("-o", run, "--device", "lightsabre"),
                            mentions="'lightsabre'; give one of sim")
        self.expect_failure(1, *self.sequence("-o", run, "--device", "sim:wand"), mentions="'wand'")
        bad = self.path("bad.toml")
        for text, words in (("[safety]\nmax_slow = 1\n", "line 2"), ("[safety\n", "not TOML"),
                            ("[coupling]\nkind = 'stiff'\n", "virtual, direct, proxy, none")):
            with open(bad, "w") as file:
                file.write(text)
            self.expect_failure(1, *live, "--settings", bad, mentions=words)
        self.expect_failure(1, *live, "--settings", self.path("absent.toml"), mentions="absent.toml")
        self.assertFalse(os.path.exists(run))

    def test_touch_live_stays_at_the_last_frame(self):
        run = self.path("run_live_probe")
        summary = json.loads(self.succeed(*self.sequence("-o", run, "--json", "--device", "sim")))
        self.assertEqual(set(summary["probe"]), {"pixel", "point", "time", "why_place", "tip",
                                                 "why_tip", "note", "how_to_aim"})
        self.assertGreater(summary["frames"], 4)  # and the last one again, 3 s in all
        self.assertGreater(summary["seconds"], 2.5)
        self.assertGreater(summary["peaks"]["desired_force_N"], 0)
        self.assertEqual(self.report_data(run)["summary"]["probe"], summary["probe"])
        self.assertIn("identical", self.succeed("replay", run))


if __name__ == "__main__":
    main()
