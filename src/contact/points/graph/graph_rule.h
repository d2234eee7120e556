// Decisions of the search along the leaf graph (thesis section 3.3.2; Algs. 3.5 and 3.6 corrected).
// Shared by host and device.
#pragma once

#include <cstdint>

#include "src/contact/points/donors/donor.h"

namespace palpate { inline namespace v0 {

/// True if an edge points away from the collision normal of its start's reference: it is walked.
PALPATE_HOSTDEV inline bool leads_inside(const Vec3d& edge, const Vec3d& normal) {
  return dot(edge, normal) < 0;
}

/// A reference offered to a sphere: the seed, and the length of the path from there.
struct alignas(16) Offer {
  double path_length = 0;
  std::int32_t seed = -1;

  /// Among offers of one round: the shorter path, then the lower index.
  PALPATE_HOSTDEV bool beats(const Offer& other) const {
    return path_length < other.path_length ||
           (path_length == other.path_length && seed < other.seed);
  }
};

/// Returns V_s of a sphere that the graph reached from this donor: whole (Alg. 3.7), or cut by its
/// plane (footnote).
PALPATE_HOSTDEV inline double reached_volume(const DonorsView& donors, const Donor& donor,
                                             std::int32_t sphere_id, InsideVolume inside,
                                             const EdgesView* edges) {
  if (inside == InsideVolume::cap) {
    return donors.assign_from(donor, sphere_id, {false, {}, edges}).volume;
  }
  if (edges != nullptr) return edges->full_volume(sphere_id, donor.point);
  return sphere_volume(static_cast<double>(donors.spheres[sphere_id].radius));
}

}}  // namespace palpate::v0
