#!/usr/bin/env python3
"""The C header from other languages: the same bits as C++, the names that it promises, errors as sentences.

usage: c_test.py LIBRARY REFERENCE CASE    CASE: symbols, ctypes, rust, errors, missing, scenes, locale, guide
"""
import ctypes
import locale
import os
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
    assert len(wanted) == 5 + 5 + 5 + 5 + 8 + 2, wanted
    for a, b in zip(wanted, got, strict=True):
        assert a == b, f"\nC++ {a}\nC   {b}"
    assert wanted[20:28] != [wanted[20]] * 8  # the hand feels something that changes


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


    # One that is longer than its room ends before a letter, not inside it.
    for spaces in range(2):
        assert not lib.palpate_tool_pack_shape((" " * spaces + "\u00e4" * 400).encode(), c_double(0.1), None, byref(error))
        assert len(error.text) > 500 and "\u00e4" in error.text.decode(), error.text

    # More than any machine has ends as an error, too.
    huge = ctypes.c_size_t(1 << 62)
    assert not lib.palpate_tool_pack(cube, huge, face, ctypes.c_size_t(1), None, None, None, byref(error))
    assert error.code == 5 and b"memory" in error.text, error.text
    for noise in (-1, float("nan"), float("inf")):
        assert not lib.palpate_simulation_create(b"hand", 160, 120, c_double(noise), ctypes.c_uint64(1), byref(error))
        assert b"noise" in error.text, error.text


