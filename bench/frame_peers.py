"""Peers of contact_peers.py beside meshes: look-ups in the image, distance grids, a height field, an octree, yes or no.

Each peer is a generator of (name, shares or None, forces or None, s per pose, s per frame, facts), like those there. On a GPU
it answers a batch first, then each pose alone. A tool of others is a box by its sides or a ball by its radius, m."""

import os
import tempfile
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
from contact_truth import rotation
from peer_rows import clock, timed

SURE = 0.02           # m: how far the look-up takes neighbors for the same surface
BATCH = 16384         # poses of a batch on a GPU


@dataclass
class Window:
    """The part of the room that meshes, grids and height fields hold, m in the camera's frame: middle and half of its sides."""

    middle: tuple = (0.0, 0.0, 1.05)
    half: tuple = (0.25, 0.25, 0.35)

    def low(self, axis):
        return self.middle[axis] - self.half[axis]

    def high(self, axis):
        return self.middle[axis] + self.half[axis]

    def has(self, points):
        """Returns which points are inside, seen from the camera; nearer ones too."""
        across = (abs(points[..., :2] - np.array(self.middle[:2])) < np.array(self.half[:2])).all(axis=-1)
        return np.isfinite(points).all(axis=-1) & across & (points[..., 2] < self.high(2))


def library(device):
    """Returns NumPy, or CuPy on a GPU: the same functions."""
    if device == "cpu":
        return np
    import cupy

    return cupy


def on_host(array):
    """Returns an array of NumPy of one in any memory."""
    return np.asarray(array) if array.__dlpack_device__()[0] == 1 else library("cuda").from_dlpack(array).get()


def for_warp(array):
    """Returns an array of NumPy or CuPy as one of Warp, in its memory."""
    import warp as wp

    return wp.from_dlpack(array)


def batches(poses, device):
    """Yields groups of poses that are asked at once: all; on a GPU a batch, moved a little from one to the next, then each alone."""
    if device == "cpu":
        yield [poses]
        return
    many = np.resize(poses, (BATCH, 7))
    many[len(poses):, :2] += np.random.default_rng(5).uniform(-0.002, 0.002, (BATCH - len(poses), 2))
    yield [many]
    yield poses[:, None]


