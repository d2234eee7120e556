"""The first minute: help, typing errors, quiet, colors, lists, early ends, and palpate try.

Usage: manners_test.py PATH_OF_PALPATE"""

import glob
import gzip
import json
import os
import pty
import re
import signal
import socket
import subprocess
import tempfile
import time
import urllib.request

import cli_case
from cli_case import CommandLineCase, INTRINSICS, palpate, PALPATE, read

VERBS = ("try", "help", "pack", "info", "export", "shape", "touch", "query", "ros2", "view", "replay", "report", "cameras", "devices",
         "scenes", "record", "calibrate", "eval")


def on_a_terminal(*arguments, **environment):
    """Status and output of a program whose output and messages go to a terminal of 60 columns."""
    master, terminal = pty.openpty()
    subprocess.run(["stty", "cols", "60"], stdin=terminal, check=True)
    process = subprocess.Popen([PALPATE, *map(str, arguments)], stdout=terminal, stderr=terminal,
                               env=dict({**os.environ, "TERM": "xterm", "NO_COLOR": ""}, **environment))
    os.close(terminal)
    said = b""
    try:
        while more := os.read(master, 4096):
            said += more
    except OSError:  # nobody writes there any more
        pass
    os.close(master)
    return process.wait(timeout=60), said.decode()


