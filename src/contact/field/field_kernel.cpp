// Elements against the depth field, compiled once per instruction set: the steps of
// palpate/field/field_sample.h for as many elements at once as a vector has lanes.
#include "src/contact/field/field_element.h"
#include "src/contact/field/field_lanes.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

// phi and its derivatives, each element on a level of its own.
[[gnu::noinline]] ImageGradient<VecF> sample_silhouettes(const Field& field, const Spot& at,
                                                         VecI level, VecF depth) {
  Curved<VecF> values[3][3];
  values_around(field, at.pixel, level, depth, values);
  return gradient_of(values, at.s, at.t, scale_of(level));
}

// The same where all values are those of planes, row by row.
[[gnu::always_inline]] inline ImageGradient<VecF> sample(const Field& field, const Spot& at,
                                                         VecI level, VecF depth) {
  if (!are_plain(field, at.pixel)) [[unlikely]] {
    return sample_silhouettes(field, at, level, depth);
  }
  VecF value[3], by_u[3], slopes[3];
  for (int q = 0; q < 3; ++q) {
    VecF pairs[6];  // offset, slope, offset, slope, ...
    gather_three_pairs(field.planes + 2 * ((q - 1) * field.stride - 1), at.pixel, pairs);
    VecF plane[3];
    for (int p = 0; p < 3; ++p) plane[p] = pairs[2 * p] - depth * pairs[2 * p + 1];
    const Curved<VecF> sum = spline(plane[0], plane[1], plane[2], at.s);
    value[q] = sum.value;
    by_u[q] = sum.slope;
    slopes[q] = spline(-pairs[1], -pairs[3], -pairs[5], at.s).value;
  }
  const VecF scale = scale_of(level);
  const Curved<VecF> phi = spline(value[0], value[1], value[2], at.t);
  return {phi.value, spline(by_u[0], by_u[1], by_u[2], at.t).value * scale, phi.slope * scale,
          spline(slopes[0], slopes[1], slopes[2], at.t).value};
}

// What elements of these radii are told by the levels of their size.
inline ImageGradient<VecF> ask_field(const Field& field, VecF u, VecF v, VecF depth,
                                     VecF inverse_depth, VecF radius) {
  const LevelBlend choice = choose_levels(field, radius, inverse_depth);
  ImageGradient<VecF> g = sample(field, spot_at(field, u, v, choice.level), choice.level, depth);
  const VecF blend = select(choice.is_single, VecF{}, choice.step.value);
  if (mask_bits(blend > VecF{}) == 0) return g;
  const VecF blend_by_z = select(choice.is_single, VecF{}, choice.step.slope * choice.x_by_z);
  const VecI last = splat(field.last_level);
  const VecI wider = choice.level < last ? choice.level + 1 : last;
  const ImageGradient<VecF> next = sample(field, spot_at(field, u, v, wider), wider, depth);
  return mixed(g, next, blend, blend_by_z);
}

// Sums of one group.
struct Totals {
  RowSums volume, potential, fx, fy, fz, tx, ty, tz, boundary, inside;
};

// Step 2: phi and its derivatives.
[[gnu::always_inline]] inline void ask(const MeasureJob& job, const Field& field, std::size_t begin,
                                       Elements& at) {
  const VecI last = splat(field.last_level);
  for (int i = 0; i < kSize; i += kLanes) {
    const VecF depth = load(at.depth + i), radius = load(job.radius + begin + i);
    const VecI level = load(at.level + i);
    const VecF u = load(at.from_u + i) + field.cx, v = load(at.from_v + i) + field.cy;
    ImageGradient<VecF> g =
        sample(field, {load(at.pixel + i), load(at.s + i), load(at.t + i)}, level, depth);
    const VecF blend = load(at.blend + i);
    if (mask_bits(blend > VecF{}) != 0) {
      const VecI wider = level < last ? level + 1 : last;
      g = mixed(g, sample(field, spot_at(field, u, v, wider), wider, depth), blend,
                load(at.blend_by_z + i));
    }
    VecF asked = radius;
    for (int step = 0; step < kMostDeepSteps; ++step) {
      const VecI is_deep = g.phi < -deep_limit(asked);
      if (mask_bits(is_deep) == 0) break;
      const ImageGradient<VecF> wide =
          ask_field(field, u, v, depth, load(at.inverse_depth + i), asked * kDeepGrowth);
      g = chosen(is_deep, deepened(g, wide, g.phi, wide.phi, asked), g);
      asked *= kDeepGrowth;
    }
    store(at.phi + i, g.phi);
    store(at.by_u + i, g.by_u);
    store(at.by_v + i, g.by_v);
    store(at.by_z + i, g.by_z);
  }
}

