"""Peers of contact_peers.py beside meshes: look-ups in the image, distance grids, height fields, an octree, yes or no.

Each peer is a generator of (name, shares or None, forces or None, s per pose, s per frame, facts), like those there."""

import time
from importlib.metadata import version

import numpy as np
from contact_truth import rotation

HALF = 0.25           # m: the window around the axis, as the meshes have it
DEEP = (0.7, 1.4)     # m: what grids and height fields hold in depth
SURE = 0.02           # m: how far the look-up takes neighbors for the same surface


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


def launched(kernel, inputs, tool, poses, device, batch):
    """Shares, forces and s per pose of a kernel: the median of five batches, after one."""
    import warp as wp

    spheres = np.asarray(tool.spheres)
    whole = 4 / 3 * np.pi * (spheres[:, 3].astype(float) ** 3).sum()
    many = poses if device == "cpu" else np.resize(poses, (batch, 7))
    asked = [wp.array(spheres, dtype=wp.vec4), wp.array(many.astype(np.float32), dtype=wp.transform)]
    volumes, forces, times = wp.zeros(len(many), dtype=float), wp.zeros(len(many), dtype=wp.vec3), []
    for _ in range(6):
        volumes.zero_()
        forces.zero_()
        begin = time.process_time()
        wp.launch(kernel, dim=(len(many), len(spheres)), inputs=[*inputs, *asked], outputs=[volumes, forces])
        wp.synchronize()
        times.append(time.process_time() - begin)
    return (volumes.numpy()[:len(poses)] / whole, forces.numpy()[:len(poses)] / whole, np.array(times[1:]) / len(many))


def image_peers(tool, depth, camera, points, poses, device, batch):
    """The cheapest of all: the depth behind each center in the image. Then distance grids, made of the filtered points."""
    import warp as wp

    global _kernels
    wp.config.quiet = True
    wp.set_module_options({"enable_backward": False})
    _kernels = _kernels or warp_kernels(wp)
    projective, trilinear = _kernels
    filtered = np.nan_to_num(points[..., 2]).astype(np.float32)
    with wp.ScopedDevice(device):
        lens = wp.vec4(camera.fx, camera.fy, camera.cx, camera.cy)
        for name, slanted in (("projective look-up", 0), ("projective look-up, cosine", 1)):
            begin = time.process_time()
            image = wp.array(filtered, dtype=float)
            wp.synchronize()
            frame = time.process_time() - begin
            yield (name, *launched(projective, [image, lens, slanted], tool, poses, device, batch), frame, f"batch={len(poses)}")
        for voxel in (0.005, 0.01, 0.02):
            begin = time.process_time()
            distances = signed_distances(filtered, camera, voxel)
            grid = wp.array(distances, dtype=float)
            wp.synchronize()
            frame = time.process_time() - begin
            low = wp.vec3(-HALF, -HALF, DEEP[0])
            yield (f"distance grid {1000 * voxel:.0f} mm", *launched(trilinear, [grid, low, voxel], tool, poses, device, batch),
                   frame, f"voxels={distances.size}")


def signed_distances(depth, camera, voxel):
    """As maps make them: voxels behind the surface are solid; exact Euclidean distances to the others, from SciPy."""
    from scipy.ndimage import distance_transform_edt

    side = np.arange(-HALF, HALF + voxel / 2, voxel)
    x, y, z = np.meshgrid(side, side, np.arange(*DEEP, voxel), indexing="ij")
    u = np.clip((camera.fx * x / z + camera.cx + 0.5).astype(int), 0, camera.width - 1)
    v = np.clip((camera.fy * y / z + camera.cy + 0.5).astype(int), 0, camera.height - 1)
    seen = depth[v, u]
    solid = (seen > 0) & (z > seen)
    outside, inside = distance_transform_edt(~solid), distance_transform_edt(solid)
    return (voxel * np.where(solid, 0.5 - inside, outside - 0.5)).astype(np.float32)


def heights(points, cell):
    """Mean height towards the camera of the points in each cell, over DEEP[1]."""
    p = points[np.isfinite(points).all(axis=-1)]
    p = p[(abs(p[:, :2]) < HALF).all(axis=1) & (p[:, 2] < DEEP[1])]
    num = int(round(2 * HALF / cell))
    # Seen from the back of the image: x to the right, y up.
    at = np.floor((HALF - p[:, 1]) / cell).astype(int) * num + np.floor((p[:, 0] + HALF) / cell).astype(int)
    count, total = np.bincount(at, minlength=num**2), np.bincount(at, DEEP[1] - p[:, 2], num**2)
    return np.where(count > 0, total / np.maximum(count, 1), 0.0).reshape(num, num)


def timed_alone(call, num=5):
    times = []
    for _ in range(num):
        begin = time.process_time()
        made = call()
        times.append(time.process_time() - begin)
    return made, np.array(times)


