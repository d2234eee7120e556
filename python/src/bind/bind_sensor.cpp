// palpate.Camera, palpate.Sensor and palpate.Surface: from depth images to surfaces for contact
// queries.
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>

#include "palpate/field/sensor.h"
#include "palpate/io/formats.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "python/src/gpu_order.h"
#include "python/src/keywords.h"
#include "src/field/internal/field_sample.h"

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

/// Class palpate.Sensor: computes surfaces, each valid as long as Python holds it.
class PySensor {
 public:
  PySensor(const PyCamera& camera, const Place& place, const SensorOptions& options)
      : camera_(camera), place_(place), options_(options) {
    const nb::gil_scoped_release no_gil;
    owners_.push_back(make());
  }

  const PyCamera& camera() const { return camera_; }
  const Place& place() const { return place_; }

  PySurface update(nb::handle given, std::optional<double> time, const nb::object& pose,
                   nb::handle stream) {
    PySurface surface;
    surface.X_WC = pose.is_none() ? camera_.X_WC : pose_of(pose, "pose");
    if (!is_finite(surface.X_WC)) throw nb::value_error("pose: not finite");
    surface.X_CW = inverse(surface.X_WC);
    surface.is_in_camera_frame = surface.X_WC == Pose{};
    surface.time = time.value_or(std::numeric_limits<double>::quiet_NaN());
    surface.place = place_;
    const AnyArray image = dense_of(given, 2, stream);
    const DepthImageView view = view_of_image(image);
    const CallerStream where = stream_of(stream).value_or(CallerStream{});
    const nb::gil_scoped_release no_gil;
    Status status = view.gpu == kHostMemory ? Done{} : wait_for_producers(view.gpu, where);
    if (status) {
      const std::lock_guard lock(mutex_);
      surface.owner = free_owner();
      surface.view = surface.owner->update(view);
      status = surface.owner->status();
    }
    const nb::gil_scoped_acquire gil;
    check(status);
    return surface;
  }

  nb::object update_batch(nb::handle given, nb::handle out, nb::handle stream) {
    const AnyArray images = dense_of(given, 3, stream);
    nb::object result =
        out.is_none() ? nb::cast(PySurfaces{nullptr, {}, camera_.X_WC, place_}) : nb::borrow(out);
    PySurfaces* surfaces = nullptr;
    if (!nb::try_cast<PySurfaces*>(result, surfaces, false) || surfaces == nullptr) {
      throw nb::type_error("out: palpate.Surfaces are taken, which an earlier call gave");
    }
    const bool is_given = !out.is_none();
    const auto num = static_cast<int>(images.shape(0));
    const DepthImageView first = view_of_image(images);
    const std::optional<CallerStream> where = stream_of(stream);
    const nb::gil_scoped_release no_gil;
    Status status = first.gpu == kHostMemory || where ? Done{} : wait_for_producers(first.gpu, {});
    if (status) {
      const std::lock_guard lock(mutex_);
      if (is_given && std::find(owners_.begin(), owners_.end(), surfaces->owner) == owners_.end()) {
        throw nb::value_error("out: another sensor made these surfaces");
      }
      if (surfaces->owner == nullptr) surfaces->owner = free_owner();
      surfaces->batch = surfaces->owner->update_batch(first, num, where);
      status = surfaces->owner->status();
    }
    const nb::gil_scoped_acquire gil;
    check(status);
    return result;
  }

 private:
  std::shared_ptr<Sensor> make() const {
    auto sensor = Sensor::create(camera_.camera, place_, options_);
    if (!sensor) raise(sensor.error());
    return std::make_shared<Sensor>(*std::move(sensor));
  }

  std::shared_ptr<Sensor> free_owner() {
    for (const auto& owner : owners_) {
      if (owner.use_count() == 1) return owner;
    }
    return owners_.emplace_back(make());
  }

