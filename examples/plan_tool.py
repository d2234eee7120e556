"""Plans a motion of a free-flying tool around what one depth frame shows, with OMPL's RRT-Connect.

    pip install palpate-*.whl ompl
    python3 examples/plan_tool.py

Palpate is the check of states: is a pose nearer than the margin? Motions are checked pose by pose in
one call. Exits with 1 if there is no plan, or if it is not clear.
"""

import sys

import numpy as np
from trajopt import box

import palpate

MARGIN = 0.008


def main():
    try:
        from ompl import base, geometric
    except ImportError:
        print("SKIPPED plan_tool: no OMPL; pip install ompl")
        return 0
    depth, camera, _ = palpate.render_scene("pillar", 0.0, width=320, height=240)
    scene = palpate.Scene([palpate.Sensor(camera).update(depth)])
    contact = palpate.Contact(palpate.pack(*box([0.03, 0.02, 0.06]), 100))
    pillar = np.nanmin(scene.cameras[0].points[120, :, 2])

    space = base.SE3StateSpace()
    bounds = base.RealVectorBounds(3)
    for axis, (low, high) in enumerate([(-0.25, 0.25), (-0.15, 0.15), (pillar - 0.25, pillar + 0.05)]):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    space.setBounds(bounds)

    def pose_of(state):
        q = state.rotation()
        return [state.getX(), state.getY(), state.getZ(), q.x, q.y, q.z, q.w]

    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: not contact.any(scene, [pose_of(state)], MARGIN)[0])
    ends = []
    for x in (-0.2, 0.2):
        state = space.allocState()
        state.setXYZ(x, 0, pillar + 0.01)
        state.rotation().setIdentity()
        ends.append(state)
    setup.setStartAndGoalStates(*ends)
    setup.getSpaceInformation().setStateValidityCheckingResolution(0.005)
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    if not setup.solve(20.0):
        print("no plan within 20 s")
        return 1
    path = setup.getSolutionPath()
    path.interpolate(200)
    poses = np.array([pose_of(state) for state in path.getStates()])
    least = contact.measure_batch(scene, poses, clearance=True).clearance.min()
    print(f"plan of {len(poses)} poses, least clearance {1e3 * least:.1f} mm")
    return 0 if least > MARGIN / 2 else 1


if __name__ == "__main__":
    sys.exit(main())
