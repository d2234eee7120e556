// The spheres of a tool in spatial order, in small groups: what the plane stage loops over.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/math/geometry.h"
#include "src/contact/index/num_bytes.h"

namespace palpate { inline namespace v0 {

/// A few neighboring spheres: the box around their *centers*, and a ball around its middle that
/// covers their surfaces.
struct Cluster {
  Vec3f center;
  Vec3f half_size;
  float reach = 0;
};

/// Structure of arrays in cluster order, each cluster kSize long, each group kClustersPerGroup
/// clusters. The last slots of a cluster may be padding, with radius 0 and sphere_id -1.
class SphereClusters {
 public:
  static constexpr int kSize = 32;
  static constexpr int kClustersPerGroup = 16;

  explicit SphereClusters(std::span<const Sphere> spheres) : SphereClusters(spheres, {}, kSize) {}
  /// `together`: numbers of spheres that stay together, `run` at a time and in this order, in
  /// clusters behind those of all other spheres.
  SphereClusters(std::span<const Sphere> spheres, std::span<const std::int32_t> together, int run);

  int num_clusters() const { return static_cast<int>(clusters.size()); }
  int num_groups() const { return static_cast<int>(groups.size()); }
  /// The spheres of a cluster, without padding.
  int num_spheres(int cluster) const {
    return cluster < num_loose ? std::min(kSize, num_loose_spheres - cluster * kSize) : run;
  }

  std::size_t num_bytes() const {
    return bytes_of(x, y, z, radius, volume, sphere_id, slot_of, clusters, groups);
  }

  std::vector<float> x, y, z, radius, volume;  ///< one per slot
  std::vector<std::int32_t> sphere_id;         ///< of each slot; -1 for padding
  std::vector<std::int32_t> slot_of;           ///< of each sphere
  int num_loose = 0;                           ///< clusters before those that stay together
  int num_loose_spheres = 0, run = kSize;
  std::vector<Cluster> clusters;
  std::vector<Cluster> groups;  ///< around kClustersPerGroup clusters
};

}}  // namespace palpate::v0