def warp_kernels(wp):
    @wp.func
    def add(r: float, distance: float, normal: wp.vec3, pose: int, volumes: wp.array(dtype=float), forces: wp.array(dtype=wp.vec3)):
        """The volume of a sphere behind the plane at this distance of its center."""
        if distance < r:
            h = wp.min(r - distance, 2.0 * r)
            volume = 3.14159265 * h * h * (r - h / 3.0)
            wp.atomic_add(volumes, pose, volume)
            wp.atomic_add(forces, pose, volume * normal)

    @wp.kernel
    def projective(depth: wp.array(dtype=float, ndim=2), lens: wp.vec4, slanted: int, spheres: wp.array(dtype=wp.vec4),
                   poses: wp.array(dtype=wp.transform), volumes: wp.array(dtype=float), forces: wp.array(dtype=wp.vec3)):
        """depth(u, v) - z of the center; slanted: times the cosine of the normal, which four neighbors give."""
        pose, i = wp.tid()
        s = spheres[i]
        c = wp.transform_point(poses[pose], wp.vec3(s[0], s[1], s[2]))
        u, v = int(lens[0] * c[0] / c[2] + lens[2] + 0.5), int(lens[1] * c[1] / c[2] + lens[3] + 0.5)
        if c[2] > 0.0 and u > 2 and v > 2 and u < depth.shape[1] - 3 and v < depth.shape[0] - 3:
            z = depth[v, u]
            if z > 0.0:
                normal, distance = wp.vec3(0.0, 0.0, -1.0), z - c[2]
                if slanted != 0:
                    dx, dy = depth[v, u + 2] - depth[v, u - 2], depth[v + 2, u] - depth[v - 2, u]
                    if wp.abs(dx) < SURE and wp.abs(dy) < SURE:
                        a = wp.vec3((4.0 * z + (float(u) - lens[2]) * dx) / lens[0], (float(v) - lens[3]) * dx / lens[1], dx)
                        b = wp.vec3((float(u) - lens[2]) * dy / lens[0], (4.0 * z + (float(v) - lens[3]) * dy) / lens[1], dy)
                        normal = wp.normalize(wp.cross(b, a))
                        distance = distance * wp.abs(normal[2])
                add(s[3], distance, normal, pose, volumes, forces)

    @wp.kernel
    def trilinear(grid: wp.array(dtype=float, ndim=3), low: wp.vec3, voxel: float, spheres: wp.array(dtype=wp.vec4),
                  poses: wp.array(dtype=wp.transform), volumes: wp.array(dtype=float), forces: wp.array(dtype=wp.vec3)):
        """Value and gradient of a grid of signed distances, z the fastest index."""
        pose, i = wp.tid()
        s = spheres[i]
        c = (wp.transform_point(poses[pose], wp.vec3(s[0], s[1], s[2])) - low) / voxel
        x, y, z = int(wp.floor(c[0])), int(wp.floor(c[1])), int(wp.floor(c[2]))
        if x >= 0 and y >= 0 and z >= 0 and x < grid.shape[0] - 1 and y < grid.shape[1] - 1 and z < grid.shape[2] - 1:
            a, b, g = c[0] - float(x), c[1] - float(y), c[2] - float(z)
            v00, v01 = wp.lerp(grid[x, y, z], grid[x, y, z + 1], g), wp.lerp(grid[x, y + 1, z], grid[x, y + 1, z + 1], g)
            v10, v11 = wp.lerp(grid[x + 1, y, z], grid[x + 1, y, z + 1], g), wp.lerp(grid[x + 1, y + 1, z], grid[x + 1, y + 1, z + 1], g)
            near = wp.lerp(wp.lerp(grid[x, y, z], grid[x + 1, y, z], a), wp.lerp(grid[x, y + 1, z], grid[x + 1, y + 1, z], a), b)
            far = wp.lerp(wp.lerp(grid[x, y, z + 1], grid[x + 1, y, z + 1], a),
                          wp.lerp(grid[x, y + 1, z + 1], grid[x + 1, y + 1, z + 1], a), b)
            slope = wp.vec3(wp.lerp(v10, v11, b) - wp.lerp(v00, v01, b), wp.lerp(v01, v11, a) - wp.lerp(v00, v10, a), far - near)
            add(s[3], wp.lerp(near, far, g), wp.normalize(slope), pose, volumes, forces)

    return projective, trilinear


_kernels = None


def launched(kernel, inputs, tool, poses, device):
    """Yields shares, forces, s per pose and how many poses were asked at once, of a kernel that sums over spheres."""
    import warp as wp

    spheres = np.asarray(tool.spheres)
    whole = 4 / 3 * np.pi * (spheres[:, 3].astype(float) ** 3).sum()
    balls = wp.array(spheres, dtype=wp.vec4)
    for groups in batches(poses, device):
        num, repeats, times, shares, sums = len(groups[0]), 6 if len(groups) == 1 else 2, [], [], []
        where = wp.zeros(num, dtype=wp.transform)
        volumes, forces = wp.zeros(num, dtype=float), wp.zeros(num, dtype=wp.vec3)

        def ask():
            volumes.zero_()
            forces.zero_()
            wp.launch(kernel, dim=(num, len(spheres)), inputs=[*inputs, balls, where], outputs=[volumes, forces])
            wp.synchronize()

        for group in groups:
            where.assign(group.astype(np.float32))
            wp.synchronize()
            times.extend(timed(ask, repeats, device)[1][1:] / num)  # the first loads the kernel
            shares.append(volumes.numpy() / whole)
            sums.append(forces.numpy() / whole)
        yield np.concatenate(shares)[:len(poses)], np.concatenate(sums)[:len(poses)], np.array(times), num


