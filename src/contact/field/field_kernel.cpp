// Elements against the depth field, compiled once per instruction set.
#include "src/contact/field/ball_totals.h"
#include "src/contact/field/packed_samples.h"
#include "src/contact/field/whole_totals.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

// Vectors of elements, and their samples of the fields.
template <class Sample, int kFields>
struct Answers {
  static constexpr int kMaxVectors = 2 * kNumVectors;  // of two clusters

  int num = 0;
  std::size_t slots[kMaxVectors];
  const NearFields<kFields>* near[kMaxVectors];  // those that are sampled
  Lanes lanes[kMaxVectors];
  Sample samples[kFields][kMaxVectors];
  VecI is_touching[kFields]
                  [kMaxVectors];  // before the camera and nearer to the surface than a radius

  void add(std::size_t slot, const NearFields<kFields>& fields_near) {
    slots[num] = slot;
    near[num++] = &fields_near;
  }
};

template <class Sample, int kFields>
[[gnu::noinline]] void query_elements(const ElementRows& rows, const FieldFrame& frame,
                                      const Grid& grid, const Pixels (&fields)[kFields],
                                      Answers<Sample, kFields>& to) {
  constexpr int kMaxVectors = Answers<Sample, kFields>::kMaxVectors;
  for (int i = 0; i < to.num; ++i) to.lanes[i] = aim(rows, frame, grid, to.slots[i]);
  for (int k = 0; k < kFields; ++k) {
    VecI(&is_touching)[kMaxVectors] = to.is_touching[k];
    for (int i = 0; i < to.num; ++i) {
      is_touching[i] = splat(-static_cast<std::int32_t>(to.near[i]->bits >> k & 1));
      const DepthTile& bound = to.near[i]->bounds[k];
      if (!is_known(bound)) continue;
      // A little more than rounding may lower what is sampled.
      const Lanes& e = to.lanes[i];
      const VecF distance = bound.min_slope * (bound.nearest - e.depth);
      if (mask_bits(distance > 1.0001f * e.radius + 1e-6f) == kAllLanes) is_touching[i] = VecI{};
    }
    sample_together<kMaxVectors>(grid, fields[k], to.lanes, is_touching, to.num, 1, to.samples[k]);
    for (int i = 0; i < to.num; ++i) {
      const Lanes& e = to.lanes[i];
      is_touching[i] &=
          (e.lz + frame.p_WC[2] > splat(kMinDepth)) & (first_of(to.samples[k][i]).phi < e.radius);
    }
    deepen_together<kMaxVectors>(grid, fields[k], to.lanes, is_touching, to.num, to.samples[k]);
  }
}

/// A field's values in W for vector i of the elements.
template <class Sample, int kFields>
[[gnu::always_inline]] inline SpaceCurvature<VecF> in_space(const FieldFrame& frame,
                                                            Answers<Sample, kFields>& answers,
                                                            int i, int k) {
  const auto at = palpate::in_space(frame, answers.lanes[i], answers.samples[k][i]);
  return {first_of(at), second_of(at)};
}

/// Calls f(cluster, number of its first vector among the answers) after the fields near the
/// elements of the clusters of a group were sampled, by the bits of `near`.
template <class Sample, int kFields, class F>
[[gnu::always_inline]] inline void for_each_near(const MeasureJob& job, const Grid& grid,
                                                 const Pixels (&fields)[kFields], int group,
                                                 const NearFields<kFields> (&near)[kNumClusters],
                                                 Answers<Sample, kFields>& answers, const F& f) {
  constexpr int kMaxVectors = Answers<Sample, kFields>::kMaxVectors;
  for (int number = 0; number < kNumClusters;) {
    int numbers[kMaxVectors], first[kMaxVectors], num = 0;
    answers.num = 0;
    for (; number < kNumClusters; ++number) {
      if (near[number].bits == 0) continue;
      const int cluster = group * kNumClusters + number;
      const int num_vectors = (job.clusters->num_spheres(cluster) + kLanes - 1) / kLanes;
      if (answers.num + num_vectors > kMaxVectors) break;
      numbers[num] = number;
      first[num++] = answers.num;
      for (int i = 0; i < num_vectors; ++i) {
        answers.add(static_cast<std::size_t>(cluster * kSize + i * kLanes), near[number]);
      }
    }
    query_elements<Sample, kFields>(job.elements, job.frame, grid, fields, answers);
    for (int i = 0; i < num; ++i) f(numbers[i], first[i]);
  }
}

