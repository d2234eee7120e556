// What the field method asks the field with: the spheres of a tool, the large ones in parts.
#pragma once

#include <cstdint>
#include <vector>

#include "palpate/contact/contact_query.h"
#include "src/contact/sphere_clusters.h"

namespace palpate {

/// A sphere takes one value of the field and cuts itself by one plane. That is exact for a flat
/// surface, and wrong by percents of the tool's volume for a sphere as large as a third of the tool
/// at a ridge or a curved surface. So a large sphere is felt at twelve places (the corners of an
/// icosahedron) by balls that together have its volume and its second moments: the share of it
/// behind any plane is off by 0.9 % of its volume at most, 0.4 % rms.
///
/// Elements are in cluster order; centres are relative to the tool's centre of mass.
struct FieldElements {
  explicit FieldElements(const Tool& tool);

  /// Per place: volume that counts / volume of the ball.
  const std::vector<float>& factor(SphereVolumes volumes) const {
    return volumes == SphereVolumes::own ? own_factor : represented_factor;
  }

  SphereClusters clusters;
  // Per place:
  std::vector<float> radius;              ///< as in `clusters`, but padding has a tiny ball
  std::vector<float> own_factor;          ///< own volume of the element / volume of its ball
  std::vector<float> represented_factor;  ///< represented volume / volume of its ball
  std::vector<float> counted;             ///< 1: stands for its sphere when spheres are counted
  std::vector<float> largest_radius;      ///< per cluster
};

}  // namespace palpate
