// palpate.Contact.measure_batch: many poses in one call.
#include <nanobind/stl/unique_ptr.h>

#include <optional>
#include <utility>

#include "python/src/batch.h"
#include "python/src/batch_layout.h"
#include "python/src/contact.h"

namespace palpate::python {

std::unique_ptr<PyBatch> make_batch(std::size_t num, bool with_stiffness, bool with_std, int gpu) {
  auto batch = std::make_unique<PyBatch>();
  batch->num = num;
  const std::size_t size = num * (PyBatch::kPerPose + (with_stiffness ? PyBatch::kStiffness : 0) +
                                  (with_std ? PyBatch::kStd : 0));
  if (gpu == kHostMemory) {
    batch->numbers.resize(size);
    batch->status.resize(num);
    batch->lay_out(batch->numbers.data(), batch->status.data(), with_stiffness, with_std, gpu);
    return batch;
  }
#ifdef PALPATE_CUDA
  batch->memory = std::make_unique<gpu::Memory>(gpu);
  auto* const numbers = batch->memory->take<double>(size);
  auto* const status = batch->memory->take<std::uint32_t>(num);
  check(batch->memory->status());
  batch->lay_out(numbers, status, with_stiffness, with_std, gpu);
#endif
  return batch;
}

namespace {

void make_batch_over(PyBatch* self, nb::handle volume, nb::handle potential, nb::handle force,
                     nb::handle torque, nb::handle stiffness, nb::handle status,
                     nb::handle volume_std, nb::handle force_std, nb::handle torque_std,
                     nb::handle clearance, nb::handle clearance_gradient, nb::handle nearest,
                     nb::handle decided, nb::handle unseen, nb::handle sphere_depth,
                     nb::handle sphere_volume, nb::handle sphere_direction,
                     nb::handle sphere_decided) {
  PyBatch batch;
  Layout layout(batch);
  BatchAnswers& answers = batch.answers;
  answers.volume = layout.take<double>(volume, "volume", {});
  answers.potential = layout.take<double>(potential, "potential", {});
  answers.force = layout.take<double>(force, "force", {3});
  answers.torque = layout.take<double>(torque, "torque", {3});
  answers.stiffness = layout.take<double>(stiffness, "stiffness", {6, 6});
  answers.status = layout.take<std::uint32_t>(status, "status", {});
  answers.volume_std = layout.take<double>(volume_std, "volume_std", {});
  answers.force_std = layout.take<double>(force_std, "force_std", {3});
  answers.torque_std = layout.take<double>(torque_std, "torque_std", {3});
  SceneAnswers& scene = batch.scene;
  scene.clearance = layout.take_named<double>(clearance, "clearance", {});
  scene.clearance_gradient =
      layout.take_named<double>(clearance_gradient, "clearance_gradient", {6});
  scene.nearest = layout.take_named<std::int32_t>(nearest, "nearest", {});
  scene.decided = layout.take_named<std::int32_t>(decided, "decided", {});
  scene.unseen = layout.take_named<double>(unseen, "unseen", {});
  scene.sphere_depth = layout.take_spheres<float>(sphere_depth, "sphere_depth");
  scene.sphere_volume = layout.take_spheres<float>(sphere_volume, "sphere_volume");
  scene.sphere_direction = layout.take_spheres<float>(sphere_direction, "sphere_direction", {3});
  scene.sphere_decided = layout.take_spheres<std::int8_t>(sphere_decided, "sphere_decided");
  if (batch.given.empty()) throw nb::value_error("Batch: give one array or more");
  new (self) PyBatch(std::move(batch));
}

template <class T>
nb::object array_in(nb::handle self, const T* at, std::initializer_list<std::size_t> shape) {
  if (at == nullptr) throw PalpateError("this batch was given no array for that");
  const int gpu = nb::cast<PyBatch&>(self).answers.gpu;
  if (gpu == kHostMemory) return view_of(at, shape, self);
  return nb::cast(nb::ndarray<nb::array_api, const T>(at, shape, self, {}, nb::dtype<T>(),
                                                      nb::device::cuda::value, gpu));
}

/// The surfaces of a batch, and the objects that keep them alive.
struct SurfaceArgument {
  std::vector<SurfaceView> views;
  std::vector<Pose> X_WC;  // empty: all cameras are at the origin of W
  SurfaceBatch batch;
  std::vector<nb::object> owners;

