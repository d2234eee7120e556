"""Files that well-known libraries write, in every variant that they know: the program reads in them what they do.
Meshes against trimesh, recordings against rosbags and mcap, silhouettes of robots against yourdfpy, clouds against
Open3D. By `make peers-of-files`, not among the other tests: the libraries are large.

Usage: file_peers.py PATH_OF_PALPATE"""

import json
import os
import pathlib
import sys
import unittest

try:
    import mcap.reader
    import mcap.writer
    import numpy
    import rosbags.highlevel
    import rosbags.rosbag1
    import rosbags.rosbag2
    import rosbags.typesys
    import trimesh
    import yourdfpy
except ImportError as error:
    print(f"SKIPPED: {error}; scripts/setup.sh --files installs it")
    sys.exit()
from camera_case import HEIGHT, WIDTH, CameraCase, palpate, wall
from made_files import write_depth_png

DATA = pathlib.Path(os.environ.get("PALPATE_DATA") or pathlib.Path(__file__).resolve().parents[3] / "shared/data")
TOPIC, INFO = "/camera/depth/image_rect_raw", "/camera/depth/camera_info"
NUM = 5
LENS = (200, 200, 79.5, 59.5)


class Meshes(CameraCase):
    def volume(self, path, scale=1.0):
        """m3, by the program; none: it refuses the mesh."""
        done = palpate("pack", path, "--spheres", 50, "--scale", scale, "-o", self.folder / "peer.palp", "--json")
        self.assertIn(done.returncode, (0, 1), done.stderr)
        return json.loads(done.stdout)["mesh_volume"] if done.returncode == 0 else None

    def test_shapes_of_trimesh(self):
        make = trimesh.creation
        turned = make.box((0.1, 0.05, 0.02))
        turned.apply_transform(trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.2, 0, 0.1)))
        shapes = {"box": turned, "ball": make.icosphere(3, 0.05), "rod": make.cylinder(0.02, 0.1),
                  "capsule": make.capsule(0.1, 0.03), "ring": make.torus(0.05, 0.015), "tube": make.annulus(0.02, 0.04, 0.1),
                  "cone": make.cone(0.04, 0.1), "two": trimesh.util.concatenate([make.box((0.1,) * 3),
                                                                                make.icosphere(2, 0.04).apply_translation((0.2, 0, 0))])}
        formats = {"stl": {}, "stl_ascii": {}, "ply": {}, "ply_ascii": {"encoding": "ascii"}, "obj": {}, "off": {}, "glb": {}}
        for name, mesh in shapes.items():
            for kind, options in formats.items():
                path = self.folder / f"{name}_{kind}.{kind.split('_')[0]}"
                written = mesh.export(file_type=kind if kind == "stl_ascii" else path.suffix[1:], **options)
                path.write_bytes(written.encode() if isinstance(written, str) else written)
                expected = trimesh.load(path, force="mesh").volume
                self.assertAlmostEqual(self.volume(path) / expected, 1, delta=1e-5, msg=path.name)

    def test_scenes_of_trimesh(self):
        """Parts that are placed, turned, mirrored and used twice."""
        scene = trimesh.Scene()
        move = trimesh.transformations.translation_matrix
        turn = trimesh.transformations.rotation_matrix(1, (1, 0, 2))
        box = trimesh.creation.box((0.1, 0.05, 0.02))
        scene.add_geometry(box, "box", geom_name="box", transform=turn)
        scene.add_geometry(trimesh.creation.icosphere(2, 0.04), "ball", transform=move((0.3, 0, 0)) @ turn)
        scene.graph.update("again", matrix=move((0, 0.3, 0)) @ numpy.diag((-1, 1, 2, 1)), geometry="box")
        for kind in ("glb", "gltf"):
            folder = self.folder / kind
            folder.mkdir()
            written = scene.export(file_type=kind)
            for name, content in (written if kind == "gltf" else {"model.glb": written}).items():
                (folder / name).write_bytes(content)
            path = folder / f"model.{kind}"
            expected = trimesh.load(path).to_mesh().volume
            self.assertAlmostEqual(self.volume(path) / expected, 1, delta=1e-5, msg=kind)

    def test_handed_meshes(self):
        paths = sorted(each for folder in ("meshes_good", "meshes_bad", "field/31-odd-stl") for each in (DATA / folder).glob("*")
                       if each.suffix in (".stl", ".ply", ".obj", ".off", ".glb", ".gltf"))
        if not paths:
            self.skipTest("SKIPPED: no real data for meshes_good (set PALPATE_DATA)")
        num_read = 0
        for path in paths:
            try:
                mesh = trimesh.load(path, force="mesh")
                scale = 0.1 / max(mesh.extents)
            except Exception:  # what trimesh cannot read, either
                continue
            volume = self.volume(path, scale)
            if volume is None:
                continue
            num_read += 1
            self.assertAlmostEqual(volume / (abs(mesh.volume) * scale**3), 1, delta=1e-3, msg=path.name)
        print(f"{num_read} of {len(paths)} handed meshes were accepted, and have the volume of trimesh")
        self.assertGreater(num_read, len(paths) // 3)


class Recordings(CameraCase):
    def messages(self, store):
        """Topic, type, stamp and message of each."""
        make = {key.rsplit("/", 1)[1]: value for key, value in store.types.items()}
        is_ros1 = store is self.ros1
        for k in range(NUM):
            stamp = 1_700_000_000_000_000_000 + k * 33_333_333
            time = store.types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
            header = make["Header"](*((k,) if is_ros1 else ()), time, "cam")
            f, c = numpy.float64, numpy.array
            yield INFO, "sensor_msgs/msg/CameraInfo", stamp, make["CameraInfo"](
                header, HEIGHT, WIDTH, "plumb_bob", c((0,) * 5, f), c((LENS[0], 0, LENS[2], 0, LENS[1], LENS[3], 0, 0, 1), f),
                c(numpy.eye(3).ravel(), f), c((LENS[0], 0, LENS[2], 0, 0, LENS[1], LENS[3], 0, 0, 0, 1, 0), f), 0, 0,
                make["RegionOfInterest"](0, 0, 0, 0, False))
            yield TOPIC, "sensor_msgs/msg/Image", stamp, make["Image"](
                header, HEIGHT, WIDTH, "16UC1", 0, 2 * WIDTH, numpy.frombuffer(wall(k), "u1"))

    ros1 = rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS1_NOETIC)
    ros2 = rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE)

    def expect_read(self, path, what):
        copy = self.folder / "copy.mcap"
        self.check(palpate("record", "--camera", f"bag:{path}", "-o", copy))
        frames = []
        with rosbags.highlevel.AnyReader([copy]) as reader:
            for connection, _, data in reader.messages():
                if connection.topic == TOPIC:
                    frames.append(reader.deserialize(data, connection.msgtype).data.tobytes())
        self.assertEqual(frames, [wall(k) for k in range(NUM)], what)

    def write_with(self, writer, store, serialize):
        with writer:
            connections = {}
            for topic, kind, stamp, message in self.messages(store):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(connections[topic], stamp, serialize(message, kind))

    def test_rosbags_of_ros_2(self):
        modes, formats = rosbags.rosbag2.CompressionMode, rosbags.rosbag2.CompressionFormat
        for version in (8, 9):
            for plugin in rosbags.rosbag2.StoragePlugin:
                for mode in modes:
                    what = f"{version} {plugin.name} {mode.name}"
                    path = self.folder / what
                    writer = rosbags.rosbag2.Writer(path, version=version, storage_plugin=plugin)
                    if mode != modes.NONE:
                        writer.set_compression(mode, formats.ZSTD)
                    try:
                        self.write_with(writer, self.ros2, self.ros2.serialize_cdr)
                    except rosbags.rosbag2.WriterError as error:  # it knows no such variant
                        print(f"left out: {what}: {error}")
                        continue
                    if mode == modes.FILE:
                        self.refused("compressed as a whole", "record", "--camera", f"bag:{path}", "-o",
                                     self.folder / "never.mcap")
                    else:
                        self.expect_read(path, what)

    def test_rosbags_of_ros_1(self):
        for kind in (None, *rosbags.rosbag1.Writer.CompressionFormat):
            path = self.folder / f"{kind}.bag"
            writer = rosbags.rosbag1.Writer(path)
            if kind:
                writer.set_compression(kind)
            self.write_with(writer, self.ros1, self.ros1.serialize_ros1)
            self.expect_read(path, path.name)

    def test_mcap(self):
        kinds, indices = mcap.writer.CompressionType, mcap.writer.IndexType
        for profile, store, encoding in (("ros2", self.ros2, "cdr"), ("ros1", self.ros1, "ros1")):
            for number, options in enumerate([{"compression": kind, "chunk_size": size} for kind in kinds
                                              for size in (1, 100_000, 1 << 24)] +
                                             [{"use_chunking": False}, {"index_types": indices.NONE},
                                              {"enable_crcs": False}, {"enable_data_crcs": True},
                                              {"use_statistics": False, "use_summary_offsets": False,
                                               "repeat_channels": False, "repeat_schemas": False}]):
                path = self.folder / f"{profile}_{number}.mcap"
                with open(path, "wb") as file:
                    writer = mcap.writer.Writer(file, **options)
                    writer.start(profile)
                    channels = {}
                    for topic, kind, stamp, message in self.messages(store):
                        name = kind if profile == "ros2" else kind.replace("/msg/", "/")
                        if topic not in channels:
                            schema = writer.register_schema(name, profile + "msg", b"")
                            channels[topic] = writer.register_channel(topic, encoding, schema)
                        data = (store.serialize_cdr if profile == "ros2" else store.serialize_ros1)(message, kind)
                        writer.add_message(channels[topic], stamp, bytes(data), stamp)
                    writer.finish()
                self.expect_read(path, f"{profile} {options}")

    def test_what_the_program_records(self):
        """The mcap and the rosbags reader return the same messages."""
        path = self.folder / "ours.mcap"
        self.check(palpate("record", "--camera", "scene:wall?noise=off", "--duration", 0.3, "-o", path))
        with open(path, "rb") as file:
            messages = [(channel.topic, bytes(message.data))
                        for _, channel, message in mcap.reader.make_reader(file, validate_crcs=True).iter_messages()]
        with rosbags.highlevel.AnyReader([path]) as reader:
            others = [(connection.topic, bytes(data)) for connection, _, data in reader.messages()]
        self.assertEqual(sorted(messages), sorted(others))
        self.assertGreater(len(messages), 10)


