#!/usr/bin/env python3
"""Modules may include only the modules below them (docs/architecture.md draws the picture).

Also: a public header (include/palpate/MODULE/...) is for everybody and is installed; an internal one
(src/MODULE/internal/...) is for the modules above; a private one (src/MODULE/...) is for its own module
and that module's tests. Public headers include nothing but the standard library and each other; every
other library has a home. A folder is a room that one can look over, and so is a file.

usage: tools/check_modules.py [ROOT]
"""

import re
import sys
from collections import Counter
from pathlib import Path

from project_files import ROOT, project_files

# A module may include itself and the modules named here, and what these may include.
BELOW = {
    "core": (),
    "math": ("core",),
    "settings": ("math",),
    "gpu": ("core",),
    "mesh": ("math",),
    "packing": ("mesh", "settings"),
    "tool": ("mesh", "packing"),
    "cloud": ("settings", "gpu"),
    "field": ("cloud",),
    "contact": ("field", "tool"),
    "io": ("contact",),
    "front": ("io",),
    "ros": ("io",),
    "haptics": ("contact",),
    "bodies": ("haptics",),
    "run": ("bodies",),
    "devices": ("haptics", "io", "ros"),
    "cameras": ("io", "ros", "scenes"),
    "robot": ("cameras",),
    "pages": ("core",),
    "session": ("io", "pages", "run", "devices"),
    "viewer": ("pages", "session"),
    "scenes": ("mesh", "cloud"),
    "c": ("haptics", "io", "scenes"),
    "eval": ("session", "scenes"),
    "apps": ("session", "viewer", "eval", "robot"),
    "python": ("front", "session", "robot"),
}
READ_EVERYTHING = ("tests", "bench")
# Tests and benchmarks of the evaluation's own studies; all others speak the public API.
EVAL_READERS = ("tests/eval/", "tests/accuracy/", "bench/contact_bench.cpp", "bench/distance_grid.cuh",
                "bench/peers_bench.cpp")
# Public headers that lie in no folder of a module.
FRONT_DOOR = {"palpate/palpate.h": "front", "palpate/version.h": "core"}

# A stranger reads them all: one for each subject of a module, not for each class.
MOST_PUBLIC_HEADERS = 34

# Rooms: at most so many files in a folder, and lines in a file; tests may be longer.
ROOMS = ("src/", "include/", "apps/", "web/src/", "python/")
MAX_FILES = 20
MAX_LINES = 400
MAX_TEST_LINES = 600
# Fewer lines belong into a neighbor, but for entry points, parts that a build may lack, and headers that spare many
# files a larger one.
MIN_LINES = 20
SMALL = (
    "include/palpate/version.h",
    "python/palpate/_program.py",
    "src/gpu/no_gpu.cpp",
    "src/pages/no_page.cpp",
    "src/cameras/drivers/python_packages.h",
    "src/cloud/internal/mean_frame.h",
    "src/contact/index/num_bytes.h",
    "src/core/internal/assert.h",
    "src/core/internal/monotonic_clock.h",
    "src/core/internal/num_cores.h",
    "src/core/internal/stamp.h",
    "src/field/internal/pinhole_cloud.h",
    "src/gpu/internal/device_code.cuh",
    "src/mesh/internal/surface_points.h",
)

# Private headers that one more module may include: the evaluation times the stages of a query one by one.
SHARED_PRIVATE = {
    "src/contact/points/scan/image_window.h": ("eval",),
    "src/contact/points/scan/point_scan.h": ("eval",),
    "src/contact/index/sphere_grid.h": ("eval",),
}

# Libraries and where they are at home, beside tests and bench.
LIBRARIES = (
    (r"png\.h", ("io",)),
    (r"(lib)?lzf\.h", ("io",)),
    (r"tinyxml2\.h", ("cameras",)),
    (r"zlib\.h", ("io", "session")),
    (r"zstd\.h", ("io",)),
    (r"nlohmann/", ("io", "session", "viewer", "eval", "apps")),
    (r"boost/(beast|asio)", ("viewer",)),
    (r"toml\+\+/", ("io",)),
    (r"CLI/", ("apps",)),
    (r"embree\d*/", ("scenes",)),
    (r"nanobind/", ("python",)),
    (r"boost/context/", ("gpu",)),
    (r"(gtest|gmock|benchmark|pcl|opencv\d*|Eigen)/|nanoflann\.hpp", ()),
)
CUDA = re.compile(r"(cuda|cub/|thrust/|cooperative_groups|nv)")
IS_CUDA_FILE = re.compile(r"(\.cuh?|_cuda\.(h|cpp))$")

