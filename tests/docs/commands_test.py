#!/usr/bin/env python3
"""Runs every command of README and guides as a reader would, page by page in an empty folder.

usage: tests/docs/commands_test.py PALPATE [PAGE ...]

A fenced block is run unless the line before it is `<!-- not run: WHY -->`; then WHY is printed. A
block in python or c++ is not a command. What a reader brings (meshes, frames, recordings of pages
before) is made by the program itself; long runs are cut to one or three seconds, and pages are
served until they answer. Every command has to end with 0, no tool may be packed that feels nothing at
an end, and what a page is about has to be in its runs (subjects.py).
"""
import fcntl
import gzip
import os
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import urllib.request
import zlib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/test_util"))
import parts  # noqa: E402
from subjects import SUBJECTS  # noqa: E402

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.S | re.M)
NOT_RUN = re.compile(r"<!-- not run: (.+) -->\s*\Z")
SERVES = re.compile(r"\bpalpate (view|try)\b|--view\b|--device page\b")


def pages():
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")),
            *sorted((ROOT / "docs/guide").glob("*.md")), *sorted((ROOT / "docs/reference").glob("*.md"))]


def blocks(text):
    """(first line, commands, why they are not run) of the blocks that hold commands."""
    for match in FENCE.finditer(text):
        language, body = match.groups()
        line = text.count("\n", 0, match.start()) + 2
        why = NOT_RUN.search(text[:match.start()])
        if language in ("", "sh", "bash") and (why or re.search(r"^(\S*/)?(palpate|make|cmake|scripts/|bench/|ssh) ?", body, re.M)):
            yield line, body, why.group(1) if why else None


def write_frame(path, number, width=640, height=480):
    """A 16-bit PNG, millimeters: a wall with squares a millimeter deep that change places from frame to frame."""
    kinds = [b"\0" + struct.pack(f">{width}H", *(700 + (u - 320) // 16 + (u // 8 + kind) % 2 for u in range(width)))
             for kind in range(2)]
    rows = b"".join(kinds[(v // 8 + number) % 2] for v in range(height))

    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" +
                     chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)) +
                     chunk(b"IDAT", zlib.compress(rows, 1)) + chunk(b"IEND", b""))


def draw_in_millimeters(path):
    """A binary STL file of meters."""
    data = bytearray(path.read_bytes())
    for begin in range(84, len(data), 50):
        for at in range(begin + 12, begin + 48, 4):
            struct.pack_into("<f", data, at, 1000 * struct.unpack_from("<f", data, at)[0])
    path.write_bytes(data)


def bring(folder, palpate):
    """Makes the files that the pages assume: meshes in millimeters, frames of a camera, a tool, a run."""
    def run(*words):
        subprocess.run([palpate, *words], cwd=folder, check=True, stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL)
    for name in ("part.stl", "probe.stl"):
        run("shape", "stylus", "--size", "0.12", "-o", name)
        draw_in_millimeters(folder / name)
    run("shape", "box", "--size", "0.05", "-o", "box.stl")
    run("pack", "box.stl", "--spheres", "500", "-o", "box.palp")
    frames = folder / "frames"
    frames.mkdir()
    for number in range(1, 31):
        write_frame(frames / f"{number:04}.png", number)
    shutil.copy(frames / "0001.png", folder / "frame.png")
    run("touch", "box.palp", "--scene", "wall", "--duration", "1", "-o", "run")


def shortened(command):
    command = re.sub(r"--duration (\d+)", lambda m: f"--duration {min(int(m.group(1)), 1)}", command)
    # The paths of simulated scenes touch them within three of their up to eight seconds.
    if re.search(r"\btouch .*(--scene |scene:)", command) and not re.search(r"--(duration|device|path|robot|view)\b", command):
        command = command.replace("touch ", "touch --duration 3 ", 1)
    return command


def serve(command, folder, environment):
    """Starts what serves a page, asks for the page, and ends it as Ctrl-C does."""
    process = subprocess.Popen(["bash", "-c", "exec " + command], cwd=folder, env=environment,
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    text = ""
    try:
        for line in process.stdout:
            text += line
            address = re.search(r"http://127\.0\.0\.1:\d+\S*", text)
            if address:
                page = urllib.request.urlopen(urllib.request.Request(
                    address.group(0), headers={"Accept-Encoding": "gzip"}), timeout=120)
                assert b"<html" in gzip.decompress(page.read()).lower(), "there is no page"
                process.send_signal(signal.SIGINT)
                break
        text += process.stdout.read()
        status = process.wait(timeout=600)
    finally:
        process.kill()
    return (0 if "http://" in text and status in (0, 130, -signal.SIGINT) else status or 1), text


def processor_seconds():
    """Returns what the commands so far have used."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def run_page(page, palpate, brought):
    """The number of commands that failed, and of those that were run."""
    num_failed = num_run = 0
    name, all_said = page.relative_to(ROOT), ""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        text = page.read_text()
        shutil.copytree(brought, folder, dirs_exist_ok=True)
        if "palpate replay run/" not in text or "-o run/" in text:
            shutil.rmtree(folder / "run")
        (folder / "build/release/bin").mkdir(parents=True)
        (folder / "build/release/bin/palpate").symlink_to(palpate)
        environment = dict(os.environ, PATH=f"{folder}/build/release/bin:{os.environ['PATH']}")
        for line, body, why in blocks(text):
            if why:
                print(f"SKIPPED: {name}:{line}: {why}")
                continue
            for command in re.sub(r"\\\n\s*", "", body).splitlines():
                command = command.split("  #")[0].strip()
                if not SERVES.search(command):  # which is ended once its page has been seen
                    command = shortened(command)
                if not command or command.startswith(("#", "alias ")):
                    continue
                begin, used = time.monotonic(), processor_seconds()
                if SERVES.search(command):
                    # One at a time, in whatever part: all have the same port.
                    with open(Path(tempfile.gettempdir()) / "palpate-docs-port", "w", encoding="ascii") as port:
                        fcntl.flock(port, fcntl.LOCK_EX)
                        status, said = serve(command, folder, environment)
                else:
                    run = subprocess.run(["bash", "-c", command], cwd=folder, env=environment,
                                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
                    status, said = run.returncode, run.stdout
                num_run += 1
                all_said += said
                if "stays empty and feels nothing" in said:
                    status = status or 1
                print(f"{name}:{line}: {command}: {status}, {time.monotonic() - begin:.1f} s, "
                      f"{processor_seconds() - used:.1f} s of processor", flush=True)
                if status != 0:
                    num_failed += 1
                    print(said[-3000:])
        if str(name) in SUBJECTS and num_failed == 0:
            try:
                SUBJECTS[str(name)](folder, all_said)
            except (AssertionError, OSError) as error:
                num_failed += 1
                print(f"{name}: does not show its subject: {SUBJECTS[str(name)].__doc__} {error!r}")
    return num_failed, num_run


def main():
    palpate = Path(sys.argv[1]).resolve()
    chosen = [Path(page).resolve() for page in sys.argv[2:]] or parts.share(pages())
    with tempfile.TemporaryDirectory() as brought:
        bring(Path(brought), palpate)
        failed, run = map(sum, zip(*(run_page(page, palpate, brought) for page in chosen)))
    print(f"{run} commands, {failed} failed")
    sys.exit(failed != 0 or run == 0)


if __name__ == "__main__":
    main()
