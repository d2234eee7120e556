// palpate.Scene, and the question to it: Contact.measure, measure_batch and any.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <unistd.h>

#include <optional>

#include "palpate/contact/scene.h"
#include "python/src/batch.h"
#include "python/src/contact.h"
#include "python/src/made_array.h"

namespace palpate::python {
namespace {

/// Class palpate.Scene. Keeps its surfaces and shapes alive.
struct PyScene {
  Scene scene;
  std::vector<nb::object> cameras, bodies;
  std::string unseen;
};

void add_to(PyScene& scene, nb::handle one, const char* name) {
  if (nb::isinstance<PySurface>(one)) {
    const auto& surface = nb::cast<PySurface&>(one);
    SurfaceView view = surface.view;
    view.X_WC = surface.X_WC;
    scene.scene.surfaces.push_back(view);
    scene.cameras.push_back(nb::borrow(one));
  } else if (nb::isinstance<PyBody>(one)) {
    scene.scene.bodies.emplace_back(nb::cast<PyBody&>(one).placed);
    scene.bodies.push_back(nb::borrow(one));
  } else {
    throw nb::type_error(
        (std::string(name) + ": a palpate.Surface, palpate.Body or a list of them is taken")
            .c_str());
  }
}

void add_all_to(PyScene& scene, nb::handle given, const char* name) {
  if (!nb::isinstance<nb::list>(given) && !nb::isinstance<nb::tuple>(given)) {
    return add_to(scene, given, name);
  }
  for (nb::handle one : nb::borrow<nb::sequence>(given)) add_to(scene, one, name);
}

/// Converts a scene, a surface, a body, or a list of them. These keep the policy of the surfaces.
PyScene scene_of(nb::handle given) {
  if (nb::isinstance<PyScene>(given)) return nb::cast<PyScene&>(given);
  PyScene scene;
  add_all_to(scene, given, "scene");
  return scene;
}

using Indices = nb::ndarray<const std::int32_t, nb::c_contig, nb::device::cpu>;

/// Converts (P,) indices; null for None.
std::optional<Indices> indices_of(nb::handle given, const char* name, std::size_t num) {
  if (given.is_none()) return {};
  Indices indices = numbers_of<std::int32_t>(given, name, "int32");
  if (indices.ndim() != 1 || indices.shape(0) != num) {
    refuse_shape(name, shape_of(indices), (shape_text({num}) + ", one for each pose").c_str());
  }
  return indices;
}

/// The poses of a question in host memory or on a GPU, and the arrays that keep them alive.
struct PoseRequest {
  explicit PoseRequest(const SceneQuestion& question) : stream(stream_of(question.stream)) {
    if (const auto array = array_on_gpu(question.poses, "poses", question.stream)) {
      there = *array;
      query.X_WT = poses_on_gpu(there, "poses");
      query.gpu = there.device_id();
    } else {
      numbers = doubles_of(question.poses, "poses");
      query.X_WT = poses_in(numbers, "poses", converted);
    }
    tool_of_pose = indices_of(question.tool_of_pose, "tool_of_pose", query.X_WT.size());
    group_of_pose = indices_of(question.group_of_pose, "group_of_pose", query.X_WT.size());
    if (tool_of_pose) query.tool_of_pose = {tool_of_pose->data(), query.X_WT.size()};
    if (!group_of_pose) return;
    query.group_of_pose = {group_of_pose->data(), query.X_WT.size()};
    for (const std::int32_t group : query.group_of_pose) {
      query.num_groups = std::max(query.num_groups, group + 1);
    }
  }
  /// The stream of work with arrays on a GPU: without one that of arrays without a stream.
  std::optional<CallerStream> queue(int gpu_of_answers) const {
    const bool is_here = query.gpu == kHostMemory && gpu_of_answers == kHostMemory;
    return stream || is_here ? stream : CallerStream{};
  }

  std::optional<CallerStream> stream;
  Doubles numbers;
  AnyArray there;
  std::vector<Pose> converted;
  std::optional<Indices> tool_of_pose, group_of_pose;
  ScenePoses query;
};

/// Refuses results that no machine like this one can hold.
void check_memory(std::size_t num_poses, std::size_t bytes_each) {
  const auto memory =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGE_SIZE));
  const double size = static_cast<double>(num_poses) * static_cast<double>(bytes_each);
  if (size < 0.8 * memory) return;
  throw PalpateError("the results of " + std::to_string(num_poses) + " poses take " +
                     std::to_string(static_cast<std::int64_t>(size / 1e9)) +
                     " GB, and this machine has " +
                     std::to_string(static_cast<std::int64_t>(memory / 1e9)) +
                     "; ask fewer poses at a time, or without per_sphere");
}