def image_peers(tool, depth, camera, points, poses, device, window=Window()):
    """The cheapest of all: the depth behind each center in the image. Then distance grids, made of the filtered points."""
    import warp as wp

    global _kernels
    wp.config.quiet = True
    wp.set_module_options({"enable_backward": False})
    _kernels = _kernels or warp_kernels(wp)
    projective, trilinear = _kernels
    filtered = np.nan_to_num(points[..., 2]).astype(np.float32)

    def ready(make):
        made = make()
        wp.synchronize()
        return made

    with wp.ScopedDevice(device):
        lens = wp.vec4(camera.fx, camera.fy, camera.cx, camera.cy)
        for name, slanted in (("projective look-up", 0), ("projective look-up, cosine", 1)):
            image, frame = timed(lambda: ready(lambda: wp.array(filtered, dtype=float)), device=device)
            for shares, forces, times, num in launched(projective, [image, lens, slanted], tool, poses, device):
                yield name, shares, forces, times, frame, f"batch={num}"
        for voxel in (0.005, 0.01, 0.02):
            grid, frame = timed(lambda: ready(lambda: for_warp(signed_distances(filtered, camera, voxel, window, device))),
                                1 if device == "cpu" else 5, device)
            low = wp.vec3(*(window.low(axis) for axis in range(3)))
            for shares, forces, times, num in launched(trilinear, [grid, low, voxel], tool, poses, device):
                yield f"distance grid {1000 * voxel:.0f} mm", shares, forces, times, frame, f"batch={num} voxels={grid.size}"


def signed_distances(depth, camera, voxel, window, device):
    """As maps make them: voxels behind the surface are solid; exact Euclidean distances to the others, from SciPy or CuPy."""
    xp = library(device)
    if device == "cpu":
        from scipy.ndimage import distance_transform_edt
    else:
        from cupyx.scipy.ndimage import distance_transform_edt

    depth = xp.asarray(depth)
    x, y, z = xp.meshgrid(*(xp.arange(window.low(k), window.high(k) + (voxel / 2 if k < 2 else 0), voxel) for k in range(3)), indexing="ij")
    u = xp.clip((camera.fx * x / z + camera.cx + 0.5).astype(int), 0, camera.width - 1)
    v = xp.clip((camera.fy * y / z + camera.cy + 0.5).astype(int), 0, camera.height - 1)
    seen = depth[v, u]
    solid = (seen > 0) & (z > seen)
    outside, inside = distance_transform_edt(~solid), distance_transform_edt(solid)
    return (voxel * xp.where(solid, 0.5 - inside, outside - 0.5)).astype(xp.float32)


def heights(points, cell, window, device="cpu"):
    """Mean height towards the camera of the points in each cell, over the far side of the window."""
    xp = library(device)
    p = xp.asarray(points[window.has(points)]) - xp.asarray([window.middle[0], window.middle[1], window.high(2)])
    half, num = window.half[0], int(round(2 * window.half[0] / cell))
    # Seen from the back of the image: x to the right, y up.
    at = xp.floor((half - p[:, 1]) / cell).astype(int) * num + xp.floor((p[:, 0] + half) / cell).astype(int)
    count, total = xp.bincount(at, minlength=num**2), xp.bincount(at, -p[:, 2], num**2)
    return xp.where(count > 0, total / xp.maximum(count, 1), 0.0).reshape(num, num).astype(xp.float32)


def height_field_model(shape, cell, window):
    """MuJoCo's model of a tool and a height field of these cells: the field's z is the image's -z, turned about x."""
    import mujoco

    num = int(round(2 * window.half[0] / cell))
    kind, size = ("sphere", shape) if np.isscalar(shape) else ("box", " ".join(map(str, np.asarray(shape) / 2)))
    x, y, _ = window.middle
    return mujoco.MjModel.from_xml_string(f"""<mujoco><asset><hfield name="room" nrow="{num}" ncol="{num}"
      size="{window.half[0]} {window.half[1]} 1 0.1"/></asset><worldbody>
      <geom type="hfield" hfield="room" pos="{x} {y} {window.high(2)}" quat="0 1 0 0"/>
      <body><freejoint/><geom type="{kind}" size="{size}" mass="1"/></body></worldbody></mujoco>""")


