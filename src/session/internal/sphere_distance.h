// The distance of a point from the spheres of a tool: for the user who asks how far away a tool is.
//
//   distance(p) = min over spheres s of |p - c_s| - r_s
//
// It goes down the sphere tree, whose bounds are no farther than what they hold.
#pragma once

#include <array>

#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

/// Returns the distance if it is below `limit`, else `limit`, m; `p_T`: in the tool frame.
inline double sphere_distance_below(const Tool& tool, const Vec3d& p_T, double limit) {
  const auto nodes = tool.tree().nodes();
  std::array<std::int32_t, InnerSphereTree::kMaxWaiting> waiting;
  std::size_t num_waiting = 0;
  waiting[num_waiting++] = 0;
  while (num_waiting > 0) {
    const IstNode& node = nodes[static_cast<std::size_t>(waiting[--num_waiting])];
    const double distance =
        norm(p_T - to_double(node.bound.center)) - static_cast<double>(node.bound.radius);
    if (distance >= limit) continue;
    if (node.num_children == 0) limit = distance;
    for (int k = 0; k < node.num_children; ++k) waiting[num_waiting++] = node.first_child + k;
  }
  return limit;
}

}}  // namespace palpate::v0
