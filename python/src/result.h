// palpate.Result, for its files of bindings.
#pragma once

#include <memory>
#include <optional>

#include "python/src/contact.h"

namespace palpate::python {

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
  std::optional<double> volume_std;
  Vec3d force_std, torque_std;
  nb::dict more;  ///< results by name, of scenes
};

/// Adds palpate.Result.
void bind_result(nb::module_& m);

}  // namespace palpate::python
