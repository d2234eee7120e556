"""Prints what reference.cpp prints, through the C header alone: libpalpate_c.so by ctypes.

usage: calls.py LIBRARY
"""
import ctypes
import struct
import sys
from ctypes import POINTER, Structure, byref, c_char, c_char_p, c_double, c_int32, c_uint8, c_uint16, c_uint32, c_uint64, c_void_p

WIDTH, HEIGHT = 160, 120


class Error(Structure):
    _fields_ = [("code", c_int32), ("text", c_char * 508)]


class Pose(Structure):
    _fields_ = [("translation", c_double * 3), ("rotation", c_double * 4)]


class Camera(Structure):
    _fields_ = [("size", c_uint32), ("width", c_int32), ("height", c_int32), ("intrinsics", c_double * 4),
                ("distortion", c_double * 8)]


class Measure(Structure):
    _fields_ = [("size", c_uint32), ("wants", c_uint32), ("progress", c_double), ("states", c_void_p), ("planes", c_void_p),
                ("status", c_uint32), ("num_boundary", c_int32), ("num_inside", c_int32), ("volume", c_double),
                ("potential", c_double), ("force", c_double * 3), ("torque", c_double * 3), ("stiffness", c_double * 36),
                ("sigma", c_double * 7), ("moments", c_double * 9), ("polar_moment", c_double),
                ("bodies_volume", c_double)]


class Answers(Structure):
    _fields_ = [("size", c_uint32), ("padding", c_uint32)] + [
        (name, c_void_p) for name in ("volume", "potential", "force", "torque", "stiffness", "status", "volume_sigma",
                                      "force_sigma", "torque_sigma", "unseen")
    ] + [("clearance_limit", c_double), ("clearance", c_void_p)] + [
        (name, c_void_p) for name in ("nearest", "gradient", "sphere_depth", "sphere_volume", "sphere_direction")]


class Device(Structure):
    _fields_ = [("size", c_uint32), ("padding", c_uint32), ("limits", c_double * 8), ("rate", c_double)]


class Handle(Structure):
    _fields_ = [("size", c_uint32), ("buttons", c_uint32), ("time", c_double), ("X_BH", Pose), ("velocity", c_double * 6),
                ("is_valid", c_int32), ("wants_force", c_int32), ("is_released", c_int32), ("is_stopping", c_int32)]


class Tick(Structure):
    _fields_ = [("size", c_uint32), ("state", c_int32), ("F_H_B", c_double * 6), ("contact_W", c_double * 6), ("X_WT", Pose),
                ("X_WT_hand", Pose), ("stretch", c_double), ("energy", c_double), ("gain", c_double), ("fault", c_int32),
                ("num_faults", c_int32)]


def sized(kind, **members):
    return kind(ctypes.sizeof(kind), **members)


def load(path):
    library = ctypes.CDLL(path)
    for name in ("tool_pack_shape", "tool_load", "sensor_create", "scene_create", "contact_create", "hand_create",
                 "simulation_create"):
        getattr(library, "palpate_" + name).restype = c_void_p
    return library


def show(name, numbers):
    print(name, *(struct.pack(">d", number).hex() for number in numbers))


def pose(i):
    x, y, z, w = 0.1 * i, 0.05, 0.0, 1.0
    length = (x * x + y * y + z * z + w * w) ** 0.5
    return Pose((0.004 * i - 0.01, 0.003 * i, 0.54 + 0.01 * i), (x / length, y / length, z / length, w / length))


