"""A peg of Drake in the room of a depth frame: a LeafSystem with a depth image and a camera pose as inputs.

    pip install palpate-*.whl -r requirements.txt
    python3 drake_depth_world.py [--seconds 3]

`DepthWorld` connects a camera of a diagram (or fixed images) with the applied spatial forces of a MultibodyPlant: what
the camera sees is then geometry that Drake does not need to know. New images are taken with the rate of the camera.
"""

import argparse
import sys

import numpy as np
from room import GRAVITY, HALF_SIDES, MASS, STEP, Room, free_body, peg, peg_inertia, table

import palpate

try:
    from pydrake.common.eigen_geometry import Quaternion
    from pydrake.common.value import Value
    from pydrake.math import RigidTransform
    from pydrake.multibody.math import SpatialForce, SpatialVelocity
    from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
    from pydrake.multibody.tree import SpatialInertia, UnitInertia
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder, LeafSystem
    from pydrake.systems.sensors import ImageDepth32F
except ImportError:
    LeafSystem = None


def world_of_depth(plant, body, camera, rate=30.0):
    """A DepthWorld for one free body of the plant."""

    class DepthWorld(LeafSystem):
        def __init__(self):
            super().__init__()
            self.depth = self.DeclareAbstractInputPort("depth", Value(ImageDepth32F(camera.width, camera.height)))
            self.camera_pose = self.DeclareAbstractInputPort("X_WC", Value(RigidTransform()))
            self.poses = self.DeclareAbstractInputPort("body_poses", Value([RigidTransform()]))
            self.twists = self.DeclareAbstractInputPort("body_spatial_velocities", Value([SpatialVelocity.Zero()]))
            self.DeclareAbstractOutputPort("forces", lambda: Value([ExternallyAppliedSpatialForce()]), self.push,
                                           {self.all_sources_ticket()})
            self.DeclareInitializationUnrestrictedUpdateEvent(self.look)
            self.DeclarePeriodicUnrestrictedUpdateEvent(1 / rate, 1 / rate, self.look)
            self.sensor, self.room, self.latest = palpate.Sensor(camera), None, None

        def look(self, context, state):
            """Takes the image at the port, if it is another one. What is seen is kept here: one context to a system."""
            image = self.depth.Eval(context).data[:, :, 0]
            if self.latest is not None and np.array_equal(image, self.latest):
                return
            self.latest = image.copy()
            surface = self.sensor.update(self.latest, pose=self.camera_pose.Eval(context).GetAsMatrix4())
            if self.room is None:
                self.room = Room(peg(), surface)
            else:
                self.room.show(surface, context.get_time())

        def push(self, context, output):
            X = self.poses.Eval(context)[body.index()].GetAsMatrix4()
            twist = self.twists.Eval(context)[body.index()]
            v = np.concatenate([twist.translational(), twist.rotational()])
            v[2] -= STEP * GRAVITY
            w = self.room.wrench(X, v, free_body(X[:3, :3], peg_inertia()), STEP, context.get_time())
            force = ExternallyAppliedSpatialForce()
            force.body_index, force.p_BoBq_B, force.F_Bq_W = body.index(), np.zeros(3), SpatialForce(w[3:], w[:3])
            output.set_value([force])

    return DepthWorld()


def run(depth, camera, seconds, start=(0, 0, HALF_SIDES[2] + 0.002), on_step=None):
    """Times, positions of the peg and the wrenches on it: (N,), (N, 3) and (N, 6). on_step: gets plant and context."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(STEP))
    unit = UnitInertia(*(peg_inertia() / MASS))
    body = plant.AddRigidBody("peg", SpatialInertia(MASS, np.zeros(3), unit))
    plant.mutable_gravity_field().set_gravity_vector([0, 0, -GRAVITY])
    plant.Finalize()
    world = builder.AddSystem(world_of_depth(plant, body, camera))
    builder.Connect(plant.get_body_poses_output_port(), world.poses)
    builder.Connect(plant.get_body_spatial_velocities_output_port(), world.twists)
    builder.Connect(world.get_output_port(), plant.get_applied_spatial_force_input_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    seen, image = world.GetMyContextFromRoot(context), ImageDepth32F(camera.width, camera.height)
    image.mutable_data[:, :, 0] = depth
    world.depth.FixValue(seen, Value(image))
    turned = camera.pose[[6, 3, 4, 5]] / np.linalg.norm(camera.pose[3:])
    world.camera_pose.FixValue(seen, Value(RigidTransform(Quaternion(turned), camera.pose[:3])))
    of_plant = plant.GetMyContextFromRoot(context)
    plant.SetFreeBodyPose(of_plant, body, RigidTransform(start))
    simulator.Initialize()
    times, path, wrenches = [], [], []
    for k in range(round(seconds / STEP)):
        force = world.get_output_port().Eval(seen)[0].F_Bq_W
        simulator.AdvanceTo((k + 1) * STEP)
        times.append(context.get_time())
        path.append(plant.EvalBodyPoseInWorld(of_plant, body).translation())
        wrenches.append(np.concatenate([force.translational(), force.rotational()]))
        if on_step is not None:
            on_step(plant, of_plant)
    return np.array(times), np.array(path), np.array(wrenches)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3)
    given = parser.parse_args()
    if LeafSystem is None:
        print("SKIPPED drake_depth_world: no pydrake; pip install -r requirements.txt")
        return 0
    times, path, wrenches = run(*table(), given.seconds)
    late = times > times[-1] - 0.2
    carried = wrenches[late, 2].mean()
    print(f"the table carries {carried:.4f} N of the {MASS * GRAVITY:.4f} N of the peg, which moved by "
          f"{1e6 * np.ptp(path[late], axis=0).max():.2f} um in the last 0.2 s")
    return 0 if abs(carried / MASS / GRAVITY - 1) < 0.001 else 1


if __name__ == "__main__":
    sys.exit(main())
