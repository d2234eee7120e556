"""Depth images of a wall in every format that is read without a library of others, written byte by byte."""

import sqlite3
import struct
import zlib

SECONDS = 1_500_000_000  # of the first image, since 1970


def counts(width, height, number=0):
    """Millimeters to a wall that is bent a little and moves."""
    return [500 + (u - width // 2) ** 2 // 400 + (v + number) % 2 for v in range(height) for u in range(width)]


def raw(width, height, number=0):
    return struct.pack(f"<{width * height}H", *counts(width, height, number))


def png(width, height, number=0):
    pixels = struct.pack(f">{width * height}H", *counts(width, height, number))
    rows = b"".join(b"\0" + pixels[begin:begin + 2 * width] for begin in range(0, len(pixels), 2 * width))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in ((b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)),
                           (b"IDAT", zlib.compress(rows)), (b"IEND", b"")))


def write_folder(path, width, height, num):
    path.mkdir()
    for number in range(num):
        (path / f"{number}.png").write_bytes(png(width, height, number))
    return f"folder:{path}?"


def write_raw(path, width, height, num):
    path.write_bytes(b"".join(raw(width, height, number) for number in range(num)))
    return f"pipe:{path}?size={width}x{height}&"


def write_ros1_bag(path, width, height, num):
    def text(data):
        return struct.pack("<I", len(data)) + data

    def record(data, **fields):
        return text(b"".join(text(name.encode() + b"=" + value) for name, value in fields.items())) + text(data)

    def image(number):
        return struct.pack("<3I", number, SECONDS + number, 0) + text(b"camera") + struct.pack(
            "<2I", height, width) + text(b"16UC1") + struct.pack("<BI", 0, 2 * width) + text(raw(width, height, number))

    topic, zero = b"/d/image", bytes(4)
    records = [record(text(b"topic=" + topic) + text(b"type=sensor_msgs/Image"), op=b"\7", conn=zero, topic=topic)]
    records += [record(image(number), op=b"\2", conn=zero, time=struct.pack("<2I", SECONDS + number, 0))
                for number in range(num)]
    chunks = [b"".join(records[begin:begin + 2]) for begin in range(0, len(records), 2)]
    path.write_bytes(b"#ROSBAG V2.0\n" + b"".join(
        record(chunk, op=b"\5", compression=b"none", size=struct.pack("<I", len(chunk))) for chunk in chunks))
    return f"bag:{path}?"


def write_sqlite_bag(path, width, height, num):
    def image(number):
        # CDR, little-endian; numbers begin at multiples of their size after the first four bytes.
        return b"\0\1\0\0" + struct.pack("<iI I3sx II I6sBx II", SECONDS + number, 0, 3, b"ir\0", height, width,
                                         6, b"16UC1\0", 0, 2 * width,
                                         2 * width * height) + raw(width, height, number)

    database = sqlite3.connect(path)
    with database:
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
        database.execute("INSERT INTO topics VALUES (1, '/d/image', 'sensor_msgs/msg/Image', 'cdr')")
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)",
                             [((SECONDS + number) * 10**9, image(number)) for number in range(num)])
    database.close()
    return f"bag:{path}?"
