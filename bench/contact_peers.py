"""Ours beside what can be installed, on the same depth images, tool and poses, against exact solids: Warp, coal, MuJoCo and the
methods of the thesis here; look-ups in the image, distance grids, a height field, Drake, an octree and VAMP in frame_peers.py;
height fields of MuJoCo Warp and Newton in world_peers.py.

The image is one of the simulated camera, without and with 1.5 mm of noise; the tool a box of spheres, 5 to 60 % of it
in the solid, turned at random. All get the points of our filter. What each computes is said where it is asked below.
Writes a CSV; one core and its processor's time, or with --device cuda:0 a GPU and the time of the wall: a batch of 16,384
poses, and each alone. A peer that fails is said, and the others are measured.
Usage: contact_peers.py FILE.csv [--device cpu] [--poses 200] [--scenes ...] [--peers ...] [--noises 0,1.5]
Needs the packages of scripts/setup.sh --peers, in build/python-peers, and the wheel of make wheel there."""

import argparse
import os
import sys

import frame_peers
import numpy as np
import palpate
import world_peers
from contact_truth import SCENES, SIDES, random_poses, rotation
from frame_peers import Window, batches, launched
from peer_rows import clock, guarded, machine, stamp, timed, write

SPHERES = 1000
JUMP = 0.02    # m in depth: no triangle spans an edge
BOX_FACES = ((0, 3, 2), (0, 1, 3), (4, 7, 5), (4, 6, 7), (0, 5, 1), (0, 4, 5), (2, 7, 6), (2, 3, 7), (0, 6, 4), (0, 2, 6),
             (1, 7, 3), (1, 5, 7))


# Depth images ------------------------------------------------------------------------------------


def mesh_of(points, window=Window()):
    """Returns two triangles for each square of pixels within the window, facing the camera."""
    seen = window.has(points)
    number = np.full(seen.shape, -1)
    number[seen] = np.arange(seen.sum())
    corners = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    vertices = points[seen]
    corners = corners[(corners >= 0).all(axis=1)]
    corners = corners[np.ptp(vertices[corners, 2], axis=1) < JUMP]
    return vertices, np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])


# Peers: each a generator of (name, shares or None, forces, s per pose, s per frame, facts) --


def ours(tool, depth, camera, poses, device):
    place = "cpu" if device == "cpu" else "cuda"
    sensor, contact = palpate.Sensor(camera, place=place), palpate.Contact(tool, place=place)

    def wait():
        if device != "cpu":
            frame_peers.library(device).cuda.Device().synchronize()

    def ready():
        made = sensor.update(depth)
        wait()
        return made

    surface, frame = timed(ready, 20, device)
    results, times = [], []
    for pose in poses:
        result, spent = timed(lambda: contact.measure(surface, pose), 2, device)
        results.append(result)
        times.append(spent[-1])
    volume = tool.volume
    yield ("palpate measure", np.array([r.volume for r in results]) / volume,
           np.array([r.force for r in results]) / volume, times, frame, "batch=1")
    many = next(batches(poses, device))[0]
    there = frame_peers.library(device).asarray(many)
    for stiffness in (False, True):
        batch = contact.measure_batch(surface, there, stiffness=stiffness)

        def ask():
            contact.measure_batch(surface, there, stiffness=stiffness, out=batch)
            wait()

        _, passed = timed(ask, 20, device)
        volumes, forces = (frame_peers.on_host(values)[:len(poses)] / volume for values in (batch.volume, batch.force))
        yield (f"palpate measure_batch{', stiffness' if stiffness else ''}", volumes, forces, passed / len(many), frame,
               f"batch={len(many)}")


def methods_of_the_thesis(tool, depth, camera, poses):
    """The three methods of the thesis, as Palpate has them. Their torque and volume are not those of a potential."""
    surface, frame = timed(lambda: palpate.Sensor(camera).update(depth))
    for method in ("weighted", "simplified", "graph"):
        contact, results, times = palpate.Contact(tool, method), [], []
        for pose in poses:
            result, spent = timed(lambda: contact.measure(surface, pose), 1)
            results.append(result)
            times.extend(spent)
        yield (f"thesis, {method}", np.array([r.volume for r in results]) / tool.volume,
               np.array([r.force for r in results]) / tool.volume, times, frame, "")


def warp_kernel(wp):
    @wp.kernel
    def caps(mesh: wp.uint64, reach: float, spheres: wp.array(dtype=wp.vec4), poses: wp.array(dtype=wp.transform),
             volumes: wp.array(dtype=float), forces: wp.array(dtype=wp.vec3)):
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


_caps = None


