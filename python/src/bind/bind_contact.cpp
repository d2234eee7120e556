// palpate.Contact: how much of a tool is inside a surface, and the wrench that follows.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <memory>
#include <optional>

#include "python/src/batch.h"
#include "python/src/bindings.h"
#include "python/src/contact.h"
#include "python/src/result.h"

namespace palpate::python {
namespace {

/// Converts a surface, or a list of them.
std::vector<nb::object> surfaces_of(nb::handle given) {
  if (nb::isinstance<PySurface>(given)) return {nb::borrow(given)};
  std::vector<nb::object> surfaces;
  if (nb::isinstance<nb::list>(given) || nb::isinstance<nb::tuple>(given)) {
    for (nb::handle one : given) {
      if (!nb::isinstance<PySurface>(one)) break;
      surfaces.push_back(nb::borrow(one));
    }
    if (!surfaces.empty() && surfaces.size() == nb::len(given)) return surfaces;
  }
  throw nb::type_error("surface: a palpate.Surface or a list of them is taken");
}

/// Checks that this contact can measure the surfaces. Error: they are on a GPU, and it is not.
void check_surfaces(const std::vector<nb::object>& surfaces, const PyContact& contact) {
  for (const nb::object& one : surfaces) {
    const Place& where = nb::cast<PySurface&>(one).place;
    if (where.backend == Backend::cpu || contact.place().backend != Backend::cpu) continue;
    const std::string gpu = std::to_string(where.gpu);
    throw PalpateError("a surface in the memory of GPU " + gpu +
                       " was given to a contact on the CPU; create the contact with place=\"cuda:" +
                       gpu + "\", or the sensor with place=\"cpu\"");
  }
  if (surfaces.size() < 2) return;
  if (surfaces.size() > kMaxCameras) {
    throw nb::value_error("surface: at most 16 surfaces are joined");
  }
  if (contact.method() != "field") {
    throw PalpateError("surfaces of several cameras are joined by the method \"field\" alone");
  }
  for (const nb::object& one : surfaces) {
    const SurfaceView& view = nb::cast<PySurface&>(one).view;
    if (view.field.num_levels > 0 && view.role != SurfaceRole::one_of_several) {
      throw PalpateError(
          "surfaces of several cameras are joined by what each has seen to be free: make them with "
          "Sensor(camera, joined=True)");
    }
  }
}

PyResult measure(PyContact& self, nb::handle given, nb::handle pose, bool with_stiffness,
                 bool with_std, bool with_states) {
  if (with_std) check_std(self);
  const std::vector<nb::object> surfaces = surfaces_of(given);
  // Same bits as in a batch, which does not normalize quaternions.
  const Pose X_WT = surfaces.size() == 1 ? given_pose(pose, "pose") : pose_of(pose, "pose");
  check_surfaces(surfaces, self);
  std::vector<SurfaceBlend> cameras;
  for (const nb::object& one : surfaces) {
    const auto& surface = nb::cast<PySurface&>(one);
    SurfaceView view = surface.view;
    view.X_WC = surface.X_WC;
    cameras.push_back({view, view, 1});
  }
  double fraction = 0, of_whole = 0;
  SpherePicture spheres;
  if (with_states) spheres.resize(self.tool().tool->spheres().size());
  ContactWants wants = spheres.wants();
  wants.stiffness = with_stiffness;
  wants.noise = with_std;
  const bool has_seen_free = cameras[0].to.role == SurfaceRole::one_of_several;
  wants.unseen_volume = has_seen_free;
  const ContactResult measured = self.alone([&](const Contact& contact) {
    const ContactResult result = contact.measure(cameras, X_WT, wants);
    fraction = contact.fraction(result.penetration);
    Penetration unseen;
    unseen.volume = result.penetration.unseen_volume;
    of_whole = contact.fraction(unseen);
    return result;
  });
  const Penetration& p = measured.penetration;
  PyResult result{p.volume,
                  fraction,
                  p.potential,
                  p.measure_W.force,
                  p.measure_W.torque,
                  measured.stiffness,
                  p.status,
                  self.tool().tool,
                  surfaces.front(),
                  X_WT,
                  {},
                  std::move(spheres),
                  {},
                  {},
                  {},
                  {}};
  if (const auto& noise = measured.noise) {
    result.volume_std = noise->volume_std();
    result.force_std = noise->force_std();
    result.torque_std = noise->torque_std();
  }
  if (has_seen_free) result.unseen = of_whole;
  return result;
}

/// The same in a scene. What is by name has the first axis left out.
PyResult measure_in_scene(PyContact& self, nb::handle scene, nb::handle pose,
                          const SceneWants& wants) {
  const Pose X_WT = pose_of(pose, "pose");
  const nb::object one = seven_of(X_WT).attr("reshape")(1, 7);
  const std::unique_ptr<PyBatch> batch = measure_scene(self, {scene, one}, wants);
  const BatchAnswers& measured = batch->answers;
  const auto vector = [](const double* at) { return Vec3d{at[0], at[1], at[2]}; };
  PyResult result;
  result.volume = measured.volume[0];
  result.potential = measured.potential[0];
  result.force = vector(measured.force);
  result.torque = vector(measured.torque);
  result.status.bits = measured.status[0];
  if (wants.stiffness) {
    result.stiffness.emplace();
    std::copy_n(measured.stiffness, 36, &result.stiffness->m[0][0]);
  }
  if (wants.noise) {
    result.volume_std = measured.volume_std[0];
    result.force_std = vector(measured.force_std);
    result.torque_std = vector(measured.torque_std);
  }
  self.alone([&](const Contact& contact) {
    Penetration whole;
    whole.volume = result.volume;
    result.fraction = contact.fraction(whole);
    return 0;
  });
  result.tool = self.tool().tool;
  result.X_WT = X_WT;
  for (auto item : batch->more) {
    nb::object values = nb::borrow(item.second)[nb::int_(0)];
    result.more[item.first] = values;
  }
  if (result.more.contains("unseen")) result.unseen = nb::cast<double>(result.more["unseen"]);
  return result;
}

std::vector<PyTool> tools_of(nb::handle given) {
  PyTool* tool = nullptr;
  if (nb::try_cast<PyTool*>(given, tool, false) && tool != nullptr) return {*tool};
  std::vector<PyTool> tools;
  if (nb::isinstance<nb::list>(given) || nb::isinstance<nb::tuple>(given)) {
    for (nb::handle one : nb::borrow<nb::sequence>(given)) {
      if (!nb::try_cast<PyTool*>(one, tool, false) || tool == nullptr) break;
      tools.push_back(*tool);
    }
    if (!tools.empty() && tools.size() == nb::len(given)) return tools;
  }
  throw nb::type_error("tool: a palpate.Tool or a list of them is taken");
}

}  // namespace

void bind_contact(nb::module_& m) {
  bind_result(m);
  nb::class_<PyContact> contact(m, "Contact", nb::is_weak_referenceable(),
                                R"(Measures a tool, or several, against surfaces and scenes.

tool: a Tool or a list of them, of which measure_batch and any take the index of each pose.
method: "field" (the default), "weighted", "simplified" or "graph".
place: "cpu", "cuda" or "cuda:1". threads: on a CPU; useful from about 50,000 spheres on.
options: of docs/settings.md [contact]: volumes, priority, inside, edges, continuity.)");
  contact
      .def(
          "__init__",
          [](PyContact* self, nb::handle tool, const std::string& method, const std::string& place,
             int threads, nb::kwargs keywords) {
            ContactOptions options;
            SettingTable table = settings_of(options);
            check(table.set("contact.method", method));
            apply(keywords, table);
            new (self) PyContact(tools_of(tool), taken(contact_method(options)), place_of(place),
                                 checked_threads(threads));
          },
          nb::arg("tool"), nb::arg("method") = "field", nb::kw_only(), nb::arg("place") = "cpu",
          nb::arg("threads") = 1, nb::arg("options"),
          nb::sig("def __init__(self, tool: Tool | collections.abc.Sequence[Tool], method: str = "
                  "'field', *, place: str = 'cpu', "
                  "threads: int = 1, **options: str) -> None"))
      .def(
          "measure",
          [](PyContact& self, nb::handle surface, nb::handle pose, bool stiffness, bool with_std,
             bool states, bool clearance, bool per_sphere, double smooth) {
            if (is_scene(surface) || clearance || per_sphere) {
              return measure_in_scene(self, surface, pose,
                                      {stiffness, with_std, clearance, per_sphere,
                                       is_scene(surface), kClearanceLimit, smooth});
            }
            return measure(self, surface, pose, stiffness, with_std, states);
          },
          nb::arg("surface"), nb::arg("pose"), nb::kw_only(), nb::arg("stiffness") = false,
          nb::arg("std") = false, nb::arg("states") = false, nb::arg("clearance") = false,
          nb::arg("per_sphere") = false, nb::arg("smooth") = 0.0,
          nb::sig("def measure(self, surface: Scene | Surface | collections.abc.Sequence[Surface], "
                  "pose: palpate._types.Array, *, stiffness: bool = False, std: bool = False, "
                  "states: bool = False, clearance: bool = False, per_sphere: bool = False, "
                  "smooth: float = 0.0) -> Result"),
          R"(Measures the tool at a pose against a surface. Releases the GIL.

surface: one, or a list of several cameras: each sphere then has the depth of the camera that has it
    least deep. Each surface is at the pose of its camera; create their sensors with joined=True.
pose: X_WT, (4, 4) or (7,) tx ty tz qx qy qz qw, m.
stiffness: also compute Result.stiffness (method "field").
std: also compute Result.volume_std, force_std and torque_std: what the random noise of the depth does
    to them (method "field").
states: also describe each sphere, for display; takes twice as long.
clearance, per_sphere, smooth: see measure_batch.
If the pose is not finite or there is no surface, Result.status says so and everything else is zero.)")
      .def("measure_batch", measure_many, nb::arg("surfaces"), nb::arg("poses"), nb::kw_only(),
           nb::arg("surface_of_pose") = nb::none(), nb::arg("stiffness") = false,
           nb::arg("std") = false, nb::arg("out") = nb::none(), nb::arg("stream") = nb::none(),
           nb::arg("clearance") = false, nb::arg("per_sphere") = false,
           nb::arg("limit") = kClearanceLimit, nb::arg("smooth") = 0.0,
           nb::arg("tool_of_pose") = nb::none(), nb::arg("group_of_pose") = nb::none(),
           nb::sig("def measure_batch(self, surfaces: Scene | Surface | "
                   "collections.abc.Sequence[Surface] | Surfaces | Body | "
                   "collections.abc.Sequence[Body], poses: palpate._types.Array, *, "
                   "surface_of_pose: palpate._types.Array | None = None, stiffness: bool = False, "
                   "std: bool = False, "
                   "out: Batch | None = None, stream: palpate._types.Stream | None = None, "
                   "clearance: bool = False, per_sphere: bool = False, limit: float = 0.1, "
                   "smooth: float = 0.0, "
                   "tool_of_pose: palpate._types.Array | None = None, "
                   "group_of_pose: palpate._types.Array | None = None) -> Batch"),
           R"(Many poses in one call, over all cores or in one launch on a GPU; method "field".

surfaces: one, a list, or the result of Sensor.update_batch. Or palpate.Body, one or a list, on a CPU:
    then surface_of_pose is the index of the body, volume is the common volume, and force and torque
    act on the tool.
poses: X_WT, (P, 4, 4) or (P, 7) tx ty tz qx qy qz qw; on a GPU (P, 7) float64 of unit quaternions.
surface_of_pose: (P,) int32, the index of the surface of each pose; None: one surface for all, or
    one per pose.
out: a Batch of the same size to overwrite: of an earlier call, or over your own arrays. Of a scene
    over your own arrays, which say what is computed.
stiffness: also compute Batch.stiffness.
std: also compute Batch.volume_std, force_std and torque_std; zero for bodies, and not a number where
    the noise of a surface is not known.
clearance: also Batch.clearance, nearest, decided and clearance_gradient, up to `limit` (m).
smooth: m; above 0 clearance and gradient are those of a smooth minimum over all spheres, never above
    the least and below it by at most smooth * ln(their number).
per_sphere: also Batch.sphere_depth, sphere_volume, sphere_direction and sphere_decided.
tool_of_pose: (P,) int32, the index of the tool of each pose, for a contact with several.
group_of_pose: (P,) int32, such as the configuration of a robot: Batch.group_clearance and others.
With one of these, or a palpate.Scene, all poses are measured in the whole scene, the hull of its
surfaces and the sum over its bodies, and Batch.unseen is there for a Scene with cameras. Results are
where the poses are; indices of tools and groups are in host memory, and so is all of per_sphere and
groups.
stream: a CUDA stream, as a number or an object of PyTorch or CuPy: arrays on the GPU are read after
    its earlier work. With poses and results on the GPU too, the work is only enqueued, and may be
    captured in a CUDA graph; of a scene after one call with it. None: the default stream.

The result of a pose has the same bits in every batch. For poses that are not finite and indices
without a surface, Batch.status says so and everything else is zero.)")
      .def_prop_ro("method", &PyContact::method)
      .def_prop_ro("place", [](const PyContact& self) { return name_of(self.place()); })
      .def_prop_ro("tool", &PyContact::tool)
      .def_prop_ro(
          "tools", [](const PyContact& self) { return nb::tuple(nb::cast(self.tools())); },
          nb::sig("def tools(self) -> tuple[Tool, ...]"));
  bind_scene(m, contact);
}

}  // namespace palpate::python
