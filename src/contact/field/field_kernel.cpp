// Elements against the depth field, compiled once per instruction set.
#include "src/contact/field/field_element.h"
#include "src/contact/field/field_lanes.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

using Gradient = ImageGradient<VecF>;
using Curvature = ImageCurvature<VecF>;

constexpr int kNumVectors = kSize / kLanes;  // of a cluster

// Where the elements of a vector are.
struct Lanes {
  VecF lx, ly, lz;      // from C, in W
  VecF from_u, from_v;  // pixels of level 0 from the principal point
  VecF depth, inverse_depth, radius;
};

[[gnu::always_inline]] inline Lanes aim(const MeasureJob& job, const Grid& grid, std::size_t slot) {
  const SphereClusters& c = *job.clusters;
  const VecF x_T = load(&c.x[slot]), y_T = load(&c.y[slot]), z_T = load(&c.z[slot]);
  const auto rotated = [&](const float(&row)[3]) {
    return row[0] * x_T + row[1] * y_T + row[2] * z_T;
  };
  Lanes e;
  e.lx = rotated(job.frame.R_WT[0]);
  e.ly = rotated(job.frame.R_WT[1]);
  e.lz = rotated(job.frame.R_WT[2]);
  e.depth = max(e.lz + job.frame.p_WC[2], splat(kLeastDepth));
  e.inverse_depth = 1.0f / e.depth;
  e.from_u = grid.fx * (e.lx + job.frame.p_WC[0]) * e.inverse_depth;
  e.from_v = grid.fy * (e.ly + job.frame.p_WC[1]) * e.inverse_depth;
  e.radius = load(job.radius + slot);
  return e;
}

[[gnu::always_inline]] inline Gradient& first_of(Gradient& g) { return g; }
[[gnu::always_inline]] inline Gradient& first_of(Curvature& c) { return c.first; }

[[gnu::always_inline]] inline Look look_of(const Grid& grid, const Lanes& e, VecF radius) {
  return look_at(grid, e.from_u + grid.cx, e.from_v + grid.cy, e.inverse_depth, radius);
}

// What the fields say to elements of a vector.
template <class Sample, int kFields>
struct Answer {
  Sample samples[kFields];
  VecI is_touching[kFields];  // before the camera and nearer to the surface than a radius

  [[gnu::always_inline]] bool is_free() const {
    VecI any = is_touching[0];
    for (int k = 1; k < kFields; ++k) any |= is_touching[k];
    return mask_bits(any) == 0;
  }
};

// What lies deep asks wider pixels, too.
template <class Sample, int kFields>
[[gnu::always_inline]] inline void ask_deeper(const Grid& grid, const Pixels (&fields)[kFields],
                                              const Lanes& e, Answer<Sample, kFields>& answer) {
  VecF asked = e.radius;
  for (int step = 0; step < kMostDeepSteps; ++step) {
    VecI is_deep[kFields], any{};
    for (int k = 0; k < kFields; ++k) {
      is_deep[k] = answer.is_touching[k] & (first_of(answer.samples[k]).phi < -deep_limit(asked));
      any |= is_deep[k];
    }
    if (mask_bits(any) == 0) break;
    const Look look = look_of(grid, e, asked * kDeepGrowth);
    for (int k = 0; k < kFields; ++k) {
      if (kFields > 1 && mask_bits(is_deep[k]) == 0) continue;
      Sample& known = answer.samples[k];
      Sample wide = ask_field<Sample>(grid, fields[k], look, e.depth, e.inverse_depth);
      known = chosen(is_deep[k],
                     deepened(known, wide, first_of(known).phi, first_of(wide).phi, asked), known);
    }
    asked *= kDeepGrowth;
  }
}

// The elements of a cluster and what the fields say to them. Each step is a short loop: then the
// processor has several vectors in flight, where one long loop would wait for each vector's chain.
template <class Sample, int kFields>
struct Answers {
  Lanes lanes[kNumVectors];
  Answer<Sample, kFields> fields[kNumVectors];
};

