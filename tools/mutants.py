#!/usr/bin/env python3
"""Changes one operator at a time in the sources of contact, field and haptics, and runs the tests.

Every mutant is a place and a change: + for -, * for /, < for <=, && for ||, a constant that is off by
a little. Which ones are tried follows from --seed alone. A mutant that the tests of its module do not
notice has survived: it is either equivalent or a missing test. Results are added to the file given by
--results, line by line, so that a run that was stopped goes on where it was.

usage: tools/mutants.py [--count 200] [--seed 1] [--share K/N] [--jobs 2] [--minutes M]
                        [--tree build/mutants] [--results build/mutants.tsv] [--only FILE:LINE]

Works in --tree: a copy of the working tree that is built once, and for each job a folder with the one
changed file and what had to be compiled anew. With --minutes it ends by itself; what had not been
judged by then is counted, too. With --share, only every Nth mutant from the Kth on is tried: N
machines then judge --count together. Where GoogleTest is not installed, CMAKE_PREFIX_PATH names it."""

import argparse
import fcntl
import json
import os
import random
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import namedtuple
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from project_files import ROOT, project_files

MODULES = ("contact", "field", "haptics")
# Test programs of a module, quick ones first; the first that fails kills the mutant.
TESTS = {
    "contact": ["test_golden", "test_between_surfaces", "test_contact_parts", "test_contact_batch", "test_contact",
                "test_field_contact", "test_depth_hull", "test_body_contact", "test_contact_query"],
    "field": ["test_golden", "test_field_contact", "test_field", "test_depth_hull", "test_sensor_batch_cuda",
              "test_run_pipeline"],
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


class OutOfTime(Exception):
    pass


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


def all_mutants(root=ROOT):
    mutants = []
    for module in MODULES:
        for path in sorted((root / "src" / module).rglob("*")):
            if path.suffix not in (".h", ".cpp") or "cuda" in path.as_posix():
                continue
            name = path.relative_to(root).as_posix()
            mutants += [(module, name, *place) for place in mutants_of(path)]
    return mutants


def run(command, cwd, timeout, deadline=None):
    """The exit status, or "timeout". OutOfTime: the deadline came first."""
    left = timeout if deadline is None else min(timeout, deadline - time.monotonic())
    if left > 0:
        process = subprocess.Popen(command, cwd=cwd, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                   start_new_session=True)
        try:
            return process.wait(left)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if deadline is not None and time.monotonic() >= deadline:
        raise OutOfTime
    return "timeout"


# A source as it is compiled for a target.
Unit = namedtuple("Unit", "target made source command")


class Build:
    """The unchanged tree, built: how each object is compiled, what it includes, and of which objects
    and libraries a test program is linked."""

    def __init__(self, tree, programs, jobs):
        # As the release lies in its tree: what was compiled there is in the compiler's cache.
        self.tree, self.folder = tree, tree / "build" / "release"
        subprocess.run(["cmake", "-S", str(tree), "-B", str(self.folder), "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
                        "-DPALPATE_APPS=OFF", "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON"],
                       check=True, stdout=subprocess.DEVNULL)
        self.link = {}  # command by program
        for program in sorted(programs):
            told = subprocess.run(["ninja", "-C", str(self.folder), "-t", "commands", "-s", f"bin/{program}"],
                                  capture_output=True, text=True)
            link = re.search(r": && (.* -o .*?) && ", told.stdout)
            if link:
                self.link[program] = shlex.split(link[1])
            else:
                print(f"mutants: this build has no {program}: it is not run")
        if not self.link:
            sys.exit("mutants: this build has none of the tests")
        subprocess.run(["ninja", "-C", str(self.folder), f"-j{jobs}", *self.link], check=True,
                       stdout=subprocess.DEVNULL)
        self.included = {}  # by file
        self.units = []
        for entry in json.loads((self.folder / "compile_commands.json").read_text()):
            command = shlex.split(entry["command"])
            if "ccache" in " ".join(command[:4]):
                command = command[[Path(part).name for part in command].index("ccache") + 1:]
            made = command[command.index("-o") + 1]
            target = re.search(r"CMakeFiles/(.*)\.dir/", made)[1]
            self.units.append(Unit(target, made, Path(entry["file"]), tuple(command)))
        self.files = {unit.source: self.files_of(unit.source) for unit in self.units}

    def includes(self, path):
        if path not in self.included:
            names = re.findall(r'^\s*#include "([^"]+)"', path.read_text(), re.MULTILINE)
            places = [(self.tree / name, self.tree / "include" / name, path.parent / name) for name in names]
            self.included[path] = [next((place for place in some if place.is_file()), None) for some in places]
        return [path for path in self.included[path] if path]

    def files_of(self, source):
        """All files of the tree that a source includes, and itself."""
        seen, left = {source}, [source]
        while left:
            new = [path for path in self.includes(left.pop()) if path not in seen]
            seen.update(new)
            left += new
        return seen

    def units_of(self, program, changed):
        """What of a test program has to be compiled anew when a file has changed."""
        targets = {re.sub(r"^lib|\.a$", "", Path(part).name) for part in self.link[program] if part.endswith(".a")}
        return [unit for unit in self.units
                if unit.target in targets | {program} and changed in self.files[unit.source]]


def compiled(build, unit, place, changed, deadline):
    """The object of a unit with the changed file in front of its original, or None."""
    overlay, made, source = place / "overlay", place / unit.made, unit.source
    made.parent.mkdir(parents=True, exist_ok=True)
    instead = overlay / changed.relative_to(build.tree)
    if source == changed:
        source = instead
    elif str(changed) in source.read_text():  # a text that is compiled several times
        source = overlay / source.name
        source.write_text(unit.source.read_text().replace(str(changed), str(instead)))
    at = unit.command.index("-o")
    command = [unit.command[0], f"-I{overlay}", *unit.command[1:at], "-w", "-o", str(made), "-c", str(source)]
    return made if run(command, build.folder, 1800, deadline) == 0 else None


def linked(build, program, objects, place, deadline):
    """The program with these objects in place of its own, or None."""
    replaced = {unit.made: str(made) for unit, made in objects.items() if unit.target == program}
    command = [replaced.get(part, part) for part in build.link[program]]
    at = command.index("-o")
    command[at + 1] = str(place / program)
    # Before the libraries, of which nobody asks for what is there.
    command[at:at] = [str(made) for unit, made in objects.items() if unit.target != program]
    return place / program if run(command, build.folder, 600, deadline) == 0 else None


def judge(mutant, build, place, seconds, deadline):
    """killed by PROGRAM, does not compile, or survived. `seconds`: of each program without a change;
    one that takes ten times as long does not end."""
    module, name, number, column, before, after = mutant
    changed = build.tree / name
    lines = changed.read_text().splitlines(keepends=True)
    line = lines[number]
    lines[number] = line[:column] + after + line[column + len(before):]
    shutil.rmtree(place, ignore_errors=True)
    instead = place / "overlay" / name
    instead.parent.mkdir(parents=True)
    instead.write_text("".join(lines))
    objects = {}
    for program in TESTS[module]:
        if program not in seconds:
            continue
        units = build.units_of(program, changed)
        if not units:
            continue
        for unit in units:
            if unit not in objects:
                objects[unit] = compiled(build, unit, place, changed, deadline)
            if objects[unit] is None:
                return "does not compile"
        target = linked(build, program, {unit: objects[unit] for unit in units}, place, deadline)
        if target is None:
            return "does not compile"
        status = run([str(target), "--gtest_brief=1", "--gtest_fail_fast"], build.tree, 20 + 10 * seconds[program],
                     deadline)
        if status != 0:
            return f"killed by {program}" + (" (time-out)" if status == "timeout" else "")
    return "survived"


def copied(tree):
    for name in project_files():
        source, target = ROOT / name, tree / name
        if not target.exists() or target.read_bytes() != source.read_bytes():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)  # as new, so that it is built again


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--share", default="1/1", metavar="K/N")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--tree", default="build/mutants")
    parser.add_argument("--results", default="build/mutants.tsv")
    parser.add_argument("--only", metavar="FILE:LINE", help="all mutants of a line (or, without :LINE, of a file)")
    options = parser.parse_args()
    deadline = time.monotonic() + 60 * options.minutes if options.minutes else None
    share, shares = map(int, options.share.split("/"))
    if not 1 <= share <= shares:
        parser.error(f"--share {options.share}: K has to be from 1 to N")
    tree, results = (ROOT / options.tree).resolve(), (ROOT / options.results).resolve()
    tree.mkdir(parents=True, exist_ok=True)
    lock = open(tree / "lock", "w")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        sys.exit(f"mutants: {tree} is in use; give this run a --tree of its own")
    copied(tree)

    mutants = all_mutants(tree)
    random.Random(options.seed).shuffle(mutants)
    mutants = mutants[share - 1::shares]
    count = options.count // shares + (share <= options.count % shares)
    if options.only:
        name, _, line = options.only.partition(":")
        mutants = [m for m in all_mutants(tree) if m[1] == name and line in ("", str(m[2] + 1))]
        count = len(mutants)
    build = Build(tree, {program for mutant in mutants for program in TESTS[mutant[0]]}, options.jobs)

    pool = ThreadPoolExecutor(options.jobs)

    def seconds_of(program):
        begin = time.monotonic()
        if run([str(build.folder / "bin" / program), "--gtest_brief=1"], tree, 3600, deadline) != 0:
            print(f"mutants: {program} fails without a change; run it by hand and fix it first")
            return None
        return time.monotonic() - begin

    seconds = dict(zip(build.link, pool.map(seconds_of, build.link)))
    if None in seconds.values():
        return 1

    known = {}
    if results.exists():
        for line in results.read_text().splitlines():
            *key, verdict, text = line.split("\t")
            known[(*key, text)] = verdict
    counts = {"killed": 0, "survived": 0, "does": 0, "late": 0}
    places = SimpleQueue()
    for job in range(options.jobs):
        places.put(tree / f"job-{job + 1}")
    telling = threading.Lock()
    remaining = iter(mutants)

    def work():
        place = places.get()
        while True:
            with telling:
                enough = counts["killed"] + counts["survived"] >= count
                mutant = None if enough or counts["late"] else next(remaining, None)
            if mutant is None:
                return
            module, name, number, column, before, after = mutant
            text = (tree / name).read_text().splitlines()[number].strip()
            key = (name, str(number + 1), str(column + 1), f"{before.strip()} -> {after.strip()}")
            verdict = known.get((*key, text))
            try:
                is_new = verdict is None
                verdict = verdict or judge(mutant, build, place, seconds, deadline)
            except OutOfTime:
                verdict, is_new = "late", False
            with telling:
                counts[verdict.split()[0]] += 1
                if is_new:
                    with open(results, "a") as file:
                        file.write("\t".join([*key, verdict, text]) + "\n")
                print(f"{verdict:40}", *key, sep="\t", flush=True)

    for job in [pool.submit(work) for _ in range(options.jobs)]:
        job.result()
    judged = counts["killed"] + counts["survived"]
    print(f"{judged} mutants: {counts['killed']} killed, {counts['survived']} survived "
          f"({counts['does']} more did not compile, {counts['late']} were begun too late)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