  explicit SurfaceArgument(nb::handle given) {
    PySurfaces* many = nullptr;
    if (nb::try_cast<PySurfaces*>(given, many, false) && many != nullptr) {
      owners.push_back(nb::borrow(given));
      batch = many->batch;
      if (!(many->X_WC == Pose{})) X_WC.assign(static_cast<std::size_t>(batch.size()), many->X_WC);
      return;
    }
    bool is_anywhere = false;
    const auto add = [&](nb::handle one) {
      PySurface* surface = nullptr;
      if (!nb::try_cast<PySurface*>(one, surface, false) || surface == nullptr) {
        throw nb::type_error(
            "surfaces: a palpate.Surface, a list of them or palpate.Surfaces is taken");
      }
      owners.push_back(nb::borrow(one));
      views.push_back(surface->view);
      X_WC.push_back(surface->X_WC);
      is_anywhere = is_anywhere || !surface->is_in_camera_frame;
    };
    if (nb::isinstance<nb::list>(given) || nb::isinstance<nb::tuple>(given)) {
      for (nb::handle one : nb::borrow<nb::sequence>(given)) add(one);
      if (views.empty()) throw nb::value_error("surfaces: the list is empty");
    } else {
      add(given);
    }
    if (!is_anywhere) X_WC.clear();
    batch = SurfaceBatch(views);
  }
};

/// Bodies in place of surfaces: one, or a list that begins with one; empty: none.
std::vector<PyBody> bodies_of(nb::handle given) {
  std::vector<PyBody> bodies;
  PyBody* body = nullptr;
  if (nb::try_cast<PyBody*>(given, body, false) && body != nullptr) return {*body};
  if (!nb::isinstance<nb::list>(given) && !nb::isinstance<nb::tuple>(given)) return {};
  for (nb::handle one : nb::borrow<nb::sequence>(given)) {
    if (!nb::try_cast<PyBody*>(one, body, false) || body == nullptr) {
      if (bodies.empty()) return {};
      throw nb::type_error("surfaces: a list has bodies or surfaces, not both");
    }
    bodies.push_back(*body);
  }
  return bodies;
}

/// Poses and surface indices of a batch, and the arrays that keep them alive.
struct PoseArgument {
  Doubles numbers_of_poses;  // of the caller, where they are as they have to be
  std::vector<Pose> poses;
  AnyArray poses_there, surface_of_pose_there;
  nb::ndarray<const std::int32_t, nb::c_contig, nb::device::cpu> surface_of_pose;
  PoseBatch batch;

  PoseArgument(nb::handle given, nb::handle numbers, nb::handle stream) {
    const std::optional<AnyArray> array = array_on_gpu(given, "poses", stream);
    if (array) {
      poses_there = *array;
      batch.gpu = array->device_id();
      batch.X_WT = poses_on_gpu(poses_there, "poses");
    } else {
      numbers_of_poses = doubles_of(given, "poses");
      batch.X_WT = poses_in(numbers_of_poses, "poses", poses);
    }
    if (!numbers.is_none()) add_numbers(numbers, stream);
  }

