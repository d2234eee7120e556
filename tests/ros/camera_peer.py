"""Cameras of a robot on the Python package cyclonedds: how depth images come over ROS 2. Publishes what BEHAVIOR
says, reads wrench, contact, tool pose and twist, and prints what it saw as JSON when its standard input ends.
Standard error tells that it has begun, and that it has seen enough for a test.

usage: camera_peer.py DOMAIN BEHAVIOR [X,Y,Z]

X,Y,Z: where the tool is, m, in the camera's frame or, with tf, in the base's.

png, rvl, inverse:  compressedDepth; inverse: RVL of 32FC1
plain:              PNG by the transport `compressed`
float:              32FC1
millimeters:        32FC1 in millimeters
bent:               two lenses in turn, each image with its camera_info, which comes after it
bent_late:          the same, but it comes 0.15 s after it
once:               one camera_info, with the stamp of one image, as soon as somebody listens, and none after it
uncalibrated:       some camera_infos are all 0; the corner of the images, which all of them would be then, is nearer
moving:             a camera that moves; tf tells late where it was
two:                two cameras, one behind the other; the second one sees the wall half of the time
late:               images come 0.2 to 0.25 s late, 5 % of them do not come
follow:             nothing but images; somebody follows the tool's pose
spheres:            a wall of which the right half is not measured; somebody draws the tool's spheres
bodies:             a wall; somebody looks at the bodies of the run, who began to look late at what they are like
bag:FOLDER          rosbags plays the depth images of a bag, one every quarter of a second, again and again
"""

import json
import math
import pathlib
import random
import struct
import sys
import time
import zlib
from collections import deque
from dataclasses import dataclass

import rvl
from cyclone_peer import (CameraInfo, Contact, Header, HEIGHT, Image, Pose, PoseStamped, Quaternion, RegionOfInterest,
                          Robot, TFMessage, Time, TransformStamped, Vector3, WIDTH, WrenchStamped, has_ended, header,
                          taken, tell)
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float32, float64, int32, sequence, uint8, uint32

FOCAL, U0, V0 = 64.0, 39.5, 29.5
NEAR, FAR = 0.49, 0.7  # m
TOPIC = "rt/camera/depth/image_raw"
UPRIGHT = Quaternion(0, 0, 0, 1)


@dataclass
class CompressedImage(IdlStruct, typename="sensor_msgs::msg::dds_::CompressedImage_"):
    header: Header
    format: str
    data: sequence[uint8]


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TwistStamped_"):
    header: Header
    twist: Twist


@dataclass
class ColorRGBA(IdlStruct, typename="std_msgs::msg::dds_::ColorRGBA_"):
    r: float32
    g: float32
    b: float32
    a: float32


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces::msg::dds_::Duration_"):
    sec: int32
    nanosec: uint32


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class UVCoordinate(IdlStruct, typename="visualization_msgs::msg::dds_::UVCoordinate_"):
    u: float32
    v: float32


@dataclass
class MeshFile(IdlStruct, typename="visualization_msgs::msg::dds_::MeshFile_"):
    filename: str
    data: sequence[uint8]


@dataclass
class Marker(IdlStruct, typename="visualization_msgs::msg::dds_::Marker_"):
    header: Header
    ns: str
    id: int32
    type: int32
    action: int32
    pose: Pose
    scale: Vector3
    color: ColorRGBA
    lifetime: Duration
    frame_locked: bool
    points: sequence[Point]
    colors: sequence[ColorRGBA]
    texture_resource: str
    texture: CompressedImage
    uv_coordinates: sequence[UVCoordinate]
    text: str
    mesh_resource: str
    mesh_file: MeshFile
    mesh_use_embedded_materials: bool


@dataclass
class MarkerArray(IdlStruct, typename="visualization_msgs::msg::dds_::MarkerArray_"):
    markers: sequence[Marker]


def count_image(stamp, depths, frame="camera"):
    data = struct.pack(f"<{WIDTH * HEIGHT}H", *(round(1000 * z) for z in depths))
    return Image(header(stamp, frame), HEIGHT, WIDTH, "16UC1", 0, 2 * WIDTH, list(data))


