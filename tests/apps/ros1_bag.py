"""Writes a bag of ROS 1 by rosbag as Debian has it (python3-rosbag, python3-sensor-msgs, python3-tf2-msgs).

Usage: ros1_bag.py FILE.bag none|bz2|lz4 IMAGES.raw WIDTH HEIGHT [RATE fx,fy,cx,cy]. 20 images to the chunk at most; the
camera is at (0.1, 0, 0.02) m in the frame `table`, by two transforms."""

import sys

import genpy
import rosbag
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

path, compression, images, width, height, *more = sys.argv[1:]
width, height = int(width), int(height)
rate = float(more[0]) if more else 30
fx, fy, cx, cy = map(float, more[1].split(",")) if more else (200, 200, width / 2 - 0.5, height / 2 - 0.5)
size = 2 * width * height
with open(images, "rb") as file:
    counts = file.read()


def transform(parent, child, stamp, x, z):
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id, message.header.stamp = parent, child, stamp
    message.transform.translation.x, message.transform.translation.z = x, z
    message.transform.rotation.w = 1
    return message


with rosbag.Bag(path, "w", compression=compression, chunk_threshold=20 * size) as bag:
    for k in range(len(counts) // size):
        stamp = genpy.Time.from_sec(1_500_000_000 + k / rate)
        if k == 0:
            bag.write("/tf_static", TFMessage([transform("table", "stand", stamp, 0.1, 0)]), stamp)
        bag.write("/tf", TFMessage([transform("stand", "depth_optical", stamp, 0, 0.02)]), stamp)
        info = CameraInfo(height=height, width=width, distortion_model="plumb_bob", D=[0] * 5,
                          K=[fx, 0, cx, 0, fy, cy, 0, 0, 1])
        info.header.stamp, info.header.frame_id, info.header.seq = stamp, "depth_optical", k
        bag.write("/camera/depth/camera_info", info, stamp)
        image = Image(height=height, width=width, encoding="16UC1", step=2 * width,
                      data=counts[k * size:(k + 1) * size])
        image.header = info.header
        bag.write("/camera/depth/image_raw", image, stamp)
        color = Image(height=2, width=2, encoding="rgb8", step=6, data=bytes(12))
        color.header = info.header
        bag.write("/camera/color/image_raw", color, stamp)
