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

[[gnu::always_inline]] inline Lanes aim(const MeasureJob& job, const Field& field,
                                        std::size_t slot) {
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
  e.from_u = field.fx * (e.lx + job.frame.p_WC[0]) * e.inverse_depth;
  e.from_v = field.fy * (e.ly + job.frame.p_WC[1]) * e.inverse_depth;
  e.radius = load(job.radius + slot);
  return e;
}

[[gnu::always_inline]] inline const Gradient& first_of(const Gradient& g) { return g; }
[[gnu::always_inline]] inline const Gradient& first_of(const Curvature& c) { return c.first; }

template <class Sample>
[[gnu::always_inline]] inline Sample ask(const Field& field, const Lanes& e, VecF radius) {
  return ask_field<Sample>(field, e.from_u + field.cx, e.from_v + field.cy, e.depth,
                           e.inverse_depth, radius);
}

// What the field answers elements, of which this is known so far.
template <class Sample>
[[gnu::always_inline]] inline Sample ask_deeper(const Field& field, const Lanes& e, Sample known) {
  VecF asked = e.radius;
  for (int step = 0; step < kMostDeepSteps; ++step) {
    const VecI is_deep = first_of(known).phi < -deep_limit(asked);
    if (mask_bits(is_deep) == 0) break;
    const Sample wide = ask<Sample>(field, e, asked * kDeepGrowth);
    known = chosen(is_deep, deepened(known, wide, first_of(known).phi, first_of(wide).phi, asked),
                   known);
    asked *= kDeepGrowth;
  }
  return known;
}

// The elements of a cluster and what the field answers them. Each step is a short loop: then the
// processor has several vectors in flight, where one long loop would wait for each vector's chain.
template <class Sample>
struct Answers {
  Lanes lanes[kNumVectors];
  Sample samples[kNumVectors];
  VecI is_touching[kNumVectors];  // before the camera and nearer to the surface than a radius
};

template <class Sample>
[[gnu::always_inline]] inline void ask_cluster(const MeasureJob& job, const Field& field,
                                               std::size_t begin, Answers<Sample>& to) {
  for (int i = 0; i < kNumVectors; ++i) {
    to.lanes[i] = aim(job, field, begin + static_cast<std::size_t>(i * kLanes));
  }
  Gradient gradients[kNumVectors];
  for (int i = 0; i < kNumVectors; ++i) {
    const Lanes& e = to.lanes[i];
    gradients[i] = ask<Gradient>(field, e, e.radius);
    to.is_touching[i] =
        (gradients[i].phi < e.radius) & (e.lz + job.frame.p_WC[2] > splat(kLeastDepth));
  }
  for (int i = 0; i < kNumVectors; ++i) {
    const Lanes& e = to.lanes[i];
    if (mask_bits(to.is_touching[i]) == 0) continue;
    if constexpr (std::is_same_v<Sample, Gradient>) {
      to.samples[i] = ask_deeper(field, e, gradients[i]);
    } else {
      to.samples[i] = ask_deeper(field, e, ask<Curvature>(field, e, e.radius));
    }
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

/// Calls f(slot, lanes, sample, which lanes touch, part of the sums) for vectors of elements that
/// touch the surface.
template <class Sample, class F>
[[gnu::always_inline]] inline void for_touching(const MeasureJob& job, int group, const F& f) {
  const Field field(job.field);
  Answers<Sample> answers;
  for_near_clusters(job, group, [&](std::size_t begin) {
    ask_cluster(job, field, begin, answers);
    for (int i = 0; i < kNumVectors; ++i) {
      if (mask_bits(answers.is_touching[i]) == 0) continue;
      f(begin + static_cast<std::size_t>(i * kLanes), answers.lanes[i], answers.samples[i],
        answers.is_touching[i], i % RowSums::kParts);
    }
  });
}

}  // namespace

FieldSums measure_group(const MeasureJob& job, int group) {
  const float fx = job.frame.fx, fy = job.frame.fy;
  Totals totals;
  for_touching<Gradient>(
      job, group,
      [&](std::size_t slot, const Lanes& e, const Gradient& g, VecI is_touching, int part) {
        const VecF phi = select(is_touching, g.phi, e.radius);
        const Gradient3<VecF> n = to_space(g, e.from_u, e.from_v, e.inverse_depth, fx, fy);
        add_measure(job, slot, e, phi, load(job.factor + slot), bounded(n, length_of(n)), part,
                    totals);
      });
  return totals.sums();
}

FieldSums measure_stiffness_group(const MeasureJob& job, int group, StiffnessSums& stiffness) {
  const float fx = job.frame.fx, fy = job.frame.fy;
  Totals totals;
  RowSums numbers[StiffnessSums::kNum];
  for_touching<Curvature>(
      job, group,
      [&](std::size_t slot, const Lanes& e, const Curvature& c, VecI is_touching, int part) {
        const VecF phi = select(is_touching, c.first.phi, e.radius);
        const VecF factor = load(job.factor + slot);
        const Gradient3<VecF> n = to_space(c.first, e.from_u, e.from_v, e.inverse_depth, fx, fy);
        const VecF length = length_of(n);
        const Gradient3<VecF> shortened = bounded(n, length);
        const VecF volume = add_measure(job, slot, e, phi, factor, shortened, part, totals);
        const Symmetric<VecF> h = hessian_in_space(c, e.from_u, e.from_v, e.inverse_depth, fx, fy);
        const VecF disc =
            factor * (static_cast<float>(kPi) * max(e.radius * e.radius - phi * phi, VecF{}));
        VecF terms[StiffnessSums::kNum];
        stiffness_terms<VecF>({e.lx, e.ly, e.lz}, volume, disc, shortened, bounded(h, n, length),
                              terms);
        for (int k = 0; k < StiffnessSums::kNum; ++k) numbers[k].add(part, terms[k]);
      });
  for (int k = 0; k < StiffnessSums::kNum; ++k) stiffness.numbers[k] = numbers[k].total();
  return totals.sums();
}

// The planes that whole spheres are cut by.
void describe_group(const MeasureJob& job, int group, const SphereCuts& to) {
  const SphereClusters& clusters = *job.clusters;
  for_touching<Gradient>(
      job, group, [&](std::size_t first, const Lanes& e, const Gradient& g, VecI is_touching, int) {
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
