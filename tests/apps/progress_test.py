"""Progress that long verbs show on a terminal.

Usage: progress_test.py PATH_OF_PALPATE"""

import os
import pty
import re
import signal
import subprocess
import threading
import time

import cli_case
from cli_case import CommandLineCase, PALPATE


class Terminal:
    """A program whose messages go to a terminal."""

    def __init__(self, *arguments):
        self.shown = b""
        self.master, terminal = pty.openpty()
        self.program = subprocess.Popen([PALPATE, *map(str, arguments)], stdout=subprocess.PIPE, stderr=terminal, text=True)
        os.close(terminal)
        self.reader = threading.Thread(target=self.read)
        self.reader.start()

    def read(self):
        try:
            while more := os.read(self.master, 4096):
                self.shown += more
        except OSError:  # nobody writes there any more
            pass

    def end(self):
        """Waits for it; returns its status, its output, and the lines that it showed, also those that were replaced."""
        output = self.program.communicate(timeout=300)[0]
        self.reader.join()
        os.close(self.master)
        return self.program.returncode, output, self.lines()

    def lines(self):
        return re.split(r"\r\x1b\[K|\r?\n", self.shown.decode())


class OnATerminal(CommandLineCase):
    BAR = r"^{} \[=*\s*\] +\d+ %  (-:--|\d+:\d\d) left  .*Ctrl-C ends"

    def run_along_a_path(self, run):
        poses = self.path("pressing.txt")
        with open(poses, "w") as file:
            file.write("0 0 0 0.4 0 0 0 1\n120 0 0 0.48 0 0 0 1\n")
        return Terminal(*self.sequence("-o", run, "--path", poses, "--duration", 120)).end()

    def expect_progress(self, lines, title):
        bars = [line for line in lines if re.search(self.BAR.format(title), line)]
        self.assertGreater(len(bars), 1, lines)
        shares = [int(re.search(r"(\d+) %", bar).group(1)) for bar in bars]
        self.assertEqual(shares, sorted(shares))
        self.assertGreater(shares[-1], shares[0])
        self.assertEqual(lines[-1], "", "nothing of it stays")
        return bars

    def test_a_run_along_a_path_and_its_replays(self):
        run = self.path("run_shown")
        status, _, lines = self.run_along_a_path(run)
        self.assertEqual(status, 0, lines)
        bars = self.expect_progress(lines, "touching")
        self.assertRegex(bars[-1], r"left  \d+\.\d s, \d+\.\d\d N; Ctrl-C")
        for more in ((), ("-o", self.path("run_again"), "--method", "graph")):
            status, output, lines = Terminal("replay", run, *more).end()
            self.assertEqual(status, 0, lines)
            self.assertIn("120000 ticks", output)
            self.expect_progress(lines, "repeating")

    def test_a_live_run_without_an_end(self):
        terminal = Terminal("touch", self.tool, "--scene", "wall", "--device", "page", "--view-port", 0,
                            "-o", self.path("run_live"), "--settings", self.patient_settings("patient.toml"))
        wanted = r"^touching  \d+\.\d s, \d+\.\d\d N, \d+ Hz; Ctrl-C ends the run$"
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline and not any(re.search(wanted, line) for line in terminal.lines()[:-1]):
            time.sleep(0.1)
        terminal.program.send_signal(signal.SIGINT)
        status, _, lines = terminal.end()
        self.assertEqual(status, 0, lines)
        self.assertTrue(any(re.search(wanted, line) for line in lines), lines)
        self.assertFalse(any("0 %" in line for line in lines), lines)


if __name__ == "__main__":
    cli_case.main()
