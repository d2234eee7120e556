#!/usr/bin/env python3
"""The core as WebAssembly in wasmtime: the bits of tests/contact/golden.txt, memory that ends where it is said, and damaged
tool files and images.

usage: wasmtime_test.py FOLDER    with golden.wasm and palpate.wasm, as make web-core builds them
"""
import ctypes
import ctypes.util
import math
import struct
import sys
import tempfile
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[2]
NUM_DAMAGED = 4000
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


class Core:
    """palpate.wasm with its memory; `told` is set once it has used that up."""

    module = None

    def __init__(self):
        if Core.module is None:
            Core.module = Module.from_file(engine, str(folder / "palpate.wasm"))
            outside = {entry.module for entry in Core.module.imports}
            assert outside <= {"palpate", "wasi_snapshot_preview1"}, outside
        self.store, self.told = Store(engine), False
        self.store.set_wasi(WasiConfig())
        linker = Linker(engine)
        linker.define_wasi()
        linker.define(self.store, "palpate", "out_of_memory", Func(self.store, FuncType([], []), self.out_of_memory))
        linker.define(self.store, "palpate", "progress",
                      Func(self.store, FuncType([ValType.i32(), ValType.f64()], [ValType.i32()]), lambda *_: 1))
        self.exports = linker.instantiate(self.store, Core.module).exports(self.store)
        self.memory = self.exports["memory"]
        self.call("_initialize")
        self.error = self.call("malloc", 512)

    def out_of_memory(self):
        self.told = True
        raise MemoryError

    def call(self, name, *values):
        return self.exports[name](self.store, *values)

    def put(self, data):
        """Returns the address of new memory with these bytes."""
        at = self.call("malloc", max(1, len(data)))
        assert at, "no memory"
        self.memory.write(self.store, data, at)
        return at

    def get(self, at, size):
        return bytes(self.memory.read(self.store, at, at + size))

    def sentence(self):
        text = self.get(self.error + 4, 508).split(b"\0")[0].decode()
        assert len(text) > 10 and "\n" not in text, text
        return text

    def sensor(self, width, height, focal):
        camera = struct.pack("<3i4x4d8d", 112, width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, *[0] * 8)
        return self.call("palpate_sensor_create", self.put(camera), 0, 1, self.error)

    def tool(self, spheres):
        return self.call("palpate_tool_pack_shape", self.put(b"stylus\0"), 0.12, self.put(b"packing.spheres = %d\0" % spheres), self.error)

    def saved(self, tool):
        size = self.call("palpate_tool_save", tool, 0, 0, self.error)
        at = self.put(bytes(size))
        assert self.call("palpate_tool_save", tool, at, size, self.error) == size
        data = self.get(at, size)
        self.call("free", at)
        return data


def memory():
    core = Core()
    try:
        for _ in range(3):
            core.sensor(4096, 4096, 3000)
        raise AssertionError("three cameras of 16 million pixels fit into 512 MB?")
    except Exception as failure:  # a trap with our MemoryError inside
        assert core.told, failure
    assert core.memory.data_len(core.store) <= 512 << 20
    print("the page is told of 512 MB")


ODD = [b"\0\0\0\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\xc0\x7f", b"\0\0\x80\xff", b"\1\0\0\0", b"\0\0\x80\x7f"]


