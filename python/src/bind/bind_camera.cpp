// palpate.Camera, a depth camera with its unit and pose, and depth images from files.
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/string.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <tuple>

#include "palpate/io/formats.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"

namespace palpate::python {
namespace {

Distortion distortion_of(nb::handle given) {
  const Doubles k = doubles_of(given, "distortion");
  const std::size_t num = k.ndim() == 1 ? k.shape(0) : 0;
  if (num != 4 && num != 5 && num != 8) {
    refuse_shape("distortion", shape_of(k), "(4,), (5,) or (8,): k1 k2 p1 p2 [k3 [k4 k5 k6]]");
  }
  Distortion d{k.data()[0], k.data()[1], k.data()[2], k.data()[3]};
  if (num > 4) d.k3 = k.data()[4];
  if (num > 5) std::tie(d.k4, d.k5, d.k6) = std::tuple(k.data()[5], k.data()[6], k.data()[7]);
  return d;
}

PyCamera make_camera(int width, int height, double fx, double fy, double cx, double cy, double unit,
                     const nb::object& distortion, const nb::object& pose) {
  PyCamera made{{width, height, {fx, fy, cx, cy}}, unit, {}};
  if (!distortion.is_none()) made.camera.distortion = distortion_of(distortion);
  if (!pose.is_none()) made.X_WC = pose_of(pose, "pose");
  if (!(unit > 0 && unit <= 1)) {
    throw nb::value_error("unit: meters per count, more than 0 and at most 1");
  }
  if (!is_finite(made.X_WC)) throw nb::value_error("pose: not finite");
  return made;
}

}  // namespace

DepthStreamInfo PyCamera::stream() const {
  DepthStreamInfo info;
  info.width = camera.width;
  info.height = camera.height;
  info.intrinsics = camera.intrinsics;
  info.unit = unit;
  info.distortion = camera.distortion;
  return info;
}

void bind_camera(nb::module_& m) {
  nb::class_<PyCamera>(
      m, "Camera",
      R"(A depth camera: a pinhole, x right, y down, z forward (frame C), and its pose.

width, height: pixels, 8 to 4096. fx, fy, cx, cy: pixels, pixel centers at whole numbers.
unit: meters per count of uint16 images.
distortion: k1 k2 p1 p2 [k3 [k4 k5 k6]] as in OpenCV and ROS; images are undistorted.
pose: X_WC, (4, 4) or (7,) tx ty tz qx qy qz qw, pose of the camera in the world W.)")
      .def(
          "__init__",
          [](PyCamera* self, int width, int height, double fx, double fy, double cx, double cy,
             double unit, nb::object distortion, nb::object pose) {
            new (self) PyCamera(make_camera(width, height, fx, fy, cx, cy, unit, distortion, pose));
          },
          nb::arg("width"), nb::arg("height"), nb::arg("fx"), nb::arg("fy"), nb::arg("cx"),
          nb::arg("cy"), nb::kw_only(), nb::arg("unit") = 0.001, nb::arg("distortion") = nb::none(),
          nb::arg("pose") = nb::none(),
          nb::sig("def __init__(self, width: int, height: int, fx: float, fy: float, cx: float, "
                  "cy: float, *, unit: float = 0.001, "
                  "distortion: palpate._types.Array | None = None, "
                  "pose: palpate._types.Array | None = None) -> None"))
      .def_prop_ro(
          "width", [](const PyCamera& self) { return self.camera.width; }, "Pixels.")
      .def_prop_ro(
          "height", [](const PyCamera& self) { return self.camera.height; }, "Pixels.")
      .def_prop_ro(
          "fx", [](const PyCamera& self) { return self.camera.intrinsics.fx; }, "Pixels.")
      .def_prop_ro(
          "fy", [](const PyCamera& self) { return self.camera.intrinsics.fy; }, "Pixels.")
      .def_prop_ro(
          "cx", [](const PyCamera& self) { return self.camera.intrinsics.cx; }, "Pixels.")
      .def_prop_ro(
          "cy", [](const PyCamera& self) { return self.camera.intrinsics.cy; }, "Pixels.")
      .def_prop_ro(
          "unit", [](const PyCamera& self) { return self.unit; }, "Meters per count.")
      .def_prop_ro(
          "distortion",
          [](const PyCamera& self) {
            const Distortion& d = self.camera.distortion;
            return array_of<double>({d.k1, d.k2, d.p1, d.p2, d.k3, d.k4, d.k5, d.k6}, {8});
          },
          nb::sig(array_property("distortion").c_str()), "(8,) k1 k2 p1 p2 k3 k4 k5 k6.")
      .def_prop_ro(
          "pose", [](const PyCamera& self) { return seven_of(self.X_WC); },
          nb::sig(array_property("pose").c_str()), "X_WC: (7,) tx ty tz qx qy qz qw, m.")
      .def("__repr__", [](const PyCamera& self) {
        char text[160];
        const Intrinsics& k = self.camera.intrinsics;
        std::snprintf(text, sizeof text,
                      "<palpate.Camera %d x %d, fx %.6g fy %.6g cx %.6g cy %.6g>",
                      self.camera.width, self.camera.height, k.fx, k.fy, k.cx, k.cy);
        return std::string(text);
      });
  m.def(
      "load_depth_png",
      [](const std::filesystem::path& path) {
        DepthFrame frame;
        {
          const nb::gil_scoped_release no_gil;
          frame = taken(palpate::load_depth_png(path));
        }
        return array_of(std::move(frame.pixels), {static_cast<std::size_t>(frame.height),
                                                  static_cast<std::size_t>(frame.width)});
      },
      nb::arg("path"),
      nb::sig("def load_depth_png(path: str | os.PathLike[str]) -> "
              "numpy.typing.NDArray[numpy.uint16]"),
      "Reads a 16-bit PNG depth image: (H, W) uint16 counts; 0: no measurement.");
}

}  // namespace palpate::python