class Manners(CommandLineCase):

    def test_help_is_short_and_wrapped(self):
        for verb in VERBS:
            for words in ((verb, "--help"), ("help", verb)):
                lines = self.succeed(*words).splitlines()
                self.assertLessEqual(len(lines), 45, words)
                self.assertLessEqual(max(map(len, lines)), 80, words)
            self.assertIn(f"palpate {verb}", "\n".join(lines))
        self.assertEqual(self.succeed("help", "touch"), self.succeed("touch", "--help"))
        self.assertEqual(self.succeed("help"), self.succeed("--help"))
        self.assertLessEqual(len(self.succeed("--help").splitlines()), 45)
        self.assertLessEqual(max(map(len, on_a_terminal("touch", "--help")[1].splitlines())), 60)

    def test_what_is_left_out_of_help_is_named(self):
        short, whole = self.succeed("touch", "--help"), self.succeed("touch", "--help-all")
        more = re.sub(r"\s+", " ", re.search(r"More, by --help-all: ((?:.|\n)*?)\.\n", short).group(1)).split(", ")
        self.assertIn("Recording", more)
        for group in more:
            self.assertRegex(whole, rf"(?m)^{re.escape(group)}:$")
            self.assertNotRegex(short, rf"(?m)^{re.escape(group)}:$")
        flags = set(re.findall(r"(?m)^  (?:-\w,)?(--[a-z0-9-]+)", whole))
        self.assertGreater(len(flags), 70)
        for flag in ("--camera", "--depth-unit", "--path", "--device", "--method", "--json"):
            self.assertIn(flag, short)
        # The completion, which is made from the same options, knows no other.
        self.succeed("--write-manual", self.folder)
        with open(self.path("palpate.bash")) as file:
            known = re.search(r'(?m)^ +touch\) words="(.*)" ;;$', file.read()).group(1).split()
        self.assertEqual(set(known), flags)

    def test_typing_errors_get_a_suggestion(self):
        query = ("query", self.tool, "--camera", "scene:wall", "--pose", "0 0 0.99 0 0 0 1")
        for arguments, words in (
                (("tuch",), "there is no verb 'tuch'; did you mean touch? (see palpate --help)"),
                (("help", "qeury"), "there is no verb 'qeury'; did you mean query?"),
                ((*query, "--methd", "graph"), "there is no option '--methd'; did you mean --method? (see palpate query --help)"),
                (("touch", "--hepl"), "there is no option '--hepl'; did you mean --help?"),
                (("touch", self.tool, "-o", self.path("x"), "--durration=3"), "there is no option '--durration'; did you mean --duration?"),
                (("info", self.tool, "again"), "'again' is one word too many; see palpate info --help"),
                (("touch", self.tool, "--scene", "hnad", "-o", self.path("x")), "there is no scene 'hnad'; did you mean hand?"),
                (("touch", self.tool, "--scene", "paradise", "-o", self.path("x")), "choose one of wall, "),
                ((*query, "--method", "grph"), "did you mean graph?"),
                (("zzzzzzzz",), "the verbs are try, help, ")):
            self.expect_failure(2, *arguments, mentions=words)
        self.expect_failure(1, "touch", self.tool, "--camera", "scene:hnad", "-o", self.path("x"), mentions="did you mean hand?")
        self.expect_failure(2, mentions="give a verb; to begin: palpate try; see palpate --help")

    def test_version(self):
        self.assertEqual(self.succeed("-v"), self.succeed("--version"))

    def test_quiet_leaves_errors_and_what_was_asked_for(self):
        box = self.path("quiet.stl")
        for words in (("shape", "box", "--size", 0.1, "-o", box),
                      ("pack", box, "--spheres", 50, "-o", self.path("quiet.palp")),
                      ("touch", self.tool, "--scene", "wall", "--duration", 0.1, "--backend", "auto", "-o", self.path("quiet")),
                      ("replay", self.path("quiet")), ("export", self.tool, "--spheres", self.path("quiet.csv"))):
            result = palpate(*words, "--quiet")
            self.assertEqual((result.returncode, result.stdout, result.stderr), (0, "", ""), words)
        summary = self.succeed("touch", self.tool, "--scene", "wall", "--duration", 0.1, "--quiet", "--json", "-o", self.path("q2"))
        self.assertEqual(json.loads(summary)["ticks"], 100)
        self.expect_failure(1, "info", self.path("absent.palp"), "--quiet", mentions="absent.palp")
        # The word before the verb does the same.
        self.assertEqual(palpate("--quiet", "shape", "box", "-o", box).stdout, "")

    def test_colors_are_for_terminals(self):
        red = "\x1b[31mpalpate:\x1b[0m "
        self.assertTrue(on_a_terminal("info", "absent.palp")[1].startswith(red))
        for environment in ({"NO_COLOR": "1"}, {"TERM": "dumb"}):
            self.assertNotIn("\x1b", on_a_terminal("info", "absent.palp", **environment)[1])
        self.assertNotIn("\x1b", palpate("info", "absent.palp").stderr)
        status, said = on_a_terminal("touch", self.tool, "--scene", "wall", "--duration", 0.01, "--threads", 200, "-o", self.path("c"))
        self.assertEqual(status, 0, said)
        self.assertIn("palpate: \x1b[33mnote:\x1b[0m --threads 200 is more", said)

    def test_lists_have_a_line_a_kind(self):
        for verb in ("cameras", "devices"):
            lines = self.succeed(verb).splitlines()
            kinds = [line[0] for line in lines[:-1]]
            self.assertEqual(kinds, sorted(kinds), "usable ones first")
            self.assertLessEqual(max(map(len, lines)), 80)
            self.assertIn(f"palpate {verb} -v", lines[-1])
            found = json.loads(self.succeed(verb, "--json"))
            found = found["devices"] if verb == "devices" else found
            self.assertEqual(len(lines), len(found) + 1)
            details = self.succeed(verb, "-v")
            for one in found:
                self.assertIn(one["what"] if verb == "devices" else one["reason"], details)

    def test_an_early_end_says_that_nothing_was_written(self):
        fifo, run = self.path("fifo"), self.path("early")
        os.mkfifo(fifo)  # which nobody writes to: the program waits
        camera = f"pipe:{fifo}?size=8x8&intrinsics=8,8,4,4"
        for arguments in (("touch", self.tool, "--camera", camera, "-o", run),
                          ("query", self.tool, "--camera", camera, "--pose", "0 0 1 0 0 0 1")):
            for how in (signal.SIGINT, signal.SIGTERM):
                status, output, errors = self.interrupt(arguments, lambda since: since > 0.3, how)
                self.assertEqual((status, output), (-how, ""), errors)
                self.assertEqual(errors.splitlines()[-1], "palpate: interrupted; nothing was written")
                self.assertFalse(os.path.exists(run))

    def test_a_run_without_contact_says_how_near_it_came(self):
        path = self.path("beside.txt")
        with open(path, "w") as file:  # towards a wall at 1 m and back; half of the tool is 40 mm
            file.write("0 0 0 0.5 0 0 0 1\n1 0 0 0.8 0 0 0 1\n2 0 0 0.5 0 0 0 1\n")
        run = ("touch", self.tool, "--scene", "wall", "--no-noise", "--path", path, "-o", self.path("beside"))
        said = self.succeed(*run)
        distance, when = re.search(r"(?m)^the tool never touched; nearest ([\d.]+) m at ([\d.]+) s$", said).groups()
        # The spheres end before the tips of an octahedron do.
        self.assertTrue(0.16 <= float(distance) <= 0.175, said)
        self.assertAlmostEqual(float(when), 1.0, delta=0.15)
        data = self.report_data(self.path("beside"))
        self.assertAlmostEqual(data["nearest"]["distance_m"], float(distance), delta=0.006)
        with open(path, "w") as file:
            file.write("0 0 0 0.9 0 0 0 1\n1 0 0 1.0 0 0 0 1\n")
        self.assertNotIn("never touched", self.succeed(*run))
        self.assertIsNone(self.report_data(self.path("beside"))["nearest"])

    def test_newtons_beside_volumes(self):
        query = ("query", self.tool, "--camera", "scene:wall", "--pose", "0.01 0 0.99 0 0 0 1")
        plain = json.loads(self.succeed(*query, "--json"))["results"][0]
        result = json.loads(self.succeed(*query, "--stiffness", 2.5e5, "--json"))["results"][0]
        self.assertNotIn("force_N", plain)
        self.assertLess(plain["force"][2], 0)
        for name, measure in (("force_N", "force"), ("torque_Nm", "torque")):
            self.assertEqual(result[name], [2.5e5 * value for value in plain[measure]])
        numbers = re.search(r"at 250000 N/m³: force (\S+) (\S+) (\S+) N, torque", self.succeed(*query, "--stiffness", 2.5e5)).groups()
        for number, value in zip(numbers, result["force_N"]):
            self.assertAlmostEqual(float(number), value, delta=1e-3 * abs(value) + 1e-9)
        said = json.loads(self.succeed(*query, "--stiffness", 2.5e5, "--std", "--json"))["results"][0]
        for name, measure in (("force_std_N", "force_std"), ("torque_std_Nm", "torque_std")):
            self.assertEqual(said[name], [2.5e5 * value for value in said[measure]])
        deviation = re.search(r" \+- at 250000 N/m³: force (\S+)", self.succeed(*query, "--stiffness", 2.5e5, "--std")).group(1)
        self.assertAlmostEqual(float(deviation), said["force_std_N"][0], delta=1e-3 * said["force_std_N"][0])
        self.expect_failure(2, *query, "--stiffness", -1, mentions="--stiffness: must be a number from 0")
        self.expect_failure(2, "touch", self.tool, "--scene", "wall", "--stiffness", 1e6, "-o", self.path("never"),
                            mentions="--set coupling.force_at_eighth=N")
        self.expect_failure(2, "touch", self.tool, "--scene", "wall", "--set", "safety.max_force=1", "-o", self.path("never"),
                            mentions="the nearest one is 'safety.force_share', of what the device can give")

    def test_a_query_says_what_no_camera_sees_and_where_its_deviation_is_too_large(self):
        query = ("query", self.tool, "--camera", "scene:wall", "--pose")
        share = json.loads(self.succeed(*query, "0 0 1.02 0 0 0 1", "--json"))["results"][0]["unseen"]
        told = re.search(r"\n +(\S+) % of the tool is where no camera sees \(--unseen solid\)", self.succeed(*query, "0 0 1.02 0 0 0 1"))
        self.assertAlmostEqual(float(told.group(1)), 100 * share, delta=0.5)
        self.assertNotIn("no camera sees", self.succeed(*query, "0 0 0.97 0 0 0 1"))
        many = self.path("many.palp")
        self.succeed("pack", self.mesh, "-o", many, "--spheres", 5000)
        for tool, z, is_said in ((many, 1.1, True), (many, 0.99, False), (self.tool, 1.1, False)):
            result = palpate("query", tool, "--camera", "scene:wall", "--pose", f"0 0 {z} 0 0 0 1", "--std")
            self.assertEqual("up to four times too large" in result.stderr, is_said, (tool, z, result.stderr))

    def test_a_far_place_puts_the_depth_unit_in_doubt(self):
        run = self.path("far")
        for unit, is_far in (((), True), (("--depth-unit", 0.0001), False)):  # 5 m or 0.5 m
            result = palpate("touch", self.tool, "--depth-sequence", self.frames, "--intrinsics", INTRINSICS, *unit, "-o", run)
            self.assertEqual(result.returncode, 0, result.stderr)
            told = [text for text in json.loads(read(os.path.join(run, "summary.json")))["warnings"]
                    if "the nearest good place is 5 m away" in text and "--depth-unit" in text]
            self.assertEqual((len(told), result.stderr.count("good place")), (is_far, is_far), result.stderr)

    def test_a_hand_without_force_is_said(self):
        run = self.path("without_force")
        for age, is_off in ((0.02, True), (0.5, False)):  # s; of frames at 30 Hz
            result = palpate("touch", self.tool, "--scene", "sphere-out-160", "--coupling", "virtual", "--duration", 2,
                             "--set", f"safety.max_sensor_age={age}", "-o", run)
            self.assertEqual(result.returncode, 0, result.stderr)
            summary = json.loads(read(os.path.join(run, "summary.json")))
            on_tool, on_hand = re.search(r"largest force on the tool (\S+) N, on the hand (\S+) N;", result.stdout).groups()
            for told, peak in ((on_tool, "force_N"), (on_hand, "hand_force_N")):
                self.assertAlmostEqual(float(told) / summary["peaks"][peak], 1, delta=0.01)
            told = [text for text in summary["warnings"] if "the force on the hand was off for" in text]
            self.assertEqual((len(told), result.stderr.count("was off for")), (is_off, is_off), result.stderr)
            if is_off:
                first = summary["faults"][0]
                self.assertRegex(told[0], f"of 2.00 s, first at {first['time_s']:.2f} s: no depth frame came in time; look at")

    def test_a_mesh_in_the_place_of_a_tool_names_the_whole_command(self):
        self.expect_failure(1, "query", self.mesh, "--camera", "scene:wall", "--pose", "0 0 1 0 0 0 1",
                            mentions=f"'palpate pack {self.mesh} -o {self.mesh[:-4]}.palp'")

    def test_help_shows_what_examples_use(self):
        told = self.succeed("pack", "--help")
        self.assertIn("--unit", told)
        self.assertIn("--spheres", told)
        told = self.succeed("query", "--help")
        results = told.split("\nResults:\n")[1].split("\n\n")[0]
        for option in ("--stiffness", "--std", "--clearance", "--json"):
            self.assertIn(option, results)
        self.assertRegex(told, r"16-bit depth image, PNG or an\s+organized PCD")

    def test_a_query_in_front_says_how_near_it_is(self):
        query = ("query", self.tool, "--camera", "scene:wall")
        free = self.succeed(*query, "--pose", "0 0 0.5 0 0 0 1")
        nearest = re.search(r"the tool never touches; nearest (\S+) m", free)
        self.assertIsNotNone(nearest, free)
        self.assertTrue(0.3 < float(nearest[1]) < 0.5, free)
        self.assertNotIn("never touches", self.succeed(*query, "--pose", "0 0 0.99 0 0 0 1"))
        behind = self.succeed(*query, "--method", "graph", "--pose", "0 0 1.5 0 0 0 1")
        self.assertNotIn("never touches", behind)

    def test_what_no_camera_has_is_doubted(self):
        run = ("--duration", 0.1, "-o", self.path("doubt"))
        narrow = self.sequence(*run)
        narrow = tuple("1300,1300,79.5,59.5" if word == INTRINSICS else word for word in narrow)
        result = palpate(*narrow)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("field of view of 7 degrees", result.stderr)
        self.assertNotIn("field of view", palpate(*self.sequence(*run)).stderr)
        image = min(glob.glob(os.path.join(self.frames, "**/*.png"), recursive=True))
        for intrinsics, is_doubted in (("1300,1300,79.5,59.5", True), (INTRINSICS, False)):
            result = palpate("query", self.tool, "--depth", image, "--depth-unit", 0.0001, "--intrinsics", intrinsics,
                             "--pose", "0 0 1 0 0 0 1")
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertEqual("field of view of 7 degrees" in result.stderr, is_doubted, result.stderr)
        camera = "scene:wall?pose=0,0,0.1,0,0,0,1"
        for verb in (("touch", self.tool, *run), ("query", self.tool, "--pose", "0 0 1 0 0 0 1")):
            twins = palpate(*verb, "--camera", camera, "--camera", camera)
            self.assertEqual(twins.returncode, 0, twins.stderr)
            self.assertIn("is given twice, at the same pose", twins.stderr)
            others = palpate(*verb, "--camera", camera, "--camera", "scene:wall")
            self.assertNotIn("given twice", others.stderr)

    def test_a_port_that_is_taken_makes_way(self):
        with socket.socket() as taken:
            taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                taken.bind(("127.0.0.1", 8787))
            except OSError:
                pass  # by somebody else
            taken.listen()
            _, output, errors = self.interrupt(("view", self.tool), lambda since: since > 1)
            port = re.search(r"open http://127\.0\.0\.1:(\d+)/", output).group(1)
            self.assertNotEqual(port, "8787")
            self.assertIn(f"port 8787 is in use by another program: taking {port}", errors)
            self.expect_failure(1, "view", self.tool, "--port", 8787, mentions="port 8787 on 127.0.0.1 is in use")


