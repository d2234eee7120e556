"""Ours beside what can be installed, on the same depth images, tool and poses, against exact solids: Warp, coal, MuJoCo and the
methods of the thesis here; look-ups in the image, distance grids, height fields, Drake, an octree and VAMP in frame_peers.py.

The image is one of the simulated camera, without and with 1.5 mm of noise; the tool a box of spheres, 5 to 60 % of it
in the solid, turned at random. All get the points of our filter. What each computes is said where it is asked below.
Writes a CSV; one core and its processor's time, or a GPU with --device cuda:0 (Warp, look-ups, grids and ours).
Usage: contact_peers.py FILE.csv [--device cpu] [--poses 200] [--scenes ...] [--peers ...]
Needs the packages of scripts/setup.sh --peers, in build/python-peers, and the wheel of make wheel there."""

import argparse
import csv
import datetime
import os
import subprocess
import sys
import time

import frame_peers
import numpy as np
import palpate
from contact_truth import SCENES, SIDES, random_poses, rotation

SPHERES = 1000
WINDOW = 0.25  # m from the axis: what others make a mesh of. Ours takes the whole image.
JUMP = 0.02    # m in depth: no triangle spans an edge
NOISES = (0.0, 0.0015)  # m
BATCH = 16384  # poses of a batch on a GPU
BOX_FACES = ((0, 3, 2), (0, 1, 3), (4, 7, 5), (4, 6, 7), (0, 5, 1), (0, 4, 5), (2, 7, 6), (2, 3, 7), (0, 6, 4), (0, 2, 6),
             (1, 7, 3), (1, 5, 7))


# Depth images ------------------------------------------------------------------------------------


def mesh_of(points):
    """Returns two triangles for each square of pixels within the window, facing the camera."""
    seen = np.isfinite(points).all(axis=-1) & (np.abs(points[..., :2]) < WINDOW).all(axis=-1) & (points[..., 2] < 2)
    number = np.full(seen.shape, -1)
    number[seen] = np.arange(seen.sum())
    corners = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    vertices = points[seen]
    corners = corners[(corners >= 0).all(axis=1)]
    corners = corners[np.ptp(vertices[corners, 2], axis=1) < JUMP]
    return vertices, np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])


def clock(device="cpu"):
    """Seconds: of the processor, as the machine may be busy; with a GPU, of the wall."""
    return time.process_time() if device == "cpu" else time.perf_counter()


def timed(call, repetitions=5, device="cpu"):
    """Returns the last result, and the times in s."""
    times = []
    for _ in range(repetitions):
        start = clock(device)
        result = call()
        times.append(clock(device) - start)
    return result, np.array(times)


# Peers: each a generator of (name, shares or None, forces, s per pose, s per frame, facts) --


def ours(tool, depth, camera, poses, device):
    place = "cpu" if device == "cpu" else "cuda"
    sensor, contact = palpate.Sensor(camera, place=place), palpate.Contact(tool, place=place)
    surface, frame = timed(lambda: sensor.update(depth), device=device)
    results, times = [], []
    for pose in poses:
        start = clock()
        results.append(contact.measure(surface, pose))
        times.append(clock() - start)
    volume = tool.volume
    yield ("palpate measure", np.array([r.volume for r in results]) / volume,
           np.array([r.force for r in results]) / volume, times, frame, "")
    many = poses if device == "cpu" else np.resize(poses, (BATCH, 7))
    batch = contact.measure_batch(surface, many)
    if device == "cpu":
        _, passed = timed(lambda: contact.measure_batch(surface, many))
        volumes, forces = batch.volume, batch.force
    else:
        import cupy
        on_gpu = cupy.asarray(many)

        def ask():
            contact.measure_batch(surface, on_gpu, out=batch)
            cupy.cuda.Device().synchronize()

        _, passed = timed(ask, 20, device)
        volumes, forces = cupy.from_dlpack(batch.volume).get(), cupy.from_dlpack(batch.force).get()
    yield ("palpate measure_batch", volumes[:len(poses)] / volume, forces[:len(poses)] / volume, passed / len(many), frame,
           f"batch={len(many)}")


