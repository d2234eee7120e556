"""A peg of 1 kg on the table of a depth frame, in the simulators of examples/simulators, beside height fields of the same image.

Each row: what was measured, where, the value with its unit. `rest`: what the table carries after 2 s, and how far the peg
then moves and turns in 60 s. `energy`: kinetic, of the height and of the contact, at its highest over that at release.
`slide`: the vertical force while a damper draws the peg along at 25 mm/s, from its acceleration at 1 kHz. `frame`: what a new
image costs. `change`: the largest step of the force from one ms to the next while images change under the peg at rest.
`batch`: many pegs in Newton, their contact part over the batch alone; on a GPU, with --device cuda:0, as CUDA graphs, with and
without a new image in each.

Usage: simulator_figures.py FILE.csv [--frame depth.png --intrinsics fx,fy,cx,cy] [--seconds 60]
Needs the packages of examples/simulators/requirements.txt and the wheel of make wheel, in one environment."""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from peer_rows import guarded, stamp, timed, write

import palpate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "examples/simulators"))
import drake_depth_world  # noqa: E402
import mujoco_depth_world  # noqa: E402
import newton_depth_world  # noqa: E402
from room import GRAVITY, HALF_SIDES, MASS, STEP, Room, on_its_table, peg, peg_inertia, table  # noqa: E402

HALF, CELL, BELOW = 0.15, 0.01, 0.05  # m, of the height fields: of smaller cells, MuJoCo takes only 50 contacts, on one side
SPEED, PULL = -0.05, 200.0  # m/s along x, N s/m: the hand that draws the peg
# Options of MuJoCo against slip, as its documentation advises.
NO_SLIP = 'cone="elliptic" impratio="10" noslip_iterations="5"'
NOISE = 0.0015  # m, of the images that change


def heights(points_W):
    """Mean height of the points in each cell of a grid around the origin; cells without points take that of the table."""
    p = points_W.reshape(-1, 3)
    p = p[(abs(p[:, :2]) < HALF).all(axis=1)]
    num = int(round(2 * HALF / CELL))
    cell = np.floor((p[:, 1] + HALF) / CELL).astype(int) * num + np.floor((p[:, 0] + HALF) / CELL).astype(int)
    count, total = np.bincount(cell, minlength=num**2), np.bincount(cell, p[:, 2], num**2)
    return np.where(count > 0, total / np.maximum(count, 1), 0.0).reshape(num, num)


