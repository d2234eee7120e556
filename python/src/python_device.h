// A haptic device that somebody wrote in Python: for trying things out, not for fine forces.
#pragma once

#include <memory>

#include "palpate/haptics/device.h"
#include "python/src/arrays.h"

namespace palpate::python {

/// Calls read() and write(wrench) of `object`, in a thread of its own that needs the GIL
/// for both. read() gives the handle's pose X_BH, (4, 4) or (7,), or a tuple of it and the buttons,
/// a bit each; None: nothing is known this time. write() takes (6,) force and torque in B, N and
/// N m. Members that it may have: rate (Hz), name, max_force, max_torque, max_stiffness,
/// max_angular_stiffness, max_damping, workspace_radius, damping, angular_damping; what is missing
/// is as of the device model `touch`. What read or write raise ends the run. Errors: no read or
/// write; a number out of range.
struct PythonDevice {
  std::unique_ptr<HapticDevice> device;
  /// What it raised, to be raised once more; none: nothing. With the GIL, once it has stopped.
  std::shared_ptr<nb::object> raised;
};
PythonDevice make_python_device(nb::handle object);

}  // namespace palpate::python
