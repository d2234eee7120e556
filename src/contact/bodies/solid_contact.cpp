#include "src/contact/bodies/solid_contact.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/contact/bodies/body_pair.h"
#include "src/core/internal/select_isa.h"

namespace palpate { inline namespace v0 {
PALPATE_DECLARE_KERNELS(void measure_solid_group(const SolidJob&, int group, bool with_stiffness,
                                                 GroupSums* sums);
                        constexpr SolidContactKernels kSolidContact{measure_solid_group};)

namespace {

constexpr SolidContactKernels kKernels[] = PALPATE_BY_ISA(kSolidContact);

// Smallest weight of a direction of sampling that is worth its time.
constexpr double kMinWeight = 0.1;
// Potential of a single sphere in a light touch, over the square of the coarseness.
constexpr double kSingle = 0.05;

SolidJob job_of(const FieldElements& elements, const SolidSampling& sampling,
                const SolidField& field) {
  return {&elements.clusters,     elements.radius.data(),
          elements.factor.data(), elements.counted.data(),
          sampling.level.data(),  sampling.rounding.data(),
          view_of(field),         {}};
}

}  // namespace

SolidContactKernels solid_contact_kernels(Isa isa) { return select_isa(kKernels, isa); }

SolidFieldView view_of(const SolidField& field) {
  SolidFieldView view;
  view.values = field.values().data();
  view.num_levels = static_cast<std::int32_t>(field.levels().size());
  view.spacing = static_cast<float>(field.layout().spacing);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    view.box[axis] = static_cast<float>(field.layout().spacing * field.layout().num_cells[axis]);
    for (std::size_t k = 0; k < field.levels().size(); ++k) {
      view.num_nodes[axis][k] = field.levels()[k].num_nodes[axis];
    }
  }
  for (std::size_t k = 0; k < field.levels().size(); ++k) {
    view.first[k] = static_cast<std::int32_t>(field.levels()[k].first);
  }
  return view;
}

SolidSampling::SolidSampling(const FieldElements& elements, const SolidField& field)
    : level(elements.radius.size()) {
  const auto last = static_cast<std::int32_t>(field.levels().size()) - 1;
  const double spacing = field.layout().spacing;
  double volume = 0, squares = 0, widest = 0, owed = 0;
  for (std::size_t slot = 0; slot < level.size(); ++slot) {
    const double radius = elements.radius[slot];
    const double counts = elements.factor[slot] * sphere_volume(radius);
    volume += counts;
    squares += counts * radius * radius;
    // Second moments, in those of the finest grid. That of the ball lies between those of two
    // grids; the choice keeps the sum over all elements so far nearest to that of their balls.
    const double desired = std::max(1.0, std::pow(kSpacingPerRadius * radius / spacing, 2));
    double moment = 1;
    while (moment * 4 <= desired && level[slot] < last) {
      moment *= 4;
      ++level[slot];
    }
    const double missing = counts * (desired - moment), more = counts * 3 * moment;
    if (level[slot] < last) {
      if (owed + missing > more / 2 && counts > 0) {
        ++level[slot];
        owed -= more;
      }
      owed += missing;
    } else if (desired > 4 * moment && counts > 0) {
      is_possible = false;
    }
    widest = std::max(widest, std::ldexp(spacing, level[slot]));
    if (slot % SphereClusters::kSize == SphereClusters::kSize - 1) {
      rounding.push_back(static_cast<float>(kMaxRounding * 1.0001 * widest));
      widest = 0;
    }
  }
  coarseness = squares / volume + spacing * spacing;
}

SolidPair::SolidPair(std::shared_ptr<const ToolIndex> of_a, std::shared_ptr<const ToolIndex> of_b)
    : a(std::move(of_a)),
      b(std::move(of_b)),
      elements_a(&parts_of(*a).solid_elements()),
      elements_b(&parts_of(*b).solid_elements()),
      field_a(&parts_of(*a).solid_field()),
      field_b(&parts_of(*b).solid_field()),
      sampling_a(*elements_a, *field_b),
      sampling_b(*elements_b, *field_a) {
  const double fine_a = sampling_a.is_possible ? std::pow(sampling_a.coarseness, -2) : 0;
  const double fine_b = sampling_b.is_possible ? std::pow(sampling_b.coarseness, -2) : 0;
  const bool samples_a = fine_a >= kMinWeight * (fine_a + fine_b);
  const bool samples_b = fine_b >= kMinWeight * (fine_a + fine_b);
  const double sum = (samples_a ? fine_a : 0) + (samples_b ? fine_b : 0);
  weights.a = samples_a ? fine_a / sum : 0;
  weights.b = samples_b ? fine_b / sum : 0;
  const double coarseness = std::max(sampling_a.coarseness, sampling_b.coarseness);
  weights.single_potential = kSingle * coarseness * coarseness;
  weights.p_AC = a->tool().sphere_mass().center_of_mass;
  weights.p_BC = b->tool().sphere_mass().center_of_mass;
}

void SolidPair::place(const Pose& X_WA, const Pose& X_WB, SolidFrame& of_a,
                      SolidFrame& of_b) const {
  of_a = solid_frame(X_WA, weights.p_AC, X_WB, field_b->layout().origin);
  of_b = solid_frame(X_WB, weights.p_BC, X_WA, field_a->layout().origin);
}

BodyPenetration SolidPair::penetration(const GroupSums& of_a, const GroupSums& of_b,
                                       bool with_stiffness, const Pose& X_WA,
                                       const Pose& X_WB) const {
  const auto sums_of = [](const FieldSums& sums) {
    return SolidSums{sums.volume, sums.potential, {sums.force, sums.torque}};
  };
  const SolidPairSums both(weights, sums_of(of_a.measure), sums_of(of_b.measure), X_WA, X_WB);
  BodyPenetration result;
  result.on_a = of_a.measure.penetration();
  result.on_b = of_b.measure.penetration();
  for (Penetration* part : {&result.on_a, &result.on_b}) {
    part->volume = both.volume;
    part->potential = both.potential.value();
  }
  result.on_a.measure_W = both.on_a();
  result.on_b.measure_W = both.on_b();
  result.num_pairs = std::int64_t{result.on_a.num_boundary_spheres} +
                     result.on_a.num_inside_spheres + result.on_b.num_boundary_spheres +
                     result.on_b.num_inside_spheres;
  if (with_stiffness) {
    const Stiffness k_a = of_a.stiffness.stiffness(), k_b = of_b.stiffness.stiffness();
    result.stiffness_a = both.stiffness_a(k_a, k_b);
    result.stiffness_b = both.stiffness_b(k_a, k_b);
    result.moments_a = both.potential.moments(
        of_a.stiffness.moments(), weights.a,
        of_opposite(of_b.stiffness.moments(), both.b_on_b.force, -both.d_BA), weights.b);
  }
  return result;
}

SolidContact::SolidContact(std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b,
                           Isa isa)
    : pair_(std::move(a), std::move(b)),
      kernels_(solid_contact_kernels(isa)),
      job_a_(job_of(*pair_.elements_a, pair_.sampling_a, *pair_.field_b)),
      job_b_(job_of(*pair_.elements_b, pair_.sampling_b, *pair_.field_a)) {}

void SolidContact::start(const Pose& X_WA, const Pose& X_WB, bool wants_stiffness) noexcept {
  X_WA_ = X_WA;
  X_WB_ = X_WB;
  wants_stiffness_ = wants_stiffness;
}

BodyPenetration SolidContact::finish() noexcept {
  if (BodyPenetration nothing; is_non_finite(X_WA_, X_WB_, nothing)) return nothing;
  pair_.place(X_WA_, X_WB_, job_a_.frame, job_b_.frame);
  return pair_.penetration(sums_of(job_a_, pair_.weights.a), sums_of(job_b_, pair_.weights.b),
                           wants_stiffness_, X_WA_, X_WB_);
}

GroupSums SolidContact::sums_of(const SolidJob& job, double weight) const {
  GroupSums all;
  if (weight == 0) return all;
  for (int group = 0; group < job.clusters->num_groups(); ++group) {
    GroupSums sums;
    kernels_.measure_solid_group(job, group, wants_stiffness_, &sums);
    all.measure.add(sums.measure);
    if (wants_stiffness_) all.stiffness.add(sums.stiffness);
  }
  return all;
}

}}  // namespace palpate::v0
