// palpate.Batch as the answer of a scene: Contact.measure_batch.
#include <nanobind/stl/unique_ptr.h>

#include "python/src/batch.h"
#include "python/src/contact.h"

namespace palpate::python {
void add_scene_results(nb::class_<PyBatch>& batch) {
  struct Named {
    const char *name, *type, *doc;
  };
  static constexpr Named kNamed[] = {
      {"clearance", "float64",
       "(P,) m, if requested: least distance of the spheres' surfaces to the hull of what was seen "
       "and\nto the bodies, negative inside; saturated at the limit."},
      {"clearance_gradient", "float64",
       "(P, 6) its derivative by translation and rotation about the center of mass, in W."},
      {"nearest", "int32",
       "(P,) the sphere that has it; -1: saturated, far (+limit) or deep (-limit)."},
      {"decided", "int32",
       "(P,) the camera that it is near to, or number of cameras + body; -1: saturated."},
      {"unseen", "float64",
       "(P,) if requested: share of the tool in space that no camera has seen."},
      {"sphere_depth", "float32",
       "(P, N) m, if requested: depth of each sphere in what the cameras have seen."},
      {"sphere_volume", "float32", "(P, N) m3: the part of each sphere inside."},
      {"sphere_direction", "float32", "(P, N, 3) direction of its force, in W."},
      {"sphere_decided", "int8", "(P, N) the camera that determined the depth; -1: none."},
      {"group_clearance", "float64",
       "(G,) m, with clearance and group_of_pose: the least of each group."},
      {"group_pose", "int32", "(G,) the pose that has it; -1: none."},
      {"group_volume", "float64", "(G,) m3: sum of the volumes of each group."},
  };
  for (const Named& named : kNamed) {
    batch.def_prop_ro(
        named.name,
        [name = named.name](const PyBatch& self) -> nb::object {
          return self.more.contains(name) ? nb::object(self.more[name]) : nb::none();
        },
        nb::sig((std::string("def ") + named.name + "(self) -> numpy.typing.NDArray[numpy." +
                 named.type + "] | None")
                    .c_str()),
        named.doc);
  }
}

nb::object measure_many(PyContact& self, nb::handle surfaces, nb::handle poses,
                        nb::handle surface_of_pose, bool stiffness, bool with_std, nb::handle out,
                        nb::handle stream, bool clearance, bool per_sphere, double limit,
                        double smoothing, nb::handle tool_of_pose, nb::handle group_of_pose) {
  if (!is_scene(surfaces) && !clearance && !per_sphere && tool_of_pose.is_none() &&
      group_of_pose.is_none() && self.tools().size() == 1) {
    return measure_batch(self, surfaces, poses, surface_of_pose, stiffness, with_std, out, stream);
  }
  if (!surface_of_pose.is_none()) {
    throw nb::value_error("surface_of_pose goes with surfaces, not with a scene: leave it out");
  }
  const SceneWants wants{stiffness,          with_std, clearance, per_sphere,
                         is_scene(surfaces), limit,    smoothing};
  const SceneQuestion question{surfaces, poses, tool_of_pose, group_of_pose, stream};
  if (out.is_none()) return nb::cast(measure_scene(self, question, wants));
  PyBatch* batch = nullptr;
  if (!nb::try_cast<PyBatch*>(out, batch, false) || batch == nullptr || batch->given.empty()) {
    throw nb::type_error("out: of a scene, a palpate.Batch over your own arrays is taken");
  }
  measure_scene(self, question, wants, *batch);
  return nb::borrow(out);
}

}  // namespace palpate::python
