// palpate.Surface: points and normals of a depth image as arrays, and its depth field at given
// points. The arrays are views of the memory of the sensor where the frame allows it.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "palpate/field/sensor.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "src/field/internal/field_point.h"

namespace palpate::python {
namespace {

/// x, y, z as one array: they lie one after the other in one block.
nb::object channels(const PySurface& surface, const float* const (&at)[3], nb::handle owner) {
  const PointCloudView& cloud = surface.view.cloud;
  if (at[0] == nullptr) throw PalpateError("this surface has no points");
  const std::ptrdiff_t apart = at[1] - at[0];
  if (at[2] - at[1] != apart) throw PalpateError("the points of this surface are not one array");
  const std::size_t shape[] = {std::size_t(cloud.height), std::size_t(cloud.width), 3};
  const std::int64_t strides[] = {cloud.width, 1, apart};
  const bool is_on_gpu = cloud.gpu != kHostMemory;
  if (is_on_gpu) {
    return nb::cast(nb::ndarray<nb::array_api, const float>(
        at[0], 3, shape, owner, strides, nb::dtype<float>(), nb::device::cuda::value, cloud.gpu));
  }
  return nb::cast(nb::ndarray<nb::numpy, const float>(at[0], 3, shape, owner, strides));
}

nb::object points_in_camera(nb::handle self) {
  const auto& surface = nb::cast<PySurface&>(self);
  const PointCloudView& c = surface.view.cloud;
  return channels(surface, {c.x, c.y, c.z}, self);
}

nb::object normals_in_camera(nb::handle self) {
  const auto& surface = nb::cast<PySurface&>(self);
  const PointCloudView& c = surface.view.cloud;
  return channels(surface, {c.nx, c.ny, c.nz}, self);
}

/// Returns points or normals in W: those in C themselves if W is C.
nb::object in_world(nb::handle self, nb::object in_camera, const Vec3d& shift) {
  const auto& surface = nb::cast<PySurface&>(self);
  if (surface.is_in_camera_frame) return in_camera;
  if (surface.view.cloud.gpu != kHostMemory) {
    throw PalpateError(
        "the points of a surface on a GPU are given in its camera's frame: points_C, normals_C");
  }
  const PointCloudView& cloud = surface.view.cloud;
  const auto from = nb::cast<nb::ndarray<const float, nb::ndim<3>, nb::device::cpu>>(in_camera);
  const auto view = from.view();
  const Mat3d R = rotation_matrix(surface.X_WC.rotation);
  std::vector<float> numbers(3 * cloud.size());
  float* to = numbers.data();
  for (std::size_t v = 0; v < view.shape(0); ++v) {
    for (std::size_t u = 0; u < view.shape(1); ++u, to += 3) {
      const Vec3d p = R * Vec3d{view(v, u, 0), view(v, u, 1), view(v, u, 2)} + shift;
      to[0] = static_cast<float>(p.x);
      to[1] = static_cast<float>(p.y);
      to[2] = static_cast<float>(p.z);
    }
  }
  return array_of(std::move(numbers), {view.shape(0), view.shape(1), 3});
}

struct FieldQuestion {
  Doubles points, radii;

  FieldQuestion(const PySurface& surface, nb::handle points_W, nb::handle radii_m)
      : points(points_of(points_W, "points")), radii(doubles_of(radii_m, "radii")) {
    const bool is_one_for_all = radii.ndim() == 0;
    if (!is_one_for_all && (radii.ndim() != 1 || radii.shape(0) != points.shape(0))) {
      const std::string desired = shape_text({points.shape(0)}) + ", one for each point";
      refuse_shape("radii", shape_of(radii), desired.c_str());
    }
    for (std::size_t i = 0; i < radii.size(); ++i) {
      if (!(radii.data()[i] > 0 && std::isfinite(radii.data()[i]))) {
        throw nb::value_error("radii: they have to be positive lengths, m");
      }
    }
    if (surface.view.field.num_levels == 0) throw PalpateError("this surface has no depth field");
    if (surface.view.field.gpu != kHostMemory) {
      throw PalpateError(
          "the field of a surface on a GPU cannot be evaluated point by point; make it with "
          "Sensor(camera, place=\"cpu\"): the values are the same");
    }
  }

