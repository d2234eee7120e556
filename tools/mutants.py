#!/usr/bin/env python3
"""Changes one operator at a time in the sources of contact, field and haptics, and asks the tests.

Every mutant is a place and a change: + for -, * for /, < for <=, && for ||, a constant that is off by
a little. Which ones are tried follows from --seed alone. A mutant that the tests of its module do not
notice has survived: it is either equivalent or a missing test. Results are added to the file given by
--results, line by line, so that a run that was stopped goes on where it was.

usage: tools/mutants.py [--count 200] [--seed 1] [--share K/N] [--tree build/mutants] [--results build/mutants.tsv]

Works in --tree, a copy of the working tree, never in the tree itself. With --share, only every Nth mutant from the
Kth on is tried: N machines, or N copies of the tree, then judge --count together."""

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from project_files import ROOT

MODULES = ("contact", "field", "haptics")
# Test programs of a module, quick ones first; the first that fails kills the mutant.
TESTS = {
    "contact": ["test_golden", "test_between_surfaces", "test_contact_parts", "test_contact_batch", "test_contact",
                "test_field_contact", "test_depth_hull", "test_body_contact", "test_contact_query"],
    "field": ["test_golden", "test_field_contact", "test_field", "test_depth_hull"],
    "haptics": ["test_haptics", "test_run_pipeline"],
}
CHANGES = [
    (r"(?<=[\w)\]]) \+ (?=[\w(])", " - "),
    (r"(?<=[\w)\]]) - (?=[\w(])", " + "),
    (r"(?<=[\w)\]]) \* (?=[\w(])", " / "),
    (r"(?<=[\w)\]]) \* (?=[\w(])", " + "),
    (r"(?<=[\w)\]]) / (?=[\w(])", " * "),
    (r" < ", " <= "),
    (r" <= ", " < "),
    (r" > ", " >= "),
    (r" >= ", " > "),
    (r" < ", " > "),
    (r" == ", " != "),
    (r" != ", " == "),
    (r" && ", " || "),
    (r" \|\| ", " && "),
    (r"(?<=\b)0\.5(?=\b)", "0.51"),
    (r" \+= ", " -= "),
    (r"std::min\(", "std::max("),
    (r"std::max\(", "std::min("),
]
SKIPPED = re.compile(r"^\s*(//|#|template|static_assert|using|PALPATE_ASSERT)|operator|\bErr(or|c)\b|\"")


def mutants_of(path):
    """All (line number, column, pattern, replacement) of a file."""
    found = []
    for number, line in enumerate(path.read_text().splitlines()):
        code = line.split("//")[0]
        if SKIPPED.search(code):
            continue
        for pattern, replacement in CHANGES:
            if replacement.strip() in "<>" and ("template" in code or "_cast<" in code):
                continue
            for match in re.finditer(pattern, code):
                found.append((number, match.start(), match.group(), replacement))
    return found


def all_mutants():
    mutants = []
    for module in MODULES:
        for path in sorted((ROOT / "src" / module).rglob("*")):
            if path.suffix not in (".h", ".cpp") or "cuda" in path.as_posix():
                continue
            name = path.relative_to(ROOT).as_posix()
            mutants += [(module, name, *place) for place in mutants_of(path)]
    return mutants


def run(command, cwd, timeout):
    try:
        done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=timeout)
        return done.returncode
    except subprocess.TimeoutExpired:
        return "timeout"


def seconds_of(programs, build):
    """How long each takes when nothing is wrong. Error: a test fails before anything was changed."""
    seconds = {}
    for program in programs:
        begin = time.monotonic()
        if run([str(build / "bin" / program), "--gtest_brief=1"], build, 3600) != 0:
            sys.exit(f"mutants: {program} fails without a change; run it by hand and mend it first")
        seconds[program] = time.monotonic() - begin
    return seconds


def judge(mutant, copy, build, jobs, seconds):
    """killed by PROGRAM, does not compile, or survived. `seconds`: of each program without a change;
    one that takes ten times as long does not end."""
    module, name, number, column, before, after = mutant
    path = copy / name
    original = path.read_text()
    lines = original.splitlines(keepends=True)
    line = lines[number]
    lines[number] = line[:column] + after + line[column + len(before):]
    path.write_text("".join(lines))
    try:
        for program in TESTS[module]:
            if run(["ninja", "-C", str(build), f"-j{jobs}", program], copy, 1800) != 0:
                return "does not compile"
            status = run([str(build / "bin" / program), "--gtest_brief=1", "--gtest_fail_fast"],
                         copy, 20 + 10 * seconds[program])
            if status != 0:
                return f"killed by {program}" + (" (time-out)" if status == "timeout" else "")
        return "survived"
    finally:
        path.write_text(original)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--share", default="1/1", metavar="K/N")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--tree", default="build/mutants")
    parser.add_argument("--results", default="build/mutants.tsv")
    options = parser.parse_args()
    share, shares = map(int, options.share.split("/"))
    if not 1 <= share <= shares:
        parser.error(f"--share {options.share}: K has to be from 1 to N")
    # As the release lies in its tree: what was compiled there is in the compiler's cache.
    copy, results = (ROOT / options.tree).resolve(), (ROOT / options.results).resolve()
    build = copy / "build" / "release"
    build.mkdir(parents=True, exist_ok=True)
    os.environ["CCACHE_BASEDIR"] = str(copy)
    names = subprocess.run(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
                           cwd=ROOT, capture_output=True, check=True).stdout.decode()
    for name in filter(None, names.split("\0")):
        source, target = ROOT / name, copy / name
        if not source.is_file() or (target.exists() and
                                    target.read_bytes() == source.read_bytes()):
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(source, target)
    subprocess.run(["cmake", "-S", str(copy), "-B", str(build), "-G", "Ninja",
                    "-DCMAKE_BUILD_TYPE=Release", "-DPALPATE_APPS=OFF"],
                   check=True, stdout=subprocess.DEVNULL)
    programs = sorted({program for module in MODULES for program in TESTS[module]})
    subprocess.run(["ninja", "-C", str(build), f"-j{options.jobs}", *programs], check=True,
                   stdout=subprocess.DEVNULL)
    seconds = seconds_of(programs, build)

    mutants = all_mutants()
    random.Random(options.seed).shuffle(mutants)
    mutants = mutants[share - 1::shares]
    count = options.count // shares + (share <= options.count % shares)
    known = {}
    if results.exists():
        for line in results.read_text().splitlines():
            *key, verdict = line.split("\t")
            known["\t".join(key)] = verdict
    counts = {"killed": 0, "survived": 0, "does": 0}
    for mutant in mutants:
        if counts["killed"] + counts["survived"] >= count:
            break
        module, name, number, column, before, after = mutant
        key = f"{name}\t{number + 1}\t{column + 1}\t{before.strip()} -> {after.strip()}"
        if key not in known:
            known[key] = judge(mutant, copy, build, options.jobs, seconds)
            with open(results, "a") as file:
                file.write(f"{key}\t{known[key]}\n")
        counts[known[key].split()[0]] += 1
        print(f"{known[key]:40} {key}", flush=True)
    judged = counts["killed"] + counts["survived"]
    print(f"{judged} mutants: {counts['killed']} killed, {counts['survived']} survived "
          f"({counts['does']} more did not compile)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
