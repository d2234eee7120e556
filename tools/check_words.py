#!/usr/bin/env python3
"""Refuses what belongs to one machine or one day: absolute paths of somebody's machine, names of
package registry hosts, and notes to oneself.

usage: tools/check_words.py [ROOT]
"""

import re
import sys
from pathlib import Path

from project_files import ROOT, project_files

# The patterns are written so that they do not match this file.
REFUSED = (
    (
        re.compile(r"(?<![\w.$}/])/(?:work|home|root|Users|mnt|workspace)/[\w.]"),
        "a path of one machine: make it relative or a parameter",
    ),
    (
        re.compile(
            r"\b(?:pypi\.(?:org|python)|files\.pythonhosted\.|registry\.(?:npmjs|yarnpkg)\.|"
            r"(?:deb|security|snapshot)\.debian\.|(?:archive|ports)\.ubuntu\.|proxy\.golang\.|"
            r"(?:static\.)?crates\.io|conda\.anaconda\.|center\.conan\.|\w*arti" r"factory)",
            re.IGNORECASE,
        ),
        "the name of a registry host: leave it to the package manager's own settings",
    ),
    (
        re.compile(r"\b(?:TO" r"DO|FIX" r"ME|X" r"XX|HA" r"CK)\b"),
        "a note to oneself: do it, or write it down as a limit in the documentation",
    ),
)


def check_text(text):
    """Yields (line number, found words, what is wrong)."""
    for number, line in enumerate(text.splitlines(), start=1):
        for pattern, problem in REFUSED:
            match = pattern.search(line)
            if match:
                yield number, match.group(0), problem


def main(root=ROOT):
    num_files = num_problems = 0
    for path in project_files(root):
        content = (root / path).read_bytes()
        if b"\0" in content:  # not text
            continue
        num_files += 1
        for number, found, problem in check_text(content.decode("utf-8", errors="replace")):
            num_problems += 1
            print(f"{path.as_posix()}:{number}: '{found}' is {problem}")
    print(f"check_words: {num_files} files, {num_problems} problems")
    return 1 if num_problems else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()) if len(sys.argv) > 1 else main())