def float_image(stamp, depths, frame="camera"):
    data = struct.pack(f"<{WIDTH * HEIGHT}f", *depths)
    return Image(header(stamp, frame), HEIGHT, WIDTH, "32FC1", 0, 4 * WIDTH, list(data))


def png(counts):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + struct.pack(f">{WIDTH}H", *counts[v * WIDTH:(v + 1) * WIDTH]) for v in range(HEIGHT))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", WIDTH, HEIGHT, 16, 0, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def compressed_image(stamp, depths, behavior):
    a, b = 500.0, 20.0  # of depth in meters: count = a / depth + b
    is_inverse = behavior == "inverse"
    counts = [round(a / z + b) if is_inverse else round(1000 * z) for z in depths]
    if behavior == "plain":
        return CompressedImage(header(stamp), "16UC1; png compressed ", list(png(counts)))
    codec = "png" if behavior == "png" else "rvl"
    data = png(counts) if codec == "png" else rvl.compressed(counts, WIDTH, HEIGHT)
    return CompressedImage(header(stamp), f"{'32FC1' if is_inverse else '16UC1'}; compressedDepth {codec}",
                           list(struct.pack("<iff", 0, a, b) + data))


def info(stamp, k1=0.0, frame="camera", is_calibrated=True):
    k = [0.0] * 9 if not is_calibrated else [FOCAL, 0, U0, 0, FOCAL, V0, 0, 0, 1.0]
    return CameraInfo(header(stamp, frame), HEIGHT, WIDTH, "plumb_bob", [k1, 0.0, 0.0, 0.0, 0.0], k,
                      [1.0, 0, 0, 0, 1, 0, 0, 0, 1], k[:3] + [0.0] + k[3:6] + [0.0] + k[6:] + [0.0], 0, 0,
                      RegionOfInterest())


def half_wall(k1, edge=0.165):
    """Near left of x = edge, far right of it, as a lens sees it whose distortion is k1."""
    depths = []
    for v in range(HEIGHT):
        for u in range(WIDTH):
            xd, yd = (u - U0) / FOCAL, (v - V0) / FOCAL
            x, y = xd, yd
            for _ in range(30):
                bend = 1 + k1 * (x * x + y * y)
                x, y = xd / bend, yd / bend
            depths.append(NEAR if x * NEAR < edge else FAR)
    return depths


def flat(depth):
    return [depth] * (WIDTH * HEIGHT)


def played(folder):
    """Images and camera_infos of a bag, as rosbags reads them."""
    import rosbags.highlevel
    found = {}
    with rosbags.highlevel.AnyReader([folder]) as reader:
        for connection, _, data in reader.messages():
            kind = connection.msgtype.rsplit("/", 1)[1]
            if kind not in ("Image", "CameraInfo"):
                continue
            m = reader.deserialize(data, connection.msgtype)
            stamp = (m.header.stamp.sec, m.header.stamp.nanosec)
            frame = header(0, m.header.frame_id)
            if kind == "Image":
                found.setdefault(stamp, {})[kind] = Image(frame, m.height, m.width, m.encoding, m.is_bigendian, m.step,
                                                          m.data.tolist())
            else:
                found.setdefault(stamp, {})[kind] = CameraInfo(
                    frame, m.height, m.width, m.distortion_model, m.d.tolist(), m.k.tolist(), m.r.tolist(),
                    m.p.tolist(), m.binning_x, m.binning_y, RegionOfInterest())
    return [found[stamp] for stamp in sorted(found)]


def camera_height(stamp):
    """Returns the position of the moving camera on the base's z, m: up to 0.9 m/s fast."""
    return 0.15 * math.sin(6 * stamp)


def transform(stamp, child, z):
    return TFMessage([TransformStamped(header(stamp, "base"), child, Vector3(0, 0, z), UPRIGHT)])


