"""Files that tests of the program make: depth images, clouds."""

import math
import struct
import zlib

import contact_truth


def write_depth_png(path, width, height, value, bits=16):
    """Grayscale; value(u, v) in counts. Labels have 8 bits."""
    of_row = f">{width}" + {8: "B", 16: "H"}[bits]
    rows = b"".join(
        b"\0" + struct.pack(of_row, *(value(u, v) for u in range(width))) for v in range(height))

    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" +
                   chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)) +
                   chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def bumpy_wall():
    """x y z nx ny nz of a wall at z = 0.5 m with gentle bumps, in single precision."""
    points = []
    for i in range(-40, 41):
        for j in range(-40, 41):
            x, y = i * 0.0015, j * 0.0015
            z = 0.5 + 0.003 * math.sin(60 * x) * math.cos(45 * y)
            n = [60 * 0.003 * math.cos(60 * x) * math.cos(45 * y),
                 -45 * 0.003 * math.sin(60 * x) * math.sin(45 * y), -1.0]
            n = contact_truth.times(n, 1 / math.sqrt(contact_truth.dot(n, n)))
            points.append(struct.unpack("6f", struct.pack("6f", x, y, z, *n)))
    return points


def write_ply(path, points):
    header = ("ply\nformat ascii 1.0\nelement vertex %d\n" % len(points) +
              "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz")) +
              "end_header\n")
    with open(path, "w") as file:
        file.write(header + "".join(" ".join("%.9g" % c for c in p) + "\n" for p in points))
