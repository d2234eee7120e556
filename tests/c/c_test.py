#!/usr/bin/env python3
"""The C header from other languages: the same bits as C++, the names that it promises, errors as sentences.

usage: c_test.py LIBRARY REFERENCE CASE    CASE: symbols, ctypes, rust, errors, guide
"""
import ctypes
import re
import shutil
import subprocess
import sys
import tempfile
from ctypes import byref, c_double, c_void_p
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import calls

ROOT = Path(__file__).resolve().parents[2]
HEADER = ROOT / "include/palpate/c/palpate.h"
library, reference = Path(sys.argv[1]), sys.argv[2]


def skip(reason):
    print(f"SKIPPED: {reason}")
    sys.exit(77)


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def symbols():
    promised = set(re.findall(r"^PALPATE_C [^(]*?\b(palpate_\w+)\(", HEADER.read_text(), re.MULTILINE))
    if not shutil.which("nm"):
        skip("no nm (package binutils)")
    shown = {line.split()[-1].split("@")[0] for line in run("nm", "-D", "--defined-only", library).splitlines()}
    shown.discard("PALPATE_C_0")
    assert shown == promised, f"shown, not promised: {shown - promised}; promised, not shown: {promised - shown}"
    assert 30 <= len(promised) <= 45, len(promised)


def from_ctypes():
    wanted = run(reference).splitlines()
    got = run(sys.executable, Path(__file__).parent / "calls.py", library).splitlines()
    assert len(wanted) == 5 + 5 + 5 + 8 + 2, wanted
    for a, b in zip(wanted, got, strict=True):
        assert a == b, f"\nC++ {a}\nC   {b}"
    assert wanted[15:23] != [wanted[15]] * 8  # the hand feels something that changes


def from_rust():
    rustc = shutil.which("rustc", path="/usr/bin:/bin") or shutil.which("rustc")
    if not rustc or subprocess.run([rustc, "--version"], capture_output=True, check=False).returncode:
        skip("no rustc (package rustc)")
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "calls"
        run(rustc, "--edition=2021", "-O", "-L", library.parent, "-C", f"link-arg=-Wl,-rpath,{library.parent}",
            "-o", program, Path(__file__).parent / "calls.rs")
        wanted = [line for line in run(reference).splitlines() if line.startswith("field ")]
        assert run(program).splitlines() == wanted


def errors():
    lib, error = calls.load(library), calls.Error()
    camera = calls.sized(calls.Camera, width=4, height=120, intrinsics=(140, 140, 79.5, 59.5))
    cube = (c_double * 24)(*(0.1 * (i >> axis & 1) for i in range(8) for axis in range(3)))
    face = (ctypes.c_uint32 * 3)(0, 1, 2)
    lib.palpate_tool_pack.restype = c_void_p
    tool = c_void_p(lib.palpate_tool_pack_shape(b"box", c_double(0.1), b"packing.spheres = 10", byref(error)))
    cases = [
        (lambda: lib.palpate_tool_pack_shape(b"bix", c_double(0.1), None, byref(error)), "box"),
        (lambda: lib.palpate_tool_pack_shape(b"box", c_double(0.1), b"packing.spheres", byref(error)), "has no value"),
        (lambda: lib.palpate_tool_pack_shape(b"box", c_double(0.1), b"packing.sphere = 5", byref(error)), "spheres"),
        (lambda: lib.palpate_tool_pack_shape(b"box", c_double(0.1), b"packing.spheres = 0", byref(error)), "1 to 2000000"),
        (lambda: lib.palpate_tool_pack(cube, ctypes.c_size_t(8), face, ctypes.c_size_t(1), None, None, None, byref(error)),
         "edge"),
        (lambda: lib.palpate_tool_load(b"nonsense", ctypes.c_size_t(8), byref(error)), "tool file"),
        (lambda: lib.palpate_sensor_create(byref(camera), None, 1, byref(error)), "4"),
        (lambda: lib.palpate_contact_create(tool, b"contact.method = feel", 1, byref(error)), "graph"),
        (lambda: lib.palpate_contact_create(None, None, 1, byref(error)), "no tool"),
        (lambda: lib.palpate_simulation_create(b"moon", 160, 120, c_double(1), ctypes.c_uint64(1), byref(error)), "hand"),
    ]
    for call, word in cases:
        ctypes.memset(byref(error), 0, ctypes.sizeof(error))
        assert not call(), word
        text = error.text.decode()
        assert error.code != 0 and word in text and "\n" not in text, f"'{text}' should name '{word}'"

    # A caller of an older version has a shorter struct: nothing is written behind it. Progress cancels.
    class Short(ctypes.Structure):
        _fields_ = [("size", ctypes.c_uint32), ("num_spheres", ctypes.c_int32), ("behind", ctypes.c_int32 * 40)]
    short = Short(8)
    lib.palpate_tool_describe(tool, byref(short))
    assert short.num_spheres == 10 and not any(short.behind)
    progress = ctypes.CFUNCTYPE(ctypes.c_int, c_void_p, ctypes.c_int32, c_double)(lambda *_: 0)
    faces = [0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4, 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5]
    made = lib.palpate_tool_pack(cube, ctypes.c_size_t(8), (ctypes.c_uint32 * 36)(*faces), ctypes.c_size_t(12),
                                 b"packing.spheres = 200000", progress, None, byref(error))
    assert not made and error.code == 6, error.text


def guide():
    page = (ROOT / "docs/guide/c.md").read_text()
    compiler = shutil.which("cc")
    if not compiler:
        skip("no C compiler")
    programs = re.findall(r"^```c\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert programs
    with tempfile.TemporaryDirectory() as folder:
        for text in programs:
            (Path(folder) / "program.c").write_text(text)
            run(compiler, "-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{ROOT}/include", f"{folder}/program.c",
                "-o", f"{folder}/program", f"-L{library.parent}", "-lpalpate_c", f"-Wl,-rpath,{library.parent}")
            said = run(f"{folder}/program")
            print(said)
            assert re.search(r"force .*N", said), said


{"symbols": symbols, "ctypes": from_ctypes, "rust": from_rust, "errors": errors, "guide": guide}[sys.argv[3]]()
