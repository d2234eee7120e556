// The mean of the frames of a static scene, with less noise than one frame.
#pragma once

#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

/// Averages each pixel over the next `num_frames` frames, or those that are left; pixels measured
/// in fewer than half of them have no depth. Errors: of the source; it has no frame left.
Result<DepthFrame> mean_frame(DepthSource& source, int num_frames);

}}  // namespace palpate::v0