// Measures one group: the clusters that lie deep as one ball each, the others by their elements.
template <class Sample, int kFields>
[[gnu::always_inline]] inline void measure(const MeasureJob& job, int group, GroupSums* to) {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  GroupTotals<kWithStiffness> totals[kFields], blended[kFields];
  NoiseWriter noise(job.noise, group);
  if (noise.wants()) totals[0].noise = &noise;
  NearFields<kFields> near[kNumClusters];
  if (!find_near<kFields>(job, group, near)) {
    noise.finish();
    std::fill_n(to, kFields, GroupSums{});
    return;
  }
  const auto place_of = [&](const Lanes& e) {
    return noise.wants() ? noise_place(job.frame, e, kNotTurned, 0) : NoisePlace{};
  };
  const Grid grid(job.fields[0]);
  Pixels fields[kFields];
  for (int k = 0; k < kFields; ++k) fields[k] = pixels_of(job.fields[k]);
  Answers<Sample, kFields> answers;
  Wholes<kWithStiffness> wholes[kFields];
  const NearFields<kFields> all{(1u << kFields) - 1, {}};
  if (job.first_ball >= kMinWholes) {
    const std::size_t begin = static_cast<std::size_t>(group) * kNumClusters;
    for (int i = 0; i < kNumWholes; ++i) {
      answers.add(begin + static_cast<std::size_t>(i * kLanes), all);
    }
    query_elements<Sample, kFields>(job.wholes, job.frame, grid, fields, answers);
    for (int i = 0; i < kNumWholes; ++i) {
      for (int k = 0; k < kFields; ++k) {
        wholes[k].take(job, group, i, answers.lanes[i], answers.is_touching[k][i],
                       in_space(job.frame, answers, i, k), place_of(answers.lanes[i]));
      }
    }
  }
  // All parts of a ball count: none is left out.
  for (int number = 0; number < kNumClusters; ++number) {
    if (group * kNumClusters + number >= job.first_ball) {
      std::fill_n(near[number].bounds, kFields, DepthTile{});
    }
    for (int k = 0; k < kFields; ++k) {
      if (wholes[k].share(number) >= 1) near[number].bits &= ~(1u << k);
    }
  }
  for_each_near(job, grid, fields, group, near, answers, [&](int number, int first) {
    const int cluster = group * kNumClusters + number;
    const std::size_t begin = static_cast<std::size_t>(cluster) * kSize;
    const int num_vectors = (job.clusters->num_spheres(cluster) + kLanes - 1) / kLanes;
    for (int k = 0; k < kFields; ++k) {
      if ((near[number].bits >> k & 1) == 0) continue;
      const float share = wholes[k].share(number);
      if (share > 0) {
        blended[k] = GroupTotals<kWithStiffness>{};
        blended[k].noise = totals[k].noise;
        blended[k].share = 1 - share;
      }
      GroupTotals<kWithStiffness>& elements = share > 0 ? blended[k] : totals[k];
      if (cluster >= job.first_ball) {
        BallSamples ball;
        for (int i = 0; i < kNumVectors; ++i) {
          const Lanes& e = ball.lanes[i] = answers.lanes[first + i];
          ball.is_touching[i] = answers.is_touching[k][first + i];
          ball.place[i] = place_of(e);
          ball.is_complete &= mask_bits(~(e.lz + job.frame.p_WC[2] > splat(kMinDepth))) == 0;
          ball.field[i] = in_space(job.frame, answers, first + i, k);
          // Limited, as in the depth hull.
          ball.field[i] =
              composed(limited(ball.field[i].first.phi, e.radius, extent_of(e.radius, true, i)),
                       ball.field[i]);
        }
        add_ball(job, begin, ball, elements);
        continue;
      }
      for (int i = 0; i < num_vectors; ++i) {
        const VecI is_touching = answers.is_touching[k][first + i];
        if (mask_bits(is_touching) == 0) continue;
        const Lanes& e = answers.lanes[first + i];
        const SpaceCurvature<VecF> field = in_space(job.frame, answers, first + i, k);
        const SpaceGradient<VecF>& g = field.first;
        elements.place = place_of(e);
        elements.add(job.elements, begin + static_cast<std::size_t>(i * kLanes), e, is_touching,
                     g.phi, {g.x, g.y, g.z}, field.h, i % RowSums::kParts);
      }
      if (share > 0) wholes[k].add(number, blended[k], totals[k]);
    }
  });
  for (int k = 0; k < kFields; ++k) wholes[k].add_to(job, group, totals[k]);
  noise.finish();
  for (int k = 0; k < kFields; ++k) totals[k].write(to[k]);
}

}  // namespace

