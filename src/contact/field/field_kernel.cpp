// Elements against the depth field, compiled once per instruction set.
#include "src/contact/field/ball_totals.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

// The elements of a cluster and their samples of the fields. Each step is a short loop: then the
// processor has several vectors in flight, where one long loop would wait for each vector's chain.
template <class Sample, int kFields>
struct Answers {
  Lanes lanes[kNumVectors];
  Answer<Sample, kFields> fields[kNumVectors];
};

template <class Sample, int kFields>
[[gnu::always_inline]] inline void query_cluster(const MeasureJob& job, const Grid& grid,
                                                 const Pixels (&fields)[kFields], std::size_t begin,
                                                 int num_vectors, std::uint32_t near,
                                                 Answers<Sample, kFields>& to) {
  for (int i = 0; i < num_vectors; ++i) {
    to.lanes[i] = aim(job, grid, begin + static_cast<std::size_t>(i * kLanes));
  }
  for (int i = 0; i < num_vectors; ++i) {
    const Lanes& e = to.lanes[i];
    const Look look = look_of(grid, e, e.radius);
    const VecI is_before_camera = e.lz + job.frame.p_WC[2] > splat(kMinDepth);
    for (int k = 0; k < kFields; ++k) {
      Answer<Sample, kFields>& answer = to.fields[i];
      answer.is_touching[k] = VecI{};
      if (kFields > 1 && (near >> k & 1) == 0) continue;
      answer.samples[k] = query_field<Sample>(grid, fields[k], look, e.depth, e.inverse_depth);
      answer.is_touching[k] = is_before_camera & (first_of(answer.samples[k]).phi < e.radius);
    }
  }
  for (int i = 0; i < num_vectors; ++i) {
    query_deeper<Sample, kFields>(grid, fields, to.lanes[i], to.fields[i]);
  }
}

/// Calls f(slot, lanes, field, sample, which lanes touch, part of the sums) for vectors of elements
/// that touch the surface of a field, and ball(slot, field, answers) for each ball in parts that
/// may. Returns false if none can.
template <class Sample, int kFields, class F, class Ball>
[[gnu::always_inline]] inline bool for_touching(const MeasureJob& job, int group, const F& f,
                                                const Ball& ball) {
  if (!is_group_near<kFields>(job, group)) return false;
  const Grid grid(job.fields[0]);
  Pixels fields[kFields];
  for (int k = 0; k < kFields; ++k) fields[k] = pixels_of(job.fields[k]);
  Answers<Sample, kFields> answers;
  for_near_clusters<kFields>(job, group, [&](std::size_t begin, std::uint32_t near) {
    const int cluster = static_cast<int>(begin / kSize);
    const int num = job.clusters->num_spheres(cluster);
    const int num_vectors = (num + kLanes - 1) / kLanes;
    query_cluster<Sample, kFields>(job, grid, fields, begin, num_vectors, near, answers);
    if (cluster >= job.first_ball) {
      for (int k = 0; k < kFields; ++k) {
        if ((near >> k & 1) != 0) ball(begin, k, answers);
      }
      return;
    }
    for (int i = 0; i < num_vectors; ++i) {
      const std::size_t slot = begin + static_cast<std::size_t>(i * kLanes);
      Answer<Sample, kFields>& answer = answers.fields[i];
      for (int k = 0; k < kFields; ++k) {
        if (mask_bits(answer.is_touching[k]) == 0) continue;
        f(slot, answers.lanes[i], k, answer.samples[k], answer.is_touching[k], i % RowSums::kParts);
      }
    }
  });
  return true;
}

template <class Sample, int kFields>
[[gnu::always_inline]] inline void measure(const MeasureJob& job, int group, GroupSums* to) {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  const float fx = job.frame.fx, fy = job.frame.fy;
  GroupTotals<kWithStiffness> totals[kFields];
  NoiseWriter noise(job.noise, group);
  if (noise.wants()) totals[0].noise = &noise;
  const auto place_noise = [&](const Lanes& e) { return noise_place(job.frame, e, kNotTurned, 0); };
  const bool is_near = for_touching<Sample, kFields>(
      job, group,
      [&](std::size_t slot, const Lanes& e, int k, Sample& sample, VecI is_touching, int part) {
        const Gradient& g = first_of(sample);
        const Gradient3<VecF> n = to_space(g, e.from_u, e.from_v, e.inverse_depth, fx, fy);
        Symmetric<VecF> h;
        if constexpr (kWithStiffness) {
          h = hessian_in_space(sample, e.from_u, e.from_v, e.inverse_depth, fx, fy);
        }
        if (totals[k].noise != nullptr) totals[k].place = place_noise(e);
        totals[k].add(job, slot, e, is_touching, g.phi, n, h, part);
      },
      [&](std::size_t begin, int k, Answers<Sample, kFields>& answers) {
        BallSamples ball;
        for (int i = 0; i < kNumVectors; ++i) {
          const Lanes& e = ball.lanes[i] = answers.lanes[i];
          Sample& sample = answers.fields[i].samples[k];
          const Gradient& g = first_of(sample);
          ball.is_touching[i] = answers.fields[i].is_touching[k];
          if (totals[k].noise != nullptr) ball.place[i] = place_noise(e);
          ball.is_complete &= mask_bits(~(e.lz + job.frame.p_WC[2] > splat(kMinDepth))) == 0;
          const Gradient3<VecF> n = to_space(g, e.from_u, e.from_v, e.inverse_depth, fx, fy);
          SpaceCurvature<VecF>& field = ball.field[i] = {{g.phi, n.x, n.y, n.z}, {}};
          if constexpr (kWithStiffness) {
            field.h = hessian_in_space(sample, e.from_u, e.from_v, e.inverse_depth, fx, fy);
          }
          // Limited, as in the depth hull.
          field = composed(limited(g.phi, e.radius, extent_of(e.radius, true, i)), field);
        }
        add_ball(job, begin, ball, totals[k]);
      });
  noise.finish();
  if (!is_near) {
    std::fill_n(to, kFields, GroupSums{});
    return;
  }
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
  const auto describe_vector = [&](std::size_t slot, const Lanes& e, int, Gradient& g,
                                   VecI is_touching, int) {
    describe(job, slot, e, is_touching, g.phi,
             to_space(g, e.from_u, e.from_v, e.inverse_depth, job.frame.fx, job.frame.fy), to);
  };
  for_touching<Gradient, 1>(
      job, group, describe_vector, [&](std::size_t begin, int, Answers<Gradient, 1>& answers) {
        for (int i = 0; i < kNumVectors; ++i) {
          const std::size_t slot = begin + static_cast<std::size_t>(i * kLanes);
          Answer<Gradient, 1>& answer = answers.fields[i];
          describe_vector(slot, answers.lanes[i], 0, answer.samples[0], answer.is_touching[0], 0);
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
      const Lanes e = aim(job, grid, slot);
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
      unseen.add(i % RowSums::kParts, select(is_seen, VecF{}, whole_volume(job, slot, e.radius)));
      mark_unseen(job, slot, ~is_seen, spheres);
    }
  }
  return unseen.total();
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
