// Limits of a tool's depth in each frame of a stream, measured with the query itself.
#pragma once

#include "palpate/cloud/depth_source.h"
#include "src/session/probing/probing_motion.h"

namespace palpate { inline namespace v0 {

/// Distances of the tool's tip from the camera over time.
struct ProbeDepths {
  DepthProfile free;  ///< nothing is touched up to here
  DepthProfile aim;   ///< a tenth of the tool is in, or its tip is as deep as if it were; smooth
  DepthProfile most;  ///< upper limit: too much of the tool is in
};

/// Tries `motion` in every frame of `stream` while it is current, up to `end` seconds. Errors:
/// images that no SurfaceEstimator takes; no frame; errors of the stream.
Result<ProbeDepths> probe_stream(DepthSource& stream, const Tool& tool, const ProbingMotion& motion,
                                 double end);

}}  // namespace palpate::v0
