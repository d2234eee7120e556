// A haptic device written in Python: for experiments, not for fine forces.
#pragma once

#include <memory>

#include "palpate/haptics/device.h"
#include "python/src/arrays.h"

namespace palpate::python {

/// Calls read() and write(wrench) of `object`, in a thread of its own that needs the GIL
/// for both. read() returns the handle's pose X_BH, (4, 4) or (7,), or a tuple of it and the
/// buttons, a bit each; None: no state this time. write() takes (6,) force and torque in B, N and
/// N m. Optional members: rate (Hz), name, max_force, max_torque, max_stiffness,
/// max_angular_stiffness, max_damping, workspace_radius, damping, angular_damping; defaults are
/// those of the device model `touch`. Exceptions of read or write end the run. Errors: no read or
/// write; a number out of range.
struct PythonDevice {
  std::unique_ptr<HapticDevice> device;
  /// Exception of read or write, to be raised again; null: none. With the GIL, once it has stopped.
  std::shared_ptr<nb::object> raised;
};
PythonDevice make_python_device(nb::handle object);

}  // namespace palpate::python