def warp(tool, vertices, triangles, poses, device):
    """Warp has no contact of volumes: its nearest point on the mesh, with our sum of caps in a kernel of ten lines."""
    import warp as wp

    global _caps
    wp.config.quiet = True
    _caps = _caps or warp_kernel(wp)
    with wp.ScopedDevice(device):
        # Warp's normals follow the corners; ours face the camera.
        corners = triangles[:, ::-1].astype(np.int32).flatten()

        def build():
            made = wp.Mesh(wp.array(vertices.astype(np.float32), dtype=wp.vec3), wp.array(corners, dtype=wp.int32))
            wp.synchronize()
            return made

        mesh, frame = timed(build, device=device)
        for shares, forces, times, num in launched(_caps, [mesh.id, 0.2], tool, poses, device):
            yield (f"Warp {wp.__version__} nearest point", shares, forces, times, frame, f"batch={num} triangles={len(triangles)}")


def coal_contacts(vertices, triangles, poses, shape):
    """coal's contacts of a tool with a tree of the triangles. No volume; force: depth times the normal of the triangle,
    summed, as coal's own normal is the shortest way out of the tool, whatever the scene is."""
    import coal

    def build():
        model = coal.BVHModelOBBRSS()
        model.beginModel(len(triangles), len(vertices))
        model.addVertices(vertices)
        model.addTriangles(triangles.astype(np.int64))
        model.endModel()
        return model

    scene, frame = timed(build, 3)
    solid, still = coal.Sphere(shape) if np.isscalar(shape) else coal.Box(*shape), coal.Transform3s()
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    normals = np.cross(c - a, b - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    forces, times, num = [], [], []
    for pose in poses:
        placed = coal.Transform3s(rotation(pose[3:]), pose[:3])
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        request.num_max_contacts, request.enable_contact = 1000000, True
        start = clock()
        coal.collide(solid, placed, scene, still, request, result)
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
        times.extend(timed(lambda: mujoco.mj_collision(model, data), 1)[1])
        forces.append(frame_peers.sum_of_contacts(data))
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


def asked(tool, depth, camera, points, poses, device):
    """Returns the peers of a device by name, each to be called."""
    sheet = mesh_of(points)
    peers = {"palpate": lambda: ours(tool, depth, camera, poses, device),
             "image": lambda: frame_peers.image_peers(tool, depth, camera, points, poses, device),
             "warp": lambda: warp(tool, *sheet, poses, device),
             "mujoco-warp": lambda: world_peers.mujoco_warp_height_field(points, poses, SIDES, device),
             "newton": lambda: world_peers.newton_height_field(points, poses, SIDES, device)}
    if device == "cpu":
        peers |= {"thesis": lambda: methods_of_the_thesis(tool, depth, camera, poses),
                  "coal": lambda: coal_contacts(*sheet, poses, SIDES), "octree": lambda: frame_peers.coal_octree(points, poses, SIDES),
                  "vamp": lambda: frame_peers.vamp(points, poses), "volumetric": lambda: frame_peers.volumetric(points, poses, SIDES),
                  "field": lambda: frame_peers.mujoco_height_field(points, poses, SIDES),
                  "drake": lambda: frame_peers.drake_hydroelastic(*sheet, poses, SIDES),
                  "mujoco": lambda: mujoco_contacts(*sheet, poses)}
    return peers


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--scenes", default=",".join(SCENES))
    parser.add_argument("--noises", default="0,1.5", help="mm")
    parser.add_argument("--peers", help="some of palpate,image,warp,mujoco-warp,newton,thesis,coal,octree,vamp,volumetric,field,drake,mujoco")
    given = parser.parse_args()
    if given.device == "cpu":
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    vertices = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * SIDES
    tool = palpate.pack(vertices, np.array(BOX_FACES), SPHERES)
    rows, is_whole = [], True
    for name in given.scenes.split(","):
        poses, true_shares, true_forces = random_poses(SCENES[name], given.poses, np.random.default_rng(1))
        exact, camera, _ = palpate.render_scene(name)
        for noise in (0.001 * float(value) for value in given.noises.split(",")):
            random = np.random.default_rng(2)
            depth = (exact + noise * random.standard_normal(exact.shape)).astype(np.float32)
            points = np.asarray(palpate.Sensor(camera).update(depth).points, float)
            peers = asked(tool, depth, camera, points, np.concatenate([poses, sweep(poses[0])]), given.device)

            def measure(peer):
                for who, shares, forces, per_pose, per_frame, facts in peers[peer]():
                    rows.append({**stamp(), "machine": machine(given.device), "device": given.device, "peer": who, "scene": name,
                                 "noise_mm": 1e3 * noise, "poses": len(poses), "spheres": len(tool.spheres),
                                 "pose_us": f"{1e6 * np.median(per_pose):.5g}", "pose_p99_us": f"{1e6 * np.percentile(per_pose, 99):.5g}",
                                 "frame_ms": f"{1e3 * np.median(per_frame):.4g}", "frame_worst_ms": f"{1e3 * np.max(per_frame):.4g}",
                                 **errors(shares, forces, true_shares, true_forces), "facts": facts})
                    print(*(rows[-1][key] for key in list(rows[-1])[4:]), flush=True)

            for peer in given.peers.split(",") if given.peers else peers:
                is_whole &= guarded(f"{peer}, {name}", lambda: measure(peer))
                write(given.file, rows)
    return 0 if is_whole else 1


if __name__ == "__main__":
    sys.exit(main())
