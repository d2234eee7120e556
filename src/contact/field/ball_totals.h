// Sums of a ball in thirty parts: its parts, corrected by a plane (ball_cut.h), as the elements of
// one cluster. Included by kernel files only.
#pragma once

#include <utility>

#include "src/contact/field/group_totals.h"
#include "src/contact/internal/ball_cut.h"
#include "src/contact/internal/ball_parts.h"
#include "src/contact/internal/hull_rules.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// A number for each element of a cluster.
struct Row {
  VecF vectors[kNumVectors] = {};
};
template <class F>
[[gnu::always_inline]] inline Row for_each_vector(const F& f) {
  Row row;
  for (int i = 0; i < kNumVectors; ++i) row.vectors[i] = f(i);
  return row;
}
[[gnu::always_inline]] inline Row operator+(const Row& a, const Row& b) {
  return for_each_vector([&](int i) { return a.vectors[i] + b.vectors[i]; });
}
[[gnu::always_inline]] inline Row operator-(const Row& a, const Row& b) {
  return for_each_vector([&](int i) { return a.vectors[i] - b.vectors[i]; });
}
[[gnu::always_inline]] inline Row operator*(const Row& a, const Row& b) {
  return for_each_vector([&](int i) { return a.vectors[i] * b.vectors[i]; });
}
[[gnu::always_inline]] inline Row operator*(const Row& a, float b) {
  return for_each_vector([&](int i) { return a.vectors[i] * b; });
}
[[gnu::always_inline]] inline Row operator*(float a, const Row& b) { return b * a; }
[[gnu::always_inline]] inline Row operator+(const Row& a, float b) {
  return for_each_vector([&](int i) { return a.vectors[i] + b; });
}
[[gnu::always_inline]] inline CutBall<Row> cut_ball(const Row& radius, const Row& factor,
                                                    const Row& phi) {
  CutBall<Row> cuts;
  for (int i = 0; i < kNumVectors; ++i) {
    const CutBall<VecF> cut =
        palpate::cut_ball(radius.vectors[i], factor.vectors[i], phi.vectors[i]);
    cuts.volume.vectors[i] = cut.volume;
    cuts.potential.vectors[i] = cut.potential;
  }
  return cuts;
}
[[gnu::always_inline]] inline Row cut_area(const Row& radius, const Row& factor, const Row& phi) {
  return for_each_vector([&](int i) {
    return palpate::cut_area(radius.vectors[i], factor.vectors[i], phi.vectors[i]);
  });
}

/// Adds in an order that does not depend on the width of vectors.
struct SumOfRow {
  [[gnu::always_inline]] float operator()(Row row) const {
    for (int half = kNumVectors / 2; half > 0; half /= 2) {
      for (int i = 0; i < half; ++i) row.vectors[i] += row.vectors[i + half];
    }
    float numbers[kLanes];
    store(numbers, row.vectors[0]);
    for (int half = kLanes / 2; half > 0; half /= 2) {
      for (int i = 0; i < half; ++i) numbers[i] += numbers[i + half];
    }
    return numbers[0];
  }
};

[[gnu::always_inline]] inline Row row_of(const float* from) {
  return for_each_vector([&](int i) { return load(from + i * kLanes); });
}

[[gnu::always_inline]] inline Gradient3<VecF> chosen(VecI which, const Gradient3<VecF>& n) {
  return {select(which, n.x, VecF{}), select(which, n.y, VecF{}), select(which, n.z, VecF{})};
}
[[gnu::always_inline]] inline Symmetric<VecF> chosen(VecI which, const Symmetric<VecF>& h) {
  return {select(which, h.xx, VecF{}), select(which, h.xy, VecF{}), select(which, h.xz, VecF{}),
          select(which, h.yy, VecF{}), select(which, h.yz, VecF{}), select(which, h.zz, VecF{})};
}

/// Returns the limit up to which values count for vector `number` of a cluster's elements.
[[gnu::always_inline]] inline VecF extent_of(VecF radius, bool is_ball, int number) {
  if (!is_ball) return radius;
  return select(lane_ids() + number * kLanes < splat(kNumBallParts), kPartExtent * radius, radius);
}

/// Values of a field for the elements of a cluster, in W.
struct BallSamples {
  Lanes lanes[kNumVectors];
  VecI is_touching[kNumVectors];
  SpaceCurvature<VecF> field[kNumVectors];
  NoisePlace place[kNumVectors];  ///< if somebody asks for the noise
  bool is_complete = true;        ///< every part has a value
};

