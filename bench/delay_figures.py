#!/usr/bin/env python3
"""Latency study: a camera 0 to 300 ms late, jittery, 5 % of the images lost, over DDS on loopback.

usage: bench/delay_figures.py BUILD_DIR [--seconds S] [--csv FILE]

Needs the Python packages cyclonedds, mcap and mcap-ros2-support (scripts/setup.sh --test; run it with
build/python/bin/python). A wall goes to and fro and jumps; a simulated hand probes it in real time, 1000 ticks per
second. Said are, of each delay: how old the scene was that was felt, as the wrench says it, and what the hand was given,
summed here of what the run recorded: wrench times motion of the device, tick by tick. The tank is what it may be.
"""
import json
import math
import os
import random
import select
import subprocess
import sys
import tempfile
import time
from collections import deque
from pathlib import Path

from ros_bench import local_ros, machine_now, options_of, pack_ball, programs_of, write_rows

ROOT = Path(__file__).resolve().parent.parent
DOMAIN, TANK = 92, 0.01  # J
CASES = ((0, 0, 0), (50, 10, 0.05), (100, 20, 0.05), (200, 40, 0.05), (300, 60, 0.05))  # ms, ms, share
COLUMNS = ("delay_ms", "jitter_ms", "loss", "seconds", "images_sent", "frames_felt", "ticks", "age_min_ms", "age_p50_ms",
           "age_p99_ms", "force_max_N", "energy_max_mJ", "energy_end_mJ", "tank_mJ", "ticks_damped", "faults",
           "force_away_s", "tick_p99_us", "load_before", "load_after", "cores", "commit")


def camera(delay, jitter, loss):
    """Publishes images until its standard input ends; prints the number of published images."""
    sys.path.insert(0, str(ROOT / "tests/ros"))
    sys.argv[1:] = [str(DOMAIN)]
    import camera_peer as peer
    robot = peer.Robot(DOMAIN)
    images = robot.writer(peer.TOPIC, peer.Image, reliable=False, depth=5)
    infos = robot.writer("rt/camera/depth/camera_info", peer.CameraInfo, reliable=False, depth=5)
    chance, waiting, num_sent = random.Random(1), deque(), 0
    begin = next_image = time.time()
    while not select.select([sys.stdin], [], [], 0)[0]:
        now = time.time()
        if now >= next_image:
            next_image = max(next_image + 1 / 30, now - 1 / 30)
            t = now - begin
            depth = 0.49 + 0.01 * math.sin(2 * t) + (-0.02 if t % 3 > 1.5 else 0)  # jumps by 20 mm
            if chance.random() >= loss:
                waiting.append((now + delay + chance.uniform(0, jitter), now, depth))
        for due in [each for each in waiting if each[0] <= now]:
            infos.write(peer.info(due[1]))
            images.write(peer.count_image(due[1], peer.flat(due[2])))
            waiting.remove(due)
            num_sent += 1
        time.sleep(0.001)
    print(num_sent, flush=True)


def turned(a, b):
    """Returns the rotation vector (axis times angle) from quaternion a to b, x y z w."""
    ax, ay, az, aw = -a.x, -a.y, -a.z, a.w
    w = b.w * aw - b.x * ax - b.y * ay - b.z * az
    v = (b.w * ax + b.x * aw + b.y * az - b.z * ay, b.w * ay - b.x * az + b.y * aw + b.z * ax,
         b.w * az + b.x * ay - b.y * ax + b.z * aw)
    sine = math.sqrt(sum(part * part for part in v))
    if sine < 1e-12:
        return (0, 0, 0)
    angle = 2 * math.atan2(math.copysign(sine, w), abs(w))
    return tuple(part / sine * angle for part in v)


def dot(a, b):
    return a.x * b[0] + a.y * b[1] + a.z * b[2]


def given(recording):
    """Returns energies, forces and ages from the recorded ticks of a run."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    fading, last = 2, None
    since = most = total = max_force = 0.0
    ages, damped, num = [], 0, 0
    with open(recording, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for *_, tick in reader.iter_decoded_messages(topics=["/tick"]):
            num += 1
            if last is not None and tick.device.is_valid:
                a, b = last.device.pose, tick.device.pose
                way = [getattr(b.position, axis) - getattr(a.position, axis) for axis in "xyz"]
                work = dot(last.wrench_on_hand.force, way) + dot(last.wrench_on_hand.torque, turned(a.orientation, b.orientation))
                since += work
                total += work
                most = max(most, since)
                if last.safety.state == fading and tick.safety.state != fading:
                    since = 0.0
            force = tick.wrench_on_hand.force
            max_force = max(max_force, math.sqrt(force.x**2 + force.y**2 + force.z**2))
            damped += tick.safety.damping > 0
            if tick.contact_number > 0:
                ages.append(tick.sensor_age)
            last = tick
    ages.sort()
    return {"num": num, "ages": ages, "most": most, "total": total, "force": max_force, "damped": damped}


def main():
    options = options_of(__doc__, 20)
    [palpate] = programs_of(options.build, "palpate")
    environment = local_ros(DOMAIN)
    rows = []
    with tempfile.TemporaryDirectory() as work:
        pack_ball(palpate, work, 300)
        for delay, jitter, loss in CASES:
            before = os.getloadavg()[0]
            robot = subprocess.Popen([sys.executable, __file__, "--camera", str(delay / 1000), str(jitter / 1000),
                                      str(loss)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            run = subprocess.run(
                [palpate, "touch", "ball.palp", "--camera", "ros2:/camera/depth/image_raw?clock=shared", "--device",
                 "sim:omega.6", "--probe", "0,0,0.49", "--duration", str(options.seconds), "--set",
                 f"safety.energy_tank={TANK}", "--json", "-o", f"run{delay}"],
                cwd=work, env=environment, capture_output=True, text=True, check=False)
            num_sent = int(robot.communicate()[0] or 0)
            if run.returncode != 0:
                sys.exit(f"delay_figures: {run.stderr}")
            summary = json.loads(run.stdout)
            seen = given(next(Path(work, f"run{delay}").glob("*.mcap")))
            ages = seen["ages"]
            rows.append([delay, jitter, loss, options.seconds, num_sent, summary["frames"], seen["num"],
                         *(round(1000 * ages[int(share * (len(ages) - 1))], 1) for share in (0, 0.5, 0.99)),
                         round(seen["force"], 2), round(1000 * seen["most"], 3), round(1000 * seen["total"], 1),
                         1000 * TANK, seen["damped"], len(summary["faults"]),
                         round(sum(fault["seconds"] or 0 for fault in summary["faults"]), 2),
                         summary["microseconds"]["haptic_period"]["p99"],
                         *machine_now(before)])
            print(*(f"{name} {value}" for name, value in zip(COLUMNS, rows[-1])), sep=", ", flush=True)
    write_rows(options.csv, COLUMNS, rows)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--camera"]:
        camera(*map(float, sys.argv[2:5]))
    else:
        main()
