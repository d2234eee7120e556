// palpate.Result: a measurement of palpate.Contact.
#include "python/src/result.h"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <cstdio>

#include "python/src/arrays.h"

namespace palpate::python {
namespace {

/// True if the pixel at which a point is seen has a measurement.
bool is_seen(const PointCloudView& cloud, const Vec3d& p_C) {
  if (!(p_C.z > 0)) return false;
  const Intrinsics& k = cloud.intrinsics;
  const double u = std::floor(k.fx * p_C.x / p_C.z + k.cx + 0.5);
  const double v = std::floor(k.fy * p_C.y / p_C.z + k.cy + 0.5);
  if (!(u >= 0 && v >= 0 && u < cloud.width && v < cloud.height)) return false;
  return std::isfinite(cloud.z[static_cast<std::size_t>(v * cloud.width + u)]);
}

/// Returns the share of the spheres' volume whose centers are not seen.
double unseen_share(const PyResult& result) {
  if (result.unseen) return *result.unseen;
  if (!result.surface.is_valid()) return 0;
  const auto& surface = nb::cast<PySurface&>(result.surface);
  const PointCloudView& cloud = surface.view.cloud;
  if (cloud.x == nullptr || cloud.gpu != kHostMemory) {
    throw PalpateError("what of the tool is unseen is only known of surfaces in host memory");
  }
  const Pose& X_WT = result.X_WT;
  const Pose X_CT = surface.X_CW * Pose{X_WT.translation, normalized(X_WT.rotation)};
  double unseen = 0;
  for (const Sphere& sphere : result.tool->spheres()) {
    if (!is_seen(cloud, X_CT * to_double(sphere.center))) {
      unseen += sphere_volume(double(sphere.radius));
    }
  }
  return unseen / result.tool->sphere_mass().volume;
}

nb::object vector_of(const Vec3d& v, nb::handle owner) { return view_of(&v.x, {3}, owner); }

nb::object named(const PyResult& self, const char* name) {
  return self.more.contains(name) ? nb::object(self.more[name]) : nb::none();
}

}  // namespace

void bind_result(nb::module_& m) {
  constexpr const char* kFloats = " -> numpy.typing.NDArray[numpy.float64]";
  nb::class_<PyResult>(
      m, "Result",
      R"(A measurement. Volumes times directions: times a stiffness in N/m3 they are newtons.)")
      .def_ro("volume", &PyResult::volume, "Penetration volume of the tool, m3.")
      .def_ro("fraction", &PyResult::fraction, "Volume relative to the whole tool.")
      .def_prop_ro(
          "force", [](nb::handle self) { return vector_of(nb::cast<PyResult&>(self).force, self); },
          nb::sig((std::string("def force(self)") + kFloats).c_str()), "(3,) m3 in W.")
      .def_prop_ro(
          "torque",
          [](nb::handle self) { return vector_of(nb::cast<PyResult&>(self).torque, self); },
          nb::sig((std::string("def torque(self)") + kFloats).c_str()),
          "(3,) m4 in W, about the tool's center of mass.")
      .def_ro("potential", &PyResult::potential,
              "m4: its negative gradient by the pose is force and torque. By the method \"field\".")
      .def_prop_ro("unseen", unseen_share,
                   R"(Share of the tool in unobserved space.

With joined surfaces: more than 20 mm behind everything that any camera has seen, or where no camera
looks. With a single surface that is not joined, by volume of spheres: outside of the image, behind
the camera, or at pixels without depth. Computed on access.)")
      .def_prop_ro(
          "status", [](const PyResult& self) { return static_cast<StepStatus>(self.status.bits); },
          "Unusual conditions; OK is false.")
      .def_prop_ro(
          "stiffness",
          [](nb::handle self) -> nb::object {
            const auto& stiffness = nb::cast<PyResult&>(self).stiffness;
            return stiffness ? view_of(&stiffness->m[0][0], {6, 6}, self) : nb::none();
          },
          nb::sig((std::string("def stiffness(self)") + kFloats + " | None").c_str()),
          R"((6, 6) in W, if requested: for a small translation (m) and rotation (rad, about the center of
mass), force and torque change by minus this matrix times them.)")
      .def_prop_ro(
          "volume_std", [](const PyResult& self) { return self.volume_std; },
          nb::sig("def volume_std(self) -> float | None"),
          "Standard deviation of the volume by the noise of the depth, m3, with std=True.")
      .def_prop_ro(
          "force_std",
          [](nb::handle self) -> nb::object {
            const auto& result = nb::cast<PyResult&>(self);
            return result.volume_std ? vector_of(result.force_std, self) : nb::none();
          },
          nb::sig((std::string("def force_std(self)") + kFloats + " | None").c_str()),
          "(3,) likewise of the force, m3, along the axes of W.")
      .def_prop_ro(
          "torque_std",
          [](nb::handle self) -> nb::object {
            const auto& result = nb::cast<PyResult&>(self);
            return result.volume_std ? vector_of(result.torque_std, self) : nb::none();
          },
          nb::sig((std::string("def torque_std(self)") + kFloats + " | None").c_str()),
          "(3,) likewise of the torque, m4.")
      .def_prop_ro(
          "states",
          [](nb::handle self) -> nb::object {
            const auto& states = nb::cast<PyResult&>(self).spheres.states;
            if (states.empty()) return nb::none();
            return view_of(reinterpret_cast<const std::uint8_t*>(states.data()), {states.size()},
                           self);
          },
          nb::sig("def states(self) -> numpy.typing.NDArray[numpy.uint8] | None"),
          "(N,) of the spheres, if requested: 0 outside, 1 at the surface, 2 inside.")
      .def_prop_ro(
          "decided",
          [](nb::handle self) -> nb::object {
            const auto& deciders = nb::cast<PyResult&>(self).spheres.deciders;
            if (deciders.empty()) return named(nb::cast<PyResult&>(self), "sphere_decided");
            return view_of(deciders.data(), {deciders.size()}, self);
          },
          nb::sig("def decided(self) -> numpy.typing.NDArray[numpy.int8] | None"),
          R"((N,) of the spheres, with states=True and by the method "field": the index of the
surface that determined the depth of a sphere, the one that has it least deep. -1: no camera looks
there, or the sphere is outside.)")
      .def_prop_ro(
          "unseen_spheres",
          [](nb::handle self) -> nb::object {
            const auto& unseen = nb::cast<PyResult&>(self).spheres.unseen;
            if (unseen.empty()) return nb::none();
            return view_of(unseen.data(), {unseen.size()}, self);
          },
          nb::sig("def unseen_spheres(self) -> numpy.typing.NDArray[numpy.uint8] | None"),
          R"((N,) of the spheres, with states=True and by the method "field": 1 if the center is more
than 20 mm behind everything that any camera has seen, or where no camera looks.)")
      .def_prop_ro(
          "clearance", [](const PyResult& self) { return named(self, "clearance"); },
          nb::sig("def clearance(self) -> float | None"), "m, if requested: see Batch.clearance.")
      .def_prop_ro(
          "nearest", [](const PyResult& self) { return named(self, "nearest"); },
          nb::sig("def nearest(self) -> int | None"),
          "The sphere that has it; -1: saturated, far (+limit) or deep (-limit).")
      .def_prop_ro(
          "clearance_gradient",
          [](const PyResult& self) { return named(self, "clearance_gradient"); },
          nb::sig("def clearance_gradient(self) -> numpy.typing.NDArray[numpy.float64] | None"),
          "(6,) by translation and rotation about the center of mass, in W.")
      .def_prop_ro(
          "sphere_depth", [](const PyResult& self) { return named(self, "sphere_depth"); },
          nb::sig("def sphere_depth(self) -> numpy.typing.NDArray[numpy.float32] | None"),
          "(N,) m, if requested.")
      .def_prop_ro(
          "sphere_volume", [](const PyResult& self) { return named(self, "sphere_volume"); },
          nb::sig("def sphere_volume(self) -> numpy.typing.NDArray[numpy.float32] | None"),
          "(N,) m3, if requested.")
      .def_prop_ro(
          "sphere_direction", [](const PyResult& self) { return named(self, "sphere_direction"); },
          nb::sig("def sphere_direction(self) -> numpy.typing.NDArray[numpy.float32] | None"),
          "(N, 3) in W, if requested.")
      .def("__repr__", [](const PyResult& self) {
        char text[160];
        std::snprintf(text, sizeof text,
                      "<palpate.Result: %.4g cm3 (%.3g %%), force %.4g %.4g %.4g m3, status %u>",
                      self.volume * 1e6, self.fraction * 100, self.force.x, self.force.y,
                      self.force.z, self.status.bits);
        return std::string(text);
      });
}

}  // namespace palpate::python
