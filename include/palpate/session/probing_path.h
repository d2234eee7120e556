// A tool path for people who have a scene but no path.
#pragma once

#include <optional>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/result.h"
#include "palpate/io/trajectory_file.h"
#include "palpate/tool/tool.h"

namespace palpate {

/// Touches what a depth stream shows near the image centre, wherever camera and scene move: along
/// the viewing ray out of free space, in until about a tenth of the tool is behind the surface, a
/// slide to the side with a slow turn, and out again. The tool is held like a pen: its -z axis (the
/// tip of a stylus) points into the scene, its other end leans to the upper right.
///
/// Reads `stream` up to `duration` seconds (nullopt: to its end, which is then the end of the
/// path); a run needs a stream of its own. Errors: no usable surface near the image centre;
/// duration not > 0, or none for an endless stream; what the stream reports.
Result<std::vector<TimedPose>> probing_path(DepthSource& stream, const Tool& tool,
                                            std::optional<double> duration);

}  // namespace palpate
