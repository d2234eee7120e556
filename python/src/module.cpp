// The module palpate._core: the public headers for Python. The parts written in Python are in
// python/palpate.
#include <nanobind/nanobind.h>

#include "palpate/contact/contact.h"
#include "palpate/version.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"

namespace nb = nanobind;

NB_MODULE(_core, m) {
  using namespace palpate;
  using namespace palpate::python;
  // At the end of a script nanobind reports objects that global variables still hold, such as a run
  // and its device. To users that looks like a fault.
#ifdef NDEBUG
  nb::set_leak_warnings(false);
#endif
  m.attr("__version__") = PALPATE_VERSION;
  m.doc() = "The compiled part of palpate.";

  nb::object error = nb::exception<PalpateError>(m, "Error", PyExc_RuntimeError);
  error.attr("__doc__") =
      "What went wrong: one sentence that says what, where, and what to do next.";

  nb::enum_<StepStatus>(m, "Status", nb::is_flag(), nb::is_arithmetic(),
                        "Unusual conditions of a measurement; bits that can be combined.")
      .value("OK", StepStatus::ok)
      .value("NON_FINITE_POSE", StepStatus::non_finite_pose,
             "The pose was not finite: no measurement, everything is zero.")
      .value("AMBIGUOUS_NORMALS", StepStatus::ambiguous_normals,
             "The points in a boundary sphere disagree.")
      .value("BACKEND_FAILED", StepStatus::backend_failed,
             "The GPU did not answer or is lost: no measurement, everything is zero.")
      .value("NO_SURFACE", StepStatus::no_surface,
             "There is no surface of the kind that the method needs: no measurement.")
      .value("NO_EDGE_VECTORS", StepStatus::no_edge_vectors,
             "Edges were requested, but the cloud has none: measured without.")
      .value("OUTSIDE_WINDOW", StepStatus::outside_window,
             "The tool may extend outside of the window of the surface: no measurement.");

  bind_tool(m);
  bind_sensor(m);
  bind_batch(m);
  bind_contact(m);
  bind_penetration(m);
  bind_pose_gradients(m);
  bind_runs(m);
  bind_camera_frames(m);
  bind_recordings(m);
  bind_robot(m);
  bind_scenes(m);
}