  /// Returns phi and its gradient in C at point i.
  FieldSample<double> evaluate(const PySurface& surface, std::size_t i) const {
    const double* p = points.data() + 3 * i;
    const Vec3d p_C = surface.X_CW * Vec3d{p[0], p[1], p[2]};
    return sample_field(surface.view.field, p_C, radii.data()[radii.ndim() == 0 ? 0 : i]);
  }
};

nb::object phi_of(const PySurface& surface, nb::handle points, nb::handle radii) {
  const FieldQuestion question(surface, points, radii);
  std::vector<double> phi(question.points.shape(0));
  {
    const nb::gil_scoped_release no_gil;
    for (std::size_t i = 0; i < phi.size(); ++i) phi[i] = question.evaluate(surface, i).phi;
  }
  const std::size_t num = phi.size();
  return array_of(std::move(phi), {num});
}

nb::object gradient_of(const PySurface& surface, nb::handle points, nb::handle radii) {
  const FieldQuestion question(surface, points, radii);
  const std::size_t num = question.points.shape(0);
  std::vector<double> gradients(3 * num);
  {
    const nb::gil_scoped_release no_gil;
    const Mat3d R = rotation_matrix(surface.X_WC.rotation);
    for (std::size_t i = 0; i < num; ++i) {
      const Vec3d n = R * question.evaluate(surface, i).gradient;
      for (int k = 0; k < 3; ++k) gradients[3 * i + std::size_t(k)] = n[k];
    }
  }
  return array_of(std::move(gradients), {num, 3});
}

}  // namespace

void bind_surface(nb::module_& m) {
  const std::string floats32 = "numpy.typing.NDArray[numpy.float32]";
  nb::class_<PySurface>(
      m, "Surface",
      R"(A surface made by a Sensor from one image. Its arrays stay valid while referenced.)")
      .def_prop_ro(
          "points",
          [](nb::handle self) {
            const Vec3d shift = nb::cast<PySurface&>(self).X_WC.translation;
            return in_world(self, points_in_camera(self), shift);
          },
          nb::sig(array_property("points", floats32.c_str()).c_str()),
          "(H, W, 3) float32, m in W; NaN where there is none. A view if the camera is at the "
          "origin of W.")
      .def_prop_ro(
          "normals", [](nb::handle self) { return in_world(self, normals_in_camera(self), {}); },
          nb::sig(array_property("normals", floats32.c_str()).c_str()),
          "(H, W, 3) float32 in W: unit, out of the surface; NaN where there is none.")
      .def_prop_ro("points_C", points_in_camera,
                   nb::sig(array_property("points_C", floats32.c_str()).c_str()),
                   "(H, W, 3) float32, m in the camera's frame C. Always a view, in the memory of "
                   "the sensor.")
      .def_prop_ro(
          "normals_C", normals_in_camera,
          nb::sig(array_property("normals_C", floats32.c_str()).c_str()),
          "(H, W, 3) float32 in the camera's frame C. Always a view, in the memory of the sensor.")
      .def(
          "phi", phi_of, nb::arg("points"), nb::arg("radii"),
          nb::sig("def phi(self, points: palpate._types.Array, radii: palpate._types.Array | "
                  "float) -> numpy.typing.NDArray[numpy.float64]"),
          R"(The depth field: (M,) m, signed distances of balls from the surface, negative behind it.

points: (M, 3) centers, m in W; NaN for those that are not finite. radii: (M,) or one for all, m.
Computed in double precision.)")
      .def(
          "gradient", gradient_of, nb::arg("points"), nb::arg("radii"),
          nb::sig("def gradient(self, points: palpate._types.Array, radii: palpate._types.Array "
                  "| float) -> numpy.typing.NDArray[numpy.float64]"),
          "The exact gradient of phi with respect to the points: (M, 3) in W, about 1 long, out of "
          "the surface; NaN where phi is.")
      .def_prop_ro(
          "pose", [](const PySurface& self) { return seven_of(self.X_WC); },
          nb::sig(array_property("pose").c_str()),
          "X_WC of its image: (7,) tx ty tz qx qy qz qw, m.")
      .def_prop_ro(
          "time",
          [](const PySurface& self) -> std::optional<double> {
            return std::isnan(self.time) ? std::nullopt : std::optional(self.time);
          },
          "s, as passed to update.")
      .def_prop_ro("place", [](const PySurface& self) { return name_of(self.place); });
}

}  // namespace palpate::python
