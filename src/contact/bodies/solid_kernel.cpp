// Elements of a body against the distance field of another one, compiled once per instruction set.
#include "src/contact/bodies/solid_contact.h"
#include "src/contact/field/group_totals.h"
#include "src/core/internal/simd_rows.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

// The grids of a field, selected by the level of each lane.
struct Grids {
  explicit Grids(const SolidFieldView& view) : values(view.values) {
    float spacing = view.spacing;
    for (int k = 0; k < view.num_levels; ++k) {
      per_spacing.entries[k] = 1 / spacing;
      first.entries[k] = view.first[k];
      for (int axis = 0; axis < 3; ++axis) num[axis].entries[k] = view.num_nodes[axis][k];
      spacing *= 2;
    }
  }

  const float* values;
  LaneTable<float> per_spacing;
  LaneTable<std::int32_t> first, num[3];
};

// Positions of a vector of elements: from the center in W, from the corner of the grids in F.
struct SolidLanes {
  VecF lx, ly, lz;
  VecF p[3];
  VecF radius;
};

[[gnu::always_inline]] inline SolidLanes aim_at(const SolidJob& job, std::size_t slot) {
  const SphereClusters& c = *job.clusters;
  const VecF x = load(&c.x[slot]), y = load(&c.y[slot]), z = load(&c.z[slot]);
  const auto rotated = [&](const float(&row)[3]) { return row[0] * x + row[1] * y + row[2] * z; };
  SolidLanes e;
  for (int axis = 0; axis < 3; ++axis) {
    e.p[axis] = rotated(job.frame.R_FE[axis]) + job.frame.p_FC[axis];
  }
  e.lx = rotated(job.frame.R_WE[0]);
  e.ly = rotated(job.frame.R_WE[1]);
  e.lz = rotated(job.frame.R_WE[2]);
  e.radius = load(job.radius + slot);
  return e;
}

// Samples one grid, in the axes of the field; `is_inside`: the grid has nodes there.
template <class Sample>
[[gnu::always_inline]] inline Sample sample_level(const Grids& grids, const SolidLanes& e,
                                                  VecI level, VecI& is_inside) {
  const VecF per_spacing = look_up(grids.per_spacing, level);
  VecI at{};
  VecF off[3];
  is_inside = VecI{} - 1;
  VecI num[3];
  for (int axis = 2; axis >= 0; --axis) {
    num[axis] = look_up(grids.num[axis], level);
    const VecF desired = e.p[axis] * per_spacing + static_cast<float>(SolidField::kMargin);
    const VecF place = min(max(desired, splat(1.0f)), to_float(num[axis] - 2));
    is_inside &= place == desired;
    const VecI node = to_int(place + 0.5f);
    off[axis] = place - to_float(node);
    at = at * num[axis] + node;
  }
  const VecI row = num[0], slice = num[0] * num[1];
  at += look_up(grids.first, level) - slice - row - 1;
  Sample sample;
  sample_spline(
      off[0], off[1], off[2], per_spacing,
      [&](int j, int k, VecF(&nodes)[3]) {
        gather_three(grids.values, at + k * slice + j * row, nodes);
      },
      sample);
  return sample;
}

template <class Sample>
[[gnu::always_inline]] inline void measure_solid(const SolidJob& job, int group, GroupSums* to) {
  constexpr bool kWithStiffness = std::is_same_v<Sample, SolidCurvature<VecF>>;
  const SphereClusters& clusters = *job.clusters;
  const int first = group * SphereClusters::kClustersPerGroup;
  const int last = std::min(first + SphereClusters::kClustersPerGroup, clusters.num_clusters());
  const float rounding = *std::max_element(job.rounding + first, job.rounding + last);
  if (is_clear(job.field, job.frame, clusters.groups[static_cast<std::size_t>(group)], rounding)) {
    *to = {};
    return;
  }
  const Grids grids(job.field);
  GroupTotals<kWithStiffness> totals;
  for (int cluster = first; cluster < last; ++cluster) {
    const Cluster& ball = clusters.clusters[static_cast<std::size_t>(cluster)];
    if (is_clear(job.field, job.frame, ball, job.rounding[cluster])) continue;
    for (int i = 0; i < kSize / kLanes; ++i) {
      const std::size_t slot = static_cast<std::size_t>(cluster * kSize + i * kLanes);
      const SolidLanes e = aim_at(job, slot);
      VecI is_inside;
      Sample sample = sample_level<Sample>(grids, e, load(job.level + slot), is_inside);
      const SolidGradient<VecF>& g = first_of(sample);
      const VecI is_touching = is_inside & (g.phi < e.radius);
      if (mask_bits(is_touching) == 0) continue;
      Symmetric<VecF> h;
      if constexpr (kWithStiffness) h = turned(job.frame.R_WF, sample.h);
      totals.add(job, slot, e, is_touching, g.phi, turned(job.frame.R_WF, g.n), h,
                 i % RowSums::kParts);
    }
  }
  totals.write(*to);
}

}  // namespace

void measure_solid_group(const SolidJob& job, int group, bool with_stiffness, GroupSums* sums) {
  if (with_stiffness) return measure_solid<SolidCurvature<VecF>>(job, group, sums);
  measure_solid<SolidGradient<VecF>>(job, group, sums);
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