def mujoco_height_field(points, poses, sides, cell=0.03):
    """MuJoCo's contacts of a box with a height field, rewritten for each frame as its users do (model.hfield_data): depth
    times normal, summed. At most 50 contacts a pair: smaller cells are taken on one side only."""
    import mujoco

    num = int(round(2 * HALF / cell))
    box = " ".join(map(str, sides / 2))
    # The field's z is the image's -z: turned by 180 degrees about x.
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><asset><hfield name="room" nrow="{num}" ncol="{num}"
      size="{HALF} {HALF} 1 0.1"/></asset><worldbody><geom type="hfield" hfield="room" pos="0 0 {DEEP[1]}" quat="0 1 0 0"/>
      <body><freejoint/><geom type="box" size="{box}" mass="1"/></body></worldbody></mujoco>""")

    def rewrite():
        model.hfield_data[:] = heights(points, cell).flatten()

    _, frame = timed_alone(rewrite)
    data = mujoco.MjData(model)
    forces, times, met = [], [], []
    for pose in poses:
        data.qpos[:3], data.qpos[3:] = pose[:3], pose[[6, 3, 4, 5]]
        mujoco.mj_kinematics(model, data)
        begin = time.process_time()
        mujoco.mj_collision(model, data)
        times.append(time.process_time() - begin)
        force = np.zeros(3)
        for i in range(data.ncon):
            sign = 1 if data.contact.geom[i, 0] == 0 else -1
            force += sign * max(0.0, -data.contact.dist[i]) * data.contact.frame[i, :3]
        forces.append(force)
        met.append(data.ncon)
    yield (f"MuJoCo {mujoco.__version__} height field", None, np.array(forces), np.array(times), frame,
           f"cell_mm={1000 * cell:.0f} contacts={np.mean(met):.1f}")


def drake_hydroelastic(vertices, triangles, poses, sides):
    """Drake's hydroelastic contact of a compliant box with the meshed frame as a rigid surface: a true force by pressure over
    the contact surface. Only of meshes, so it is made anew for each frame."""
    import tempfile

    from pydrake.geometry import AddCompliantHydroelasticProperties, AddRigidHydroelasticProperties, Box, GeometryFrame
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
        moving = GeometryInstance(RigidTransform(), Box(*sides), "tool")
        moving.set_proximity_properties(tool)
        return graph, source, frame, graph.RegisterGeometry(source, frame, moving), graph.CreateDefaultContext()

    (graph, source, frame_id, tool_id, context), frame = timed_alone(build, 1)
    forces, times = [], []
    for pose in poses:
        x, y, z, w = pose[3:] / np.linalg.norm(pose[3:])
        where = FramePoseVector()
        where.set_value(frame_id, RigidTransform(Quaternion(w, x, y, z), pose[:3]))
        graph.get_source_pose_port(source).FixValue(context, Value(where))
        query = graph.get_query_output_port().Eval(context)
        begin = time.process_time()
        surfaces = query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon)
        times.append(time.process_time() - begin)
        force = np.zeros(3)
        for s in surfaces:  # normals point into M
            sign = 1.0 if s.id_M() == tool_id else -1.0
            pressure = s.poly_e_MN()
            for k in range(s.num_faces()):
                force += sign * s.area(k) * pressure.EvaluateCartesian(k, s.centroid(k)) * s.face_normal(k)
        forces.append(force)
    yield f"Drake {version('drake')} hydroelastic", None, np.array(forces), np.array(times), frame, f"triangles={len(triangles)}"


def coal_octree(points, poses, sides, voxel=0.01):
    """coal's octree of the points, yes or no; hollow behind the surface."""
    import coal

    cloud = np.ascontiguousarray(points[np.isfinite(points).all(axis=-1)])
    tree, frame = timed_alone(lambda: coal.makeOctree(cloud, voxel), 3)
    box, still, times, met = coal.Box(*sides), coal.Transform3s(), [], 0
    for pose in poses:
        R = rotation(pose[3:])
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        begin = time.process_time()
        met += coal.collide(box, coal.Transform3s(R, pose[:3]), tree, still, request, result) > 0
        times.append(time.process_time() - begin)
    yield f"coal {coal.__version__} octree, yes or no", None, None, np.array(times), frame, f"voxel_mm={1000 * voxel:.0f} yes={met}"


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
            _, frame = timed_alone(lambda: planner.add_pointcloud(cloud, *planner.min_max_radii(), 0.002), 3)
            free, times = timed_alone(lambda: planner.validate_batch(configurations))
            answers[place] = (np.array(alone) & ~np.array(free)).sum(), frame, times
        met, frame, per_batch = answers[0.0]
        yield (f"VAMP, fetch-planning {version('fetch-planning')}, yes or no", None, None, per_batch / len(configurations), frame,
               f"points={len(cloud)} hits={met} hits_behind={answers[3.0][0]} robot=Fetch")