/// Makes the arrays of a batch for what is wanted.
SceneAnswers make_answers(const SceneWants& wants, const ScenePoses& poses, std::size_t num_spheres,
                          PyBatch& batch) {
  const std::size_t num = batch.num;
  SceneAnswers& to = batch.scene;
  const auto make = [&]<class T>(const char* name, T*& at,
                                 std::initializer_list<std::size_t> shape) {
    Made<T> made(poses.gpu, shape);
    at = made.at;
    batch.more[name] = made.array;
  };
  to.contact = batch.answers;
  if (wants.unseen) make("unseen", to.unseen, {num});
  if (wants.clearance) {
    make("clearance", to.clearance, {num});
    make("clearance_gradient", to.clearance_gradient, {num, 6});
    make("nearest", to.nearest, {num});
    make("decided", to.decided, {num});
  }
  const auto num_groups = static_cast<std::size_t>(poses.num_groups);
  if (wants.clearance && num_groups > 0) {
    make("group_clearance", to.group_clearance, {num_groups});
    make("group_pose", to.group_pose, {num_groups});
    make("group_volume", to.group_volume, {num_groups});
  }
  if (wants.per_sphere) {
    make("sphere_depth", to.sphere_depth, {num, num_spheres});
    make("sphere_volume", to.sphere_volume, {num, num_spheres});
    make("sphere_direction", to.sphere_direction, {num, num_spheres, 3});
    make("sphere_decided", to.sphere_decided, {num, num_spheres});
    to.max_spheres = num_spheres;
  }
  return to;
}

void evaluate(PyContact& self, const PyScene& scene, const PoseRequest& request,
              const SceneWants& wants, SceneAnswers answers) {
  answers.clearance_limit = wants.limit;
  answers.clearance_smoothing = wants.smoothing;
  const auto queue = request.queue(answers.contact.gpu);
  check(self.with_scenes([&](const SceneContact& contact) {
    return contact.measure(scene.scene, request.query, answers, queue);
  }));
}

/// The array of the caller for the answers of `any`. ValueError: another shape, type or memory.
std::uint8_t* hits_in(const WritableArray& out, std::size_t num, int gpu) {
  const std::string shape = shape_of(out), desired = shape_text({num});
  if (shape != desired) refuse_shape("out", shape, desired.c_str());
  const bool is_bool = out.dtype() == nb::dtype<bool>();
  if (!is_bool && out.dtype() != nb::dtype<std::uint8_t>()) {
    throw nb::value_error("out: has to be bool or uint8");
  }
  require_dense(out, "out", is_bool ? nb::dtype<bool>() : nb::dtype<std::uint8_t>());
  if (memory_of(out, "out") != gpu) throw nb::value_error("out: is elsewhere than the poses");
  return static_cast<std::uint8_t*>(out.data());
}

/// Returns the array `out` of the caller. TypeError: nothing that its owner lends.
WritableArray writable(nb::handle out, nb::handle stream) {
  try {
    WritableArray here;
    if (const auto there = writable_on_gpu(out, "out", stream)) return *there;
    if (nb::try_cast<WritableArray>(out, here, false)) return here;
  } catch (const nb::python_error&) {
  } catch (const std::bad_cast&) {
  }
  throw nb::type_error(
      "out: not an array of bool or uint8 that can be written; CuPy lends uint8 only");
}

nb::object any(PyContact& self, nb::handle given, nb::handle poses, double margin,
               nb::handle tool_of_pose, nb::handle group_of_pose, nb::handle out,
               nb::handle stream) {
  const PyScene scene = scene_of(given);
  const PoseRequest request({given, poses, tool_of_pose, group_of_pose, stream});
  const int gpu = request.query.gpu;
  const std::size_t num = request.group_of_pose ? static_cast<std::size_t>(request.query.num_groups)
                                                : request.query.X_WT.size();
  WritableArray array;
  std::uint8_t* hits = nullptr;
  nb::object result = nb::borrow(out);
  if (out.is_none()) {
    const Made<std::uint8_t> made(gpu, {num});
    hits = made.at;
    result = made.bools(gpu);
  } else {
    array = writable(out, stream);
    hits = hits_in(array, num, gpu);
  }
  const auto queue = request.queue(gpu);
  check(self.with_scenes([&](const SceneContact& contact) {
    return contact.any(scene.scene, request.query, margin, hits, queue);
  }));
  return result;
}

}  // namespace

HeldScene held_scene(nb::handle given) {
  PyScene scene = scene_of(given);
  return {std::move(scene.scene), std::move(scene.cameras), std::move(scene.bodies)};
}

bool is_scene(nb::handle given) { return nb::isinstance<PyScene>(given); }

