// A ball in thirty parts as it adds to the measure: its parts, corrected by a plane (ball_cut.h),
// as the elements of one cluster. Included by kernel files only.
#pragma once

#include "src/contact/field/ball_cut.h"
#include "src/contact/field/group_totals.h"
#include "src/contact/hull/hull_rules.h"
#include "src/contact/index/ball_parts.h"

namespace palpate::inline v0::PALPATE_ISA_NAMESPACE {
namespace {

/// A number for each element of a cluster.
typedef float Row __attribute__((vector_size(4 * SphereClusters::kSize)));

/// Adds in an order that does not depend on the width of vectors.
struct SumOfRow {
  [[gnu::always_inline]] float operator()(const Row& row) const {
    float numbers[kSize];
    std::memcpy(numbers, &row, sizeof numbers);
    for (int half = kSize / 2; half > 0; half /= 2) {
      for (int i = 0; i < half; ++i) numbers[i] += numbers[i + half];
    }
    return numbers[0];
  }
};

inline Row row_of(const float* from) {
  Row row;
  std::memcpy(&row, from, sizeof row);
  return row;
}
inline VecF vector_of(const Row& row, int number) {
  return load(reinterpret_cast<const float*>(&row) + number * kLanes);
}
inline void put(VecF vector, int number, Row& row) {
  store(reinterpret_cast<float*>(&row) + number * kLanes, vector);
}

[[gnu::always_inline]] inline Gradient3<VecF> chosen(VecI which, const Gradient3<VecF>& n) {
  return {select(which, n.x, VecF{}), select(which, n.y, VecF{}), select(which, n.z, VecF{})};
}
[[gnu::always_inline]] inline Symmetric<VecF> chosen(VecI which, const Symmetric<VecF>& h) {
  return {select(which, h.xx, VecF{}), select(which, h.xy, VecF{}), select(which, h.xz, VecF{}),
          select(which, h.yy, VecF{}), select(which, h.yz, VecF{}), select(which, h.zz, VecF{})};
}

/// Up to where the values of the elements count that are vector `number` of a cluster.
[[gnu::always_inline]] inline VecF extent_of(VecF radius, bool is_ball, int number) {
  if (!is_ball) return radius;
  return select(lane_ids() + number * kLanes < splat(kNumBallParts), kPartExtent * radius, radius);
}

/// Values of a field for the elements of a cluster, in W.
struct BallSamples {
  Lanes lanes[kNumVectors];
  VecI is_touching[kNumVectors];
  SpaceCurvature<VecF> field[kNumVectors];
  bool is_complete = true;  ///< every part has a value
};

/// Adds the ball that the cluster from slot `begin` on is; few tools have more than a dozen.
template <bool kWithStiffness>
[[gnu::noinline]] void add_ball(const MeasureJob& job, std::size_t begin, const BallSamples& at,
                                GroupTotals<kWithStiffness>& totals) {
  const auto& places = ball_places().rows;
  const BallRows<Row> parts{row_of(places[0]), row_of(places[1]), row_of(places[2]),
                            row_of(places[3])};
  const SumOfRow sum;
  Row phi{};
  for (int i = 0; i < kNumVectors; ++i) put(at.field[i].first.phi, i, phi);
  const float radius = job.radius[begin + kNumBallParts];
  BallPlane<Row, float> plane;
  if (at.is_complete) {
    plane = ball_plane<float>(parts, phi * (1.0f / radius), sum, kWithStiffness);
  }
  // The ball counts so often, times powers of its radius.
  const float twice = job.ball_factor[begin / kSize] * radius * radius, thrice = twice * radius;
  Row n[3] = {}, lever[3] = {};
  for (int i = 0; i < kNumVectors; ++i) {
    const std::size_t slot = begin + static_cast<std::size_t>(i * kLanes);
    const Lanes& e = at.lanes[i];
    const VecF factor = load(job.factor + slot);
    const VecI counts = at.is_touching[i] | splat(plane.is_plane ? -1 : 0);
    const SpaceGradient<VecF>& g = at.field[i].first;
    const Gradient3<VecF> gradient = chosen(counts, Gradient3<VecF>{g.x, g.y, g.z});
    const VecF touching = select(at.is_touching[i], g.phi, e.radius);
    CutBall<VecF> cut = cut_ball(e.radius, factor, touching);
    cut.volume += thrice * vector_of(plane.volume, i);
    if (i == 0) cut.potential[0] += thrice * radius * plane.potential;
    VecF disc{};
    if constexpr (kWithStiffness) {
      disc = disc_of(e.radius, factor, touching) + twice * plane.disc * vector_of(parts.is_part, i);
      const Gradient3<VecF> shortened = bounded(gradient, length_of(gradient));
      const VecF numbers[6] = {shortened.x, shortened.y, shortened.z, e.lx, e.ly, e.lz};
      for (int axis = 0; axis < 3; ++axis) {
        put(numbers[axis], i, n[axis]);
        put(numbers[axis + 3], i, lever[axis]);
      }
    }
    totals.add(job, slot, e, touching, cut, disc, gradient, chosen(counts, at.field[i].h),
               i % RowSums::kParts);
  }
  if constexpr (kWithStiffness) {
    if (!plane.is_plane) return;
    Row weights[5];
    form_weights(parts, plane.residual, weights);
    const Row changes[6] = {n[0],
                            n[1],
                            n[2],
                            lever[1] * n[2] - lever[2] * n[1],
                            lever[2] * n[0] - lever[0] * n[2],
                            lever[0] * n[1] - lever[1] * n[0]};
    float X[5][6], terms[StiffnessSums::kNum] = {};
    for (int i = 0; i < 5; ++i) {
      for (int k = 0; k < 6; ++k) X[i][k] = sum(weights[i] * changes[k]);
    }
    add_form(plane.form, X, twice, terms);
    for (int k = 0; k < StiffnessSums::kNum; ++k) {
      VecF first{};
      first[0] = terms[k];
      totals.numbers[k].add(0, first);
    }
  }
}

}  // namespace
}  // namespace palpate::inline v0::PALPATE_ISA_NAMESPACE
