// The default camera and device: the only one that is connected.
#pragma once

#include <string>

#include "palpate/cameras/cameras.h"
#include "palpate/core/core.h"

namespace palpate::apps {

/// Finds the only plugged-in depth camera. Errors: there is none, or several, which are named.
Result<CameraUri> connected_camera();
/// Finds the only connected haptic device, except simulated ones. Errors: as above.
Result<std::string> connected_device();

}  // namespace palpate::apps
