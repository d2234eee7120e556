"""Times and rows of the scripts about peers: all take time the same way and say where and of which commit a row is."""

import csv
import datetime
import os
import subprocess
import sys
import time

import numpy as np


def clock(device="cpu"):
    """Returns seconds: of the processor, as the machine may be busy; with a GPU, of the wall."""
    return time.process_time() if device == "cpu" else time.perf_counter()


def timed(call, num=5, device="cpu"):
    """Returns the last result, and the times in s. On a GPU, the call has to wait for its work."""
    times = []
    for _ in range(num):
        begin = clock(device)
        result = call()
        times.append(clock(device) - begin)
    return result, np.array(times)


def machine(device="cpu"):
    """Returns the model of the processor or of the GPU."""
    if device != "cpu":
        import warp as wp

        return wp.get_device(device).name
    with open("/proc/cpuinfo") as file:
        return next((line.split(":", 1)[1].strip() for line in file if line.startswith("model name")), "unknown")


def stamp():
    """Returns date and commit: the variable PALPATE_COMMIT where there is no repository."""
    asked = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    commit = os.environ.get("PALPATE_COMMIT") or asked.stdout.strip() or "unknown"
    return {"date": datetime.date.today().isoformat(), "commit": commit}


def write(path, rows):
    """Writes the rows, and nothing if there are none."""
    if not rows:
        return
    with open(path, "w", newline="") as file:
        table = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def guarded(name, part):
    """Runs a part. Its error is said and does not keep the others from running; returns if there was none."""
    try:
        part()
    except Exception as error:  # noqa: BLE001  any library may fail in its own way
        print(f"FAILED {name}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
        return False
    return True