class Cameras:
    def __init__(self, robot, behavior):
        self.behavior = behavior
        self.is_compressed = behavior in ("png", "rvl", "inverse", "plain")
        qos = {"reliable": False, "depth": 5}
        transport = "/compressed" if behavior == "plain" else "/compressedDepth"
        self.images = (robot.writer(TOPIC + transport, CompressedImage, **qos) if self.is_compressed
                       else robot.writer(TOPIC, Image, **qos))
        self.infos = robot.writer("rt/camera/depth/camera_info", CameraInfo, **qos)
        self.others = robot.writer("rt/behind/depth/image_raw", Image, **qos)
        self.other_infos = robot.writer("rt/behind/depth/camera_info", CameraInfo, **qos)
        self.moving = robot.writer("rt/tf", TFMessage, depth=100)
        self.fixed = robot.writer("rt/tf_static", TFMessage, kept=True, depth=2)
        self.waiting = deque()  # what comes late: when, how
        self.delays = []  # s, of images, when they are sent
        self.chance = random.Random(1)
        self.num = self.num_heard = 0
        self.drawn = {}
        self.bag = played(pathlib.Path(behavior[4:])) if behavior.startswith("bag:") else None
        if behavior == "two":
            self.fixed.write(transform(time.time(), "camera", 0.0))
            self.fixed.write(transform(time.time(), "behind_camera", -0.2))

    def later(self, when, writer, message):
        self.waiting.append((when, writer, message))

    def drawing(self, key, make):
        if key not in self.drawn:
            self.drawn[key] = make()
        return self.drawn[key]

    def tell_where(self, stamp):
        if self.behavior == "moving":
            self.later(stamp + 0.03, self.moving, transform(stamp, "camera", camera_height(stamp)))

    def shoot(self, now):
        """The next image, and what comes with it."""
        self.num += 1
        if self.bag:
            if self.num % 8 == 0:
                both = self.bag[self.num // 8 % len(self.bag)]
                both["CameraInfo"].header = both["Image"].header = header(now, both["Image"].header.frame_id)
                self.infos.write(both["CameraInfo"])
                self.images.write(both["Image"])
            return
        is_near = self.num // 8 % 2 == 1
        behavior = self.behavior
        if behavior in ("bent", "bent_late"):
            k1 = 1.0 if self.num % 2 else 0.0
            shown = self.drawing(k1, lambda: count_image(now, half_wall(k1)))
            shown.header = header(now)
            self.images.write(shown)
            self.later(now + (0.005 if behavior == "bent" else 0.15), self.infos, info(now, k1))
            return
        if behavior == "once":
            self.images.write(count_image(now, flat(NEAR)))
            self.num_heard += bool(self.infos.get_matched_subscriptions())
            if self.num_heard == 60:  # the other side knows of it too
                self.later(now + 0.005, self.infos, info(now))
            return
        if behavior == "late":
            if self.chance.random() < 0.05:
                return
            at = now + self.chance.uniform(0.2, 0.25)
            self.later(at, self.infos, info(now))
            self.later(at, self.images, count_image(now, flat(NEAR)))
            return
        self.infos.write(info(now, is_calibrated=behavior != "uncalibrated" or self.num % 30 < 20))
        if self.is_compressed:
            shown = self.drawing(is_near, lambda: compressed_image(now, flat(NEAR if is_near else FAR), behavior))
            shown.header = header(now)
            self.images.write(shown)
        elif behavior == "float":
            self.images.write(float_image(now, flat(NEAR if is_near else FAR)))
        elif behavior == "millimeters":
            self.images.write(float_image(now, [1000 * z for z in flat(NEAR if is_near else FAR)]))
        elif behavior == "moving":  # the wall stands in the base
            self.images.write(float_image(now, flat(NEAR - camera_height(now))))
        elif behavior == "spheres":
            self.images.write(count_image(now, [NEAR if i % WIDTH <= U0 else 0 for i in range(WIDTH * HEIGHT)]))
        elif behavior == "uncalibrated":
            self.images.write(count_image(now, [0.3] + flat(NEAR)[1:]))
        elif behavior == "two":
            self.images.write(count_image(now, flat(NEAR)))
            self.other_infos.write(info(now, frame="behind_camera"))
            self.others.write(count_image(now, flat(0.2 + (NEAR if is_near else FAR)), "behind_camera"))
        else:
            self.images.write(count_image(now, flat(NEAR)))

    def send_what_is_due(self, now):
        for each in sorted((each for each in self.waiting if each[0] <= now), key=lambda each: each[0]):
            each[1].write(each[2])
            self.waiting.remove(each)
            if each[1] is self.images:
                stamp = each[2].header.stamp
                self.delays.append(time.time() - stamp.sec - 1e-9 * stamp.nanosec)


def main(domain, behavior, place="0,0,0.5"):
    robot = Robot(domain)
    cameras = Cameras(robot, behavior)
    poses = robot.writer("rt/tool_pose", PoseStamped)
    wrenches = robot.reader("rt/palpate/wrench", WrenchStamped, depth=1000)
    contacts = robot.reader("rt/palpate/contact", Contact, depth=200)
    followed = robot.reader("rt/palpate/tool_pose", PoseStamped, depth=200)
    twists = robot.reader("rt/palpate/tool_twist", TwistStamped, depth=200)
    drawn = robot.reader("rt/palpate/spheres", MarkerArray, depth=5) if behavior == "spheres" else None
    frames = robot.reader("rt/tf", TFMessage, depth=100) if behavior == "bodies" else None
    shapes = None
    seen = {"bodies": [], "shapes": {}, "spheres": [], "wrenches": 0, "touching": 0, "fractions": [], "ages": [], "poses": [], "twists": [], "frames": []}
    place = Vector3(*map(float, place.split(",")))
    has_enough = False
    next_image = next_tf = time.time()
    tell("begun")
    while not has_ended():
        now = time.time()
        while now >= next_tf:  # all places, also of a time when this computer was busy
            cameras.tell_where(next_tf)
            next_tf += 0.02
        poses.write(PoseStamped(header(now, "base" if behavior in ("moving", "two") else "camera"),
                                Pose(place, UPRIGHT)))
        if now >= next_image:
            next_image = max(next_image + 1 / 30, now - 1 / 30)
            cameras.shoot(now)
        cameras.send_what_is_due(now)
        for wrench in taken(wrenches, 200):
            seen["wrenches"] += 1
            seen["touching"] += wrench.wrench.force != Vector3()
        for contact in taken(contacts, 200):
            if contact.state == 0:
                seen["fractions"].append(contact.fraction)
                seen["ages"].append(contact.depth_age)
        for pose in taken(followed, 200):
            stamp, p, q = pose.header.stamp, pose.pose.position, pose.pose.orientation
            seen["poses"].append([stamp.sec + 1e-9 * stamp.nanosec, p.x, p.y, p.z, q.x, q.y, q.z, q.w])
            if pose.header.frame_id not in seen["frames"]:
                seen["frames"].append(pose.header.frame_id)
        for message in taken(drawn, 5) if drawn else ():
            seen["spheres"] = [[marker.ns, marker.scale.x / 2, point.x, point.y, point.z]
                               for marker in message.markers if marker.action == 0 for point in marker.points]
        for message in taken(frames, 200) if frames else ():
            for each in message.transforms:
                stamp, p, q = each.header.stamp, each.translation, each.rotation
                seen["bodies"].append([stamp.sec + 1e-9 * stamp.nanosec, each.header.frame_id, each.child_frame_id,
                                       p.x, p.y, p.z, q.x, q.y, q.z, q.w])
        if frames and not shapes and len(seen["bodies"]) > 10:
            shapes = robot.reader("rt/palpate/markers", MarkerArray, kept=True, depth=1)
        for message in taken(shapes, 5) if shapes else ():
            for marker in message.markers:
                p, q = marker.pose.position, marker.pose.orientation
                seen["shapes"][marker.ns] = {
                    "frame": marker.header.frame_id, "type": marker.type, "locked": marker.frame_locked,
                    "place": [p.x, p.y, p.z, q.x, q.y, q.z, q.w], "size": max(abs(point.x) for point in marker.points)}
        for twist in taken(twists, 200):
            stamp, v, w = twist.header.stamp, twist.twist.linear, twist.twist.angular
            seen["twists"].append([stamp.sec + 1e-9 * stamp.nanosec, v.x, v.y, v.z, w.x, w.y, w.z])
        if behavior == "follow":
            is_enough = len(seen["poses"]) > 1000 and sum(any(twist[1:]) for twist in seen["twists"][-1000:]) > 500
        else:
            is_enough = len(seen["fractions"]) > (500 if behavior in ("moving", "two") else 250) and (
                seen["touching"] > 100 or behavior == "bent") and (seen["spheres"] or not drawn)
        if is_enough and not has_enough:
            has_enough = True
            tell("enough")
        time.sleep(0.002)
    seen["delays"] = cameras.delays
    print(json.dumps(seen), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
