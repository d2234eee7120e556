#!/usr/bin/env python3
"""Refuses pages that name what is not there: links to files and headings, files of the project, and tests.

Also decisions that are called by the number of another one, and text that a table swallows.

usage: tools/check_docs.py [ROOT]
"""

import re
import sys
from pathlib import Path

from project_files import ROOT, project_files

CODE_BLOCK = re.compile(r"^ *```.*?^ *```", re.M | re.S)
LINK = re.compile(r"\]\(([^()\s]*)\)")
HEADING = re.compile(r"^#+ +(.+?) *$", re.M)
CODE = re.compile(r"`([^`\n]+)`")
TEST = re.compile(r"([A-Z]\w+)?\.([A-Z]\w{5,})")
TEST_DEFINED = re.compile(r"\bTEST(?:_[FP])?\(\s*(\w+),\s*(\w+)\s*\)")
FILE = re.compile(r"(?:bench|cmake|docs|examples|include|plugins|python|scripts|src|tests|tools)/[\w./-]*\w")
DECISION = re.compile(r"decision (\d+)\]\([^()\s]*?(\d{4})-[^()\s]*\)")
PLACEHOLDER = re.compile(r"\b[A-Z]{2,}\b")


def without_blocks(page):
    """The page with its blocks of code empty, so that lines keep their numbers."""
    return CODE_BLOCK.sub(lambda block: "\n" * block[0].count("\n"), page)


def anchors(page):
    """What links to the headings of a page end with."""
    words = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in HEADING.findall(without_blocks(page)))
    return {word.replace(" ", "-") for word in words}


def tests_of(source):
    """(suite, name) of every test that a source file defines."""
    return set(TEST_DEFINED.findall(source))


def test_is_there(suite, name, tests):
    """`.Name` is one of any suite; suites with a prefix or number (`One/Suite.Name/2`) are written without."""
    return any(name == known and suite in ("", of) for of, known in tests)


def problems(page, path, root, tests):
    """(line number, what is wrong) of a page at `path`, relative to `root`."""
    is_table = False
    for number, line in enumerate(without_blocks(page).splitlines(), 1):
        if is_table and line.strip() and not line.startswith("|"):
            yield number, "text right below a table belongs to it: leave a line empty"
        is_table = line.startswith("|")
        for named, linked in DECISION.findall(line):
            if int(named) != int(linked):
                yield number, f"decision {named} links to decision {int(linked)}"
        for link in LINK.findall(line):
            file, _, anchor = link.partition("#")
            if re.match(r"[a-z]+:", file):
                continue
            target = root / path.parent / file
            if not target.exists():
                yield number, f"a link to a file that is not there: {link}"
            elif anchor and anchor not in anchors(target.read_text() if file else page):
                yield number, f"a link to a heading that is not there: {link}"
        for code in CODE.findall(line):
            if (test := TEST.fullmatch(code)) and not test_is_there(test[1] or "", test[2], tests):
                yield number, f"a test that is not there: {code}"
            if FILE.fullmatch(code) and not PLACEHOLDER.search(code):
                if not any((base / code).exists() for base in (root, root / path.parent)):
                    yield number, f"a file that is not there: {code}"


def main():
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT
    files = project_files(root)
    tests = set()
    for path in files:
        if path.parts[0] == "tests" and path.suffix in (".cpp", ".cu", ".h"):
            tests |= tests_of((root / path).read_text())
    pages = [path for path in files if path.suffix == ".md"]
    num_problems = 0
    for path in pages:
        for number, what in problems((root / path).read_text(), path, root, tests):
            print(f"{path}:{number}: {what}")
            num_problems += 1
    print(f"check_docs: {len(pages)} pages, {num_problems} problems")
    return 1 if num_problems else 0


if __name__ == "__main__":
    sys.exit(main())
