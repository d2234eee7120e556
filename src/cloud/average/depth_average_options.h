// Validation of the settings of averages.
#pragma once

#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

/// An error says what is out of range.
Status check_average_settings(int width, int height, const DepthAverageOptions& options);

}}  // namespace palpate::v0
