// Lookup of the sphere that contains a point: a uniform grid over the tool whose cells lie wholly
// inside sphere k, or hold the few spheres to try. Replaces the tree of thesis Alg. 3.2 for points:
// same answer, independent of the number of spheres.
#pragma once

#include <cstddef>
#include <cstdint>
#include <new>
#include <span>
#include <vector>

#include "palpate/math/geometry.h"
#include "src/contact/index/num_bytes.h"

namespace palpate { inline namespace v0 {

/// Spheres to try in one cell, eight at a time, in grid units (cells). More than eight go on in the
/// next block.
struct alignas(64) CandidateBlock {
  static constexpr int kSize = 8;
  float x[kSize], y[kSize], z[kSize];
  float surely_inside[kSize];  ///< squared distance up to which the fast test is sure: inside
  float maybe_inside[kSize];   ///< beyond which it is sure: outside; negative for padding
  std::int32_t
      sphere_id[kSize];  ///< the last one carries kGoesOn if the next block is of this cell

  static constexpr std::int32_t kGoesOn = 1 << 30;
  PALPATE_HOSTDEV std::int32_t id(int slot) const { return sphere_id[slot] & (kGoesOn - 1); }
  PALPATE_HOSTDEV bool goes_on() const { return (sphere_id[kSize - 1] & kGoesOn) != 0; }
};

/// Not owning, trivially copyable.
struct SphereGridView {
  Vec3d origin;  ///< low corner, tool frame
  double cells_per_meter = 1;
  std::int32_t num_x = 0, num_y = 0, num_z = 0;
  const std::int32_t* tags = nullptr;  ///< 0: no sphere; k+1: inside sphere k; -(b+1): try block b
  const CandidateBlock* blocks = nullptr;
};

/// Owns the grid. Built once per tool.
class SphereGrid {
 public:
  explicit SphereGrid(std::span<const Sphere> spheres);
  SphereGridView view() const;
  std::size_t num_bytes() const { return bytes_of(tags_, blocks_); }
  std::span<const std::int32_t> tags() const { return tags_; }
  std::span<const CandidateBlock> blocks() const { return blocks_; }

  /// The fast test may err by this much, in cells; closer calls are decided in double.
  static constexpr double kRounding = 1e-4;

 private:
  Vec3d origin_;
  double cells_per_meter_ = 1;
  std::int32_t num_[3] = {0, 0, 0};
  std::vector<std::int32_t> tags_;
  std::vector<CandidateBlock> blocks_;
};

}}  // namespace palpate::v0
