// palpate.render_scene: the simulated camera.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>

#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "scenes/noise_model.h"
#include "scenes/scene.h"

namespace palpate::python {
namespace {

nb::tuple render_scene(const std::string& name, double time, bool noise, std::uint64_t seed,
                       int width, int height) {
  if (!std::isfinite(time)) throw nb::value_error("time: not finite");
  auto scene = taken(scenes::make_scene(name));
  if (width != 0 || height != 0) {
    if (width < 8 || height < 8 || width > kMaxImageWidth || height > kMaxImageHeight) {
      throw nb::value_error("width and height: 8 to 4096 pixels, both or none");
    }
    scenes::set_image_size(scene, width, height);
  }
  std::vector<float> depth;
  std::vector<std::uint16_t> counts;
  constexpr double kUnit = 0.001;
  {
    const nb::gil_scoped_release no_gil;
    depth = scenes::render_depth(scene, time);
    if (noise) {
      counts.resize(depth.size());
      scenes::DepthSensor sensor({}, scene.intrinsics, scene.width, scene.height, kUnit, seed);
      sensor.measure(depth, static_cast<std::uint64_t>(std::llround(time * scene.rate)), counts);
    }
  }
  const auto rows = static_cast<std::size_t>(scene.height);
  const auto columns = static_cast<std::size_t>(scene.width);
  nb::object image = noise ? array_of(std::move(counts), {rows, columns})
                           : array_of(std::move(depth), {rows, columns});
  const auto seven = seven_numbers(Pose{});
  return nb::make_tuple(image, PyCamera{{scene.width, scene.height, scene.intrinsics}, kUnit, {}},
                        array_of(std::vector<double>(seven.begin(), seven.end()), {7}));
}

}  // namespace

void bind_scenes(nb::module_& m) {
  m.def("render_scene", render_scene, nb::arg("name"), nb::arg("time") = 0.0, nb::kw_only(),
        nb::arg("noise") = false, nb::arg("seed") = 1, nb::arg("width") = 0, nb::arg("height") = 0,
        nb::sig("def render_scene(name: str, time: float = 0.0, *, noise: bool = False, "
                "seed: int = 1, width: int = 0, height: int = 0) -> "
                "tuple[numpy.typing.NDArray[typing.Any], Camera, "
                "numpy.typing.NDArray[numpy.float64]]"),
        R"(Renders a scene with the simulated depth camera: depth, Camera, X_WC.

name: one of scene_names(). time: s.
depth: (H, W) float32, exact meters, NaN without a surface; with noise uint16 millimeters as from a
    sensor like the Kinect. X_WC: (7,) tx ty tz qx qy qz qw.)");
  m.def("scene_names", &scenes::scene_names, "The simulated scenes.");
}

}  // namespace palpate::python