def mujoco_height_field(points, poses, shape, window=Window(), cell=0.03):
    """MuJoCo's contacts with a height field, rewritten for each frame as its users do (model.hfield_data): depth times
    normal, summed. At most 50 contacts a pair: smaller cells are taken on one side only."""
    import mujoco

    model = height_field_model(shape, cell, window)

    def rewrite():
        model.hfield_data[:] = heights(points, cell, window).flatten()

    _, frame = timed(rewrite)
    data = mujoco.MjData(model)
    forces, times, met = [], [], []
    for pose in poses:
        data.qpos[:3], data.qpos[3:] = pose[:3], pose[[6, 3, 4, 5]]
        mujoco.mj_kinematics(model, data)
        times.extend(timed(lambda: mujoco.mj_collision(model, data), 1)[1])
        forces.append(sum_of_contacts(data))
        met.append(data.ncon)
    yield (f"MuJoCo {mujoco.__version__} height field", None, np.array(forces), np.array(times), frame,
           f"cell_mm={1000 * cell:.0f} contacts={np.mean(met):.1f}")


def sum_of_contacts(data):
    """Depth times normal of MuJoCo's contacts, summed: normals go from the first geom to the second, the tool."""
    force = np.zeros(3)
    for i in range(data.ncon):
        sign = 1 if data.contact.geom[i, 0] == 0 else -1
        force += sign * max(0.0, -data.contact.dist[i]) * data.contact.frame[i, :3]
    return force


def drake_hydroelastic(vertices, triangles, poses, shape):
    """Drake's hydroelastic contact of a compliant tool with the meshed frame as a rigid surface: a true force by pressure over
    the contact surface. Only of meshes, so it is made anew for each frame."""
    import tempfile

    from pydrake.geometry import AddCompliantHydroelasticProperties, AddRigidHydroelasticProperties, Box, GeometryFrame, Sphere
    from pydrake.geometry import GeometryInstance, Mesh, ProximityProperties, SceneGraph
    from pydrake.geometry import FramePoseVector, HydroelasticContactRepresentation
    from pydrake.common.value import Value
    from pydrake.math import RigidTransform
    from pydrake.common.eigen_geometry import Quaternion

    def build():
        with tempfile.NamedTemporaryFile("w", suffix=".obj", delete=False) as file:
            file.write("".join(f"v {x} {y} {z}\n" for x, y, z in vertices))
            file.write("".join(f"f {a + 1} {c + 1} {b + 1}\n" for a, b, c in triangles))
        graph = SceneGraph()
        source = graph.RegisterSource("peers")
        room, tool = ProximityProperties(), ProximityProperties()
        AddRigidHydroelasticProperties(properties=room)
        AddCompliantHydroelasticProperties(resolution_hint=0.02, hydroelastic_modulus=1e6, properties=tool)
        fixed = GeometryInstance(RigidTransform(), Mesh(file.name), "room")
        fixed.set_proximity_properties(room)
        graph.RegisterAnchoredGeometry(source, fixed)
        frame = graph.RegisterFrame(source, GeometryFrame("tool"))
        moving = GeometryInstance(RigidTransform(), Sphere(shape) if np.isscalar(shape) else Box(*shape), "tool")
        moving.set_proximity_properties(tool)
        return graph, source, frame, graph.RegisterGeometry(source, frame, moving), graph.CreateDefaultContext()

    (graph, source, frame_id, tool_id, context), frame = timed(build, 1)
    forces, times = [], []
    for pose in poses:
        x, y, z, w = pose[3:] / np.linalg.norm(pose[3:])
        where = FramePoseVector()
        where.set_value(frame_id, RigidTransform(Quaternion(w, x, y, z), pose[:3]))
        graph.get_source_pose_port(source).FixValue(context, Value(where))
        query = graph.get_query_output_port().Eval(context)
        surfaces, spent = timed(lambda: query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon), 1)
        times.extend(spent)
        force = np.zeros(3)
        for s in surfaces:  # normals point into M
            sign = 1.0 if s.id_M() == tool_id else -1.0
            pressure = s.poly_e_MN()
            for k in range(s.num_faces()):
                force += sign * s.area(k) * pressure.EvaluateCartesian(k, s.centroid(k)) * s.face_normal(k)
        forces.append(force)
    yield f"Drake {version('drake')} hydroelastic", None, np.array(forces), np.array(times), frame, f"triangles={len(triangles)}"