// Step 3: volumes, energies and forces.
[[gnu::always_inline]] inline void sum_up(const MeasureJob& job, const Field& field,
                                          std::size_t begin, const Elements& at, Totals& totals) {
  for (int i = 0; i < kSize; i += kLanes) {
    const std::size_t place = begin + static_cast<std::size_t>(i);
    const VecF radius = load(job.radius + place), factor = load(job.factor + place);
    const VecF lx = load(at.lx + i), ly = load(at.ly + i), lz = load(at.lz + i);
    const VecI in_front = lz + job.frame.p_WC[2] > splat(kLeastDepth);
    const VecF phi = select(in_front, load(at.phi + i), radius);

    const CutBall<VecF> cut = cut_ball(radius, factor, phi);
    const ImageGradient<VecF> g{phi, load(at.by_u + i), load(at.by_v + i), load(at.by_z + i)};
    const Gradient3<VecF> gradient = to_space(g, load(at.from_u + i), load(at.from_v + i),
                                              load(at.inverse_depth + i), field.fx, field.fy);
    const Gradient3<VecF> n =
        bounded(gradient,
                sqrt(gradient.x * gradient.x + gradient.y * gradient.y + gradient.z * gradient.z));
    const VecF x = cut.volume * n.x, y = cut.volume * n.y, z = cut.volume * n.z;
    const int part = i / kLanes % RowSums::kParts;
    totals.volume.add(part, cut.volume);
    totals.potential.add(part, cut.potential);
    totals.fx.add(part, x);
    totals.fy.add(part, y);
    totals.fz.add(part, z);
    totals.tx.add(part, ly * z - lz * y);
    totals.ty.add(part, lz * x - lx * z);
    totals.tz.add(part, lx * y - ly * x);
    const VecF counted = load(job.counted + place);
    const VecI is_inside = phi <= -radius;
    totals.inside.add(part, select(is_inside, counted, VecF{}));
    totals.boundary.add(part, select((phi < radius) & ~is_inside, counted, VecF{}));
  }
}

// Step 3 instead: the planes that whole spheres are cut by.
void cut_spheres(const MeasureJob& job, const Field& field, std::size_t begin, const Elements& at,
                 const SphereCuts& to) {
  const SphereClusters& clusters = *job.clusters;
  alignas(64) float phi[kSize], n_T[3][kSize], offset[kSize];
  for (int i = 0; i < kSize; i += kLanes) {
    const std::size_t place = begin + static_cast<std::size_t>(i);
    const ImageGradient<VecF> g{load(at.phi + i), load(at.by_u + i), load(at.by_v + i),
                                load(at.by_z + i)};
    const Gradient3<VecF> n = to_space(g, load(at.from_u + i), load(at.from_v + i),
                                       load(at.inverse_depth + i), field.fx, field.fy);
    const VecF length = max(sqrt(n.x * n.x + n.y * n.y + n.z * n.z), splat(1e-20f));
    const VecF c_C[3] = {load(&clusters.x[place]), load(&clusters.y[place]),
                         load(&clusters.z[place])};
    VecF along = -g.phi;
    for (int axis = 0; axis < 3; ++axis) {
      const auto& R_WT = job.frame.R_WT;
      const VecF n_axis =
          (R_WT[0][axis] * n.x + R_WT[1][axis] * n.y + R_WT[2][axis] * n.z) / length;
      along += n_axis * (c_C[axis] + to.p_TC[axis]);
      store(n_T[axis] + i, n_axis);
    }
    store(phi + i, g.phi);
    store(offset + i, along);
  }
  for (int i = 0; i < kSize; ++i) {
    const std::size_t place = begin + static_cast<std::size_t>(i);
    const float radius = job.radius[place];
    const bool is_before_camera = at.lz[i] + job.frame.p_WC[2] > kLeastDepth;
    if (job.counted[place] == 0 || !is_before_camera || phi[i] >= radius) continue;
    // An element that is counted has the number of its sphere.
    const auto id = static_cast<std::size_t>(clusters.sphere_id[place]);
    to.states[id] = phi[i] > -radius ? SphereState::boundary : SphereState::inside;
    to.planes[id] = {{n_T[0][i], n_T[1][i], n_T[2][i]}, offset[i]};
  }
}

}  // namespace

FieldSums measure_group(const MeasureJob& job, int group) {
  Totals totals;
  for_near_clusters(job, group, [&](const Field& field, std::size_t begin, Elements& elements) {
    ask(job, field, begin, elements);
    sum_up(job, field, begin, elements, totals);
  });
  FieldSums sums;
  sums.volume = totals.volume.total();
  sums.potential = totals.potential.total();
  sums.force = {totals.fx.total(), totals.fy.total(), totals.fz.total()};
  sums.torque = {totals.tx.total(), totals.ty.total(), totals.tz.total()};
  sums.num_boundary = totals.boundary.total();
  sums.num_inside = totals.inside.total();
  return sums;
}

void describe_group(const MeasureJob& job, int group, const SphereCuts& to) {
  for_near_clusters(job, group, [&](const Field& field, std::size_t begin, Elements& elements) {
    ask(job, field, begin, elements);
    cut_spheres(job, field, begin, elements, to);
  });
}

}  // namespace palpate::PALPATE_ISA_NAMESPACE
