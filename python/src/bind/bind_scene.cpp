// palpate.Scene, and the question to it: Contact.measure, measure_batch and any.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <unistd.h>

#include <optional>

#include "palpate/contact/scene.h"
#include "python/src/contact.h"

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

/// The poses of a question, and the arrays that keep them alive.
struct PoseRequest {
  PoseRequest(nb::handle given, nb::handle tools, nb::handle groups)
      : numbers(doubles_of(given, "poses")) {
    query.X_WT = poses_in(numbers, "poses", converted);
    tool_of_pose = indices_of(tools, "tool_of_pose", query.X_WT.size());
    group_of_pose = indices_of(groups, "group_of_pose", query.X_WT.size());
    if (tool_of_pose) query.tool_of_pose = {tool_of_pose->data(), query.X_WT.size()};
    if (!group_of_pose) return;
    query.group_of_pose = {group_of_pose->data(), query.X_WT.size()};
    for (const std::int32_t group : query.group_of_pose) {
      query.num_groups = std::max(query.num_groups, group + 1);
    }
  }

  Doubles numbers;
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

/// Results of all poses, by name.
struct Found {
  std::vector<double> volume, potential, force, torque, stiffness, deviations, unseen, clearance,
      gradient, group_clearance, group_volume;
  std::vector<std::uint32_t> status;
  std::vector<std::int32_t> nearest, decided, group_pose;
  std::vector<float> depth, sphere_volume, direction;
  std::vector<std::int8_t> sphere_decided;
  SceneAnswers answers;

  Found(std::size_t num, std::size_t num_groups, const SceneWants& wants, std::size_t num_spheres)
      : volume(num), potential(num), force(3 * num), torque(3 * num), unseen(num), status(num) {
    answers.contact = {.volume = volume.data(),
                       .potential = potential.data(),
                       .force = force.data(),
                       .torque = torque.data(),
                       .status = status.data()};
    if (wants.stiffness) {
      stiffness.resize(36 * num);
      answers.contact.stiffness = stiffness.data();
    }
    if (wants.noise) {
      deviations.resize(7 * num);
      answers.contact.volume_std = deviations.data();
      answers.contact.force_std = deviations.data() + num;
      answers.contact.torque_std = deviations.data() + 4 * num;
    }
    if (wants.unseen) answers.unseen = unseen.data();
    if (wants.clearance) {
      clearance.resize(num);
      gradient.resize(6 * num);
      nearest.resize(num);
      decided.resize(num);
      answers.clearance = clearance.data();
      answers.clearance_gradient = gradient.data();
      answers.nearest = nearest.data();
      answers.decided = decided.data();
      answers.clearance_limit = wants.limit;
      answers.clearance_smoothing = wants.smoothing;
    }
    if (wants.clearance && num_groups > 0) {
      group_clearance.resize(num_groups);
      group_pose.resize(num_groups);
      group_volume.resize(num_groups);
      answers.group_clearance = group_clearance.data();
      answers.group_pose = group_pose.data();
      answers.group_volume = group_volume.data();
    }
    if (!wants.per_sphere) return;
    depth.resize(num * num_spheres);
    sphere_volume.resize(num * num_spheres);
    direction.resize(3 * num * num_spheres);
    sphere_decided.resize(num * num_spheres);
    answers.sphere_depth = depth.data();
    answers.sphere_volume = sphere_volume.data();
    answers.sphere_direction = direction.data();
    answers.sphere_decided = sphere_decided.data();
    answers.max_spheres = num_spheres;
  }