  DepthImageView view_of_image(const AnyArray& image) const {
    const auto& [width, height] = std::tie(camera_.camera.width, camera_.camera.height);
    const int gpu = memory_of(image, "depth");
    if (image.dtype() == nb::dtype<std::uint16_t>()) {
      const auto* counts = static_cast<const std::uint16_t*>(image.data());
      return {width, height, counts, camera_.unit, gpu};
    }
    return {width, height, static_cast<const float*>(image.data()), gpu};
  }

  /// (H, W), or (F, H, W), uint16 or float32 row by row, in memory that the sensor reads.
  AnyArray dense_of(nb::handle given, std::size_t num_axes, nb::handle stream) const {
    AnyArray image;
    nb::object plain;
    if (const std::optional<AnyArray> there = array_on_gpu(given, "depth", stream)) {
      image = *there;
    } else if (given = plain = plain_image(given); !nb::try_cast<AnyArray>(given, image, false)) {
      image = AnyArray(numbers_of<float>(given, "depth", "float32"));
    }
    const auto rows = static_cast<std::size_t>(camera_.camera.height);
    const auto columns = static_cast<std::size_t>(camera_.camera.width);
    if (image.ndim() != num_axes || image.shape(num_axes - 2) != rows ||
        image.shape(num_axes - 1) != columns) {
      const std::string size = shape_text({rows, columns});
      const std::string desired =
          num_axes == 2 ? "the camera's " + size : "(F, H, W) with the camera's " + size;
      refuse_shape("depth", shape_of(image), desired.c_str());
    }
    const auto type = image.dtype();
    const bool is_float = type.code == std::uint8_t(nb::dlpack::dtype_code::Float);
    const bool is_counts = type == nb::dtype<std::uint16_t>();
    if (!is_counts && !is_float) {
      throw nb::value_error("depth: uint16 counts or float32 meters are taken, no other type");
    }
    bool is_dense = true;
    std::int64_t stride = 1;
    for (std::size_t axis = num_axes; axis-- > 0; stride *= std::int64_t(image.shape(axis))) {
      is_dense = is_dense && (image.shape(axis) == 1 || image.stride(axis) == stride);
    }
    if (is_dense && (is_counts || type == nb::dtype<float>())) return image;
    if (memory_of(image, "depth") != kHostMemory) {
      throw nb::value_error("depth: an image on a GPU has to be uint16 or float32, row by row");
    }
    const nb::module_ numpy = nb::module_::import_("numpy");
    return nb::cast<AnyArray>(
        numpy.attr("ascontiguousarray")(given, is_counts ? "uint16" : "float32"));
  }

  PyCamera camera_;
  Place place_;
  SensorOptions options_;
  std::vector<std::shared_ptr<Sensor>> owners_;
  std::mutex mutex_;
};

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

constexpr const char* kFloats = "numpy.typing.NDArray[numpy.float64]";

std::string property(const char* name, const char* type = kFloats) {
  return std::string("def ") + name + "(self) -> " + type;
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
          nb::sig(property("distortion").c_str()), "(8,) k1 k2 p1 p2 k3 k4 k5 k6.")
      .def_prop_ro(
          "pose", [](const PyCamera& self) { return seven_of(self.X_WC); },
          nb::sig(property("pose").c_str()), "X_WC: (7,) tx ty tz qx qy qz qw, m.")
      .def("__repr__", [](const PyCamera& self) {
        char text[160];
        const Intrinsics& k = self.camera.intrinsics;
        std::snprintf(text, sizeof text,
                      "<palpate.Camera %d x %d, fx %.6g fy %.6g cx %.6g cy %.6g>",
                      self.camera.width, self.camera.height, k.fx, k.fy, k.cx, k.cy);
        return std::string(text);
      });
}

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
          nb::sig(property("points", floats32.c_str()).c_str()),
          "(H, W, 3) float32, m in W; NaN where there is none. A view if the camera is at the "
          "origin of W.")
      .def_prop_ro(
          "normals", [](nb::handle self) { return in_world(self, normals_in_camera(self), {}); },
          nb::sig(property("normals", floats32.c_str()).c_str()),
          "(H, W, 3) float32 in W: unit, out of the surface; NaN where there is none.")
      .def_prop_ro("points_C", points_in_camera,
                   nb::sig(property("points_C", floats32.c_str()).c_str()),
                   "(H, W, 3) float32, m in the camera's frame C. Always a view, in the memory of "
                   "the sensor.")
      .def_prop_ro(
          "normals_C", normals_in_camera, nb::sig(property("normals_C", floats32.c_str()).c_str()),
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
          nb::sig(property("pose").c_str()), "X_WC of its image: (7,) tx ty tz qx qy qz qw, m.")
      .def_prop_ro(
          "time",
          [](const PySurface& self) -> std::optional<double> {
            return std::isnan(self.time) ? std::nullopt : std::optional(self.time);
          },
          "s, as passed to update.")
      .def_prop_ro("place", [](const PySurface& self) {
        return self.place.backend == Backend::cpu ? std::string("cpu")
                                                  : "cuda:" + std::to_string(self.place.gpu);
      });
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

