"""A robot on the Python package cyclonedds, another version of Cyclone DDS than the program's, with
types and bytes of its own. Publishes depth images with camera_info and the tool's pose, reads
wrench, contact, diagnostics and the graph, and prints what it saw as JSON.

usage: cyclone_peer.py DOMAIN [BEHAVIOR [WIDTHxHEIGHT [NAMESPACE WRENCH]]]

It goes on until its standard input ends. Standard error tells that it has begun, and when it has
seen enough for a test. BEHAVIOR is what it does from the second after the first
wrench on: good, silent, flood (1000 images per second), wrong_encoding, wrong_size, tomorrow, dies,
talks (each image is of another encoding, which clears the screen);
tf: good, and the tool's pose comes by tf; tf_stops: the same, and then tf tells of others only;
slow: a pose comes every half second; watches: no more than that, another robot has the camera.
NAMESPACE and WRENCH are where it looks for what the program tells, as topics of DDS.
"""

import bisect
import json
import os
import select
import signal
import struct
import sys
import time
from dataclasses import dataclass

os.environ["CYCLONEDDS_URI"] = (
    '<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General><Discovery>"
    "<ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>"
    '<Peers><Peer address="127.0.0.1"/></Peers></Discovery>')

from cyclonedds._clayer import ddspy_write  # noqa: E402
from cyclonedds.core import Policy, Qos  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication  # noqa: E402
from cyclonedds.internal import InvalidSample  # noqa: E402
from cyclonedds.idl import IdlStruct  # noqa: E402
from cyclonedds.idl.types import (array, float64, int32, sequence, uint8, uint32)  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64 = 0
    y: float64 = 0
    z: float64 = 0


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64 = 0
    y: float64 = 0
    z: float64 = 0
    w: float64 = 1


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Vector3
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header
    pose: Pose


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector3
    torque: Vector3


@dataclass
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header
    wrench: Wrench


@dataclass
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dataclass
class RegionOfInterest(IdlStruct, typename="sensor_msgs::msg::dds_::RegionOfInterest_"):
    x_offset: uint32 = 0
    y_offset: uint32 = 0
    height: uint32 = 0
    width: uint32 = 0
    do_rectify: bool = False


@dataclass
class CameraInfo(IdlStruct, typename="sensor_msgs::msg::dds_::CameraInfo_"):
    header: Header
    height: uint32
    width: uint32
    distortion_model: str
    d: sequence[float64]
    k: array[float64, 9]
    r: array[float64, 9]
    p: array[float64, 12]
    binning_x: uint32
    binning_y: uint32
    roi: RegionOfInterest


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class Contact(IdlStruct, typename="palpate_msgs::msg::dds_::Contact_"):
    header: Header
    state: uint8
    reason: str
    volume: float64
    fraction: float64
    unseen: float64
    potential: float64
    max_stiffness: float64
    wrench: Wrench
    stiffness: array[float64, 36]
    depth_age: float64
    contact_age: float64
    status: uint32
    volume_std: float64
    force_std: Vector3
    torque_std: Vector3


@dataclass
class Gid(IdlStruct, typename="rmw_dds_common::msg::dds_::Gid_"):
    data: array[uint8, 16]


