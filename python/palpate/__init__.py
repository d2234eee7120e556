"""Feel what a depth camera sees: from depth images and CAD tools to forces.

    tool = palpate.load_tool("stylus.palp")
    sensor = palpate.Sensor(palpate.Camera(640, 480, 525, 525, 319.5, 239.5))
    contact = palpate.Contact(tool)
    result = contact.measure(sensor.update(depth), X_WT)

SI units. Frames: W the world, C the camera (x right, y down, z forward), T the tool; X_WT is the
pose of T in W, (4, 4) or (7,) tx ty tz qx qy qz qw. Arrays come from any library with DLPack or the
buffer protocol and are not copied if type and place match. Failures raise palpate.Error; arrays of
a wrong shape raise ValueError.
"""

from palpate._core import (
    Batch,
    Body,
    Camera,
    CameraFrames,
    Contact,
    Error,
    PushedCamera,
    RecordedFrames,
    Result,
    Robot,
    Scene,
    Sensor,
    Status,
    Surface,
    Surfaces,
    Tick,
    Tool,
    __version__,
    load_depth_png,
    load_tool,
    pack,
    pack_file,
    render_scene,
    scene_names,
)
from palpate._run import Run, touch

__all__ = [
    "Batch",
    "Body",
    "Camera",
    "CameraFrames",
    "Contact",
    "Error",
    "PushedCamera",
    "RecordedFrames",
    "Result",
    "Robot",
    "Run",
    "Scene",
    "Sensor",
    "Status",
    "Surface",
    "Surfaces",
    "Tick",
    "Tool",
    "__version__",
    "load_depth_png",
    "load_tool",
    "pack",
    "pack_file",
    "render_scene",
    "scene_names",
    "touch",
]
