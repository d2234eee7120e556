// Validation of the settings of averages.
#pragma once

#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

/// An error says what is out of range.
Status check_average_settings(int width, int height, const DepthAverageOptions& options);

/// Size of DepthAverager::state in bytes, and the error for any other state.
std::size_t estimate_bytes(int width, int height);
Error no_estimate(int width, int height);

}}  // namespace palpate::v0
