// palpate.Sensor: from depth images to surfaces for contact queries.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <limits>
#include <mutex>
#include <optional>
#include <tuple>

#include "palpate/field/sensor.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "python/src/gpu_order.h"
#include "python/src/keywords.h"

namespace palpate::python {
namespace {

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

}  // namespace

void bind_sensor(nb::module_& m) {
  bind_camera(m);
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
            options.wants_depth_change = true;  // its surfaces are for every method
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