def missing():
    """Each pointer of each function as null, and each struct without its size, with all else there."""
    lib, error = calls.load(library), calls.Error()
    lib.palpate_tool_prefix.restype = lib.palpate_tool_pack.restype = c_void_p
    lib.palpate_tool_save.restype = ctypes.c_size_t
    camera = calls.sized(calls.Camera, width=160, height=120, intrinsics=(140, 140, 79.5, 59.5))
    device = calls.sized(calls.Device, limits=(10, 0.5, 2000, 5, 10, 0.2, 1, 0.001), rate=1000)
    tool = c_void_p(lib.palpate_tool_pack_shape(b"box", c_double(0.1), b"packing.spheres = 10", byref(error)))
    good = {
        "tool": tool, "sensor": c_void_p(lib.palpate_sensor_create(byref(camera), None, 1, byref(error))),
        "scene": c_void_p(lib.palpate_scene_create(byref(error))),
        "contact": c_void_p(lib.palpate_contact_create(tool, None, 1, byref(error))),
        "hand": c_void_p(lib.palpate_hand_create(tool, byref(device), None, byref(error))),
        "simulation": c_void_p(lib.palpate_simulation_create(b"hand", 160, 120, c_double(1), ctypes.c_uint64(1), byref(error))),
    }
    assert all(handle.value for handle in good.values()), error.text
    assert lib.palpate_scene_add_body(good["scene"], tool, byref(calls.Pose(rotation=(0, 0, 0, 1))), byref(error)) == 0
    structs = {"camera": byref(camera), "device": byref(device)}
    for name, size in (("tool_info", 104), ("measure", 528), ("answers", 144), ("handle", 136), ("tick", 248), ("simulation_info", 376)):
        structs[name] = (ctypes.c_uint32 * (size // 4))(size)
    unsized, room = (ctypes.c_uint32 * 200)(), (ctypes.c_uint8 * (1 << 20))()
    may_be_null = {"options", "progress", "context", "error", "X_WC", "time", "bytes", "vertices", "triangles"}
    needed = {"palpate_tool_pack": {"vertices", "triangles"}, "palpate_tool_load": {"bytes"}}
    numbers = {"double": c_double(0), "size_t": ctypes.c_size_t(1), "int32_t": ctypes.c_int32(0), "uint64_t": ctypes.c_uint64(0)}
    num_calls = 0
    for function, text in re.findall(r"^PALPATE_C [^(;]*?\b(palpate_\w+)\(([^)]*)\);", HEADER.read_text(), re.MULTILINE):
        parameters = [re.fullmatch(r"(?:const )?(\w+)(\*?) (\w+)", " ".join(p.split())).groups() for p in text.split(",") if p != "void"]
        values = []
        for kind, star, name in parameters:
            kind = kind.removeprefix("palpate_")
            unit = c_double(0.001) if name == "unit" else numbers.get(kind)
            values.append(byref(error) if kind == "error" else None if kind == "progress" or name == "options"
                          else good.get(kind) or structs.get(kind) or room if star else unit)
        for i, (kind, star, name) in enumerate(parameters):
            if not star or name in may_be_null - needed.get(function, set()):
                continue
            for nothing in [None] + [byref(unsized)] * (kind.removeprefix("palpate_") in structs):
                ctypes.memset(byref(error), 0, ctypes.sizeof(error))
                failed = getattr(lib, function)(*values[:i], nothing, *values[i + 1:])
                num_calls += 1
                if parameters[-1][2] != "error":
                    continue
                said = error.text.decode()
                assert failed in (None, 0, -1) and error.code == 1, f"{function} without {name}: {failed} {said}"
                assert re.search(r"\bno\b|missing", said) and ": " in said, f"{function} without {name}: {said}"
    assert num_calls > 60 and not any(unsized), num_calls


def scenes():
    """A scene that a method cannot measure is an error, not a volume of 0; a method without stiffness says so."""
    lib, error = calls.load(library), calls.Error()
    camera = calls.sized(calls.Camera, width=calls.WIDTH, height=calls.HEIGHT, intrinsics=(140, 140, 79.5, 59.5))
    tool = c_void_p(lib.palpate_tool_pack_shape(b"stylus", c_double(0.12), b"packing.spheres = 100", byref(error)))
    contact = {method: c_void_p(lib.palpate_contact_create(tool, f"contact.method = {method}".encode(), 1, byref(error)))
               for method in ("field", "graph")}

    def scene_of(options, num):
        scene = c_void_p(lib.palpate_scene_create(byref(error)))
        for _ in range(num):
            sensor = c_void_p(lib.palpate_sensor_create(byref(camera), options, 1, byref(error)))
            assert lib.palpate_sensor_update_counts(sensor, calls.counts(), c_double(0.001), None, byref(error)) == 0, error.text
            assert lib.palpate_scene_add_sensor(scene, sensor, byref(error)) == 0, error.text
        return scene

    def measured(method, scene):
        m = calls.sized(calls.Measure, wants=1, progress=1)
        return lib.palpate_contact_measure(contact[method], scene, byref(calls.pose(3)), byref(m), byref(error)), m

    for method, scene, word in (("field", scene_of(b"", 0), b"empty"), ("field", scene_of(b"", 2), b"one_of_several"),
                                ("graph", scene_of(b"", 2), b"method field alone")):
        code, m = measured(method, scene)
        assert code == -1 and word in error.text and m.status == 0, error.text
    for method, wants in (("field", 1), ("graph", 0)):
        code, m = measured(method, scene_of(b"", 1))
        assert code == 0 and m.volume > 0 and m.wants == wants and any(m.stiffness) == bool(wants), (method, m.wants, m.volume)


def in_german():
    """A program that counts with commas gives options with points."""
    lib, error = calls.load(library), calls.Error()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["LOCPATH"] = folder
        if shutil.which("localedef"):
            subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", f"{folder}/de_DE.UTF-8"], capture_output=True, check=False)
        try:
            locale.setlocale(locale.LC_NUMERIC, "de_DE.UTF-8")
        except locale.Error:
            skip("no German locale (package locales)")
    assert locale.localeconv()["decimal_point"] == ","
    tool = c_void_p(lib.palpate_tool_pack_shape(b"box", c_double(0.1), b"packing.spheres = 10", byref(error)))
    device = calls.sized(calls.Device, limits=(10, 0.5, 2000, 5, 10, 0.2, 1, 0.001), rate=1000)
    assert lib.palpate_hand_create(tool, byref(device), b"friction.coefficient = 0.3", byref(error)), error.text
    assert not lib.palpate_hand_create(tool, byref(device), b"friction.coefficient = 0,3", byref(error))


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


{"symbols": symbols, "ctypes": from_ctypes, "rust": from_rust, "errors": errors, "missing": missing, "scenes": scenes,
 "locale": in_german, "guide": guide}[sys.argv[3]]()