void bind_sensor(nb::module_& m) {
  bind_camera(m);
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
  bind_surface(m);
  nb::class_<PySensor>(m, "Sensor", R"(Computes a surface from each depth image.

place: "cpu", "cuda" or "cuda:1": where it computes, and the memory of its surfaces.
threads: on a CPU; 0: one per core. The same bits for any number.
joined: for surfaces that are combined with those of other cameras; twice the work.
options: of docs/settings.md [surface] and [field], e.g. max_depth=3.0, unknown="solid".)")
      .def(
          "__init__",
          [](PySensor* self, const PyCamera& camera, const std::string& place, int threads,
             bool joined, nb::kwargs keywords) {
            SensorOptions options;
            options.num_threads = checked_threads(threads);
            options.field.one_of_several = joined;
            SettingTable table;
            add_settings(table, options.surface);
            add_settings(table, options.field);
            apply(keywords, table);
            new (self) PySensor(camera, place_of(place), options);
          },
          nb::arg("camera"), nb::kw_only(), nb::arg("place") = "cpu", nb::arg("threads") = 0,
          nb::arg("joined") = false, nb::arg("options"),
          nb::sig("def __init__(self, camera: Camera, *, place: str = 'cpu', threads: int = 0, "
                  "joined: bool = False, **options: bool | float | str) -> None"))
      .def("update", &PySensor::update, nb::arg("depth"), nb::kw_only(),
           nb::arg("time") = nb::none(), nb::arg("pose") = nb::none(),
           nb::arg("stream") = nb::none(),
           nb::sig("def update(self, depth: palpate._types.Array, *, time: float | None = None, "
                   "pose: palpate._types.Array | None = None, "
                   "stream: palpate._types.Stream | None = None) -> Surface"),
           R"(Computes the surface of an image. Releases the GIL.

depth: (H, W) uint16 counts (0: no measurement, 65535: farther) or float32 meters (0 and NaN: no
    measurement, inf: farther), of any library with DLPack or the buffer protocol; on the GPU of
    this sensor or in host memory.
time: s, stored in the surface. pose: X_WC of this image, if it is not that of the camera.
stream: a CUDA stream, as a number or an object of PyTorch or CuPy: an image on the GPU is read after
    its earlier work. None: after the work of the image's library in its current stream.
A surface does not change while it is referenced; the memory of released ones is reused.)")
      .def(
          "update_batch", &PySensor::update_batch, nb::arg("depth"), nb::kw_only(),
          nb::arg("out") = nb::none(), nb::arg("stream") = nb::none(),
          nb::sig("def update_batch(self, depth: palpate._types.Array, *, "
                  "out: Surfaces | None = None, stream: palpate._types.Stream | None = None) "
                  "-> Surfaces"),
          R"(Computes the depth fields of many images at once, for Contact.measure_batch. Releases the GIL.

depth: (F, H, W) uint16 counts or float32 meters, one image after the other; on the GPU of this
    sensor or in host memory. The values are those of update, to the bit.
out: Surfaces of this sensor to overwrite. stream: as for Contact.measure_batch; the images must
    not change until its work is done.)")
      .def_prop_ro("camera", &PySensor::camera);
}

}  // namespace palpate::python