def mujoco_peg(start, grid=None, option=""):
    """Model and data of MuJoCo with nothing but the peg, on a height field if there is a grid."""
    import mujoco

    n = 0 if grid is None else len(grid)
    asset = "" if grid is None else f'<asset><hfield name="room" nrow="{n}" ncol="{n}" size="{HALF} {HALF} 1 {BELOW}"/></asset>'
    floor = "" if grid is None else f'<geom type="hfield" hfield="room" pos="0 0 -{BELOW}" friction="0.5 0.005 0.0001"/>'
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{STEP}" gravity="0 0 -{GRAVITY}" {option}/>{asset}
      <worldbody>{floor}<body name="peg" pos="{start[0]} {start[1]} {start[2]}"><freejoint/>
      <geom type="box" size="{' '.join(map(str, HALF_SIDES))}" mass="{MASS}" friction="0.5 0.005 0.0001"/></body>
      </worldbody></mujoco>""")
    if grid is not None:
        model.hfield_data[:] = np.clip(grid + BELOW, 0, 1).flatten()
    return mujoco, model, mujoco.MjData(model)


def go_mujoco(start, seconds, room=None, grid=None, draw=False, option=""):
    """Poses (N, 4, 4) and twists (N, 6) of the peg: in our room, or on a height field."""
    mujoco, model, data = mujoco_peg(start, grid, option)
    poses, twists = [], []
    for k in range(round(seconds / STEP)):
        if draw:
            data.qfrc_applied[:2] = PULL * ((SPEED if k * STEP > 0.5 else 0.0) - data.qvel[0]), -PULL * data.qvel[1]
        if room is not None:
            mujoco_depth_world.feel(mujoco, model, data, {1: room})
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        X = mujoco_depth_world.pose_of(data, 1)
        poses.append(X)
        twists.append(np.concatenate([data.qvel[:3], X[:3, :3] @ data.qvel[3:]]))
    return np.array(poses), np.array(twists)


def vertical_force(twists):
    """The force that the table puts on the peg, N, at each step."""
    return MASS * (np.diff(twists[:, 2]) / STEP + GRAVITY)


def turned(R):
    """Angle of the rotation between the first and each matrix, degrees."""
    cosine = (np.einsum("kij,ij->k", R, R[0]) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def highest_energy(room, start, poses, twists):
    """Largest mechanical energy over that at release, J."""
    energies = []
    for X, v in zip(poses, twists):
        w = X[:3, :3].T @ v[3:]
        energies.append(MASS * v[:3] @ v[:3] / 2 + (peg_inertia() * w) @ w / 2 + MASS * GRAVITY * (X[2, 3] - start[2]) +
                        room.felt(X)[2])
    return max(energies)


def rest_rows(who, poses, twists, settled=2.0):
    late = round(settled / STEP)
    force = vertical_force(twists)[-2000:].mean()
    moved = np.linalg.norm(poses[late:, :3, 3] - poses[late, :3, 3], axis=1).max()
    yield who, "rest", "carried over weight - 1", 100 * (force / MASS / GRAVITY - 1), "%"
    yield who, "rest", f"moved in {(len(poses) - late) * STEP:.0f} s", 1e3 * moved, "mm"
    yield who, "rest", f"turned in {(len(poses) - late) * STEP:.0f} s", turned(poses[late:, :3, :3]).max(), "deg"


def slide_rows(who, poses, twists):
    begin = round(0.8 / STEP)
    force = vertical_force(twists)[begin:]
    yield who, "slide", "way", 1e3 * np.linalg.norm(poses[-1, :2, 3] - poses[begin, :2, 3]), "mm"
    yield who, "slide", "ripple, sd", 100 * force.std() / MASS / GRAVITY, "% of the weight"
    yield who, "slide", "ripple, largest", 100 * abs(force - MASS * GRAVITY).max() / MASS / GRAVITY, "% of the weight"
    yield who, "slide", "height, peak to peak", 1e3 * np.ptp(poses[begin:, 2, 3]), "mm"


def quaternion(R):
    """x y z w of a rotation by less than half a turn."""
    w = np.sqrt(1 + np.trace(R)) / 2
    return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 4 * w * w]) / (4 * w)


class NewtonPeg:
    """The peg on Newton's height field, XPBD."""

    def __init__(self, start, grid):
        import newton
        import warp as wp

        self.newton, self.wp = newton, wp
        builder = newton.ModelBuilder(gravity=(0, 0, -GRAVITY))
        config = newton.ModelBuilder.ShapeConfig(mu=0.5, density=0.0)
        field = newton.Heightfield(data=grid, nrow=len(grid), ncol=len(grid), hx=HALF, hy=HALF, min_z=grid.min(), max_z=grid.max())
        builder.add_shape_heightfield(heightfield=field, cfg=config)
        body = builder.add_body(xform=wp.transform(start, wp.quat_identity()), mass=MASS, inertia=wp.mat33(np.diag(peg_inertia())))
        builder.add_shape_box(body, hx=HALF_SIDES[0], hy=HALF_SIDES[1], hz=HALF_SIDES[2], cfg=config)
        self.model = builder.finalize(device="cpu")
        self.solver = newton.solvers.SolverXPBD(self.model, iterations=10)
        self.state, self.next, self.contacts = self.model.state(), self.model.state(), self.model.contacts()

    def go(self, seconds, draw=False):
        poses, twists = [], []
        for k in range(round(seconds / STEP)):
            self.state.clear_forces()
            if draw:
                v = self.state.body_qd.numpy()[0]
                self.state.body_f.numpy()[0, :2] = PULL * ((SPEED if k * STEP > 0.5 else 0.0) - v[0]), -PULL * v[1]
            self.model.collide(self.state, self.contacts)
            self.solver.step(self.state, self.next, None, self.contacts, STEP)
            self.state, self.next = self.next, self.state
            poses.append(pose_matrix(self.state.body_q.numpy()[0]))
            twists.append(self.state.body_qd.numpy()[0].astype(float))
        return np.array(poses), np.array(twists)