 private:
  void add_numbers(nb::handle given, nb::handle stream) {
    std::size_t num = 0;
    std::string shape;
    if (batch.gpu == kHostMemory) {
      surface_of_pose = numbers_of<std::int32_t>(given, "surface_of_pose", "int32");
      num = surface_of_pose.ndim() == 1 ? surface_of_pose.shape(0) : 0;
      shape = shape_of(surface_of_pose);
      batch.surface_of_pose = {surface_of_pose.data(), num};
    } else {
      const std::optional<AnyArray> on_gpu = array_on_gpu(given, "surface_of_pose", stream);
      if (!on_gpu || on_gpu->device_id() != batch.gpu) {
        throw nb::value_error("surface_of_pose: has to be on the GPU where the poses are");
      }
      const AnyArray& array = surface_of_pose_there = *on_gpu;
      require_dense(array, "surface_of_pose", nb::dtype<std::int32_t>());
      num = array.ndim() == 1 ? array.shape(0) : 0;
      shape = shape_of(array);
      batch.surface_of_pose = {static_cast<const std::int32_t*>(array.data()), num};
    }
    const std::size_t desired = batch.X_WT.size();
    if (num == desired && shape != "()") return;
    refuse_shape("surface_of_pose", shape, (shape_text({desired}) + ", one for each pose").c_str());
  }
};

}  // namespace

nb::object measure_batch(PyContact& self, nb::handle surfaces, nb::handle poses,
                         nb::handle surface_of_pose, bool stiffness, bool with_std, nb::handle out,
                         nb::handle stream) {
  if (with_std) check_std(self);
  const std::vector<PyBody> bodies = bodies_of(surfaces);
  if (!bodies.empty() && (self.place().backend != Backend::cpu || self.method() != "field")) {
    throw PalpateError(
        "batches against bodies are measured on the CPU by the method field: create the contact "
        "with Contact(tool, \"field\", place=\"cpu\")");
  }
  const std::optional<SurfaceArgument> fields =
      bodies.empty() ? std::optional<SurfaceArgument>(surfaces) : std::nullopt;
  PoseArgument given(poses, surface_of_pose, stream);
  const bool is_on_gpu = given.batch.gpu != kHostMemory;
  if (is_on_gpu && !fields) {
    throw PalpateError(
        "batches against bodies take poses in host memory, where they are measured: copy them "
        "there");
  }
  if (fields) given.batch.X_WC = fields->X_WC;
  const std::size_t num = given.batch.X_WT.size();
  nb::object result;
  if (out.is_none()) {
    const bool is_there = self.place().backend == Backend::cuda;
    result =
        nb::cast(make_batch(num, stiffness, with_std, is_there ? self.place().gpu : kHostMemory));
  } else {
    PyBatch* batch = nullptr;
    if (!nb::try_cast<PyBatch*>(out, batch, false) || batch == nullptr) {
      throw nb::type_error("out: a palpate.Batch is taken, which an earlier call gave");
    }
    if (batch->num != num || batch->has_stiffness() != stiffness || batch->has_std() != with_std) {
      const std::string desired = shape_text({num}) +
                                  (stiffness ? ", with stiffness" : ", without stiffness") +
                                  (with_std ? ", with std" : "");
      refuse_shape("out", shape_text({batch->num}), desired.c_str());
    }
    result = nb::borrow(out);
  }
  const BatchAnswers answers = nb::cast<PyBatch&>(result).answers;
  if (!fields) {
    std::vector<PlacedBody> placed;
    std::vector<PyTool> shapes;
    for (const PyBody& body : bodies) {
      placed.push_back(body.placed);
      shapes.push_back(body.shape);
    }
    check(self.measure_bodies(placed, std::move(shapes), given.batch, answers));
    return result;
  }
  auto where = stream_of(stream);
  if (!where && is_on_gpu) where.emplace();
  check(self.alone([&](const Contact& contact) {
    return contact.measure_batch(fields->batch, given.batch, answers, where);
  }));
  return result;
}

void bind_batch(nb::module_& m) {
  constexpr const char* kFloats = " -> numpy.typing.NDArray[numpy.float64]";
  const auto property = [](const char* name, const char* type) {
    return std::string("def ") + name + "(self)" + type;
  };
  nb::class_<PySurfaces>(
      m, "Surfaces",
      R"(The depth fields of many images from Sensor.update_batch. They stay valid while referenced.)")
      .def("__len__", [](const PySurfaces& self) { return self.batch.size(); })
      .def_prop_ro("place", [](const PySurfaces& self) { return name_of(self.place); });

  nb::class_<PyBatch> batch_class(
      m, "Batch",
      R"(Results of Contact.measure_batch for P poses, in the memory of the contact: NumPy arrays, or arrays
with DLPack on its GPU. Volumes times directions: multiply by a stiffness in N/m3 to get newtons.

Created over your own arrays (any library with DLPack), it is an `out` that writes into these only;
others are not computed. float64, status uint32, nearest and decided int32, of spheres float32 and int8;
row-major, all for P poses and in one memory. The names from `clearance` on are results of scenes.
ValueError: another shape, type or memory.)");
  add_scene_results(batch_class);
  batch_class
      .def("__init__", make_batch_over, nb::kw_only(), nb::arg("volume") = nb::none(),
           nb::arg("potential") = nb::none(), nb::arg("force") = nb::none(),
           nb::arg("torque") = nb::none(), nb::arg("stiffness") = nb::none(),
           nb::arg("status") = nb::none(), nb::arg("volume_std") = nb::none(),
           nb::arg("force_std") = nb::none(), nb::arg("torque_std") = nb::none(),
           nb::arg("clearance") = nb::none(), nb::arg("clearance_gradient") = nb::none(),
           nb::arg("nearest") = nb::none(), nb::arg("decided") = nb::none(),
           nb::arg("unseen") = nb::none(), nb::arg("sphere_depth") = nb::none(),
           nb::arg("sphere_volume") = nb::none(), nb::arg("sphere_direction") = nb::none(),
           nb::arg("sphere_decided") = nb::none(),
           nb::sig("def __init__(self, *, volume: palpate._types.Array | None = None, "
                   "potential: palpate._types.Array | None = None, "
                   "force: palpate._types.Array | None = None, "
                   "torque: palpate._types.Array | None = None, "
                   "stiffness: palpate._types.Array | None = None, "
                   "status: palpate._types.Array | None = None, "
                   "volume_std: palpate._types.Array | None = None, "
                   "force_std: palpate._types.Array | None = None, "
                   "torque_std: palpate._types.Array | None = None, "
                   "clearance: palpate._types.Array | None = None, "
                   "clearance_gradient: palpate._types.Array | None = None, "
                   "nearest: palpate._types.Array | None = None, "
                   "decided: palpate._types.Array | None = None, "
                   "unseen: palpate._types.Array | None = None, "
                   "sphere_depth: palpate._types.Array | None = None, "
                   "sphere_volume: palpate._types.Array | None = None, "
                   "sphere_direction: palpate._types.Array | None = None, "
                   "sphere_decided: palpate._types.Array | None = None) -> None"))
      .def("__len__", [](const PyBatch& self) { return self.num; })
      .def_prop_ro(
          "volume",
          [](nb::handle self) {
            const auto& b = nb::cast<PyBatch&>(self);
            return array_in(self, b.answers.volume, {b.num});
          },
          nb::sig(property("volume", kFloats).c_str()), "(P,) penetration volume, m3.")
      .def_prop_ro(
          "potential",
          [](nb::handle self) {
            const auto& b = nb::cast<PyBatch&>(self);
            return array_in(self, b.answers.potential, {b.num});
          },
          nb::sig(property("potential", kFloats).c_str()),
          "(P,) m4: its negative gradient is force and torque.")
      .def_prop_ro(
          "force",
          [](nb::handle self) {
            const auto& b = nb::cast<PyBatch&>(self);
            return array_in(self, b.answers.force, {b.num, 3});
          },
          nb::sig(property("force", kFloats).c_str()), "(P, 3) m3 in W.")
      .def_prop_ro(
          "torque",
          [](nb::handle self) {
            const auto& b = nb::cast<PyBatch&>(self);
            return array_in(self, b.answers.torque, {b.num, 3});
          },
          nb::sig(property("torque", kFloats).c_str()),
          "(P, 3) m4 in W, about the tool's center of mass.")
      .def_prop_ro(
          "stiffness",
          [](nb::handle self) -> nb::object {
            const auto& b = nb::cast<PyBatch&>(self);
            return b.has_stiffness() ? array_in(self, b.answers.stiffness, {b.num, 6, 6})
                                     : nb::none();
          },
          nb::sig((property("stiffness", kFloats) + " | None").c_str()),
          "(P, 6, 6) in W, if requested; see Result.stiffness.")
      .def_prop_ro(
          "status",
          [](nb::handle self) {
            const auto& b = nb::cast<PyBatch&>(self);
            return array_in(self, b.answers.status, {b.num});
          },
          nb::sig(property("status", " -> numpy.typing.NDArray[numpy.uint32]").c_str()),
          "(P,) uint32: the bits of palpate.Status.");
  const auto add_std = [&](const char* name, double* BatchAnswers::*array, const char* text) {
    batch_class.def_prop_ro(
        name,
        [array](nb::handle self) -> nb::object {
          const auto& b = nb::cast<PyBatch&>(self);
          if (!b.has_std()) return nb::none();
          if (array == &BatchAnswers::volume_std) return array_in(self, b.answers.*array, {b.num});
          return array_in(self, b.answers.*array, {b.num, 3});
        },
        nb::sig((property(name, kFloats) + " | None").c_str()), text);
  };
  add_std("volume_std", &BatchAnswers::volume_std, "(P,) m3, if requested; see Result.volume_std.");
  add_std("force_std", &BatchAnswers::force_std, "(P, 3) m3, likewise.");
  add_std("torque_std", &BatchAnswers::torque_std, "(P, 3) m4, likewise.");
}

}  // namespace palpate::python
