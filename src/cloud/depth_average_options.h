// Validation of the settings of averages.
#pragma once

#include "palpate/cloud/depth_source.h"

namespace palpate::inline v0 {

/// An error says what is out of range.
Status check_average_settings(int width, int height, const DepthAverageOptions& options);

/// Of DepthAverager::state, and what is said of another one.
std::size_t estimate_bytes(int width, int height);
Error no_estimate(int width, int height);

}  // namespace palpate::inline v0
