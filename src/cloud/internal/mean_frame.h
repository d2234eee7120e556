// The mean of the frames of a static scene, with less noise than one frame.
#pragma once

#include "palpate/cloud/depth_source.h"

namespace palpate::inline v0 {

/// Of each pixel the mean of its measurements in the next `num_frames` frames, or in those that are
/// left, if it has them in at least half. Errors: of the source; it has no frame left.
Result<DepthFrame> mean_frame(DepthSource& source, int num_frames);

}  // namespace palpate::inline v0
