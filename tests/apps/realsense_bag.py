"""Records a .bag by the RealSense library itself, from its software device. Libraries of today write .db3 only: the path
of an older pyrealsense2 comes first.

Usage: realsense_bag.py FOLDER_OF_PYREALSENSE2 FILE.bag|FILE.db3 IMAGES.raw WIDTH HEIGHT METERS_PER_COUNT"""

import sys
import time

folder, path, images, width, height, unit = sys.argv[1:]
sys.path.insert(0, folder)
width, height, unit = int(width), int(height), float(unit)

import numpy  # noqa: E402
import pyrealsense2 as rs  # noqa: E402

counts = numpy.fromfile(images, dtype="<u2").reshape(-1, height, width)
camera = rs.intrinsics()
camera.width, camera.height, camera.fx, camera.fy = width, height, 200, 200
camera.ppx, camera.ppy, camera.model = width / 2 - 0.5, height / 2 - 0.5, rs.distortion.none
stream = rs.video_stream()
stream.type, stream.index, stream.uid, stream.fps = rs.stream.depth, 0, 1, 30
stream.width, stream.height, stream.bpp, stream.fmt = width, height, 2, rs.format.z16
stream.intrinsics = camera

device = rs.software_device()
device.register_info(rs.camera_info.name, "Intel RealSense D400")
device.register_info(rs.camera_info.serial_number, "1234")
sensor = device.add_sensor("Depth")
profile = sensor.add_video_stream(stream).as_video_stream_profile()
sensor.add_read_only_option(rs.option.depth_units, unit)
recorder = rs.recorder(path, device)
recorded = recorder.query_sensors()[0]
queue = rs.frame_queue(len(counts))
recorded.open(recorded.get_stream_profiles()[0])
recorded.start(queue)
for k in range(len(counts)):
    frame = rs.software_video_frame()
    frame.pixels, frame.stride, frame.bpp = counts[k], 2 * width, 2
    frame.timestamp, frame.domain, frame.frame_number = 1000 + k * 1000 / 30, rs.timestamp_domain.system_time, k
    frame.profile, frame.depth_units = profile, unit
    sensor.on_video_frame(frame)
    queue.wait_for_frame(10000)
    time.sleep(0.02)
recorded.stop()
recorded.close()
del recorded, recorder
