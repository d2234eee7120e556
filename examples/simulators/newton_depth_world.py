"""Many pegs of Newton, each in a world of its own, in the room of one depth frame.

    pip install palpate-*.whl -r requirements.txt
    python3 newton_depth_world.py [--worlds 64] [--seconds 3] [--device cuda:0]

All contacts are one palpate.Contact.measure_batch with stiffness between two kernels of Warp: `predict` says where the
bodies would be without contact, `press` solves room.py's equation for state.body_f. The arrays of Warp are read and
written in place. On a GPU nothing leaves it, and a step is one CUDA graph; a new image in `Pegs.image` is another.
"""

import argparse
import sys

import numpy as np
from room import GRAVITY, HALF_SIDES, MASS, STEP, Room, peg, peg_inertia, table

import palpate

try:
    import newton
    import warp as wp
    from warp_room import compile_for, mat66, predict, press, vec6
except ImportError:
    newton = None


class Pegs:
    """Pegs of Newton above the room of a frame, one in each world."""

    def __init__(self, depth, camera, starts, device):
        self.device, self.place = device, "cpu" if device == "cpu" else "cuda"
        compile_for(device)
        builder = newton.ModelBuilder(gravity=(0, 0, -GRAVITY))
        for start in starts:
            builder.begin_world()
            builder.add_body(xform=wp.transform(start, wp.quat_identity()), mass=MASS,
                             inertia=wp.mat33(np.diag(peg_inertia())))
            builder.end_world()
        self.model = builder.finalize(device=device)
        self.solver = newton.solvers.SolverSemiImplicit(self.model, angular_damping=0.0)
        self.state, self.next = self.model.state(), self.model.state()
        tool, num = peg(), len(starts)
        self.contact = palpate.Contact(tool, place=self.place)
        # The camera is the origin of its images; where it is, the kernels know.
        there = palpate.Camera(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, unit=camera.unit,
                               distortion=camera.distortion)
        self.sensor, self.X_WC = palpate.Sensor(there, place=self.place), wp.transformd(*camera.pose)
        self.law = Room(tool, None)
        self.center = tool.center_of_mass
        with wp.ScopedDevice(device):
            self.poses, self.free = wp.zeros((num, 7), dtype=wp.float64), wp.zeros(num, dtype=vec6)
            self.force, self.torque = wp.zeros(num, dtype=wp.vec3d), wp.zeros(num, dtype=wp.vec3d)
            self.stiffness = wp.zeros(num, dtype=mat66)
            self.image, self.image_of_peg = wp.zeros((1, *depth.shape), dtype=float), wp.zeros(num, dtype=int)
        self.out = palpate.Batch(force=self.force, torque=self.torque, stiffness=self.stiffness)
        self.fields = None
        self.show(depth)

    def stream(self):
        return {} if self.device == "cpu" else {"stream": wp.get_stream(self.device).cuda_stream}

    def show(self, depth):
        """Shows a new image, m."""
        self.image.assign(depth[None])
        self.look()

    def look(self):
        self.fields = self.sensor.update_batch(self.image, out=self.fields, **self.stream())

    def measure(self):
        self.contact.measure_batch(self.fields, self.poses, surface_of_pose=self.image_of_peg, stiffness=True, out=self.out,
                                   **self.stream())

    def feel(self):
        """Writes state.body_f for the next step."""
        state, num, law = self.state, len(self.poses), self.law
        with wp.ScopedDevice(self.device):
            wp.launch(predict, num, [state.body_q, state.body_qd, wp.vec3d(0, 0, -GRAVITY), self.X_WC], [self.poses, self.free])
            self.measure()
            wp.launch(press, num, [self.poses, self.free, self.force, self.torque, self.stiffness, self.X_WC,
                                   wp.vec3d(*peg_inertia()), wp.vec3d(*HALF_SIDES), wp.vec3d(*self.center),
                                   wp.vec3d(law.stiffness, law.friction, law.settling)], [state.body_f])

    def step(self):
        self.feel()
        self.solver.step(self.state, self.next, None, None, STEP)
        self.state, self.next = self.next, self.state


def run(depth, camera, seconds, worlds=64, device="cpu", on_step=None):
    """The pegs after this time, with their poses (N, 7) and the wrenches on them (N, 6)."""
    random = np.random.default_rng(1)
    starts = np.column_stack([random.uniform(-0.04, 0.04, (worlds, 2)), HALF_SIDES[2] + random.uniform(0.002, 0.004, worlds)])
    pegs = Pegs(depth, camera, starts, device)
    pegs.step()
    pegs.step()
    graph = None
    if device != "cpu":  # two steps, after which the states are where they were
        with wp.ScopedCapture(device) as capture:
            pegs.step()
            pegs.step()
        graph = capture.graph
    for _ in range(round(seconds / STEP / 2)):
        if graph is None:
            pegs.step()
            pegs.step()
        else:
            wp.capture_launch(graph)
        if on_step is not None:
            on_step(pegs)
    return pegs.state.body_q.numpy(), pegs.next.body_f.numpy()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=3)
    parser.add_argument("--device", default="cpu")
    given = parser.parse_args()
    if newton is None:
        print("SKIPPED newton_depth_world: no Newton; pip install -r requirements.txt")
        return 0
    wp.config.quiet = True
    poses, wrenches = run(*table(), given.seconds, given.worlds, given.device)
    off = abs(wrenches[:, 2] / MASS / GRAVITY - 1)
    print(f"the table carries {wrenches[:, 2].min():.4f} to {wrenches[:, 2].max():.4f} N of the {MASS * GRAVITY:.4f} N "
          f"of each of {given.worlds} pegs")
    return 0 if off.max() < 0.001 else 1


if __name__ == "__main__":
    sys.exit(main())