def pose_matrix(q):
    x, y, z, w = np.asarray(q[3:], float) / np.linalg.norm(q[3:])
    X = np.eye(4)
    X[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    X[:3, 3] = q[:3]
    return X


def newton_ours(depth, camera, start, seconds):
    pegs = newton_depth_world.Pegs(depth, camera, np.array([start]), "cpu")
    poses, twists = [], []
    for _ in range(round(seconds / STEP)):
        pegs.step()
        poses.append(pose_matrix(pegs.state.body_q.numpy()[0]))
        twists.append(pegs.state.body_qd.numpy()[0].astype(float))
    return np.array(poses), np.array(twists)


def batch_rows(depth, camera, start, worlds, device):
    """The contact part of a step of many pegs over measure_batch with stiffness alone, by turns; times of the wall."""
    import warp as wp

    random = np.random.default_rng(1)
    pegs = newton_depth_world.Pegs(depth, camera, start + random.uniform(-0.02, 0.02, (worlds, 3)) * [1, 1, 0], device)
    for _ in range(60 if device == "cpu" else 600):  # on a CPU they still settle
        pegs.step()
    calls = {"contact part": pegs.feel, "batch alone": pegs.measure, "contact part, new image": lambda: (pegs.look(), pegs.feel()),
             "batch alone, new image": lambda: (pegs.look(), pegs.measure())}
    if device != "cpu":
        calls = {name: graph(call, device) for name, call in calls.items()}
    times = {name: [] for name in calls}
    for _ in range(30 if device == "cpu" else 200):
        for name, call in calls.items():
            wp.synchronize()
            times[name].extend(timed(lambda: (call(), wp.synchronize()), 1, "wall")[1])
    who = f"Newton, ours, {worlds} pegs on {device}"
    for name, spent in times.items():
        yield who, "batch", f"{name}, median", 1e3 * np.median(spent), "ms"
        yield who, "batch", f"{name}, p99", 1e3 * np.percentile(spent, 99), "ms"
    for image in ("", ", new image"):
        ratio = np.median(times["contact part" + image]) / np.median(times["batch alone" + image])
        yield who, "batch", f"contact part over batch alone{image}", ratio, "times"
    weights = pegs.state.body_f.numpy()[:, 2] / MASS / GRAVITY
    yield who, "batch", "carried over weight - 1, worst", 100 * abs(weights - 1).max(), "%"


def graph(call, device):
    """Returns a call as a CUDA graph to launch."""
    import warp as wp

    call()
    with wp.ScopedCapture(device) as capture:
        call()
    return lambda: wp.capture_launch(capture.graph)


def drake_ours(depth, camera, start, seconds):
    poses, twists = [], []

    def keep(plant, context):
        body = plant.GetBodyByName("peg")
        poses.append(plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4())
        v = plant.EvalBodySpatialVelocityInWorld(context, body)
        twists.append(np.concatenate([v.translational(), v.rotational()]))

    drake_depth_world.run(depth, camera, seconds, start, keep)
    return np.array(poses), np.array(twists)


def change_rows(depth, camera, start):
    """Images with new noise every 33 ms under the peg: with and without the blend, and in a run of palpate.touch."""
    random = np.random.default_rng(3)
    sensor = palpate.Sensor(camera)
    images = [(depth + random.normal(0, NOISE, depth.shape) * (depth > 0)).astype(np.float32) for _ in range(31)]
    surfaces = [sensor.update(image) for image in images]
    for name, blend in (("blended", 1 / 30), ("at once", 1e-9)):
        room = Room(peg(), surfaces[0], blend=blend)
        X = go_mujoco(start, 1.0, room)[0][-1]
        forces = []
        for k in range(1000):
            if k and k % 34 == 0:
                room.show(surfaces[k // 34], k * STEP)
            forces.append(room.felt(X, k * STEP)[0][:3])
        step = np.linalg.norm(np.diff(forces, axis=0), axis=1).max()
        yield f"ours, {name}", "change", "largest step of the force in 1 ms, peg held", step, "N"
    with tempfile.TemporaryDirectory() as folder:  # the same in a run, on a simulated clock
        raw = Path(folder) / "depth.raw"
        raw.write_bytes(b"".join((image * 1e4).round().astype(np.uint16).tobytes() for image in images))
        lens = ",".join(str(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy))
        eye = ",".join(map(str, camera.pose))
        pose = [*X[:3, 3], *quaternion(X[:3, :3])]
        run = palpate.touch(peg(), f"pipe:{raw}?size={camera.width}x{camera.height}&unit=0.0001&rate=30&intrinsics={lens}&pose={eye}",
                            np.array([[0, *pose], [0.95, *pose]]), force_at_eighth=room.stiffness * np.prod(2 * HALF_SIDES) / 8, average="none")
        forces = run.wrench[100:, :3]
        yield "a run of palpate.touch", "change", "largest step of the force in 1 ms, peg held", \
            np.linalg.norm(np.diff(forces, axis=0), axis=1).max(), "N"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("--frame")
    parser.add_argument("--intrinsics", default="525,525,319.5,239.5")
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--parts", help="some of mujoco,slide,drake,field,change,newton,newton-field,frame,batch")
    parser.add_argument("--worlds", type=int, default=1024, help="of the part batch; 16384 on a GPU")
    parser.add_argument("--device", default="cpu", help="of the part batch, e.g. cuda:0")
    given = parser.parse_args()
    if given.frame:
        depth = palpate.load_depth_png(given.frame)
        camera = on_its_table(depth, *depth.shape[::-1], *map(float, given.intrinsics.split(",")))
        depth = (0.001 * depth).astype(np.float32)
    else:
        depth, camera = table(width=640, height=480)
    sensor = palpate.Sensor(camera)
    surface = sensor.update(depth)
    points_W = np.asarray(surface.points, float).reshape(-1, 3)
    grid = heights(points_W[np.isfinite(points_W).all(axis=1)])
    rows, start, far = [], np.array([0.0, 0, HALF_SIDES[2] + 0.004]), given.seconds + 2

    def add(found):
        for who, figure, quantity, value, unit in found:
            rows.append({**stamp(), "frame": Path(given.frame or "simulated").name,
                         "who": who, "figure": figure, "quantity": quantity, "value": f"{value:.6g}", "unit": unit})
            print(*list(rows[-1].values())[2:], flush=True)

    room, aside = Room(peg(), surface), start + [0.01, 0, 0]
    finite = points_W[np.isfinite(points_W).all(axis=1)]

    def energy(who, poses, twists):
        value = highest_energy(room, start, poses[:4000], twists[:4000])
        return [(who, "energy", "highest in 4 s over release", 1e3 * value, "mJ")]

    def in_simulator(who, go):
        poses, twists = go(depth, camera, start, far)
        add(rest_rows(who, poses, twists))
        add(energy(who, poses, twists))

    def frames():
        _, model, _ = mujoco_peg(start, grid)

        def for_mujoco():
            model.hfield_data[:] = np.clip(heights(finite) + BELOW, 0, 1).flatten()

        for who, call in (("ours", lambda: sensor.update(depth)), ("MuJoCo, height field", for_mujoco),
                          ("Newton, height field", lambda: NewtonPeg(start, heights(finite)))):
            _, times = timed(call, 25)
            add([(who, "frame", "processor time, median", 1e3 * np.median(times), "ms"),
                 (who, "frame", "processor time, p99", 1e3 * np.percentile(times, 99), "ms")])

    def height_field():
        for who, option in (("MuJoCo, height field", ""), ("MuJoCo, height field, no slip", NO_SLIP)):
            add(rest_rows(who, *go_mujoco(start, far, grid=grid, option=option)))
            add(slide_rows(who, *go_mujoco(aside, 2.0, grid=grid, draw=True, option=option)))

    parts = {
        "mujoco": lambda: in_simulator("MuJoCo, ours", lambda *_: go_mujoco(start, far, Room(peg(), surface))),
        "slide": lambda: add(slide_rows("MuJoCo, ours", *go_mujoco(aside, 2.0, Room(peg(), surface), draw=True))),
        "drake": lambda: in_simulator("Drake, ours", drake_ours),
        "field": height_field,
        "change": lambda: add(change_rows(depth, camera, start)),
        "newton": lambda: in_simulator("Newton, ours", newton_ours),
        "newton-field": lambda: (add(rest_rows("Newton, height field", *NewtonPeg(start, grid).go(12.0))),
                                 add(slide_rows("Newton, height field", *NewtonPeg(aside, grid).go(2.0, draw=True)))),
        "frame": frames,
        "batch": lambda: add(batch_rows(depth, camera, start, given.worlds, given.device)),
    }
    is_whole = True
    for part in given.parts.split(",") if given.parts else parts:
        is_whole &= guarded(part, parts[part])
        write(given.file, rows)
    return 0 if is_whole else 1


if __name__ == "__main__":
    sys.exit(main())