std::unique_ptr<PyBatch> measure_scene(PyContact& self, const SceneQuestion& question,
                                       SceneWants wants) {
  const PyScene scene = scene_of(question.scene);
  wants.unseen = !scene.cameras.empty() && self.method() == "field" && wants.unseen;
  const PoseRequest request(question);
  const std::size_t num = request.query.X_WT.size(), num_spheres = self.max_spheres();
  if (request.query.gpu == kHostMemory) {
    const std::size_t by_sphere = wants.per_sphere ? 21 * num_spheres : 0;
    check_memory(num, 200 + (wants.stiffness ? 288 : 0) + by_sphere);
  }
  auto batch = make_batch(num, wants.stiffness, wants.noise, request.query.gpu);
  evaluate(self, scene, request, wants, make_answers(wants, request.query, num_spheres, *batch));
  return batch;
}

void measure_scene(PyContact& self, const SceneQuestion& question, const SceneWants& wants,
                   const PyBatch& out) {
  const PyScene scene = scene_of(question.scene);
  const PoseRequest request(question);
  const std::size_t num = request.query.X_WT.size(), num_spheres = self.max_spheres();
  SceneAnswers answers = out.scene;
  answers.contact = out.answers;
  if (out.num != num) refuse_shape("out", shape_text({out.num}), shape_text({num}).c_str());
  if (answers.max_spheres > 0 && answers.max_spheres != num_spheres) {
    refuse_shape("out: sphere_depth", shape_text({num, answers.max_spheres}),
                 shape_text({num, num_spheres}).c_str());
  }
  evaluate(self, scene, request, wants, answers);
}

void bind_scene(nb::module_& m, nb::class_<PyContact>& contact) {
  nb::class_<PyScene>(
      m, "Scene",
      R"(Everything that a query is measured against: the depth hull of all cameras, and all CAD bodies.

cameras: surfaces, of several cameras by sensors made with joined=True. bodies: palpate.Body.
unseen: what occluded space is: "solid", or beyond `thickness` (m) behind a surface "free", or "fade",
    without force. It replaces the option of the sensors.
ValueError: another word. TypeError: neither surfaces nor bodies.)")
      .def(
          "__init__",
          [](PyScene* self, nb::handle cameras, nb::handle bodies, const std::string& unseen,
             double thickness) {
            PyScene made;
            add_all_to(made, cameras, "cameras");
            add_all_to(made, bodies, "bodies");
            made.unseen = unseen;
            made.scene.thickness = thickness;
            constexpr auto kNames = names_of(UnseenSpace{});
            for (std::size_t i = 0; i < kNames.size(); ++i) {
              if (unseen == kNames[i]) made.scene.unseen = static_cast<UnseenSpace>(i);
            }
            if (!made.scene.unseen) {
              throw nb::value_error(
                  ("unseen: '" + unseen + "' is not solid, free or fade").c_str());
            }
            if (!(thickness > 0)) throw nb::value_error("thickness: has to be above 0, in m");
            new (self) PyScene(std::move(made));
          },
          nb::arg("cameras") = nb::list(), nb::arg("bodies") = nb::list(), nb::kw_only(),
          nb::arg("unseen") = "solid", nb::arg("thickness") = 0.05,
          nb::sig("def __init__(self, cameras: Surface | collections.abc.Sequence[Surface] = (), "
                  "bodies: Body | collections.abc.Sequence[Body] = (), *, unseen: str = 'solid', "
                  "thickness: float = 0.05) -> None"))
      .def_prop_ro(
          "cameras", [](const PyScene& self) { return nb::tuple(nb::cast(self.cameras)); },
          nb::sig("def cameras(self) -> tuple[Surface, ...]"), "The surfaces.")
      .def_prop_ro(
          "bodies", [](const PyScene& self) { return nb::tuple(nb::cast(self.bodies)); },
          nb::sig("def bodies(self) -> tuple[Body, ...]"), "The bodies.")
      .def_ro("unseen", &PyScene::unseen, "What occluded space is.");
  contact.def(
      "any", any, nb::arg("scene"), nb::arg("poses"), nb::arg("margin") = 0.0, nb::kw_only(),
      nb::arg("tool_of_pose") = nb::none(), nb::arg("group_of_pose") = nb::none(),
      nb::arg("out") = nb::none(), nb::arg("stream") = nb::none(),
      nb::sig("def any(self, scene: Scene | Surface | Body | "
              "collections.abc.Sequence[Surface | Body], poses: palpate._types.Array, "
              "margin: float = 0.0, *, tool_of_pose: palpate._types.Array | None = None, "
              "group_of_pose: palpate._types.Array | None = None, "
              "out: palpate._types.Array | None = None, "
              "stream: palpate._types.Stream | None = None) "
              "-> palpate._types.Array"),
      R"(Whether the tool comes nearer than `margin` (m): (P,) bool, the clearance is below it.

Ends at the first sphere that does, several times faster than the clearance. With group_of_pose: (G,)
bool, of each group whether one of its poses does. A pose that is not finite does. The array lies where
the poses are, and is new unless you give it: `out`, bool or uint8, which a CUDA graph needs. See
measure_batch. ValueError: `out` of another shape, type or memory.)");
}

}  // namespace palpate::python
