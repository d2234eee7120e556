// The default camera and device: the only one that is connected.
#pragma once

#include <string>

#include "palpate/cameras/cameras.h"
#include "palpate/core/core.h"

namespace palpate::apps {

/// The one depth camera that is plugged in. Errors: there is none, or several, which are named.
Result<CameraUri> connected_camera();
/// The one haptic device that is there, other than simulated ones. Errors: as above.
Result<std::string> connected_device();

}  // namespace palpate::apps