def coal_octree(points, poses, shape, voxel=0.01):
    """coal's octree of the points, yes or no; hollow behind the surface."""
    import coal

    cloud = np.ascontiguousarray(points[np.isfinite(points).all(axis=-1)])
    tree, frame = timed(lambda: coal.makeOctree(cloud, voxel), 3)
    box, still, times, met = coal.Box(*shape), coal.Transform3s(), [], 0
    for pose in poses:
        R = rotation(pose[3:])
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        begin = clock()
        met += coal.collide(box, coal.Transform3s(R, pose[:3]), tree, still, request, result) > 0
        times.append(clock() - begin)
    yield f"coal {coal.__version__} octree, yes or no", None, None, np.array(times), frame, f"voxel_mm={1000 * voxel:.0f} yes={met}"


def volumetric(points, poses, shape, voxel=0.002):
    """pytorch-volumetric: distances of the tool's mesh, cached in a grid, at all points; the least says yes or no. Hollow
    behind the surface. A new frame costs nothing, a pose all of its points."""
    import open3d
    import pytorch_volumetric as pv
    import torch

    torch.set_num_threads(1)
    box = open3d.geometry.TriangleMesh.create_box(*shape).translate(-np.array(shape) / 2)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "box.obj")
        open3d.io.write_triangle_mesh(path, box)
        mesh = pv.MeshSDF(pv.MeshObjectFactory(path))
        around = np.stack([-0.6 * np.array(shape), 0.6 * np.array(shape)], axis=1)
        grid = pv.CachedSDF("box", voxel, around, mesh, cache_path=os.path.join(folder, "grid.pkl"))
    cloud, frame = timed(lambda: torch.from_numpy(points[np.isfinite(points).all(axis=-1)].astype(np.float32)), 3)
    times, met = [], 0
    for pose in poses:
        R = torch.from_numpy(rotation(pose[3:]).astype(np.float32))
        begin = clock()
        distance, _ = grid((cloud - torch.from_numpy(pose[:3].astype(np.float32))) @ R)
        met += float(distance.min()) < 0
        times.append(clock() - begin)
    yield (f"pytorch-volumetric {version('pytorch_volumetric')}, yes or no", None, None, np.array(times), frame,
           f"voxel_mm={1000 * voxel:.0f} points={len(cloud)} yes={met}")


def vamp(points, poses, strides=(16, 8)):
    """VAMP's Fetch robot (fetch-planning) before the points, yes or no: random arms, one core. Clouds are thinned as its
    users thin them: what a cloud takes to be ready grows faster than its size. `behind`: is the robot free behind the wall?"""
    from fetch_planning._ompl_vamp import OmplVampPlanner

    low, high = (np.array(limits) for limits in OmplVampPlanner.default_joint_limits())
    arm = list(range(3, 11))
    configurations = np.random.default_rng(4).uniform(low[arm], high[arm], (4000, len(arm))).tolist()
    for stride in strides:
        seen = points[::stride, ::stride].reshape(-1, 3)
        seen = seen[np.isfinite(seen).all(axis=1)]
        cloud = np.stack([seen[:, 2], -seen[:, 0], 1 - seen[:, 1]], axis=1).tolist()  # the camera at 1 m, along x
        answers = {}
        for place in (0.0, 3.0):
            stance = np.zeros(11)
            stance[0] = place
            planner = OmplVampPlanner(arm, stance.tolist())
            alone = planner.validate_batch(configurations)
            _, frame = timed(lambda: planner.add_pointcloud(cloud, *planner.min_max_radii(), 0.002), 3)
            free, times = timed(lambda: planner.validate_batch(configurations))
            answers[place] = (np.array(alone) & ~np.array(free)).sum(), frame, times
        met, frame, per_batch = answers[0.0]
        yield (f"VAMP, fetch-planning {version('fetch-planning')}, yes or no", None, None, per_batch / len(configurations), frame,
               f"points={len(cloud)} hits={met} hits_behind={answers[3.0][0]} robot=Fetch")