class Robots(CameraCase):
    URDF = """<robot name="arm">
      <link name="base"><collision><geometry><mesh filename="base.stl"/></geometry></collision></link>
      <link name="upper"><collision><origin xyz="0 0 0.1" rpy="0.1 0.2 0.3"/>
        <geometry><mesh filename="upper.obj" scale="0.001 -0.001 0.001"/></geometry></collision></link>
      <link name="hand"><collision><origin xyz="0.02 0 0"/><geometry><mesh filename="hand.ply"/></geometry></collision></link>
      <link name="finger"><collision><geometry><mesh filename="finger.glb"/></geometry></collision></link>
      <joint name="turn" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.05" rpy="0.2 -0.1 0.5"/>
        <axis xyz="0 1 0.2"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
      <joint name="slide" type="prismatic"><parent link="upper"/><child link="hand"/><origin xyz="0 0 0.22" rpy="0 0.4 0"/>
        <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
      <joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/><origin xyz="0 0.03 0.05"/>
        <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
        <mimic joint="slide" multiplier="0.5" offset="0.01"/></joint></robot>"""

    def test_silhouettes_of_yourdfpy(self):
        make = trimesh.creation
        rod = make.cylinder(20, 200)
        rod.apply_transform(trimesh.transformations.rotation_matrix(0.3, (1, 1, 0)))
        for name, mesh in (("base.stl", make.box((0.15, 0.15, 0.04))), ("upper.obj", rod),
                           ("hand.ply", make.torus(0.04, 0.012)), ("finger.glb", make.capsule(0.06, 0.01))):
            mesh.export(self.folder / name)
        path = self.folder / "arm.urdf"
        path.write_text(self.URDF)
        robot = yourdfpy.URDF.load(path, load_collision_meshes=True, build_collision_scene_graph=True,
                                   filename_handler=lambda fname: str(self.folder / fname))
        frames = self.folder / "wall"
        frames.mkdir()
        write_depth_png(frames / "0.png", WIDTH, HEIGHT, lambda u, v: 3000)
        base = numpy.eye(4)
        base[:3, 3] = (0.02, -0.1, 0.7)
        for number, (turn, slide) in enumerate(((0, 0), (0.9, 0.05), (-1.3, -0.04))):
            robot.update_cfg({"turn": numpy.float64(turn), "slide": numpy.float64(slide)})
            points = numpy.vstack([trimesh.sample.sample_surface(mesh, 40_000, seed=1)[0]
                                   for mesh in robot.collision_scene.dump()])
            points = points @ base[:3, :3].T + base[:3, 3]
            u = numpy.round(LENS[0] * points[:, 0] / points[:, 2] + LENS[2]).astype(int)
            v = numpy.round(LENS[1] * points[:, 1] / points[:, 2] + LENS[3]).astype(int)
            seen = numpy.zeros((HEIGHT, WIDTH), bool)
            inside = (u >= 0) & (u < WIDTH) & (v >= 0) & (v < HEIGHT)
            seen[v[inside], u[inside]] = True
            joints = self.folder / "joints.csv"
            joints.write_text(f"time,turn,slide\n0,{turn},{slide}\n")
            copy = self.folder / f"without_{number}.mcap"
            self.check(palpate("record", "--camera", f"folder:{frames}?intrinsics={','.join(map(str, LENS))}", "--robot", path,
                               "--joints", joints, "--robot-pose", "0.02 -0.1 0.7 0 0 0 1", "--robot-padding", 0, "-o", copy))
            with rosbags.highlevel.AnyReader([copy]) as reader:
                image = next(reader.deserialize(data, connection.msgtype) for connection, _, data in reader.messages()
                             if connection.topic == TOPIC)
            removed = image.data.view("<u2").reshape(HEIGHT, WIDTH) == 0
            # Every pixel that is touched is removed, and one more around it.
            around = seen.copy()
            for dv in range(-2, 3):
                for du in range(-2, 3):
                    around |= numpy.roll(seen, (dv, du), (0, 1))
            self.assertGreater(seen.sum(), 500)
            core = seen.copy()
            for dv, du in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                core &= numpy.roll(seen, (dv, du), (0, 1))
            self.assertEqual((core & ~removed).sum(), 0, number)
            self.assertEqual((removed & ~around).sum(), 0, number)


