// Which settings of a running loop can change.
#pragma once

#include "palpate/run/haptic_loop.h"

namespace palpate {

/// Error: a setting that differs and cannot change, by its name in a settings file.
Status check_change(const HapticSettings& before, const HapticSettings& after);

}  // namespace palpate