template <class Sample, int kFields>
[[gnu::always_inline]] inline void ask_cluster(const MeasureJob& job, const Grid& grid,
                                               const Pixels (&fields)[kFields], std::size_t begin,
                                               std::uint32_t near, Answers<Sample, kFields>& to) {
  for (int i = 0; i < kNumVectors; ++i) {
    to.lanes[i] = aim(job, grid, begin + static_cast<std::size_t>(i * kLanes));
  }
  for (int i = 0; i < kNumVectors; ++i) {
    const Lanes& e = to.lanes[i];
    const Look look = look_of(grid, e, e.radius);
    const VecI is_before_camera = e.lz + job.frame.p_WC[2] > splat(kLeastDepth);
    for (int k = 0; k < kFields; ++k) {
      Answer<Sample, kFields>& answer = to.fields[i];
      answer.is_touching[k] = VecI{};
      if (kFields > 1 && (near >> k & 1) == 0) continue;
      answer.samples[k] = ask_field<Sample>(grid, fields[k], look, e.depth, e.inverse_depth);
      answer.is_touching[k] = is_before_camera & (first_of(answer.samples[k]).phi < e.radius);
    }
  }
  for (int i = 0; i < kNumVectors; ++i) {
    ask_deeper<Sample, kFields>(grid, fields, to.lanes[i], to.fields[i]);
  }
}

// Sums of one group.
struct Totals {
  RowSums volume, potential, fx, fy, fz, tx, ty, tz, boundary, inside;

  FieldSums sums() const {
    return {volume.total(),
            potential.total(),
            {fx.total(), fy.total(), fz.total()},
            {tx.total(), ty.total(), tz.total()},
            boundary.total(),
            inside.total()};
  }
};

[[gnu::always_inline]] inline VecF length_of(const Gradient3<VecF>& n) {
  return sqrt(n.x * n.x + n.y * n.y + n.z * n.z);
}

// Volumes, energies and forces of a vector of elements; returns the volumes.
[[gnu::always_inline]] inline VecF add_measure(const MeasureJob& job, std::size_t slot,
                                               const Lanes& e, VecF phi, VecF factor,
                                               const Gradient3<VecF>& n, int part, Totals& totals) {
  const CutBall<VecF> cut = cut_ball(e.radius, factor, phi);
  const VecF x = cut.volume * n.x, y = cut.volume * n.y, z = cut.volume * n.z;
  totals.volume.add(part, cut.volume);
  totals.potential.add(part, cut.potential);
  totals.fx.add(part, x);
  totals.fy.add(part, y);
  totals.fz.add(part, z);
  totals.tx.add(part, e.ly * z - e.lz * y);
  totals.ty.add(part, e.lz * x - e.lx * z);
  totals.tz.add(part, e.lx * y - e.ly * x);
  const VecF counted = load(job.counted + slot);
  const VecI is_inside = phi <= -e.radius;
  totals.inside.add(part, select(is_inside, counted, VecF{}));
  totals.boundary.add(part, select((phi < e.radius) & ~is_inside, counted, VecF{}));
  return cut.volume;
}

