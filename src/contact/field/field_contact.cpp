#include "src/contact/field/field_contact.h"

#include <algorithm>
#include <utility>

#include "src/contact/blend.h"
#include "src/core/select_isa.h"

namespace palpate {
PALPATE_DECLARE_KERNELS(FieldSums measure_group(const MeasureJob&, int group);
                        FieldSums measure_stiffness_group(const MeasureJob&, int group,
                                                          StiffnessSums& stiffness);
                        void describe_group(const MeasureJob&, int group, const SphereCuts& to);
                        constexpr FieldContactKernels kFieldContact{
                            measure_group, measure_stiffness_group, describe_group};)

namespace {

constexpr FieldContactKernels kKernels[] = PALPATE_BY_ISA(kFieldContact);

}  // namespace

FieldContact::FieldContact(std::shared_ptr<const ToolIndex> index, const FieldMethod& method,
                           const ContactCapacities& capacities)
    : ContactQuery(std::move(index), method),
      elements_(&this->index()->parts().elements(method.volumes)),
      p_TC_(this->index()->tool().sphere_mass().centre_of_mass),
      kernels_(select_isa(kKernels, capacities.isa)),
      pool_(capacities.pool != nullptr ? capacities.pool : &own_pool_),
      group_sums_(static_cast<std::size_t>(elements_->clusters.num_groups())),
      group_stiffness_(group_sums_.size()) {}

MeasureJob FieldContact::job(const DepthFieldView& field, const Pose& X_WT) const {
  return {&elements_->clusters,
          elements_->radius.data(),
          elements_->factor.data(),
          elements_->counted.data(),
          elements_->largest_radius.data(),
          field,
          frame_of(field.intrinsics, X_WT, p_TC_)};
}

ContactResult FieldContact::measure(const Surfaces& from, const Surfaces& to, double alpha,
                                    const Pose& X_WT, const ContactWants& wants) const noexcept {
  if (!is_finite(X_WT)) return unmeasured(StepStatus::non_finite_pose, wants, true);
  const Pose X{X_WT.translation, normalized(X_WT.rotation)};
  describe(job(to.field, X), wants);
  const ContactResult newer = ask(to.field, X, wants.stiffness);
  if (alpha >= 1) return newer;
  return blend(ask(from.field, X, wants.stiffness), newer, alpha);
}

ContactResult FieldContact::ask(const DepthFieldView& field, const Pose& X_WT,
                                bool with_stiffness) const {
  if (field.num_levels == 0) {
    return unmeasured(StepStatus::no_surface, {.stiffness = with_stiffness}, true);
  }
  const MeasureJob asked = job(field, X_WT);
  pool_->parallel_for(asked.clusters->num_groups(), [&](int group) {
    const auto g = static_cast<std::size_t>(group);
    group_sums_[g] = with_stiffness
                         ? kernels_.measure_stiffness_group(asked, group, group_stiffness_[g])
                         : kernels_.measure_group(asked, group);
  });
  FieldSums sums;
  for (const FieldSums& group : group_sums_) sums.add(group);

  ContactResult result;
  Penetration& penetration = result.penetration;
  penetration.volume = sums.volume;
  penetration.potential = sums.potential;
  penetration.measure_W = {sums.force, sums.torque};
  penetration.num_boundary_spheres = static_cast<int>(sums.num_boundary);
  penetration.num_inside_spheres = static_cast<int>(sums.num_inside);
  if (with_stiffness) {
    StiffnessSums stiffness;
    for (const StiffnessSums& group : group_stiffness_) stiffness.add(group);
    result.stiffness = stiffness.stiffness();
  }
  return result;
}

void FieldContact::describe(const MeasureJob& asked, const ContactWants& wants) const {
  if (wants.states.empty() && wants.planes.empty()) return;
  std::fill(wants.states.begin(), wants.states.end(), SphereState::outside);
  std::fill(wants.planes.begin(), wants.planes.end(), Plane<float>{});
  if (asked.field.num_levels == 0) return;
  const Vec3f p_TC = to_float(p_TC_);
  const SphereCuts cuts{wants.states.data(), wants.planes.data(), {p_TC.x, p_TC.y, p_TC.z}};
  pool_->parallel_for(asked.clusters->num_groups(),
                      [&](int group) { kernels_.describe_group(asked, group, cuts); });
}

}  // namespace palpate