def methods_of_the_thesis(tool, depth, camera, poses):
    """The three methods of the thesis, as Palpate has them. Their torque and volume are not those of a potential."""
    surface, frame = timed(lambda: palpate.Sensor(camera).update(depth))
    for method in ("weighted", "simplified", "graph"):
        contact, results, times = palpate.Contact(tool, method), [], []
        for pose in poses:
            start = clock()
            results.append(contact.measure(surface, pose))
            times.append(clock() - start)
        yield (f"thesis, {method}", np.array([r.volume for r in results]) / tool.volume,
               np.array([r.force for r in results]) / tool.volume, times, frame, "")


def warp_kernel(wp):
    @wp.kernel
    def caps(mesh: wp.uint64, spheres: wp.array(dtype=wp.vec4), poses: wp.array(dtype=wp.transform),
             reach: float, volumes: wp.array(dtype=float), forces: wp.array(dtype=wp.vec3)):
        """The volume of each sphere behind the plane at its nearest point, summed, and times the normal."""
        pose, i = wp.tid()
        s = spheres[i]
        r = s[3]
        c = wp.transform_point(poses[pose], wp.vec3(s[0], s[1], s[2]))
        found = wp.mesh_query_point_sign_normal(mesh, c, reach)
        if found.result:
            nearest = wp.mesh_eval_position(mesh, found.face, found.u, found.v)
            way = c - nearest
            far = wp.length(way)
            normal = wp.normalize(way) * found.sign
            if far < 1.0e-6:
                normal = wp.mesh_eval_face_normal(mesh, found.face)
            depth = r - found.sign * far
            if depth > 0.0:
                h = wp.min(depth, 2.0 * r)
                volume = 3.14159265 * h * h * (r - h / 3.0)
                wp.atomic_add(volumes, pose, volume)
                wp.atomic_add(forces, pose, volume * normal)

    return caps


def warp(tool, vertices, triangles, poses, device):
    """Warp has no contact of volumes: its nearest point on the mesh, with our sum of caps in a kernel of ten lines."""
    import warp as wp

    wp.config.quiet = True
    caps = warp_kernel(wp)
    with wp.ScopedDevice(device):
        points = wp.array(vertices.astype(np.float32), dtype=wp.vec3)
        # Warp's normals follow the corners; ours face the camera.
        corners = wp.array(triangles[:, ::-1].astype(np.int32).flatten(), dtype=wp.int32)

        def build():
            made = wp.Mesh(points, corners)
            wp.synchronize()
            return made

        mesh, frame = timed(build, device=device)
        spheres = np.asarray(tool.spheres)
        all_spheres = 4 / 3 * np.pi * (spheres[:, 3].astype(float) ** 3).sum()
        many = poses if device == "cpu" else np.resize(poses, (BATCH, 7))
        asked = [wp.array(spheres, dtype=wp.vec4), wp.array(many.astype(np.float32), dtype=wp.transform)]
        volumes, forces = wp.zeros(len(many), dtype=float), wp.zeros(len(many), dtype=wp.vec3)

        def ask():
            volumes.zero_()
            forces.zero_()
            wp.launch(caps, dim=(len(many), len(spheres)), inputs=[mesh.id, *asked, 0.2], outputs=[volumes, forces])
            wp.synchronize()

        ask()
        _, passed = timed(ask, device=device)
        shares = volumes.numpy()[:len(poses)] / all_spheres
        yield (f"Warp {wp.__version__} nearest point", shares, forces.numpy()[:len(poses)] / all_spheres,
               passed / len(many), frame, f"batch={len(many)} triangles={len(triangles)}")


