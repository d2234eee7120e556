// A tool path for people who have a scene but no path.
#pragma once

#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/result.h"
#include "palpate/io/trajectory_file.h"
#include "palpate/tool/tool.h"

namespace palpate {

/// Finds a surface near the image centre of an organised cloud and touches it: along the viewing
/// ray out of free space, in until about a tenth of the tool is behind the surface, a slide to the
/// side with a slow turn, and out again. The tool's -z axis points along the ray (the tip of a
/// stylus). Error: no usable surface near the image centre; duration not > 0.
Result<std::vector<TimedPose>> probing_path(const PointCloudView& cloud, const Tool& tool,
                                            double duration);

}  // namespace palpate
