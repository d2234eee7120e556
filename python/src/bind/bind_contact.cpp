// palpate.Contact: how much of a tool is inside a surface, and the wrench that follows.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <optional>

#include "python/src/bindings.h"
#include "python/src/contact.h"

namespace palpate::python {
namespace {

/// Class palpate.Result: a measurement in W, with its tool, surface and pose.
struct PyResult {
  double volume = 0, fraction = 0, potential = 0;
  Vec3d force, torque;
  std::optional<Stiffness> stiffness;
  ContactStatus status;
  std::shared_ptr<const Tool> tool;
  nb::object surface;  ///< the first one
  Pose X_WT;
  std::optional<double> unseen;  ///< of joined surfaces, from the library
  SpherePicture spheres;         ///< empty: not requested
  std::optional<MeasureNoise> noise;
  Vec3d force_std, torque_std;  ///< of the noise
};

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
                  measured.noise,
                  {},
                  {}};
  if (result.noise) {
    result.force_std = result.noise->force_std();
    result.torque_std = result.noise->torque_std();
  }
  if (cameras[0].to.role == SurfaceRole::one_of_several) result.unseen = of_whole;
  return result;
}

nb::object vector_of(const Vec3d& v, nb::handle owner) { return view_of(&v.x, {3}, owner); }

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
          "volume_std",
          [](const PyResult& self) -> std::optional<double> {
            if (!self.noise) return std::nullopt;
            return self.noise->volume_std();
          },
          nb::sig("def volume_std(self) -> float | None"),
          "Standard deviation of the volume by the noise of the depth, m3, with std=True.")
      .def_prop_ro(
          "force_std",
          [](nb::handle self) -> nb::object {
            const auto& result = nb::cast<PyResult&>(self);
            return result.noise ? vector_of(result.force_std, self) : nb::none();
          },
          nb::sig((std::string("def force_std(self)") + kFloats + " | None").c_str()),
          "(3,) likewise of the force, m3, along the axes of W.")
      .def_prop_ro(
          "torque_std",
          [](nb::handle self) -> nb::object {
            const auto& result = nb::cast<PyResult&>(self);
            return result.noise ? vector_of(result.torque_std, self) : nb::none();
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
            if (deciders.empty()) return nb::none();
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
      .def("__repr__", [](const PyResult& self) {
        char text[160];
        std::snprintf(text, sizeof text,
                      "<palpate.Result: %.4g cm3 (%.3g %%), force %.4g %.4g %.4g m3, status %u>",
                      self.volume * 1e6, self.fraction * 100, self.force.x, self.force.y,
                      self.force.z, self.status.bits);
        return std::string(text);
      });
}

}  // namespace

void bind_contact(nb::module_& m) {
  bind_result(m);
  nb::class_<PyContact>(m, "Contact", R"(Measures a tool against surfaces.

method: "field" (the default), "weighted", "simplified" or "graph".
place: "cpu", "cuda" or "cuda:1". threads: on a CPU; useful from about 50,000 spheres on.
options: of docs/settings.md [contact]: volumes, priority, inside, edges, continuity.)")
      .def(
          "__init__",
          [](PyContact* self, const PyTool& tool, const std::string& method,
             const std::string& place, int threads, nb::kwargs keywords) {
            ContactOptions options;
            SettingTable table = settings_of(options);
            check(table.set("contact.method", method));
            apply(keywords, table);
            new (self) PyContact(tool, taken(contact_method(options)), place_of(place),
                                 checked_threads(threads));
          },
          nb::arg("tool"), nb::arg("method") = "field", nb::kw_only(), nb::arg("place") = "cpu",
          nb::arg("threads") = 1, nb::arg("options"),
          nb::sig("def __init__(self, tool: Tool, method: str = 'field', *, place: str = 'cpu', "
                  "threads: int = 1, **options: str) -> None"))
      .def(
          "measure",
          [](PyContact& self, nb::handle surface, nb::handle pose, bool stiffness, bool with_std,
             bool states) { return measure(self, surface, pose, stiffness, with_std, states); },
          nb::arg("surface"), nb::arg("pose"), nb::kw_only(), nb::arg("stiffness") = false,
          nb::arg("std") = false, nb::arg("states") = false,
          nb::sig("def measure(self, surface: Surface | collections.abc.Sequence[Surface], "
                  "pose: palpate._types.Array, *, stiffness: bool = False, "
                  "std: bool = False, states: bool = False) -> Result"),
          R"(Measures the tool at a pose against a surface. Releases the GIL.

surface: one, or a list of several cameras: each sphere then has the depth of the camera that has it
    least deep. Each surface is at the pose of its camera; create their sensors with joined=True.
pose: X_WT, (4, 4) or (7,) tx ty tz qx qy qz qw, m.
stiffness: also compute Result.stiffness (method "field").
std: also compute Result.volume_std, force_std and torque_std: what the random noise of the depth does
    to them (method "field", on a CPU).
states: also describe each sphere, for display; takes twice as long.
If the pose is not finite or there is no surface, Result.status says so and everything else is zero.)")
      .def("measure_batch", measure_batch, nb::arg("surfaces"), nb::arg("poses"), nb::kw_only(),
           nb::arg("surface_of_pose") = nb::none(), nb::arg("stiffness") = false,
           nb::arg("std") = false, nb::arg("out") = nb::none(), nb::arg("stream") = nb::none(),
           nb::sig(
               "def measure_batch(self, surfaces: Surface | collections.abc.Sequence[Surface] | "
               "Surfaces | Body | collections.abc.Sequence[Body], poses: palpate._types.Array, *, "
               "surface_of_pose: palpate._types.Array | None = None, stiffness: bool = False, "
               "std: bool = False, "
               "out: Batch | None = None, stream: palpate._types.Stream | None = None) -> Batch"),
           R"(Many poses in one call, over all cores or in one launch on a GPU; method "field".

surfaces: one, a list, or the result of Sensor.update_batch. Or palpate.Body, one or a list, on a CPU:
    then surface_of_pose is the index of the body, volume is the common volume, and force and torque
    act on the tool.
poses: X_WT, (P, 4, 4) or (P, 7) tx ty tz qx qy qz qw; on a GPU (P, 7) float64 of unit quaternions.
surface_of_pose: (P,) int32, the index of the surface of each pose; None: one surface for all, or
    one per pose.
out: a Batch of the same size to overwrite: of an earlier call, or over your own arrays.
stiffness: also compute Batch.stiffness.
std: also compute Batch.volume_std, force_std and torque_std, on a CPU; zero for bodies.
stream: a CUDA stream, as a number or an object of PyTorch or CuPy: arrays on the GPU are read after
    its earlier work. With poses and results on the GPU too, the work is only enqueued, and may be
    captured in a CUDA graph. None: the default stream.

The result of a pose has the same bits in every batch. For poses that are not finite and indices
without a surface, Batch.status says so and everything else is zero.)")
      .def_prop_ro("method", &PyContact::method)
      .def_prop_ro("tool", &PyContact::tool);
}

}  // namespace palpate::python