def coal_contacts(vertices, triangles, poses):
    """coal's contacts of a box with a tree of the triangles. No volume; force: depth times the normal of the triangle,
    summed, as coal's own normal is the shortest way out of the box, whatever the scene is."""
    import coal

    def build():
        model = coal.BVHModelOBBRSS()
        model.beginModel(len(triangles), len(vertices))
        model.addVertices(vertices)
        model.addTriangles(triangles.astype(np.int64))
        model.endModel()
        return model

    scene, frame = timed(build, 3)
    box, still = coal.Box(*SIDES), coal.Transform3s()
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    normals = np.cross(c - a, b - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    forces, times, num = [], [], []
    for pose in poses:
        placed = coal.Transform3s(rotation(pose[3:]), pose[:3])
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        request.num_max_contacts, request.enable_contact = 1000000, True
        start = clock()
        coal.collide(box, placed, scene, still, request, result)
        contacts = result.getContacts()
        times.append(clock() - start)
        force = np.zeros(3)
        for contact in contacts:
            force += abs(contact.penetration_depth) * normals[contact.b2]
        forces.append(force)
        num.append(len(contacts))
    yield (f"coal {coal.__version__} contacts", None, np.array(forces), times, frame,
           f"triangles={len(triangles)} contacts={np.mean(num):.0f}")


def closed(vertices, triangles, back=0.3):
    """A solid that reaches so far behind the sheet of triangles, as signed distances need."""
    # Unused vertices would become vertices of the solid.
    used, numbers = np.unique(triangles, return_inverse=True)
    triangles, vertices = numbers.reshape(-1, 3), vertices[used]
    num = len(vertices)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    code, flipped = edges[:, 0] * num + edges[:, 1], edges[:, 1] * num + edges[:, 0]
    a, b = edges[~np.isin(code, flipped)].T
    sides = np.concatenate([np.stack([b, a, a + num], axis=1), np.stack([b, a + num, b + num], axis=1)])
    behind = vertices + [0, 0, back]
    return np.concatenate([vertices, behind]), np.concatenate([triangles, triangles[:, ::-1] + num, sides])


def mujoco_contacts(vertices, triangles, poses):
    """MuJoCo's contacts of a box with an octree of signed distances of the closed mesh: points where gradient descent
    finds the deepest; force: depth times normal, summed. No volume."""
    import mujoco

    vertices, triangles = closed(vertices, triangles)

    def build():
        spec = mujoco.MjSpec()
        mesh = spec.add_mesh(name="scene", uservert=vertices.flatten(), userface=triangles[:, ::-1].flatten())
        mesh.needsdf = True
        spec.worldbody.add_body().add_geom(type=mujoco.mjtGeom.mjGEOM_SDF, meshname="scene")
        tool = spec.worldbody.add_body()
        tool.add_freejoint()
        tool.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=SIDES / 2)
        return spec.compile()

    model, frame = timed(build, 1)
    data = mujoco.MjData(model)
    forces, times, num = [], [], []
    for pose in poses:
        data.qpos[:3], data.qpos[3:] = pose[:3], pose[[6, 3, 4, 5]]
        mujoco.mj_kinematics(model, data)
        start = clock()
        mujoco.mj_collision(model, data)
        times.append(clock() - start)
        force = np.zeros(3)
        for i in range(data.ncon):  # normals go from the first geom to the second, the tool
            sign = 1 if data.contact.geom[i, 0] == 0 else -1
            force += sign * max(0.0, -data.contact.dist[i]) * data.contact.frame[i, :3]
        forces.append(force)
        num.append(data.ncon)
    yield (f"MuJoCo {mujoco.__version__} SDF", None, np.array(forces), times, frame,
           f"triangles={len(triangles)} contacts={np.mean(num):.1f} seeds={model.opt.sdf_initpoints}")


# Rows --------------------------------------------------------------------------------------------


NOTHING = dict.fromkeys(("volume_rms_percent", "force_rms_percent", "direction_rms_deg", "no_force", "jump_percent"), "")


def sweep(pose, num=30, step=0.001):
    """The pose, drawn along x in small steps: forces should change little from one to the next."""
    poses = np.tile(pose, (num, 1))
    poses[:, 0] += step * (np.arange(num) - num / 2)
    return poses