/// Keeps what the values of a ball's parts change; see set_ball_changes.
inline void keep_ball(NoiseWriter& noise, const BallSamples& at, const BallPlane<Row, float>& plane,
                      float scale, const Row (&weights)[5], const Row& is_part,
                      const Row (&changes)[6], const Row& volumes, const Row& discs) {
  Row by_field[kNumChanges];
  set_ball_changes(plane, scale, weights, is_part, changes, discs, SumOfRow(), by_field);
  for (int i = 0; i < kNumVectors; ++i) {
    VecF change[kNumChanges];
    for (int k = 0; k < kNumChanges; ++k) change[k] = by_field[k].vectors[i];
    noise.keep(at.lanes[i], at.place[i], volumes.vectors[i], change,
               {changes[0].vectors[i], changes[1].vectors[i], changes[2].vectors[i]});
  }
}

/// Adds the ball whose cluster begins at slot `begin`; few tools have more than a dozen.
template <bool kWithStiffness>
[[gnu::noinline]] void add_ball(const MeasureJob& job, std::size_t begin, const BallSamples& at,
                                GroupTotals<kWithStiffness>& totals) {
  const auto& places = ball_places().rows;
  const BallRows<Row> parts{row_of(places[0]), row_of(places[1]), row_of(places[2]),
                            row_of(places[3])};
  const SumOfRow sum;
  Row phi{};
  for (int i = 0; i < kNumVectors; ++i) phi.vectors[i] = at.field[i].first.phi;
  const float radius = job.elements.radius[begin + kNumBallParts];
  NoiseWriter* const noise = std::exchange(totals.noise, nullptr);
  BallPlane<Row, float> plane;
  if (at.is_complete) {
    plane =
        ball_plane<float>(parts, phi * (1.0f / radius), sum, kWithStiffness || noise != nullptr);
  }
  // The factor of the ball times powers of its radius.
  const float twice = job.ball_factor[begin / kSize] * radius * radius, thrice = twice * radius;
  Row n[3] = {}, lever[3] = {}, volumes{}, discs{};
  for (int i = 0; i < kNumVectors; ++i) {
    const std::size_t slot = begin + static_cast<std::size_t>(i * kLanes);
    const Lanes& e = at.lanes[i];
    const VecF factor = load(job.elements.factor + slot);
    const VecI counts = at.is_touching[i] | splat(plane.is_plane ? -1 : 0);
    const SpaceGradient<VecF>& g = at.field[i].first;
    const Gradient3<VecF> gradient = chosen(counts, Gradient3<VecF>{g.x, g.y, g.z});
    const VecF touching = select(at.is_touching[i], g.phi, e.radius);
    CutBall<VecF> cut = palpate::cut_ball(e.radius, factor, touching);
    cut.volume += thrice * plane.volume.vectors[i];
    if (i == 0) cut.potential[0] += thrice * radius * plane.potential;
    VecF disc{};
    if (kWithStiffness || noise != nullptr) {
      disc = palpate::cut_area(e.radius, factor, touching) +
             twice * plane.disc * parts.is_part.vectors[i];
      const Gradient3<VecF> shortened = bounded(gradient, length_of(gradient));
      const VecF numbers[6] = {shortened.x, shortened.y, shortened.z, e.lx, e.ly, e.lz};
      for (int axis = 0; axis < 3; ++axis) {
        n[axis].vectors[i] = numbers[axis];
        lever[axis].vectors[i] = numbers[axis + 3];
      }
    }
    volumes.vectors[i] = cut.volume;
    discs.vectors[i] = disc;
    totals.add(job.elements, slot, e, touching, cut, disc, gradient, chosen(counts, at.field[i].h),
               i % RowSums::kParts);
  }
  totals.noise = noise;
  if (!kWithStiffness && noise == nullptr) return;
  const Row changes[6] = {n[0],
                          n[1],
                          n[2],
                          lever[1] * n[2] - lever[2] * n[1],
                          lever[2] * n[0] - lever[0] * n[2],
                          lever[0] * n[1] - lever[1] * n[0]};
  Row weights[5] = {};
  if (plane.is_plane) form_weights(parts, plane.residual, weights);
  if (noise != nullptr) {
    keep_ball(*noise, at, plane, twice, weights, parts.is_part, changes, volumes, discs);
  }
  if constexpr (kWithStiffness) {
    if (!plane.is_plane) return;
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

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