void measure_group(const MeasureJob& job, int group, bool with_stiffness, GroupSums* sums) {
  const bool is_between = job.num_fields == 2;
  if (with_stiffness && is_between) return measure<Curvature, 2>(job, group, sums);
  if (with_stiffness) return measure<Curvature, 1>(job, group, sums);
  if (is_between) return measure<Gradient, 2>(job, group, sums);
  measure<Gradient, 1>(job, group, sums);
}

// Writes the planes that cut whole spheres.
void describe_group(const MeasureJob& job, int group, const SphereCuts& to) {
  NearFields<1> near[kNumClusters];
  if (!find_near<1>(job, group, near)) return;
  const Grid grid(job.fields[0]);
  const Pixels fields[] = {pixels_of(job.fields[0])};
  Answers<Gradient, 1> answers;
  for_each_near(job, grid, fields, group, near, answers, [&](int number, int first) {
    const int cluster = group * kNumClusters + number;
    const int num_vectors = (job.clusters->num_spheres(cluster) + kLanes - 1) / kLanes;
    for (int i = 0; i < num_vectors; ++i) {
      const VecI is_touching = answers.is_touching[0][first + i];
      if (mask_bits(is_touching) == 0) continue;
      const SpaceGradient<VecF> g = in_space(job.frame, answers, first + i, 0).first;
      describe(job, answers.slots[first + i], answers.lanes[first + i], is_touching, g.phi,
               {g.x, g.y, g.z}, to);
    }
  });
}

// Finds the pixels of a field that were measured, or lie inside a measured surface.
inline VecI is_measured(const DepthFieldView& field, VecI column, VecI row, VecF slope) {
  if (field.filled_behind == nullptr) return slope > VecF{};
  const auto* const words = reinterpret_cast<const std::int32_t*>(field.filled_behind);
  const VecI word = gather(words, row * field.filled_stride + (column >> 5));
  return (slope > VecF{}) & ((word >> (column & 31) & 1) == 0);
}

// Unseen by a single camera is space more than kSeenBehind behind the surface that its pixel shows,
// behind pixels without surface or measurement, and out of its sight. A memory's second field shows
// the current measurement.
double unseen_in_group(const MeasureJob& job, int group, std::uint8_t* spheres) {
  const SphereClusters& clusters = *job.clusters;
  const DepthFieldView& field = job.fields[0];
  const Grid grid(field);
  const int first = group * SphereClusters::kClustersPerGroup;
  const int last = std::min(first + SphereClusters::kClustersPerGroup, clusters.num_clusters());
  RowSums unseen;
  for (int cluster = first; cluster < last; ++cluster) {
    for (int i = 0; i < kNumVectors; ++i) {
      const auto slot = static_cast<std::size_t>(cluster * kSize + i * kLanes);
      const Lanes e = aim(job.elements, job.frame, grid, slot);
      const VecF u = e.from_u + (grid.cx + 0.5f), v = e.from_v + (grid.cy + 0.5f);
      const VecI is_in_image = (e.lz + job.frame.p_WC[2] > splat(kMinDepth)) & (u >= VecF{}) &
                               (v >= VecF{}) & (u < splat(grid.width)) & (v < splat(grid.height));
      const VecI column = is_in_image ? to_int(u) : VecI{}, row = is_in_image ? to_int(v) : VecI{};
      VecI is_seen = is_in_image;
      for (int k = 0; k < job.num_fields; ++k) {
        const float* const planes = job.fields[k].levels[0].planes;
        const VecI pixel = 2 * (row * grid.stride + column);
        const VecF offset = gather(planes, pixel), slope = gather(planes + 1, pixel);
        is_seen &= is_measured(job.fields[k], column, row, slope);
        if (k > 0) continue;  // behind a new surface space is remembered
        is_seen &= offset - e.depth * slope >= splat(-static_cast<float>(kSeenBehind));
      }
      unseen.add(i % RowSums::kParts,
                 select(is_seen, VecF{}, whole_volume(job.elements, slot, e.radius)));
      mark_unseen(job, slot, ~is_seen, spheres);
    }
  }
  return unseen.total();
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
