#!/usr/bin/env python3
"""No two types of one namespace have the same name. The compiler does not see two that are in different files, and the
linker takes the functions of one (say, of a vector of them) for the other's: silently, and only with some compilers.

Types in unnamed namespaces are their file's own. Those of examples/ are each in a program of its own.

usage: tools/check_types.py [ROOT]
"""

import re
import sys
from pathlib import Path

from project_files import ROOT, project_files

OPENED = re.compile(r"(?:inline )?namespace\b.*\{$")  # one or several
NAME = re.compile(r"namespace\s*([\w:]*)\s*\{")
CLOSED = re.compile(r"(\}+)\s*// namespace\b")
# One of them is compiled, never both.
ALTERNATIVES = {
    "src/gpu/runtime_emulated.cpp": "src/gpu/runtime_cuda.cpp",
    "scenes/body_rays_plain.cpp": "scenes/body_rays_embree.cpp",
    "src/core/thread_pool.cpp": "src/core/one_thread.cpp",
}

# Namespaces are not indented (.clang-format): what is inside of a type is.
TYPE = re.compile(
    r"(?:template <.*>\s*)?(?:struct|class|union|enum(?: class| struct)?)\s+"
    r"(?:\[\[.*?\]\]\s*|alignas\(.*?\)\s*)*([A-Za-z_][\w:]*(?:<.*?>)?)(?:\s+final)?\s*(?:[:{].*|)$"
)


def types_of(text):
    """Yields (line number, name with its namespaces) of each type that other files could have, too."""
    namespaces = []
    for number, line in enumerate(text.splitlines(), start=1):
        closed = CLOSED.match(line)
        if OPENED.match(line):
            namespaces += NAME.findall(line)
        elif closed:
            del namespaces[-len(closed.group(1)):]
        elif all(namespaces):
            found = TYPE.match(line)
            if found:
                yield number, "::".join([*namespaces, found.group(1)])


def main(root=ROOT):
    first = {}
    num_problems = 0
    for path in project_files(root):
        name = path.as_posix()
        if path.suffix not in (".h", ".cpp", ".cu", ".cuh") or name.startswith("examples/"):
            continue
        for number, found in types_of((root / path).read_text(encoding="utf-8")):
            other, at = first.setdefault(found, (name, number))
            if other not in (name, ALTERNATIVES.get(name)):
                num_problems += 1
                print(f"{name}:{number}: {found} is also defined in {other}:{at}: rename one of them")
    print(f"check_types: {len(first)} types, {num_problems} problems")
    return 1 if num_problems else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()) if len(sys.argv) > 1 else main())