class Clouds(CameraCase):
    def test_clouds_of_open3d(self):
        try:
            import open3d
        except (ImportError, OSError) as error:
            self.skipTest(f"there is no Open3D: {error}")
        u, v = numpy.meshgrid(numpy.arange(WIDTH), numpy.arange(HEIGHT))
        z = 0.5 + 0.003 * numpy.sin(u / 20) * numpy.cos(v / 15)
        points = numpy.stack([(u - LENS[2]) * z / LENS[0], (v - LENS[3]) * z / LENS[1], z], -1).reshape(-1, 3)
        normals = numpy.tile((0.0, 0.0, -1.0), (len(points), 1))
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
        cloud.normals = open3d.utility.Vector3dVector(normals)
        results = {}
        for ending, options in (("ply", {}), ("ply", {"write_ascii": True}), ("pcd", {}), ("pcd", {"write_ascii": True}),
                                ("pcd", {"compressed": True})):
            for has_colors in (False, True):
                what = f"{ending} {options} {has_colors}"
                cloud.colors = open3d.utility.Vector3dVector(points * 0 + 0.5 if has_colors else numpy.empty((0, 3)))
                path = self.folder / f"cloud.{ending}"
                self.assertTrue(open3d.io.write_point_cloud(str(path), cloud, **options), what)
                done = self.check(palpate("query", self.tool, "--cloud", path, "--method", "weighted", "--pose",
                                          "0.01 0.005 0.49 0 0 0 1", "--json"))
                self.assertEqual(done.stderr, b"", what)
                results[what] = json.loads(done.stdout)["results"][0]
        first = next(iter(results.values()))
        self.assertGreater(first["fraction"], 0.1)
        for what, result in results.items():
            for key in ("volume", "fraction"):
                self.assertAlmostEqual(result[key] / first[key], 1, delta=1e-4, msg=what)


if __name__ == "__main__":
    unittest.main()
