#!/usr/bin/env python3
"""Draws docs/pictures/several-bodies.svg: a section of two packed cubes that overlap, as the program measures them.

usage: tools/draw_bodies.py PROGRAM > docs/pictures/several-bodies.svg
       tools/draw_bodies.py PROGRAM --check docs/pictures/several-bodies.svg
"""

import csv
import json
import math
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

SIDE = 0.06  # m, of both cubes
TURN = math.radians(30)  # of the tool about z
AT = (0.046, -0.030, 0.5)  # m, the tool from the object, and how far both are from the camera
SCALE = 2500  # pixels per meter
MIDDLE = (170, 222)  # of the object in the picture
STIFFNESS = 1e6  # N/m3, of the arrows
FORCE_SCALE = 5.5  # pixels per newton


def run(program, folder, *arguments):
    made = subprocess.run([program, *arguments], cwd=folder, check=True, capture_output=True, text=True)
    return made.stdout


def blank_depth(path, width=64, height=48, count=3000):
    """A 16-bit PNG of a wall far behind both bodies."""
    rows = (b"\0" + struct.pack(">H", count) * width) * height
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + b"".join(struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in chunks)
    )


def measure(program):
    """Spheres of the cube, and the force on the tool in N."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        blank_depth(folder / "wall.png")
        run(program, folder, "shape", "box", "--size", str(SIDE), "-o", "cube.stl")
        run(program, folder, "pack", "cube.stl", "--spheres", "1000", "--max-radius", "0.007", "-o", "cube.palp")
        run(program, folder, "export", "cube.palp", "--spheres", "spheres.csv")
        pose = f"{AT[0]} {AT[1]} {AT[2]} 0 0 {math.sin(TURN / 2):.9f} {math.cos(TURN / 2):.9f}"
        answer = run(
            program, folder, "query", "cube.palp", "--depth", "wall.png", "--intrinsics", "60,60,31.5,23.5", "--json",
            "--object", f"cube.palp@0 0 {AT[2]} 0 0 0 1", "--pose", pose,
        )  # fmt: skip
        with open(folder / "spheres.csv", newline="") as file:
            rows = [[float(value) for value in row] for row in list(csv.reader(file))[1:]]
        result = json.loads(answer)["results"][0]
        return [row[-4:] for row in rows], [STIFFNESS * f for f in result["force"]], result["volume"]


def depth_in_cube(x, y, z):
    """How deep a point is in a cube at the origin, m; negative outside."""
    return SIDE / 2 - max(abs(x), abs(y), abs(z))


def rotated(x, y, angle):
    return (math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y)


def to_world(x, y):
    x, y = rotated(x, y, TURN)
    return x + AT[0], y + AT[1]


def pixel(x, y):
    return MIDDLE[0] + SCALE * x, MIDDLE[1] + SCALE * y


def circles(spheres, place, depth_in_other, colors):
    """Those that the plane of the centers cuts; `colors`: outside of the other body, and inside."""
    drawn = []
    for x, y, z, radius in spheres:
        if abs(z) >= radius:
            continue
        u, v = pixel(*place(x, y))
        is_inside = depth_in_other(x, y, z) > -radius
        fill, line = colors[is_inside]
        size = SCALE * math.sqrt(radius**2 - z**2)
        drawn.append(f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{size:.1f}" fill="{fill}" fill-opacity="0.8" stroke="{line}"/>')
    return drawn


def square(place, half):
    corners = [pixel(*place(x, y)) for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))]
    return "M" + " L".join(f"{u:.1f} {v:.1f}" for u, v in corners) + " Z"


def arrow(start, way):
    end = (start[0] + way[0], start[1] + way[1])
    length = math.hypot(*way)
    x, y = way[0] / length, way[1] / length
    base = (end[0] - 12 * x, end[1] - 12 * y)
    head = f"M{end[0]:.1f} {end[1]:.1f} L{base[0] - 6 * y:.1f} {base[1] + 6 * x:.1f} L{base[0] + 6 * y:.1f} {base[1] - 6 * x:.1f} Z"
    return f'<path d="M{start[0]:.1f} {start[1]:.1f} L{base[0]:.1f} {base[1]:.1f}"/><path d="{head}"/>'


def picture(program):
    spheres, force, volume = measure(program)

    def of_tool(x, y, z):  # how deep a point of the tool is in the object
        return depth_in_cube(*to_world(x, y), z)

    def of_object(x, y, z):
        x, y = rotated(x - AT[0], y - AT[1], -TURN)
        return depth_in_cube(x, y, z)

    def at_rest(x, y):
        return x, y

    way = [FORCE_SCALE * f for f in force[:2]]
    tool, thing = pixel(*to_world(0, 0)), pixel(0, 0)
    lines = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 640 340" font-family="sans-serif" font-size="15">',
        "<title>Two overlapping bodies: the spheres of each evaluate the distance field of the other</title>",
        '<rect width="640" height="340" fill="#fff"/>',
        *circles(spheres, at_rest, of_object, (("#f2e8d5", "#c9b48a"), ("#d9a441", "#7a5c2e"))),
        *circles(spheres, to_world, of_tool, (("#d7e7f5", "#8fb4d6"), ("#5b9bd5", "#1f5c99"))),
        '<g fill="none" stroke="#7a5c2e">',
        f'<path d="{square(at_rest, SIDE / 2)}" stroke-width="2.5"/>',
        *(f'<path d="{square(at_rest, SIDE / 2 - d)}" stroke-dasharray="4 4" opacity="0.7"/>' for d in (0.005, 0.01, 0.015)),
        f'</g><path d="{square(to_world, SIDE / 2)}" fill="none" stroke="#1f5c99" stroke-width="2.5"/>',
        '<g stroke="#c0392b" stroke-width="3" fill="#c0392b">',
        arrow(tool, way),
        arrow(thing, [-w for w in way]),
        "</g>",
        '<text x="92" y="134">object</text><text x="330" y="40">tool</text>',
        '<text x="18" y="326">a section of 1,000 spheres each; dashed: the distance field of the object</text>',
        f'<text x="430" y="112">{1e6 * volume:.1f} cm³ in common</text>',
        f'<text x="430" y="134">{math.hypot(*force):.0f} N on the tool,</text>',
        '<text x="430" y="154">the opposite on the object</text>',
        '<g font-size="13"><circle cx="438" cy="208" r="7" fill="#5b9bd5" stroke="#1f5c99"/>',
        '<text x="452" y="213">touch the object</text><circle cx="438" cy="234" r="7" fill="#d9a441" stroke="#7a5c2e"/>',
        '<text x="452" y="239">touch the tool</text></g>',
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def main(program, check=None, path=None):
    drawn = picture(str(Path(program).resolve()))
    if check is None:
        print(drawn, end="")
    elif check != "--check" or path is None:
        sys.exit(__doc__)
    elif Path(path).read_text(encoding="utf-8") != drawn:
        sys.exit(f"{path} is not what the program gives; draw it again: tools/draw_bodies.py PROGRAM > {path}")


if __name__ == "__main__":
    main(*sys.argv[1:]) if 2 <= len(sys.argv) <= 4 else sys.exit(__doc__)
