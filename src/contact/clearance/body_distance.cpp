#include "src/contact/clearance/body_distance.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "src/contact/bodies/solid_sample.h"
#include "src/contact/index/tool_parts.h"

namespace palpate { inline namespace v0 {
namespace {

/// Samples a level at a point, which has all nodes around it.
PointDistance sample(const SolidField& field, int level, const Vec3d& p) {
  const SolidField::Level& grid = field.levels()[static_cast<std::size_t>(level)];
  const std::span<const float> values = field.values(level);
  int node[3];
  double offset[3];
  for (int axis = 0; axis < 3; ++axis) {
    const double place =
        (p[axis] - field.layout().origin[axis]) / grid.spacing + SolidField::kMargin;
    node[axis] = std::clamp(static_cast<int>(std::lround(place)), 1,
                            grid.num_nodes[static_cast<std::size_t>(axis)] - 2);
    offset[axis] = std::clamp(place - node[axis], -0.5, 0.5);
  }
  SolidGradient<double> found;
  sample_spline(
      offset[0], offset[1], offset[2], 1 / grid.spacing,
      [&](int j, int k, double(&nodes)[3]) {
        const int row = (node[2] + k - 1) * grid.num_nodes[1] + node[1] + j - 1;
        for (int i = 0; i < 3; ++i) {
          nodes[i] = static_cast<double>(
              values[static_cast<std::size_t>(row * grid.num_nodes[0] + node[0] + i - 1)]);
        }
      },
      found);
  return {found.phi, {found.n.x, found.n.y, found.n.z}};
}

/// The nearest point in the box of a level, one node from its end.
Vec3d clamped(const SolidField& field, int level, const Vec3d& p) {
  const SolidField::Level& grid = field.levels()[static_cast<std::size_t>(level)];
  Vec3d q;
  for (int axis = 0; axis < 3; ++axis) {
    const double first = field.layout().origin[axis] - (SolidField::kMargin - 1) * grid.spacing;
    const double size = (grid.num_nodes[static_cast<std::size_t>(axis)] - 3) * grid.spacing;
    q[axis] = std::clamp(p[axis], first, first + size);
  }
  return q;
}

}  // namespace

PointDistance body_distance(const SolidField& field, const Vec3d& p) {
  const int num_levels = static_cast<int>(field.levels().size());
  for (int level = 0; level < num_levels; ++level) {
    if (clamped(field, level, p) == p) return sample(field, level, p);
  }
  // Beyond all grids: the surface point that the nearest point of the widest grid is nearest to.
  Vec3d from = clamped(field, num_levels - 1, p);
  PointDistance best{1e30, {}};
  for (int round = 0; round < 3; ++round) {
    const PointDistance at = sample(field, num_levels - 1, from);
    const Vec3d foot = from - at.phi * normalized(at.gradient), apart = p - foot;
    const double distance = norm(apart);
    if (distance < best.phi) best = {distance, apart / distance};
    from = clamped(field, num_levels - 1, foot + apart * 0.5);
  }
  return best;
}

void add_body_clearance(const ToolIndex& tool, const SolidField& field, const Pose& X_WB,
                        const Pose& X_WT, int decider, Clearance& least) {
  const Pose X{X_WT.translation, normalized(X_WT.rotation)};
  const Pose X_BT = inverse({X_WB.translation, normalized(X_WB.rotation)}) * X;
  const SphereClusters& clusters = parts_of(tool).clusters();
  const std::span<const Sphere> spheres = tool.tool().spheres();
  Vec3d gradient_B;
  std::int32_t found = -1;
  const double slack = field.levels().back().spacing;
  for (int i = 0; i < clusters.num_clusters(); ++i) {
    const Cluster& ball = clusters.clusters[static_cast<std::size_t>(i)];
    const double middle = body_distance(field, X_BT * to_double(ball.center)).phi;
    if (middle - static_cast<double>(ball.reach) - slack > least.value) continue;
    for (int k = 0; k < clusters.num_spheres(i); ++k) {
      const auto slot = static_cast<std::size_t>(i * SphereClusters::kSize + k);
      const std::int32_t id = clusters.sphere_id[slot];
      if (id < 0) continue;
      const Sphere& sphere = spheres[static_cast<std::size_t>(id)];
      const PointDistance at = body_distance(field, X_BT * to_double(sphere.center));
      const double value = at.phi - static_cast<double>(sphere.radius);
      if (!(value < least.value)) continue;
      least.value = value;
      gradient_B = at.gradient;
      found = id;
    }
  }
  if (found < 0) return;
  least.sphere = found;
  least.decider = decider;
  const Vec3d n = rotate(normalized(X_WB.rotation), gradient_B);
  const Vec3d c_T = to_double(spheres[static_cast<std::size_t>(found)].center);
  const Vec3d turn = cross(rotate(X.rotation, c_T - tool.tool().sphere_mass().center_of_mass), n);
  for (int axis = 0; axis < 3; ++axis) {
    least.gradient[axis] = n[axis];
    least.gradient[3 + axis] = turn[axis];
  }
}

}}  // namespace palpate::v0
