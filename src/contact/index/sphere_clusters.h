// The spheres of a tool in spatial order, in small groups: what the plane stage loops over.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/math/geometry.h"
#include "src/contact/index/num_bytes.h"

namespace palpate::inline v0 {

/// A few neighbouring spheres: the box around their *centres*, and a ball around its middle that
/// covers their surfaces.
struct Cluster {
  Vec3f centre;
  Vec3f half_size;
  float reach = 0;
};

/// Structure of arrays in cluster order, each cluster kSize long, each group kClustersPerGroup
/// clusters. Padding has radius 0 and sphere_id -1.
class SphereClusters {
 public:
  static constexpr int kSize = 32;
  static constexpr int kClustersPerGroup = 16;

  explicit SphereClusters(std::span<const Sphere> spheres);

  int num_clusters() const { return static_cast<int>(clusters.size()); }
  int num_groups() const { return static_cast<int>(groups.size()); }
  /// Of a cluster, without padding.
  int num_spheres(int cluster) const {
    return std::min(kSize, static_cast<int>(slot_of.size()) - cluster * kSize);
  }
  /// All spheres in cluster order.
  std::span<const std::int32_t> order() const { return std::span(sphere_id).first(slot_of.size()); }

  std::size_t num_bytes() const {
    return bytes_of(x, y, z, radius, volume, sphere_id, slot_of, clusters, groups);
  }

  std::vector<float> x, y, z, radius, volume;  ///< one per slot
  std::vector<std::int32_t> sphere_id;         ///< of each slot; -1 for padding
  std::vector<std::int32_t> slot_of;           ///< of each sphere
  std::vector<Cluster> clusters;
  std::vector<Cluster> groups;  ///< around kClustersPerGroup clusters
};

}  // namespace palpate::inline v0