@dataclass
class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::NodeEntitiesInfo_"):
    node_namespace: str
    node_name: str
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantEntitiesInfo(IdlStruct,
                              typename="rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]


WIDTH, HEIGHT = 80, 60


class Robot:
    def __init__(self, domain):
        self.participant = DomainParticipant(domain)

    def qos(self, reliable=True, kept=False, depth=10):
        return Qos(Policy.Reliability.Reliable(0) if reliable else Policy.Reliability.BestEffort,
                   Policy.Durability.TransientLocal if kept else Policy.Durability.Volatile,
                   Policy.History.KeepLast(depth),
                   # History for readers that come late, as nodes of ROS 2 have it.
                   Policy.DurabilityService(0, Policy.History.KeepLast(depth), -1, -1, -1),
                   Policy.DataRepresentation(use_cdrv0_representation=True))

    def writer(self, name, kind, **qos):
        return DataWriter(self.participant, Topic(self.participant, name, kind), self.qos(**qos))

    def reader(self, name, kind, **qos):
        return DataReader(self.participant, Topic(self.participant, name, kind), self.qos(**qos))


def taken(reader, most):
    """Without what only says that a writer has gone."""
    return [sample for sample in reader.take(most) if not isinstance(sample, InvalidSample)]


def header(stamp, frame="camera"):
    return Header(Time(int(stamp), int(stamp % 1 * 1e9)), frame)


def image(depth, width, height, encoding="16UC1", cut=0):
    data = depth.to_bytes(2, "little") * (width * height)
    return Image(header(0), height, width, encoding, 0, 2 * width, list(data[:len(data) - cut]))


def camera_info(width, height):
    model = [0.8 * width, 0, width / 2 - 0.5, 0, 0.8 * width, height / 2 - 0.5, 0, 0, 1]
    return CameraInfo(header(0), height, width, "plumb_bob", [0.0] * 5, model, [1.0, 0, 0, 0, 1, 0, 0, 0, 1],
                      model[:3] + [0.0] + model[3:6] + [0.0] + model[6:] + [0.0], 0, 0, RegionOfInterest())


class Prepared:
    """A message that begins with a header, sent again and again with other stamps: a list of bytes takes Python long."""

    def __init__(self, writer, message):
        self.writer = writer
        data = message.serialize(use_version_2=writer._use_version_2)
        self.data = bytearray(data.ljust((len(data) + 3) // 4 * 4, b"\0"))

    def send(self, stamp):
        struct.pack_into("<iI", self.data, 4, int(stamp), int(stamp % 1 * 1e9))
        if ddspy_write(self.writer._ref, bytes(self.data)) < 0:
            raise RuntimeError("an image was not written")


def parts(values):
    """Median, what 99 % are within and the largest, ms."""
    values = sorted(values) or [0]
    return [round(1e3 * values[int(share * (len(values) - 1))], 3) for share in (0.5, 0.99, 1)]


def tell(word):
    print(word, file=sys.stderr, flush=True)


def has_ended():
    return bool(select.select([sys.stdin], [], [], 0)[0])


def main(domain, behavior="good", size=f"{WIDTH}x{HEIGHT}", namespace="rt/palpate", wrench_topic="rt/palpate/wrench"):
    width, height = map(int, size.split("x"))
    robot = Robot(domain)
    has_camera = behavior != "watches"
    images = robot.writer("rt/camera/depth/image_raw", Image, reliable=False, depth=5)
    infos = robot.writer("rt/camera/depth/camera_info", CameraInfo, reliable=False, depth=5)
    poses = robot.writer("rt/tool_pose", PoseStamped)
    moving = robot.writer("rt/tf", TFMessage)
    fixed = robot.writer("rt/tf_static", TFMessage, kept=True, depth=1)
    wrenches = robot.reader(wrench_topic, WrenchStamped, depth=20000)
    contacts = robot.reader(namespace + "/contact", Contact, depth=100)
    diagnostics = robot.reader("rt/diagnostics", DiagnosticArray)
    graph = robot.reader("ros_discovery_info", ParticipantEntitiesInfo, kept=True, depth=1)
    offers = BuiltinDataReader(robot.participant, BuiltinTopicDcpsPublication)
    upright = Quaternion(0, 0, 0, 1)
    turned = Quaternion(0.5**0.5, 0, 0, 0.5**0.5)  # its y is the camera's z
    # The camera looks along the base's z from its origin; the tool is 0.5 m before it.
    fixed.write(TFMessage([TransformStamped(header(time.time(), "base"), "camera", Vector3(),
                                            upright)]))
    near, far = (Prepared(images, image(depth, width, height)) for depth in (490, 700))
    wild = {"wrong_encoding": lambda: Prepared(images, image(490, width, height, "rgb8")),
            "wrong_size": lambda: Prepared(images, image(490, width, height, cut=1000))}.get(behavior, lambda: None)()
    model = Prepared(infos, camera_info(width, height))
    begin = time.time()
    seen = {"images": 0, "wrenches": 0, "touching": 0, "frames": [], "states": [], "turns": [], "reasons": [],
            "nodes": [], "hashes": {}, "contact": None, "wild_touching": 0, "wild_from": None}
    next_image = next_pose = begin
    wild_from = wild_since = float("inf")
    shown, is_touching, has_enough = 0, False, False
    sent, counts, latencies, delays, came = [], [], [], [], []
    end = float("inf")
    tell("begun")
    # Until the last word of a run is here, and all that was sent before it.
    while end > time.time() - 10 and (end == float("inf") or came or "the run has ended" not in seen["reasons"]):
        now = time.time()
        if has_ended():
            end = min(end, now)
        is_wild = now > wild_from
        if is_wild:
            wild_since = min(wild_since, now)
        if is_wild and behavior == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        if behavior in ("tf", "tf_stops"):
            told = ("odom", "base_footprint") if is_wild and behavior == "tf_stops" else ("base", "tool0")
            moving.write(TFMessage([TransformStamped(header(now, told[0]), told[1], Vector3(0, 0, 0.5), turned)]))
        elif has_camera and (behavior != "slow" or now >= next_pose):
            next_pose = now + 0.5
            poses.write(PoseStamped(header(now), Pose(Vector3(0, 0, 0.5), upright)))
        is_flood = is_wild and behavior == "flood"
        period = 0.001 if is_flood else 1 / 30
        while has_camera and now >= next_image and not (is_wild and behavior == "silent"):
            next_image = max(next_image + period, now - 0.05)
            stamp = time.time() + (86400 if is_wild and behavior == "tomorrow" else 0)
            is_near = seen["images"] // 8 % 2 == 1
            if seen["images"] % 8 == 0:
                shown = stamp if is_near and not is_touching else 0
            model.send(stamp)
            if is_wild and behavior == "talks":
                images.write(image(490, width, height, f"\x1b[2J{seen['images']}"))
            else:
                (wild if is_wild and wild else near if is_near else far).send(stamp)
            seen["images"] += 1
        for message in taken(diagnostics, 20):
            for status in message.status:
                # Number of wrenches sent until then, by palpate's own count.
                count = next((int(value.value) for value in status.values if value.key == "wrenches sent"), 0)
                counts.append([1e-9 * message.sample_info.source_timestamp, count])
                words = status.message.split(" is ")[0]
                if words not in seen["reasons"]:
                    seen["reasons"].append(words)
        came = taken(wrenches, 200)
        for wrench in came:
            seen["wrenches"] += 1
            wild_from = min(wild_from, now + 1)
            sent.append(1e-9 * wrench.sample_info.source_timestamp)
            delays.append(time.time() - sent[-1])
            force = wrench.wrench.force
            is_touching = force != Vector3()
            seen["touching"] += is_touching
            if is_touching:
                seen["force"] = [force.x, force.y, force.z]
                if shown > 0:
                    latencies.append(sent[-1] - shown)
                    shown = 0
            if sent[-1] > wild_since + 1:
                seen["wild_touching"] += is_touching
            if wrench.header.frame_id not in seen["frames"]:
                seen["frames"].append(wrench.header.frame_id)
        for contact in taken(contacts, 200):
            # On a busy computer some come without a stiffness.
            if contact.state == 0 and contact.volume > 0 and (any(contact.stiffness) or "contact" not in seen):
                seen["contact"] = {"volume": contact.volume, "fraction": contact.fraction,
                                   "force": [contact.wrench.force.x, contact.wrench.force.y,
                                             contact.wrench.force.z],
                                   "stiffness": [contact.stiffness[7 * i] for i in range(3)],
                                   "depth_age": contact.depth_age}
            if contact.state not in seen["states"]:
                seen["states"].append(contact.state)
            if not seen["turns"] or seen["turns"][-1][1] != contact.state:
                seen["turns"].append([1e-9 * contact.sample_info.source_timestamp, contact.state])
        for entities in taken(graph, 20):
            for node in entities.node_entities_info_seq:
                seen["nodes"].append([node.node_namespace + node.node_name,
                                      len(node.reader_gid_seq), len(node.writer_gid_seq)])
        for offer in offers.take(50):
            topic = offer.topic_name or ""
            if topic == wrench_topic or topic.startswith(namespace):
                data = next((policy.data for policy in offer.qos
                             if isinstance(policy, Policy.Userdata)), b"")
                seen["hashes"][topic] = bytes(data).decode()
        if behavior == "tf_stops":
            is_enough = now > wild_since + 2 and "the tool's pose" in seen["reasons"]
        elif behavior == "silent":  # which is told after 2 s
            is_enough = now > wild_since + 4 and "the depth image" in seen["reasons"]
        elif behavior in ("wrong_encoding", "wrong_size", "talks"):
            is_enough = now > wild_since + 2
        else:
            is_enough = (
                seen["wrenches"] > 1000 and seen["touching"] > 100 and seen["contact"]
                and sum(stamp > sent[0] for stamp, _ in counts) > 7 and (behavior != "flood" or seen["images"] > 5000)
                and (behavior not in ("flood", "tomorrow") or seen["wild_touching"] > 10))
        if is_enough and not has_enough:
            has_enough = True
            tell("enough")
        time.sleep(0.0005 if is_flood else max(0, min(0.004, next_image - time.time())))
    seen["nodes"] = seen["nodes"][-1:]
    # Number of wrenches sent that had not come here, at each report of palpate's count: constant from the first report
    # on, if none is lost. A report that was sent long after it was counted says less; the last one was not.
    missing = [count - bisect.bisect_right(sent, stamp) for stamp, count in counts if sent and stamp > sent[0]]
    seen["lost"] = missing[-1] - max(missing[:6]) if len(missing) > 6 else None
    seen["delay_ms"] = parts(delays)
    seen["sent_gap_ms"] = parts([after - before for before, after in zip(sent, sent[1:])])
    seen["image_to_sent_ms"], seen["measured"] = parts(latencies), len(latencies)
    print(json.dumps(seen), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
