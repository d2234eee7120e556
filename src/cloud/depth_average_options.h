// Which settings of averages of depth are accepted.
#pragma once

#include "palpate/cloud/depth_source.h"

namespace palpate {

/// An error says what is out of range.
Status check_average_settings(int width, int height, const DepthAverageOptions& options);

}  // namespace palpate