def counts():
    values = [0 if (u * 31 + v * 17) % 97 == 0 else (560 if u > 90 else 600) + (u * u // 37 + v * v // 53) % 5
              for v in range(HEIGHT) for u in range(WIDTH)]
    return (c_uint16 * len(values))(*values)


def main():
    lib, error = load(sys.argv[1]), Error()

    def made(handle):
        if not handle:
            raise SystemExit(error.text.decode())
        return c_void_p(handle)

    tool = made(lib.palpate_tool_pack_shape(b"stylus", c_double(0.12), b"packing.spheres = 300", byref(error)))
    camera = sized(Camera, width=WIDTH, height=HEIGHT, intrinsics=(140, 140, 79.5, 59.5))
    sensor = made(lib.palpate_sensor_create(byref(camera), None, 0, byref(error)))
    assert lib.palpate_sensor_update_counts(sensor, counts(), c_double(0.001), None, byref(error)) == 0, error.text
    scene = made(lib.palpate_scene_create(byref(error)))
    lib.palpate_scene_add_sensor(scene, sensor, byref(error))
    field = None
    for name, options in (("field", b""), ("graph", b"contact.method = graph; contact.edges = cut")):
        contact = made(lib.palpate_contact_create(tool, options, 0, byref(error)))
        field = field or contact
        for i in range(5):
            m = sized(Measure, wants=1, progress=1)
            assert lib.palpate_contact_measure(contact, scene, byref(pose(i)), byref(m), byref(error)) == 0, error.text
            show(name, [m.volume, m.potential, *m.force, *m.torque, m.stiffness[14], m.stiffness[22]])
    clearances = (c_double * 5)()
    answers = sized(Answers, clearance=ctypes.addressof(clearances))
    poses = (Pose * 5)(*(pose(i) for i in range(5)))
    assert lib.palpate_contact_measure_many(field, scene, poses, ctypes.c_size_t(5), byref(answers), byref(error)) == 0, error.text
    for clearance in clearances:
        show("clearance", [clearance])

    box = made(lib.palpate_tool_pack_shape(b"box", c_double(0.1), b"packing.spheres = 50", byref(error)))
    X_WB = Pose((0.05, 0.02, 0.56), (0, 0, 0, 1))
    assert lib.palpate_scene_add_body(scene, box, byref(X_WB), byref(error)) == 0, error.text
    for i in range(5):
        m = sized(Measure, wants=1, progress=1)
        assert lib.palpate_contact_measure(field, scene, byref(pose(i)), byref(m), byref(error)) == 0, error.text
        show("body", [m.volume, m.bodies_volume, *m.force, *m.torque, m.stiffness[14], *m.moments, m.polar_moment])
    lib.palpate_scene_free(scene)
    scene = made(lib.palpate_scene_create(byref(error)))
    lib.palpate_scene_add_sensor(scene, sensor, byref(error))

    device = sized(Device, limits=(10, 0.5, 2000, 5, 10, 0.2, 1, 0.001), rate=1000)
    hand = made(lib.palpate_hand_create(tool, byref(device), None, byref(error)))
    X_WT, start = pose(0), Pose()
    lib.palpate_hand_handle_at(hand, byref(X_WT), byref(start))
    for k in range(400):
        time = 1 + 1e-3 * k
        m = sized(Measure, wants=1, progress=1)
        lib.palpate_contact_measure(field, scene, byref(X_WT), byref(m), byref(error))
        lib.palpate_hand_contact(hand, byref(m), byref(X_WT), c_double(time), c_double(time))
        at = Pose(start.translation, start.rotation)
        at.translation[2] += 2e-4 * k
        handle, tick = sized(Handle, time=time, X_BH=at, is_valid=1), sized(Tick)
        lib.palpate_hand_tick(hand, byref(handle), byref(tick))
        X_WT = tick.X_WT
        if k % 50 == 49:
            show("push", [*tick.F_H_B[:3], X_WT.translation[2], tick.energy])

    simulation = made(lib.palpate_simulation_create(b"hand", 160, 120, c_double(1), c_uint64(7), byref(error)))
    pixels = (c_uint16 * (160 * 120))()
    for _ in range(2):
        lib.palpate_simulation_next(simulation, pixels, None, None, byref(error))
        hashed = 0xCBF29CE484222325
        for count in pixels:
            hashed = (hashed ^ count) * 0x100000001B3 % 2**64
        print(f"frame {hashed:016x}")
    for free, handle in (("hand", hand), ("contact", field), ("scene", scene), ("sensor", sensor), ("tool", tool), ("tool", box),
                         ("simulation", simulation)):
        getattr(lib, f"palpate_{free}_free")(handle)


if __name__ == "__main__":
    main()