class Try(CommandLineCase):

    def setUp(self):
        self.temporary = tempfile.mkdtemp(dir=self.folder)
        self.environment = {**os.environ, "TMPDIR": self.temporary}
        for name in ("DISPLAY", "WAYLAND_DISPLAY"):
            self.environment.pop(name, None)

    def begin(self, *arguments):
        return subprocess.Popen([PALPATE, "try", "--port", "0", *map(str, arguments)], stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True, env=self.environment)

    def expect_page(self, process):
        """The page answers, and the run has a report."""
        address, deadline = None, time.monotonic() + 300
        while address is None and time.monotonic() < deadline:
            line = process.stderr.readline()
            self.assertNotEqual(line, "", "it ended")
            address = re.search(r"open (http://127\.0\.0\.1:\d+/\S*) in a browser", line)
        request = urllib.request.Request(address.group(1), headers={"Accept-Encoding": "gzip"})
        with urllib.request.urlopen(request, timeout=60) as answer:
            self.assertIn(b"<html", gzip.decompress(answer.read()).lower())

    def test_a_pen_in_a_hand(self):
        process = self.begin("--duration", 2)
        self.expect_page(process)
        output, errors = process.communicate(timeout=300)
        self.assertEqual(process.returncode, 0, errors)
        report = re.search(r"(?m)^report: (.*)$", output).group(1)
        self.assertTrue(os.path.exists(report))
        with open(os.path.join(os.path.dirname(report), "summary.json")) as file:
            summary = json.load(file)
        self.assertEqual((summary["device"]["kind"], summary["cameras"][0]["width"] > 0), ("page", True))

    def test_your_own_mesh_tool_and_camera(self):
        for tool in (self.mesh, self.tool):
            process = self.begin(tool, "--camera", "scene:wall", "--no-open", "--duration", 1)
            self.expect_page(process)
            output, errors = process.communicate(timeout=300)
            self.assertEqual(process.returncode, 0, errors)
            self.assertIn("report: ", output)

    def test_an_end_by_ctrl_c(self):
        process = self.begin()
        self.expect_page(process)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=300)
        self.assertEqual(process.returncode, 0, errors)
        self.assertIn("report: ", output)

    def test_bad_input_leaves_nothing(self):
        open_mesh = self.path("open.ply")
        with open(open_mesh, "w") as file:
            file.write("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                       "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n0.1 0 0\n0 0.1 0\n3 0 1 2\n")
        for status, words, arguments in ((1, "open.ply", (open_mesh,)), (1, "absent.stl", (self.path("absent.stl"),)),
                                         (1, "absent.palp", (self.path("absent.palp"),)), (2, "--camera", ("--camera", "")),
                                         (1, "did you mean hand?", ("--camera", "scene:hnad")), (2, "--unit", ("--unit", "mile"))):
            result = subprocess.run([PALPATE, "try", "--no-open", *arguments], capture_output=True, text=True,
                                    env=self.environment, timeout=300)
            self.assertEqual((result.returncode, result.stdout), (status, ""), (arguments, result.stderr))
            self.assertIn(words, result.stderr)
            self.assertEqual(glob.glob(os.path.join(self.temporary, "*")), [])


if __name__ == "__main__":
    cli_case.main()
