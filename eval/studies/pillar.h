// A box scrapes past the edge of a pillar (thesis section 3.5, Figs. 3.12-3.14). Seen from the
// camera, the pillar and the space that it hides are the solid behind its front *and* behind the
// plane of sight along its edge: a ridge, so the volume is known exactly. Shared by the figures and
// tests/accuracy/edge_tunnelling_test.cpp.
#pragma once

#include <memory>
#include <vector>

#include "eval/context.h"
#include "eval/studies/frozen_frame.h"
#include "eval/studies/method_queries.h"

namespace palpate::eval {

inline constexpr double kPillarEdge = 0.11;  ///< m: x of its edges; its front is at z = 1 m

/// Right of the pillar the camera sees the room, left of it the projector throws a shadow.
enum class PillarSide { right, left };
const char* name_of(PillarSide side);

/// Renders the first frame of the scene `pillar`, with Kinect noise or in steps of 0.1 mm.
Result<FrozenFrame> seen_pillar(Context& context, bool with_noise);

/// Returns a cube of 8 cm.
Result<std::shared_ptr<const Tool>> pillar_box(Context& context, int num_spheres,
                                               GapRule rule = GapRule::relative);

/// Returns poses of the box, tilted by 20 degrees and half inside, as it moves to the side until it
/// has left the pillar.
std::vector<Pose> pillar_way(PillarSide side, double step);

/// Returns the shares of the tool inside, at each pose of a way.
std::vector<double> exact_volumes(const Tool& tool, PillarSide side, const std::vector<Pose>& X_WT);
std::vector<double> measured_volumes(MethodQueries& query, const Tool& tool,
                                     const std::vector<Pose>& X_WT, const ContactOptions& options);

/// Errors of a measured volume along a way: shares of the tool.
struct WayError {
  double rms = 0, worst = 0;
  double largest_step = 0;  ///< of the measured volume between two poses
};
WayError way_error(const std::vector<double>& measured, const std::vector<double>& exact);

}  // namespace palpate::eval
