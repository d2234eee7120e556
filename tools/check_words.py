#!/usr/bin/env python3
"""Refuses what belongs to one machine or one day: absolute paths of a machine, names of package
registry hosts, and notes to oneself; in names of the code, words that the field does not use; and
comments and errors that open with a relative word instead of naming the thing.

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

# Identifiers of the library and the programs, not words of sentences: each with the term to use.
TERMS = tuple(
    (re.compile(rf"(?<![/\w])(?:{names})(?!\w)"), f"a name that the field does not use: {term}")
    for names, term in (
        (r"Told\w+|is_told_?|told_(?:as|at|by|fault|in|joints|unit)|tells?_[a-z_]+", "report, publish, require"),
        (r"\w*[Ll]ender\w*|[Bb]orrow\w+|may_lend|laid_over|badness", "donor, cost, composite"),
        (r"\w*[Ww]ishes_?|obey", "subscription, execute"),
        (r"\w*Onlooker\w*|\w*[Mm]inder_?|Keeper", "consumer, governor, observer"),
        (r"(?:Hand|Camera|Tool)Moments?|\w+_moment_json|on_moment", "snapshot, blend"),
        (r"Felt\w*|felt_\w+|is_felt_?|num_felt|for_felt|Feeling", "measure, contact, touch"),
        (r"Asked\w*|asked_(?:window|stream)|ask_for_\w+|ask_(?:to|field|state|deep\w*)\w*", "query, request, need"),
        (r"Heard\w*|hear_\w+|heard_|is_deaf_?|has_changed_words_?", "receive, handle, ignore"),
        (r"PlaceState|ids_of_places|(?:touched|skipped|donor)_places_", "slot"),
        (r"Seen(?:Frame|Scene|Table|Pose)\w*", "frame, scene, table"),
        (r"go_on_from|let_go|lets_go|is_let_go", "resume, release"),
        (r"k(?:Most|Least|Fewest)\w*", "kMax, kMin"),
        (r"(?:most|least)_\w+", "max, min"),
        (r"(?:is_|has_|num_|not_)?(?:wanted|asked|told)_?|is(?:Wanted|Asked)", "desired, requested, reported"),
        (r"asks?|asking|SolidAsking", "query, sample, request, evaluate"),
    )
)
NAMED = re.compile(r"(?:apps|eval|include|src|python/src|web/src)/.*\.(?:h|cpp|cu|cuh|ts)")

# "Shift of the edge, pixels", not "By how much the edge is shifted".
RELATIVE = re.compile(r"(?:Of|By|What|How|Where|Whether|Which|That|So|Who|Whose|Whom)\b", re.IGNORECASE)
EXPLAINED = re.compile(r"(?:apps|bench|eval|include|python|src|tests|web/src)/.*\.(?:h|cpp|cu|cuh|ts|py)")
COMMENT_OF_PYTHON = re.compile(r'(?P<code>.*?)(?:(?<!\S)#|""")\s*(?P<text>.*)')
COMMENT = re.compile(r"(?P<code>.*?)(?:(?<!:)//[/!]?<?|/\*\*?|^\s*\*(?=\s))\s*(?P<text>.*)")
ERROR = re.compile(r'Errc::\w+,\s*"(?P<text>[^"]*)')
STRING = re.compile(r"\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])*'|//.*")


def find_openers(text, name):
    """Yields (line number, first words) of each comment and error that opens with a relative word."""
    comment = COMMENT_OF_PYTHON if name.endswith(".py") else COMMENT
    was_comment = False
    for number, line in enumerate(text.splitlines(), start=1):
        match = comment.match(line)
        is_alone = match is not None and not match["code"].strip()
        if match and not (is_alone and was_comment) and match["text"][:1].isupper() and RELATIVE.match(match["text"]):
            yield number, match["text"][:40]
        was_comment = is_alone and match["text"] != ""
    for error in ERROR.finditer(text):
        if RELATIVE.match(error["text"]):
            yield text.count("\n", 0, error.start("text")) + 1, error["text"][:40]


def check_text(text, name=""):
    """Yields (line number, found words, what is wrong)."""
    for number, found in find_openers(text, name) if EXPLAINED.fullmatch(name) else ():
        yield number, found, "an opening that names nothing: say what the thing is or does"
    has_names = NAMED.fullmatch(name) is not None
    for number, line in enumerate(text.splitlines(), start=1):
        for pattern, problem in REFUSED:
            match = pattern.search(line)
            if match:
                yield number, match.group(0), problem
        code = STRING.sub("", line) if has_names else ""
        for pattern, problem in TERMS if has_names else ():
            match = pattern.search(code)
            if match:
                yield number, match.group(0), problem


def main(root=ROOT):
    num_files = num_problems = 0
    for path in project_files(root):
        content = (root / path).read_bytes()
        if b"\0" in content:  # not text
            continue
        num_files += 1
        for number, found, problem in check_text(content.decode("utf-8", errors="replace"), path.as_posix()):
            num_problems += 1
            print(f"{path.as_posix()}:{number}: '{found}' is {problem}")
    print(f"check_words: {num_files} files, {num_problems} problems")
    return 1 if num_problems else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()) if len(sys.argv) > 1 else main())
