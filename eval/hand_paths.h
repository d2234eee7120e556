// How a hand moves a tool on something seen: poses like those of a recorded interaction, at a
// chosen average depth (the thesis' recordings are not published; theirs were 7 to 70 % deep).
#pragma once

#include <vector>

#include "eval/seen_frame.h"
#include "palpate/tool/tool.h"

namespace palpate::eval {

struct HandPath {
  std::vector<Pose> X_WT;
  double mean_depth = 0, most_depth = 0;  ///< shares of the tool's volume, by the field
};

/// A calm place in the middle of what the frame shows, for a tool of this radius: a point of the
/// surface and the direction into it.
struct Place {
  Vec3d p_W, into_W;
};
Result<Place> calm_place(const PointCloudView& cloud, double radius);

/// A figure of eight across a calm place, swinging in and out by a share of the tool's radius and
/// turning by a few degrees, as deep that on average `mean_depth` of the tool is inside. The same
/// for the same input. Errors: nothing in the frame can be touched.
Result<HandPath> hand_path(const SeenFrame& frame, const Tool& tool, double mean_depth,
                           std::size_t num_poses, double swing = 0.1);

}  // namespace palpate::eval