def errors(shares, forces, true_shares, true_forces):
    """rms: of the volume and the force in % of the tool, of the force's direction in degrees; poses without force; the
    largest step of the force in the sweep, in % of its mean."""
    if forces is None:
        return NOTHING
    num = len(true_shares)
    swept, forces, shares = forces[num:], forces[:num], None if shares is None else shares[:num]
    steps = np.linalg.norm(np.diff(swept, axis=0), axis=1)
    size = np.linalg.norm(swept, axis=1).mean()
    length = np.linalg.norm(forces, axis=1)
    felt = length > 0
    true_length = np.linalg.norm(true_forces, axis=1)
    cosine = (forces * true_forces).sum(axis=1)[felt] / (length * true_length)[felt]
    rms = lambda values: float(np.sqrt(np.mean(np.square(values))))
    angle = rms(np.degrees(np.arccos(np.clip(cosine, -1, 1)))) if felt.any() else float("nan")
    return {"volume_rms_percent": "" if shares is None else f"{100 * rms(shares - true_shares):.3f}",
            "force_rms_percent": "" if shares is None else
            f"{100 * rms(np.linalg.norm(forces - true_forces, axis=1)):.3f}",
            "direction_rms_deg": f"{angle:.2f}", "no_force": int((~felt).sum()),
            "jump_percent": f"{100 * steps.max() / size:.2f}" if size > 0 else ""}


def machine():
    with open("/proc/cpuinfo") as file:
        return next((line.split(":", 1)[1].strip() for line in file if line.startswith("model name")), "unknown")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--scenes")
    parser.add_argument("--peers", help="some of palpate,image,warp,thesis,coal,octree,vamp,field,drake,mujoco")
    given = parser.parse_args()
    if given.device == "cpu":
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
    vertices = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * SIDES
    tool = palpate.pack(vertices, np.array(BOX_FACES), SPHERES)
    rows = []
    for name in given.scenes.split(",") if given.scenes else SCENES:
        solid = SCENES[name]
        poses, true_shares, true_forces = random_poses(solid, given.poses, np.random.default_rng(1))
        exact, camera, _ = palpate.render_scene(name)
        for noise in NOISES:
            random = np.random.default_rng(2)
            depth = (exact + noise * random.standard_normal(exact.shape)).astype(np.float32)
            points = np.asarray(palpate.Sensor(camera).update(depth).points, float)
            sheet = mesh_of(points)
            every = np.concatenate([poses, sweep(poses[0])])
            asked = {"palpate": lambda: ours(tool, depth, camera, every, given.device),
                     "image": lambda: frame_peers.image_peers(tool, depth, camera, points, every, given.device, BATCH),
                     "warp": lambda: warp(tool, *sheet, every, given.device)}
            if given.device == "cpu":
                asked |= {"thesis": lambda: methods_of_the_thesis(tool, depth, camera, every),
                          "coal": lambda: coal_contacts(*sheet, every), "octree": lambda: frame_peers.coal_octree(points, every, SIDES),
                          "vamp": lambda: frame_peers.vamp(points, every),
                          "field": lambda: frame_peers.mujoco_height_field(points, every, SIDES),
                          "drake": lambda: frame_peers.drake_hydroelastic(*sheet, every, SIDES),
                          "mujoco": lambda: mujoco_contacts(*sheet, every)}
            for peer in given.peers.split(",") if given.peers else asked:
                for who, shares, forces, per_pose, per_frame, facts in asked[peer]():
                    rows.append({"date": datetime.date.today().isoformat(), "commit": commit, "machine": machine(),
                                 "device": given.device, "peer": who, "scene": name, "noise_mm": 1e3 * noise,
                                 "poses": len(poses), "spheres": len(tool.spheres), "pose_us": f"{1e6 * np.median(per_pose):.2f}", "pose_p99_us": f"{1e6 * np.percentile(per_pose, 99):.2f}",
                                 "frame_ms": f"{1e3 * np.median(per_frame):.2f}", "frame_worst_ms": f"{1e3 * np.max(per_frame):.2f}",
                                 **errors(shares, forces, true_shares, true_forces), "facts": facts})
                    print(*(rows[-1][key] for key in list(rows[-1])[4:]), flush=True)
    with open(given.file, "w", newline="") as file:
        table = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


if __name__ == "__main__":
    sys.exit(main())
