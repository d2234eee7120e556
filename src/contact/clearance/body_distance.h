// The distance of a tool to a CAD body, by the body's distance field. Shared by host and device.
#pragma once

#include "src/contact/bodies/solid_sample.h"
#include "src/contact/clearance/clearance_rules.h"

namespace palpate { inline namespace v0 {

/// A body of a scene; its field in the memory of the device that searches.
struct SearchedBody {
  SolidFieldView field;
  Vec3d corner;  ///< lower corner of the solid's box, in B
  Pose X_WB, X_BW;
};

/// The nearest point in the box of a grid, one node from its end. Points are from the corner of the
/// solid's box.
PALPATE_HOSTDEV inline Vec3d clamped(const SolidFieldView& field, int level, const Vec3d& p) {
  const double spacing = static_cast<double>(field.spacing) * (1 << level);
  Vec3d q;
  for (int axis = 0; axis < 3; ++axis) {
    const double first = -(SolidField::kMargin - 1) * spacing;
    const double size = (field.num_nodes[axis][level] - 3) * spacing;
    q[axis] = lesser(greater(p[axis], first), first + size);
  }
  return q;
}

/// Samples a grid at a point that has all nodes around it.
PALPATE_HOSTDEV inline PointDistance sample_grid(const SolidFieldView& field, int level,
                                                 const Vec3d& p) {
  const double spacing = static_cast<double>(field.spacing) * (1 << level);
  std::int32_t node[3];
  double offset[3];
  for (int axis = 0; axis < 3; ++axis) {
    const double place = p[axis] / spacing + SolidField::kMargin;
    const auto nearest = static_cast<std::int32_t>(place + 0.5);
    node[axis] = lesser(greater(nearest, 1), field.num_nodes[axis][level] - 2);
    offset[axis] = lesser(greater(place - node[axis], -0.5), 0.5);
  }
  const std::int32_t row = field.num_nodes[0][level], slice = row * field.num_nodes[1][level];
  const float* const middle =
      field.values + field.first[level] + node[2] * slice + node[1] * row + node[0];
  SolidGradient<double> found;
  sample_spline(
      offset[0], offset[1], offset[2], 1 / spacing,
      [&](int j, int k, double(&nodes)[3]) {
        const float* const from = middle + (k - 1) * slice + (j - 1) * row - 1;
        for (int i = 0; i < 3; ++i) nodes[i] = static_cast<double>(from[i]);
      },
      found);
  return {found.phi, {found.n.x, found.n.y, found.n.z}};
}

/// Returns the signed distance of a point, from the corner of the solid's box, and its derivative.
/// Exact at flat faces, and to a few tenths of the spacing of the grid there else; beyond all grids
/// to a few percent.
PALPATE_HOSTDEV inline PointDistance body_distance(const SolidFieldView& field, const Vec3d& p) {
  for (int level = 0; level < field.num_levels; ++level) {
    if (clamped(field, level, p) == p) return sample_grid(field, level, p);
  }
  // Beyond all grids: the surface point that the nearest point of the widest grid is nearest to.
  const int widest = field.num_levels - 1;
  Vec3d from = clamped(field, widest, p);
  PointDistance best{1e30, {}};
  for (int round = 0; round < 3; ++round) {
    const PointDistance at = sample_grid(field, widest, from);
    const Vec3d foot = from - at.phi * normalized(at.gradient), apart = p - foot;
    const double distance = norm(apart);
    if (distance < best.phi) best = {distance, apart / distance};
    from = clamped(field, widest, foot + apart * 0.5);
  }
  return best;
}

/// A body with a tool at a pose.
struct PlacedTool {
  PALPATE_HOSTDEV PlacedTool(const SearchedBody& to, const Pose& X_WT)
      : body(&to), X_BT(to.X_BW * X_WT) {}

  PALPATE_HOSTDEV PointDistance distance(const Vec3f& p_T) const {
    return body_distance(body->field, X_BT * to_double(p_T) - body->corner);
  }
  /// False if no sphere of a cluster has a value below `least`.
  PALPATE_HOSTDEV bool may_be_below(const Cluster& ball, double least) const {
    const double slack =
        static_cast<double>(body->field.spacing) * (1 << (body->field.num_levels - 1));
    return !(distance(ball.center).phi - static_cast<double>(ball.reach) - slack > least);
  }

  const SearchedBody* body;
  Pose X_BT;
};

/// Returns the clearance of one sphere to a body at a distance; the quaternion of X_WT is unit.
PALPATE_HOSTDEV inline Clearance clearance_to_body(const SearchedBody& body, std::int32_t decider,
                                                   const PointDistance& at,
                                                   const ClearanceTool& tool, std::int32_t sphere,
                                                   const Pose& X_WT) {
  const Sphere& s = tool.spheres[sphere];
  Clearance found{at.phi - static_cast<double>(s.radius), sphere, decider, {}};
  put_gradient(rotate(body.X_WB.rotation, at.gradient),
               rotate(X_WT.rotation, to_double(s.center) - tool.p_TC), found.gradient);
  return found;
}

/// Calls visit(sphere, distance) for the spheres of a tool whose cluster may come nearer than
/// `least` to a body. `visit` may lower `least`.
template <class Visit>
void for_spheres_near(const SearchedBody& body, const ClusterView& clusters,
                      const ClearanceTool& tool, const Pose& X_WT, const double& least,
                      const Visit& visit) {
  const PlacedTool placed(body, X_WT);
  for (std::int32_t i = 0; i < clusters.num_clusters; ++i) {
    if (!placed.may_be_below(clusters.clusters[i], least)) continue;
    constexpr std::int32_t kSize = SphereClusters::kSize;
    const std::int32_t num = lesser(kSize, clusters.num_spheres - i * kSize);
    for (std::int32_t k = 0; k < num; ++k) {
      const std::int32_t id = clusters.sphere_id[i * kSize + k];
      visit(id, placed.distance(tool.spheres[id].center));
    }
  }
}

}}  // namespace palpate::v0
