// Second stage of the two brute-force methods: spheres that no point touches take a plane from
// the boundary spheres (thesis section 3.2.2, Algs. 3.3 and 3.4 corrected).
#pragma once

#include <cstdint>

#include "palpate/contact/contact.h"
#include "palpate/math/geometry.h"
#include "src/contact/index/sphere_clusters.h"
#include "src/core/internal/select_isa.h"

namespace palpate { inline namespace v0 {

/// Boundary spheres that give a plane, ascending by sphere id; arrays are padded to a multiple of
/// 16 with slots whose distance is huge and whose weight is 0. Tool frame.
struct BoundaryPlanes {
  int num = 0;
  const std::int32_t* sphere_id = nullptr;
  const float *x = nullptr, *y = nullptr, *z = nullptr;  ///< centers
  const float *nx = nullptr, *ny = nullptr, *nz = nullptr, *offset = nullptr;
  const float* count = nullptr;          ///< points inside: the priority `count`
  const float* presence = nullptr;       ///< factors of the weights; null: all ones
  const Plane<double>* plane = nullptr;  ///< the same planes in double
};

/// Sums over some spheres, tool frame; the torque is about `origin`.
struct MeasureSums {
  double volume = 0;
  Vec3d force, torque;
  int num_inside = 0;

  PALPATE_HOSTDEV void add(const MeasureSums& other) {
    volume += other.volume;
    force += other.force;
    torque += other.torque;
    num_inside += other.num_inside;
  }
};

/// Input and output of the stage. `donor[slot]` < 0 requests a plane; `kTouched` marks boundary
/// spheres, which are left alone.
struct PlaneAssignment {
  static constexpr std::int32_t kNone = -1, kTouched = -2;

  const SphereClusters* clusters = nullptr;
  const Sphere* spheres = nullptr;
  BoundaryPlanes boundary;
  Vec3d origin;  ///< center of mass
  /// Weighted: anything but `path`. Simplified: the nearest, or by count, see `first_donor`.
  Priority priority = Priority::distance;
  float doublings_per_square = 0;  ///< gaussian: kDoublings * PriorityRule::per_square, in 1/m2
  /// Simplified: the only donors of `boundary`; by count that is the one with the most points.
  std::int32_t first_donor = 0, num_donors = 0;
  const std::int32_t* numbers = nullptr;  ///< 0, 1, 2, ..., as many as `boundary` and 16 more
  const std::int32_t* touched = nullptr;  ///< per slot: kTouched or kNone
  const float* volume_scale = nullptr;    ///< per slot: factor of its V_s
  std::int32_t* donor = nullptr;          ///< simplified: index into `boundary` per slot
  float* assigned_volume = nullptr;       ///< per slot: V_s, for the state of the sphere
};

/// Boundary spheres that can be the nearest one to some sphere of a group or cluster.
struct Candidates {
  int num = 0;
  float *x = nullptr, *y = nullptr, *z = nullptr;  ///< centers
  float* squared_distance = nullptr;               ///< scratch, as large as `boundary`
  std::int32_t* donor = nullptr;                   ///< index into BoundaryPlanes
};

/// Scratch of one task. Each array holds at least as many as there are spheres, plus 16.
struct AssignmentScratch {
  Candidates of_group, of_cluster;
};

/// Clusters of one group: the best boundary sphere of each sphere cuts it (Alg. 3.4).
using AssignNearest = MeasureSums (*)(const PlaneAssignment&, int group, AssignmentScratch&);
/// Clusters of one group: average over all boundary spheres, weighted by priority (Alg. 3.3).
using AssignWeighted = MeasureSums (*)(const PlaneAssignment&, int group);

PALPATE_DECLARE_KERNELS(MeasureSums assign_nearest(const PlaneAssignment&, int group,
                                                   AssignmentScratch&);
                        MeasureSums assign_weighted(const PlaneAssignment&, int group);)

}}  // namespace palpate::v0
