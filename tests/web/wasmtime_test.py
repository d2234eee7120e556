#!/usr/bin/env python3
"""The core as WebAssembly in wasmtime: the bits of tests/contact/golden.txt, and memory that ends where it is said.

usage: wasmtime_test.py FOLDER    with golden.wasm and palpate.wasm, as make web-core builds them
"""
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
folder = Path(sys.argv[1])


def skip(reason):
    print(f"SKIPPED: {reason}")
    sys.exit(77)


if not (folder / "golden.wasm").exists():
    skip("no WebAssembly (make web-core)")
for place in (ROOT / "build").glob("*/lib/python3*/site-packages/wasmtime"):
    sys.path.append(str(place.parent))
try:
    from wasmtime import Config, Engine, Func, FuncType, Linker, Module, Store, ValType, WasiConfig
except ImportError:
    skip("no Python package wasmtime (scripts/setup.sh --web)")

config = Config()
engine = Engine(config)


def bits():
    with tempfile.TemporaryDirectory() as temporary:
        said = Path(temporary) / "said.txt"
        store, linker = Store(engine), Linker(engine)
        wasi = WasiConfig()
        wasi.stdout_file = str(said)
        store.set_wasi(wasi)
        linker.define_wasi()
        instance = linker.instantiate(store, Module.from_file(engine, str(folder / "golden.wasm")))
        instance.exports(store)["_start"](store)
        got = dict(line.split() for line in said.read_text().splitlines())
    wanted = {line.split()[0]: line.split()[1] for line in (ROOT / "tests/contact/golden.txt").read_text().splitlines()}
    assert len(wanted) > 30
    different = {name: got.get(name) for name in wanted if got.get(name) != wanted[name]}
    assert not different and got.keys() == wanted.keys(), f"other bits than golden.txt: {different}"
    print(f"{len(wanted)} hashes are those of golden.txt")


def memory():
    module = Module.from_file(engine, str(folder / "palpate.wasm"))
    outside = {entry.module for entry in module.imports}
    assert outside <= {"palpate", "wasi_snapshot_preview1"}, outside
    store, linker = Store(engine), Linker(engine)
    store.set_wasi(WasiConfig())
    linker.define_wasi()
    told = []

    def out_of_memory():
        told.append(True)
        raise MemoryError
    linker.define(store, "palpate", "out_of_memory", Func(store, FuncType([], []), out_of_memory))
    linker.define(store, "palpate", "progress", Func(store, FuncType([ValType.i32(), ValType.f64()], [ValType.i32()]), lambda *_: 1))
    exports = linker.instantiate(store, module).exports(store)
    exports["_initialize"](store)
    shape = exports["malloc"](store, 16)
    exports["memory"].write(store, b"sphere\0", shape)
    error = exports["malloc"](store, 512)
    # Two million sensors' worth of pixels do not fit: the page is told so, and nothing hangs.
    camera = exports["malloc"](store, 112)
    import struct
    exports["memory"].write(store, struct.pack("<3i4x4d8d", 112, 4096, 4096, 3000, 3000, 2047.5, 2047.5, *[0] * 8), camera)
    try:
        for _ in range(3):
            exports["palpate_sensor_create"](store, camera, 0, 1, error)
        raise AssertionError("three cameras of 16 million pixels fit into 512 MB?")
    except Exception as failure:  # a trap with our MemoryError inside
        assert told, failure
    assert exports["memory"].data_len(store) <= 512 << 20
    print("the page is told of 512 MB")


bits()
memory()
