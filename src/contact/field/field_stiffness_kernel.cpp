// How the force of elements in the depth field changes with the pose, compiled once per instruction
// set: the steps of palpate/field/field_curvature.h and of add_stiffness (field_element.h) for as
// many elements at once as a vector has lanes.
#include "palpate/field/field_curvature.h"
#include "src/contact/field/field_element.h"
#include "src/contact/field/field_lanes.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

// phi with first and second derivatives, each element on a level of its own.
[[gnu::noinline]] ImageCurvature<VecF> curvature_at_silhouettes(const Field& field, const Spot& at,
                                                                VecI level, VecF depth) {
  Curved<VecF> values[3][3];
  values_around(field, at.pixel, level, depth, values);
  return curvature_of(values, at.s, at.t, scale_of(level));
}

[[gnu::always_inline]] inline ImageCurvature<VecF> sample_curvature(const Field& field,
                                                                    const Spot& at, VecI level,
                                                                    VecF depth) {
  if (!are_plain(field, at.pixel)) [[unlikely]] {
    return curvature_at_silhouettes(field, at, level, depth);
  }
  Curved<VecF> values[3][3];
  for (int q = 0; q < 3; ++q) {
    VecF pairs[6];  // offset, slope, offset, slope, ...
    gather_three_pairs(field.planes + 2 * ((q - 1) * field.stride - 1), at.pixel, pairs);
    for (int p = 0; p < 3; ++p) values[q][p] = plane_value(pairs[2 * p], pairs[2 * p + 1], depth);
  }
  return curvature_of(values, at.s, at.t, scale_of(level));
}

// What elements of these radii are told by the levels of their size.
ImageCurvature<VecF> ask_curvature(const Field& field, VecF u, VecF v, VecF depth,
                                   VecF inverse_depth, VecF radius) {
  const LevelBlend choice = choose_levels(field, radius, inverse_depth);
  const ImageCurvature<VecF> c =
      sample_curvature(field, spot_at(field, u, v, choice.level), choice.level, depth);
  const VecF blend = select(choice.is_single, VecF{}, choice.step.value);
  if (mask_bits(blend > VecF{}) == 0) return c;
  const VecI last = splat(field.last_level);
  const VecI wider = choice.level < last ? choice.level + 1 : last;
  const ImageCurvature<VecF> next =
      sample_curvature(field, spot_at(field, u, v, wider), wider, depth);
  const VecI is_between = (choice.x > VecF{}) & (choice.x < splat(1.0f));
  const VecF bend = select(is_between, (6.0f - 12.0f * choice.x), VecF{});
  const VecF by_zz =
      choice.x_by_z * (bend * choice.x_by_z - 2.0f * choice.step.slope * inverse_depth);
  return blended(c, next, blend,
                 select(choice.is_single, VecF{}, choice.step.slope * choice.x_by_z),
                 select(choice.is_single, VecF{}, by_zz));
}

// Sums of one group.
struct Totals {
  RowSums numbers[StiffnessSums::kNum];
};

void add_up(const MeasureJob& job, const Field& field, std::size_t begin, const Elements& at,
            Totals& totals) {
  for (int i = 0; i < kSize; i += kLanes) {
    const std::size_t place = begin + static_cast<std::size_t>(i);
    const VecF radius = load(job.radius + place), factor = load(job.factor + place);
    const VecF depth = load(at.depth + i), inverse_depth = load(at.inverse_depth + i);
    const VecF from_u = load(at.from_u + i), from_v = load(at.from_v + i);
    const VecF u = from_u + field.cx, v = from_v + field.cy;
    ImageCurvature<VecF> c = ask_curvature(field, u, v, depth, inverse_depth, radius);
    VecF asked = radius;
    for (int step = 0; step < kMostDeepSteps; ++step) {
      const VecI is_deep = c.first.phi < -deep_limit(asked);
      if (mask_bits(is_deep) == 0) break;
      const ImageCurvature<VecF> wide =
          ask_curvature(field, u, v, depth, inverse_depth, asked * kDeepGrowth);
      c = chosen(is_deep, deepened(c, wide, c.first.phi, wide.first.phi, asked), c);
      asked *= kDeepGrowth;
    }
    const VecF lx = load(at.lx + i), ly = load(at.ly + i), lz = load(at.lz + i);
    const VecI in_front = lz + job.frame.p_WC[2] > splat(kLeastDepth);
    const VecF phi = select(in_front, c.first.phi, radius);
    if (mask_bits(phi < radius) == 0) continue;
    const VecF volume = cut_ball(radius, factor, phi).volume;
    const VecF disc = factor * (static_cast<float>(kPi) * max(radius * radius - phi * phi, VecF{}));
    const Gradient3<VecF> n = to_space(c.first, from_u, from_v, inverse_depth, field.fx, field.fy);
    const Symmetric<VecF> h =
        hessian_in_space(c, from_u, from_v, inverse_depth, field.fx, field.fy);
    const VecF length = sqrt(n.x * n.x + n.y * n.y + n.z * n.z);
    const int part = i / kLanes % RowSums::kParts;
    VecF terms[StiffnessSums::kNum];
    stiffness_terms<VecF>({lx, ly, lz}, volume, disc, bounded(n, length), bounded(h, n, length),
                          terms);
    for (int k = 0; k < StiffnessSums::kNum; ++k) totals.numbers[k].add(part, terms[k]);
  }
}

}  // namespace

StiffnessSums stiffness_of_group(const MeasureJob& job, int group) {
  Totals totals;
  for_near_clusters(job, group, [&](const Field& field, std::size_t begin, Elements& elements) {
    add_up(job, field, begin, elements, totals);
  });
  StiffnessSums sums;
  for (int k = 0; k < StiffnessSums::kNum; ++k) sums.numbers[k] = totals.numbers[k].total();
  return sums;
}

}  // namespace palpate::PALPATE_ISA_NAMESPACE
