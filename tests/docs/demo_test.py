#!/usr/bin/env python3
"""scripts/demo.sh with a program that only writes what it is told to: every report is listed at the end.

usage: tests/docs/demo_test.py
"""
import os
import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """#!/usr/bin/env bash
verb=$1
while [ "$1" != -o ]; do shift; done
if [ "$verb" = touch ]; then mkdir -p "$2"; echo page >"$2/report.html"; else echo "$verb" >"$2"; fi
"""


class Demo(unittest.TestCase):
    def test_all_reports_are_listed(self):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch).resolve()
            for part in ("scripts", "build/release/bin", "data/sequences/visp_rbt/depth", "data/meshes_good"):
                (folder / part).mkdir(parents=True)
            (folder / "data/meshes_good/fuze_bottle.obj").touch()
            program = folder / "build/release/bin/palpate"
            program.write_text(PROGRAM)
            program.chmod(0o755)
            shutil.copy(ROOT / "scripts/demo.sh", folder / "scripts")
            done = subprocess.run([folder / "scripts/demo.sh"], env=dict(os.environ, PALPATE_DATA=str(folder / "data")),
                                  capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            listed = done.stdout.split("Reports, to open in a browser:")[1].split("==")[0].split()
            made = sorted(map(str, (folder / "demo").glob("*/report.html")))
            self.assertEqual(len(made), 4)
            self.assertEqual(sorted(listed), made)


if __name__ == "__main__":
    unittest.main()