def mutated(data, random):
    """The bytes with a few changes: single ones, odd numbers, parts that are missing or doubled."""
    data = bytearray(data)
    for _ in range(random.randint(1, 5)):
        at = random.randrange(len(data) + 1)
        kind = random.randrange(6)
        if kind == 0:
            data[at:at + 1] = random.randbytes(1)
        elif kind == 1:
            data[at // 4 * 4:at // 4 * 4 + 4] = random.choice(ODD)
        elif kind == 2:
            del data[at:at + random.randint(1, 40)]
        elif kind == 3:
            data[at:at] = data[:random.randint(1, 60)]
        elif kind == 4:
            data[at:at] = random.choice(ODD)
        elif random.random() < 0.2:
            del data[at:]
    return bytes(data)


def sealed(data, xxhash):
    """A tool file whose length and checksum are right, so that what they hide is reached."""
    if len(data) < 32:
        return data
    data = data[:16] + struct.pack("<Q", len(data)) + data[24:-8]
    return data + struct.pack("<Q", xxhash.XXH3_64bits(data, len(data)))


def damaged_tools():
    library = ctypes.util.find_library("xxhash")
    if library is None:
        print("damaged tool files: skipped, no libxxhash")
        return
    xxhash = ctypes.CDLL(library)
    xxhash.XXH3_64bits.restype, xxhash.XXH3_64bits.argtypes = ctypes.c_uint64, [ctypes.c_char_p, ctypes.c_size_t]
    core, random = Core(), Random(20)
    seeds = [core.saved(core.tool(spheres)) for spheres in (1, 12)]
    assert sealed(seeds[1], xxhash) == seeds[1], "the checksum is another one"
    taken, before = 0, core.memory.data_len(core.store)
    for i in range(NUM_DAMAGED):
        data = mutated(random.choice(seeds), random)
        if i % 4:
            data = sealed(data, xxhash)
        at = core.put(data)
        tool = core.call("palpate_tool_load", at, len(data), core.error)
        if tool:
            taken += 1
            again = core.saved(tool)
            back = core.put(again)
            copy = core.call("palpate_tool_load", back, len(again), core.error)
            assert copy and core.saved(copy) == again, "a tool comes back with the same bytes"
            core.call("palpate_tool_free", copy)
            core.call("palpate_tool_free", tool)
            core.call("free", back)
        else:
            core.sentence()
        core.call("free", at)
    assert 0 < taken < NUM_DAMAGED / 2, taken
    assert core.memory.data_len(core.store) - before < 16 << 20, "damaged files keep memory"
    print(f"{NUM_DAMAGED} damaged tool files, {taken} of them taken")


def damaged_images():
    """Numbers of every kind in a depth image: a force is felt or not, and is a number."""
    core, random, (width, height) = Core(), Random(21), (32, 24)
    sensor, tool = core.sensor(width, height, 28), core.tool(100)
    scene = core.call("palpate_scene_create", core.error)
    assert core.call("palpate_scene_add_sensor", scene, sensor, core.error) == 0
    contact = core.call("palpate_contact_create", tool, 0, 1, core.error)
    pose = core.put(struct.pack("<7d", 0, 0, 0.57, 0, 1, 0, 0))
    measure = core.put(struct.pack("<IId", 528, 1, 1) + bytes(512))
    counts = core.put(bytes(4 * width * height))
    good = {"counts": struct.pack("<H", 600) * (width * height), "meters": struct.pack("<f", 0.6) * (width * height)}
    felt = 0
    for i in range(NUM_DAMAGED // 4):
        kind = random.choice(["counts", "meters"])
        image = good[kind]
        for _ in range(random.randint(0, 30)):
            image = mutated(image, random)
        image = (image + good[kind])[:len(good[kind])]
        core.memory.write(core.store, image, counts)
        unit = (random.choice([0.001, 0.0001, 1e-30, 1e30]),) if kind == "counts" else ()
        bad = core.call(f"palpate_sensor_update_{kind}", sensor, counts, *unit, 0, core.error)
        if bad:
            core.sentence()
            continue
        assert core.call("palpate_contact_measure", contact, scene, pose, measure, core.error) == 0, core.sentence()
        numbers = struct.unpack("<44d", core.get(measure + 40, 8 * 44))  # volume to stiffness
        assert all(map(math.isfinite, numbers)), (i, numbers)
        felt += numbers[0] > 0
    assert felt > NUM_DAMAGED // 16, felt
    print(f"{NUM_DAMAGED // 4} damaged images, {felt} of them felt")


bits()
memory()
damaged_tools()
damaged_images()
