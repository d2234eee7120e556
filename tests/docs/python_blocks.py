#!/usr/bin/env python3
"""Runs every block in Python of README and guides with the palpate that is installed, page by page in
a folder with what a reader brings: tool.palp, a pen of 12 cm.

usage: PYTHON tests/docs/python_blocks.py [PAGE ...]

A block without an import goes on where the one before it ended. A block is run unless the line before it is `<!-- not run: WHY -->`. Where its first line is
`# needs: MODULE` and that is not installed, it is skipped by name.
"""
import importlib.util
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import palpate

ROOT = Path(__file__).resolve().parents[2]
FENCE = re.compile(r"^```python\n(.*?)^```$", re.S | re.M)
NOT_RUN = re.compile(r"<!-- not run: (.+) -->\s*\Z")
IMPORT = re.compile(r"^(import|from) ", re.M)
NEEDS = re.compile(r"# needs: (\w+)\n")


def bring(folder):
    program = Path(palpate.__file__).parent / "bin/palpate"
    subprocess.run([program, "shape", "stylus", "--size", "0.12", "-o", folder / "stylus.stl"], check=True,
                   stdout=subprocess.DEVNULL)
    palpate.pack_file(folder / "stylus.stl", 300).save(folder / "tool.palp")


def main(pages):
    num_run = num_failed = 0
    for page in pages:
        text = page.read_text()
        with tempfile.TemporaryDirectory() as name:
            folder, before = Path(name), ""
            for match in FENCE.finditer(text):
                where = f"{page.relative_to(ROOT)}:{text.count(chr(10), 0, match.start()) + 2}"
                why, needs = NOT_RUN.search(text[:match.start()]), NEEDS.match(match.group(1))
                if why or (needs and importlib.util.find_spec(needs.group(1)) is None):
                    print(f"{where}: not run: {why.group(1) if why else needs.group(1) + ' is not installed'}")
                    continue
                if not (folder / "tool.palp").exists():
                    bring(folder)
                num_run += 1
                code = match.group(1) if IMPORT.search(match.group(1)) else before + match.group(1)
                before = code
                result = subprocess.run([sys.executable, "-c", code], cwd=folder,
                                        capture_output=True, text=True, timeout=600, check=False)
                print(f"{where}: {'ran' if result.returncode == 0 else 'FAILED'}")
                if result.returncode != 0:
                    num_failed += 1
                    print(result.stdout + result.stderr)
    print(f"{num_run} blocks, {num_failed} failed")
    return 1 if num_failed or num_run == 0 else 0


if __name__ == "__main__":
    named = [Path(page).resolve() for page in sys.argv[1:]]
    sys.exit(main(named or [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]))