INCLUDE = re.compile(r'^\s*#\s*include\s*(?:<([^>]+)>|"([^"]+)")')
NAMED_FILE = re.compile(r"(?<![\w/.<*-])((?:\w+/)+\w+\.(?:h|cuh|cpp|cu))\b")
SOURCE = {".h", ".cpp", ".cu", ".cuh"}
LAID_OUT = SOURCE | {".mjs", ".py", ".ts"}


def allowed_modules(module):
    """The module itself and everything it may include."""
    modules = {module}
    for below in BELOW[module]:
        modules |= allowed_modules(below)
    return modules


def module_of(name):
    """The module of a path relative to the root, or None for a file outside all modules."""
    if name.removeprefix("include/") in FRONT_DOOR:
        return FRONT_DOOR[name.removeprefix("include/")]
    parts = Path(name).parts
    if parts[:2] == ("include", "palpate") and len(parts) > 3:
        return parts[2]
    if parts[0] == "palpate" and len(parts) > 2:  # as written in an include line
        return parts[1]
    if parts[0] == "src" and len(parts) > 2:
        return parts[1]
    if parts[0] in ("scenes", "eval", "apps", "python") + READ_EVERYTHING:
        return parts[0]
    return None


def is_public(name):
    return name.startswith("include/") or name == "scenes/scene.h"


def is_internal(name):
    """Whether a header is for the modules above its own, but not for users."""
    return re.fullmatch(r"src/\w+/internal/[^/]+", name) is not None


def check_project_include(name, target):
    """What is wrong with the file `name` including "target"; None if nothing is."""
    module, target_module = module_of(name), module_of(target)
    if target_module is None:
        return f'write the path from the root, e.g. "palpate/{module}/..." or "src/{module}/..."'
    if target_module not in BELOW and target_module not in READ_EVERYTHING:
        return f"there is no module {target_module}: name it in tools/check_modules.py"
    if module in READ_EVERYTHING:
        if target_module == "eval" and not name.startswith(EVAL_READERS):
            return f"{module} may not include eval: use the public API, or tests/test_util"
        tested = Path(name).parts[1]
        if target.startswith("src/") and module == "tests" and tested in BELOW:
            shared = is_internal(target) or tested in SHARED_PRIVATE.get(target, ())
            if target_module != tested and not shared:
                return f"tests of {tested} may not read the private headers of {target_module}"
        return None
    if target_module in READ_EVERYTHING or target_module not in allowed_modules(module):
        below = ", ".join(sorted(allowed_modules(module) - {module})) or "no other module"
        return f"{module} may not include {target_module} (only {below})"
    if target.startswith("src/"):
        if is_public(name):
            return "a public header may not include a private one"
        shared = is_internal(target) or module in SHARED_PRIVATE.get(target, ())
        if target_module != module and not shared:
            return f"{target} is private to {target_module}"
    return None


def check_library_include(name, target):
    """The same for <target>."""
    module = module_of(name)
    if is_public(name):
        if target in ("stddef.h", "stdint.h") and module == "c":  # which is C
            return None
        if "/" in target or "." in target:
            return "public headers include only the C++ standard library and each other"
        return None
    if CUDA.match(target) and not IS_CUDA_FILE.search(name):
        return "CUDA headers belong into *.cu, *.cuh and *_cuda.* files"
    if module in READ_EVERYTHING:
        return None
    for pattern, homes in LIBRARIES:
        if re.match(pattern, target) and module not in homes:
            return f"<{target}> may be included only in {', '.join(homes + READ_EVERYTHING)}"
    return None


