// A tool path for people who have a scene but no path.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/result.h"
#include "palpate/io/trajectory_file.h"
#include "palpate/tool/tool.h"

namespace palpate {

/// Opens the same stream once more, from its first frame.
using OpenDepthSource = std::function<Result<std::unique_ptr<DepthSource>>()>;

/// Touches what a depth stream shows near the image centre, wherever camera and scene move: along
/// the viewing ray out of free space, in until about a tenth of the tool is behind the surface, a
/// slide to the side with a slow turn, and out again. The tool is held like a pen: its -z axis (the
/// tip of a stylus) points into the scene, its other end leans to the upper right. A tool that is
/// clearly longer along x or y points the lighter end of that axis.
///
/// The path is tried in every frame: it starts and ends where the whole tool is clear of everything
/// that any frame shows, and presses less where other parts of the tool would be in as well.
///
/// Reads the stream twice, up to `duration` seconds (nullopt: to its end, which is then the end of
/// the path). Errors: no usable surface near the image centre; images that no
/// SurfaceEstimator takes; duration not > 0, or none for an
/// endless stream; what the stream reports.
Result<std::vector<TimedPose>> probing_path(const OpenDepthSource& open, const Tool& tool,
                                            std::optional<double> duration);

}  // namespace palpate