/// Calls f(slot, lanes, field, sample, which lanes touch, part of the sums) for vectors of elements
/// that touch the surface of a field. Returns false if none can.
template <class Sample, int kFields, class F>
[[gnu::always_inline]] inline bool for_touching(const MeasureJob& job, int group, const F& f) {
  if (!is_group_near<kFields>(job, group)) return false;
  const Grid grid(job.fields[0]);
  Pixels fields[kFields];
  for (int k = 0; k < kFields; ++k) fields[k] = pixels_of(job.fields[k]);
  Answers<Sample, kFields> answers;
  for_near_clusters<kFields>(job, group, [&](std::size_t begin, std::uint32_t near) {
    ask_cluster<Sample, kFields>(job, grid, fields, begin, near, answers);
    for (int i = 0; i < kNumVectors; ++i) {
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
  Totals totals[kFields];
  RowSums numbers[kFields][kWithStiffness ? StiffnessSums::kNum : 1];
  const bool is_near = for_touching<Sample, kFields>(
      job, group,
      [&](std::size_t slot, const Lanes& e, int k, Sample& sample, VecI is_touching, int part) {
        const Gradient& g = first_of(sample);
        const VecF phi = select(is_touching, g.phi, e.radius);
        const VecF factor = load(job.factor + slot);
        const Gradient3<VecF> n = to_space(g, e.from_u, e.from_v, e.inverse_depth, fx, fy);
        const VecF length = length_of(n);
        const Gradient3<VecF> shortened = bounded(n, length);
        const VecF volume = add_measure(job, slot, e, phi, factor, shortened, part, totals[k]);
        if constexpr (kWithStiffness) {
          const Symmetric<VecF> h =
              hessian_in_space(sample, e.from_u, e.from_v, e.inverse_depth, fx, fy);
          const VecF disc =
              factor * (static_cast<float>(kPi) * max(e.radius * e.radius - phi * phi, VecF{}));
          VecF terms[StiffnessSums::kNum];
          stiffness_terms<VecF>({e.lx, e.ly, e.lz}, volume, disc,
                                polar_moment<VecF>(e.radius, factor, phi), shortened,
                                bounded(h, n, length), terms);
          for (int i = 0; i < StiffnessSums::kNum; ++i) numbers[k][i].add(part, terms[i]);
        }
      });
  if (!is_near) {
    std::fill_n(to, kFields, GroupSums{});
    return;
  }
  for (int k = 0; k < kFields; ++k) {
    to[k].measure = totals[k].sums();
    if constexpr (kWithStiffness) {
      for (int i = 0; i < StiffnessSums::kNum; ++i) {
        to[k].stiffness.numbers[i] = numbers[k][i].total();
      }
    }
  }
}

}  // namespace

void measure_group(const MeasureJob& job, int group, bool with_stiffness, GroupSums* sums) {
  const bool is_between = job.num_fields == 2;
  if (with_stiffness && is_between) return measure<Curvature, 2>(job, group, sums);
  if (with_stiffness) return measure<Curvature, 1>(job, group, sums);
  if (is_between) return measure<Gradient, 2>(job, group, sums);
  measure<Gradient, 1>(job, group, sums);
}

// The planes that whole spheres are cut by.
void describe_group(const MeasureJob& job, int group, const SphereCuts& to) {
  const SphereClusters& clusters = *job.clusters;
  for_touching<Gradient, 1>(
      job, group, [&](std::size_t first, const Lanes& e, int, Gradient& g, VecI is_touching, int) {
        const Gradient3<VecF> n =
            to_space(g, e.from_u, e.from_v, e.inverse_depth, job.frame.fx, job.frame.fy);
        const VecF length = max(length_of(n), splat(1e-20f));
        const VecF c_C[3] = {load(&clusters.x[first]), load(&clusters.y[first]),
                             load(&clusters.z[first])};
        VecF along = -g.phi, n_T[3];
        for (int axis = 0; axis < 3; ++axis) {
          const auto& R_WT = job.frame.R_WT;
          n_T[axis] = (R_WT[0][axis] * n.x + R_WT[1][axis] * n.y + R_WT[2][axis] * n.z) / length;
          along += n_T[axis] * (c_C[axis] + to.p_TC[axis]);
        }
        const VecI is_counted = is_touching & (load(job.counted + first) > VecF{});
        for (std::uint32_t bits = mask_bits(is_counted); bits != 0; bits &= bits - 1) {
          const int lane = __builtin_ctz(bits);
          // An element that is counted has the number of its sphere.
          const auto id =
              static_cast<std::size_t>(clusters.sphere_id[first + static_cast<std::size_t>(lane)]);
          if (to.states != nullptr)
            to.states[id] =
                g.phi[lane] > -e.radius[lane] ? SphereState::boundary : SphereState::inside;
          if (to.planes != nullptr)
            to.planes[id] = {{n_T[0][lane], n_T[1][lane], n_T[2][lane]}, along[lane]};
        }
      });
}

}  // namespace palpate::PALPATE_ISA_NAMESPACE
