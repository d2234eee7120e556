"""Peers of contact_peers.py that step many worlds at once: height fields of MuJoCo Warp and of Newton, on a CPU or a GPU.

One world for each pose, one height field for all, rewritten in place for a new frame. A query is the detection of contacts;
on a GPU it is a CUDA graph, as both advise. Its force is depth times normal, summed. Neither gives a volume."""

from importlib.metadata import version

import numpy as np
from frame_peers import Window, batches, for_warp, height_field_model, heights
from peer_rows import timed


def recorded(call, device):
    """Returns the call, which waits for its work; on a GPU as one graph."""
    import warp as wp

    call()  # loads the kernels
    if device != "cpu":
        with wp.ScopedCapture(device) as capture:
            call()

    def ask():
        call() if device == "cpu" else wp.capture_launch(capture.graph)
        wp.synchronize()

    ask()
    return ask


def summed(world, num, depths, normals):
    """Sums depth times normal in each world."""
    return np.stack([np.bincount(world, np.maximum(depths, 0) * normals[:, k], num) for k in range(3)], axis=1)


def measured(groups, num, device, place, ask, forces):
    """Returns forces, s per pose and how many contacts a world has. place(poses) puts them; forces() reads after ask()."""
    times, found, met = [], [], []
    for group in groups:
        place(group.astype(np.float32))
        times.extend(timed(ask, 5 if len(groups) == 1 else 1, device)[1] / len(group))
        one, contacts = forces()
        found.append(one)
        met.append(contacts)
    return np.concatenate(found)[:num], np.array(times), np.mean(met) / len(groups[0])


def mujoco_warp_height_field(points, poses, shape, device, window=Window(), cell=0.03):
    """MuJoCo Warp looks at 50 cells of a pair, as MuJoCo does, and keeps up to 4 contacts."""
    import mujoco_warp
    import warp as wp

    wp.config.quiet = True
    model = height_field_model(shape, cell, window)
    for groups in batches(poses, device):
        num = len(groups[0])
        with wp.ScopedDevice(device):
            there, data = mujoco_warp.put_model(model), mujoco_warp.make_data(model, nworld=num, nconmax=8, njmax=8)

            def rewrite():
                there.hfield_data.assign(for_warp(heights(points, cell, window, device).flatten()))
                wp.synchronize()

            rewrite()
            _, frame = timed(rewrite, device=device)
            ask = recorded(lambda: mujoco_warp.collision(there, data), device)

            def place(group):
                data.qpos.assign(group[:, [0, 1, 2, 6, 3, 4, 5]])
                mujoco_warp.kinematics(there, data)
                wp.synchronize()

            def forces():
                count, found = int(data.nacon.numpy()[0]), data.contact
                sign = np.where(found.geom.numpy()[:count, 0] == 0, 1.0, -1.0)
                return summed(found.worldid.numpy()[:count], num, -found.dist.numpy()[:count],
                              sign[:, None] * found.frame.numpy()[:count, 0]), count

            found, times, contacts = measured(groups, len(poses), device, place, ask, forces)
        yield (f"MuJoCo Warp {version('mujoco-warp')} height field", None, found, times, frame,
               f"batch={num} cell_mm={1000 * cell:.0f} contacts={contacts:.1f}")


def newton_height_field(points, poses, shape, device, window=Window(), cell=0.01):
    """Newton's pipeline of collisions, without contacts ahead of touch (gap 0)."""
    import newton
    import warp as wp

    wp.config.quiet = True
    high = 2 * window.half[2]

    def elevations():
        return heights(points, cell, window, device) / high

    first = np.array(elevations().tolist(), dtype=np.float32)
    first[0, 0], first[0, 1] = 0, 1  # it takes the least and the most for the range
    config = newton.ModelBuilder.ShapeConfig(gap=0.0, density=0.0)
    for groups in batches(poses, device):
        num, builder, world = len(groups[0]), newton.ModelBuilder(), newton.ModelBuilder()
        body = world.add_body(mass=1.0, inertia=wp.mat33(np.eye(3)))
        if np.isscalar(shape):
            world.add_shape_sphere(body, radius=shape, cfg=config)
        else:
            world.add_shape_box(body, hx=shape[0] / 2, hy=shape[1] / 2, hz=shape[2] / 2, cfg=config)
        field = newton.Heightfield(first, *first.shape, window.half[0], window.half[1], 0.0, high)
        at = wp.transform((window.middle[0], window.middle[1], window.high(2)), wp.quat(1.0, 0.0, 0.0, 0.0))
        builder.add_shape_heightfield(xform=at, heightfield=field, cfg=config)
        builder.replicate(world, num)
        model = builder.finalize(device=device)
        pipeline = newton.CollisionPipeline(model, rigid_contact_max=64 * num, max_triangle_pairs=max(1000000, 600 * num))
        state, contacts = model.state(), pipeline.contacts()
        with wp.ScopedDevice(device):
            def rewrite():
                model.heightfield_elevations.assign(for_warp(elevations().flatten()))
                wp.synchronize()

            rewrite()
            _, frame = timed(rewrite, device=device)
            ask = recorded(lambda: pipeline.collide(state, contacts), device)
            distance = wp.zeros(contacts.rigid_contact_max, dtype=float)

            def place(group):
                state.body_q.assign(group)
                wp.synchronize()

            def forces():
                count = min(int(contacts.rigid_contact_count.numpy()[0]), contacts.rigid_contact_max)
                newton.eval_rigid_contact_kinematics(model, state, contacts, out_distance=distance)
                touched = model.shape_body.numpy()[np.stack([contacts.rigid_contact_shape0.numpy()[:count],
                                                             contacts.rigid_contact_shape1.numpy()[:count]])]
                sign = np.where(touched[0] < 0, 1.0, -1.0)  # normals go from the first shape to the second
                return summed(touched.max(axis=0), num, -distance.numpy()[:count],
                              sign[:, None] * contacts.rigid_contact_normal.numpy()[:count]), count

            found, times, met = measured(groups, len(poses), device, place, ask, forces)
        yield (f"Newton {newton.__version__} height field", None, found, times, frame,
               f"batch={num} cell_mm={1000 * cell:.0f} contacts={met:.1f}")
