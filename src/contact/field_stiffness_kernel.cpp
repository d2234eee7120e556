// How the force of elements in the depth field changes with the pose, compiled once per instruction
// set: the steps of palpate/field/field_curvature.h and of add_stiffness (field_element.h) for as
// many elements at once as a vector has lanes.
#include "palpate/field/field_curvature.h"
#include "src/contact/field_element.h"
#include "src/contact/field_lanes.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

// phi with first and second derivatives, each element on a level of its own.
[[gnu::always_inline]] inline ImageCurvature<VecF> sample_curvature(const Field& field,
                                                                    const Spot& at, VecI level,
                                                                    VecF depth, VecF radius) {
  BentPlane<VecF> planes[3][3];
  for (int q = 0; q < 3; ++q) {
    VecF pairs[6];  // offset, slope, offset, slope, ...
    gather_three_pairs(field.planes + 2 * ((q - 1) * field.stride - 1), at.pixel, pairs);
    for (int p = 0; p < 3; ++p) {
      planes[q][p] = straight_plane(pairs[2 * p], pairs[2 * p + 1], depth);
    }
  }
  const VecF step_limit = look_up(field.step_limit, level), thickness = splat(field.thickness);
  const VecI must_bend = (gather_bytes(field.is_step, at.pixel) != 0) |
                         (planes[1][1].distance < 2.0f * step_limit - thickness);
  if (mask_bits(must_bend) != 0) {
    for (BentPlane<VecF>(&row)[3] : planes) {
      for (BentPlane<VecF>& plane : row) {
        const BentPlane<VecF> bent = bend_plane(plane, radius + step_limit, thickness);
        plane = {select(must_bend, bent.distance, plane.distance),
                 select(must_bend, bent.by_z, plane.by_z), select(must_bend, bent.by_zz, VecF{})};
      }
    }
  }
  return curvature_of(planes, at.s, at.t, scale_of(level));
}

// Sums of one group.
struct Totals {
  RowSums numbers[StiffnessSums::kNum];
};

void add_up(const MeasureJob& job, const Field& field, std::size_t begin, const Elements& at,
            Totals& totals) {
  const VecI last = splat(field.last_level);
  for (int i = 0; i < kSize; i += kLanes) {
    const std::size_t place = begin + static_cast<std::size_t>(i);
    const VecF radius = load(job.radius + place), factor = load(job.factor + place);
    const VecF depth = load(at.depth + i), inverse_depth = load(at.inverse_depth + i);
    const VecI level = load(at.level + i);
    const VecF from_u = load(at.from_u + i), from_v = load(at.from_v + i);
    ImageCurvature<VecF> c = sample_curvature(
        field, {load(at.pixel + i), load(at.s + i), load(at.t + i)}, level, depth, radius);
    const VecF blend = load(at.blend + i);
    if (mask_bits(blend > VecF{}) != 0) {
      const LevelBlend choice = choose_levels(field, radius, inverse_depth);
      const VecI wider = level < last ? level + 1 : last;
      const ImageCurvature<VecF> next = sample_curvature(
          field, spot_at(field, from_u + field.cx, from_v + field.cy, wider), wider, depth, radius);
      const VecI is_between = (choice.x > VecF{}) & (choice.x < splat(1.0f));
      const VecF bend = select(is_between, (6.0f - 12.0f * choice.x), VecF{});
      const VecF by_zz =
          choice.x_by_z * (bend * choice.x_by_z - 2.0f * choice.step.slope * inverse_depth);
      c = blended(c, next, blend, load(at.blend_by_z + i), select(choice.is_single, VecF{}, by_zz));
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
    const int part = i / kLanes % RowSums::kParts;
    VecF terms[StiffnessSums::kNum];
    stiffness_terms<VecF>({lx, ly, lz}, volume, disc, n, h, terms);
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
