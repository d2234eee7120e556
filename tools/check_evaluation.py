#!/usr/bin/env python3
"""Refuses a page of the evaluation that is not of today's arithmetic or lacks a figure.

docs/evaluation.md has the hash of the tests/contact/golden.txt that it was made with, and has to have all rows of
tests/eval/rows.txt. make golden marks a page that has become old; make eval makes it anew; make ci-all checks it.

usage: tools/check_evaluation.py [--hash | --mark]
  --hash   prints the hash of today's golden.txt and does nothing else
  --mark   writes at the top of the page that it is old, or removes that
"""

import hashlib
import re
import sys

from project_files import ROOT

PAGE = ROOT / "docs/evaluation.md"
GOLDEN = ROOT / "tests/contact/golden.txt"
ROWS = ROOT / "tests/eval/rows.txt"

ARITHMETIC = re.compile(r"^\*\*Arithmetic:\*\* .*?`([0-9a-f]{16})`", re.M)
MARK = ("> **Older than the program:** measurements have other bits today than when this page was made. "
        "`make eval` makes it anew.\n\n")
DRAWN = re.compile(r"^Drawn, in the report only: (.*)\.$", re.M)
CELL = re.compile(r"^\| ([^|]+?) \|", re.M)
NUMBERS = re.compile(r"(\d+)\.(\d+)[a-z]*(?:-(?:\d+\.)?(\d+))?")


def hash_of(golden):
    """The first half of the SHA-256 of the text, as much as anybody compares."""
    return hashlib.sha256(golden.encode()).hexdigest()[:16]


def is_of(page, golden):
    """Whether the page was made with this golden.txt."""
    made_with = ARITHMETIC.search(page)
    return made_with is not None and made_with[1] == hash_of(golden)


def marked(page, golden):
    """The page, with the mark below its title exactly if it is old."""
    page = page.replace(MARK, "")
    if is_of(page, golden):
        return page
    title, rest = page.split("\n\n", 1)
    return f"{title}\n\n{MARK}{rest}"


def figures_on(page):
    """Ids of all rows and drawings of the page, and the figures of the thesis that they stand for."""
    page = page.replace("\\", "")
    cells = CELL.findall(page) + [cell for drawn in DRAWN.findall(page) for cell in drawn.split(", ")]
    figures = set(cells)
    for cell in cells:
        for chapter, first, last in NUMBERS.findall(cell):
            figures |= {f"{chapter}.{number}" for number in range(int(first), int(last or first) + 1)}
    return figures


def wanted_rows(text):
    """Lines of rows.txt."""
    return [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("#")]


def problems(page, golden, rows):
    """What is wrong with the page, one sentence each."""
    if not is_of(page, golden):
        yield "is not of today's tests/contact/golden.txt: make eval makes it anew"
    if marked(page, golden) != page:
        yield "does not say at its top whether it is old: tools/check_evaluation.py --mark"
    figures = figures_on(page)
    if missing := [row for row in wanted_rows(rows) if row not in figures]:
        yield f"lacks figures of tests/eval/rows.txt: {', '.join(missing)}: make eval makes all"


def main():
    golden, page = GOLDEN.read_text(), PAGE.read_text()
    if sys.argv[1:] == ["--hash"]:
        print(hash_of(golden))
        return 0
    if sys.argv[1:] == ["--mark"]:
        if (text := marked(page, golden)) != page:
            PAGE.write_text(text)
        return 0
    if sys.argv[1:]:
        print(__doc__.strip(), file=sys.stderr)
        return 2
    found = list(problems(page, golden, ROWS.read_text()))
    for problem in found:
        print(f"{PAGE.relative_to(ROOT)} {problem}")
    print(f"check_evaluation: {len(found)} problems")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
