// Paths of a hand-held tool on a visible surface: poses like those of a recorded interaction, at a
// chosen average depth (the thesis' recordings are not published; theirs were 7 to 70 % deep). The
// motion is that of a recorded hand, or, where times are compared, a figure of eight.
#pragma once

#include <functional>
#include <limits>
#include <vector>

#include "eval/studies/frozen_frame.h"
#include "palpate/io/files.h"
#include "palpate/tool/tool.h"

namespace palpate::eval {

struct HandPath {
  std::vector<Pose> X_WT;
  double mean_depth = 0, max_depth = 0;  ///< shares of the tool's volume, by the field
};

/// A calm place in the middle of the frame, for a tool of this radius: a point of the surface,
/// nearer than `farthest` m, and the direction into it.
struct Place {
  Vec3d p_W, into_W;
};
Result<Place> calm_place(const PointCloudView& cloud, double radius,
                         double farthest = std::numeric_limits<double>::infinity());

/// Offset of a hand from the middle of its path at a phase of 0 to 1.
struct HandShift {
  double side = 0, up = 0;  ///< m
  double in = 0;            ///< a swing of about -1 to 1
  Vec3d turn;               ///< about side, up and in; rad
};
using HandMotion = std::function<HandShift(double phase)>;
/// A figure of eight with rotations of a few degrees.
HandShift figure_of_eight(double phase);
/// A recorded hand: its rotation, and its shifts scaled down to 15 mm rms across, for a tool in
/// contact, and to the rms of a sine in and out.
HandMotion recorded_hand(std::vector<TimedPose> poses);

/// Makes a path across a calm place, swinging in and out by a share of the tool's radius, at a
/// depth that has `mean_depth` of the tool inside on average. Deterministic. Errors: nothing in the
/// frame can be touched.
Result<HandPath> hand_path(const FrozenFrame& frame, const Tool& tool, double mean_depth,
                           std::size_t num_poses, double swing = 0.1,
                           const HandMotion& motion = figure_of_eight,
                           double farthest = std::numeric_limits<double>::infinity());

}  // namespace palpate::eval