def check_named_files(text, ends):
    """Yields (line number, what is wrong) of comments that name a file with a folder. `ends`: all ends of the paths of
    project files."""
    for number, line in enumerate(text.splitlines(), start=1):
        for named in NAMED_FILE.findall(line.partition("//")[2]):
            if named not in ends:
                yield number, f"there is no {named}: name a file that is there"


def check_text(name, text):
    """Yields (line number, what is wrong)."""
    module = module_of(name)
    if module is None:
        return
    if module not in BELOW and module not in READ_EVERYTHING:
        yield 1, f"there is no module {module}: name it in tools/check_modules.py"
        return
    for number, line in enumerate(text.splitlines(), start=1):
        match = INCLUDE.match(line)
        if not match:
            continue
        library, target = match.groups()
        if target is not None:
            problem = check_project_include(name, target)
        else:
            problem = check_library_include(name, library)
        if problem:
            yield number, problem


def uses(name, text):
    """The permissions of SHARED_PRIVATE and LIBRARIES that the file `name` needs."""
    parts = Path(name).parts
    module = parts[1] if parts[0] == "tests" else module_of(name)
    for line in text.splitlines():
        if not (match := INCLUDE.match(line)):
            continue
        library, target = match.groups()
        if target is not None and module_of(target) != module:
            yield target, module
        for pattern, _ in LIBRARIES if library is not None and parts[0] != "tests" else ():
            if re.match(pattern, library):
                yield pattern, module


def unused(used, lines):
    """Permissions that nobody needs. `lines`: how many each file has."""
    for name in SMALL:
        if not 0 < lines.get(name, 0) < MIN_LINES:
            yield f"{name} is not small: take out the permission"
    for what, modules in [*SHARED_PRIVATE.items(), *LIBRARIES]:
        for module in modules:
            if (what, module) not in used:
                yield f"nothing in {module} includes {what}: take out the permission"


def check_rooms(lines):
    """Yields (name, what is wrong) of folders and files of ROOMS and of tests. `lines`: how many each file has."""
    folders = Counter(str(Path(name).parent) for name in lines if name.startswith(ROOMS))
    for folder, num in sorted(folders.items()):
        if num > MAX_FILES:
            yield folder, f"{num} files, at most {MAX_FILES}: give those that belong together a folder"
    for name, num in sorted(lines.items()):
        most = MAX_LINES if name.startswith(ROOMS) else MAX_TEST_LINES
        if num > most:
            yield name, f"{num} lines, at most {most}: give a part that stands alone its own file"
        if name.startswith(ROOMS) and 0 < num < MIN_LINES and name not in SMALL:
            yield name, f"{num} lines, at least {MIN_LINES}: put them into the file of the same concept"


def main(root=ROOT):
    num_files = num_problems = num_public = 0
    lines = {}
    used = set()
    ends = {"/".join(path.parts[i:]) for path in project_files(root) for i in range(len(path.parts))}
    for path in project_files(root):
        if path.as_posix().startswith((*ROOMS, "tests/")):
            content = (root / path).read_bytes()
            lines[path.as_posix()] = content.count(b"\n") if path.suffix in LAID_OUT else 0
        if path.suffix not in SOURCE:
            continue
        num_files += 1
        num_public += path.suffix == ".h" and is_public(path.as_posix())
        text = (root / path).read_text(encoding="utf-8", errors="replace")
        used.update(uses(path.as_posix(), text))
        for number, problem in (*check_text(path.as_posix(), text), *check_named_files(text, ends)):
            num_problems += 1
            print(f"{path.as_posix()}:{number}: {problem}")
    for name, problem in check_rooms(lines):
        num_problems += 1
        print(f"{name}: {problem}")
    for problem in unused(used, lines):
        num_problems += 1
        print(f"tools/check_modules.py: {problem}")
    if num_public > MOST_PUBLIC_HEADERS:
        num_problems += 1
        print(f"include/palpate: {num_public} public headers, at most {MOST_PUBLIC_HEADERS}: put what is new into one "
              "of its module")
    print(f"check_modules: {num_files} files, {num_public} public headers, {num_problems} problems")
    return 1 if num_problems else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()) if len(sys.argv) > 1 else main())