  /// Moves what was not wanted by name into arrays.
  nb::dict more(std::size_t num, std::size_t num_groups, const SceneWants& wants,
                std::size_t num_spheres) {
    nb::dict to;
    if (wants.unseen) to["unseen"] = array_of(std::move(unseen), {num});
    if (wants.clearance) {
      to["clearance"] = array_of(std::move(clearance), {num});
      to["clearance_gradient"] = array_of(std::move(gradient), {num, 6});
      to["nearest"] = array_of(std::move(nearest), {num});
      to["decided"] = array_of(std::move(decided), {num});
    }
    if (!group_clearance.empty()) {
      to["group_clearance"] = array_of(std::move(group_clearance), {num_groups});
      to["group_pose"] = array_of(std::move(group_pose), {num_groups});
      to["group_volume"] = array_of(std::move(group_volume), {num_groups});
    }
    if (wants.per_sphere) {
      to["sphere_depth"] = array_of(std::move(depth), {num, num_spheres});
      to["sphere_volume"] = array_of(std::move(sphere_volume), {num, num_spheres});
      to["sphere_direction"] = array_of(std::move(direction), {num, num_spheres, 3});
      to["sphere_decided"] = array_of(std::move(sphere_decided), {num, num_spheres});
    }
    return to;
  }
};

nb::object any(PyContact& self, nb::handle given, nb::handle poses, double margin,
               nb::handle tool_of_pose, nb::handle group_of_pose) {
  const PyScene scene = scene_of(given);
  const PoseRequest request(poses, tool_of_pose, group_of_pose);
  const std::size_t num = request.group_of_pose ? static_cast<std::size_t>(request.query.num_groups)
                                                : request.query.X_WT.size();
  std::vector<std::uint8_t> hits(num);
  check(self.with_scenes([&](const SceneContact& contact) {
    return contact.any(scene.scene, request.query, margin, hits.data());
  }));
  return array_of(std::move(hits), {num}).attr("view")("bool");
}

}  // namespace

HeldScene held_scene(nb::handle given) {
  PyScene scene = scene_of(given);
  return {std::move(scene.scene), std::move(scene.cameras), std::move(scene.bodies)};
}

bool is_scene(nb::handle given) { return nb::isinstance<PyScene>(given); }

SceneMeasured measure_scene(PyContact& self, nb::handle given, nb::handle poses, SceneWants wants,
                            nb::handle tool_of_pose, nb::handle group_of_pose,
                            const SceneOut* out) {
  if (wants.noise) check_std(self, true);
  const PyScene scene = scene_of(given);
  // On a GPU it is known of joined cameras alone.
  wants.unseen = !scene.cameras.empty() &&
                 (self.place().backend == Backend::cpu || scene.cameras.size() > 1) &&
                 self.method() == "field" && wants.unseen;
  const PoseRequest request(poses, tool_of_pose, group_of_pose);
  const std::size_t num = request.query.X_WT.size(), num_spheres = self.max_spheres();
  const auto num_groups = static_cast<std::size_t>(request.query.num_groups);
  if (out != nullptr) {
    SceneAnswers answers = out->answers;
    answers.clearance_limit = wants.limit;
    answers.clearance_smoothing = wants.smoothing;
    if (out->num != num) {
      refuse_shape("out", shape_text({out->num}), shape_text({num}).c_str());
    }
    if (answers.max_spheres > 0 && answers.max_spheres != num_spheres) {
      refuse_shape("out: sphere_depth", shape_text({num, answers.max_spheres}),
                   shape_text({num, num_spheres}).c_str());
    }
    check(self.with_scenes([&](const SceneContact& contact) {
      return contact.measure(scene.scene, request.query, answers);
    }));
    return {};
  }
  check_memory(num, 200 + (wants.stiffness ? 288 : 0) + (wants.per_sphere ? 21 * num_spheres : 0));
  Found found(num, num_groups, wants, num_spheres);
  check(self.with_scenes([&](const SceneContact& contact) {
    return contact.measure(scene.scene, request.query, found.answers);
  }));
  SceneMeasured measured;
  measured.more = found.more(num, num_groups, wants, num_spheres);
  measured.volume = std::move(found.volume);
  measured.potential = std::move(found.potential);
  measured.force = std::move(found.force);
  measured.torque = std::move(found.torque);
  measured.stiffness = std::move(found.stiffness);
  measured.deviations = std::move(found.deviations);
  measured.status = std::move(found.status);
  return measured;
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
      nb::sig("def any(self, scene: Scene | Surface | Body | "
              "collections.abc.Sequence[Surface | Body], poses: palpate._types.Array, "
              "margin: float = 0.0, *, tool_of_pose: palpate._types.Array | None = None, "
              "group_of_pose: palpate._types.Array | None = None) "
              "-> numpy.typing.NDArray[numpy.bool_]"),
      R"(Whether the tool comes nearer than `margin` (m): (P,) bool, the clearance is below it.

Ends at the first sphere that does, several times faster than the clearance. With group_of_pose: (G,)
bool, of each group whether one of its poses does. A pose that is not finite does. See measure_batch.)");
}

}  // namespace palpate::python
