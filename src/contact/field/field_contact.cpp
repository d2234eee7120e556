#include "src/contact/field/field_contact.h"

#include <algorithm>

namespace palpate {
#define PALPATE_DECLARE_FIELD_CONTACT(isa)                                                   \
  namespace isa {                                                                            \
  FieldSums measure_group(const MeasureJob&, int group);                                     \
  FieldSums measure_stiffness_group(const MeasureJob&, int group, StiffnessSums& stiffness); \
  void describe_group(const MeasureJob&, int group, const SphereCuts& to);                   \
  constexpr FieldContactKernels kFieldContact{measure_group, measure_stiffness_group,        \
                                              describe_group};                               \
  }
PALPATE_DECLARE_FIELD_CONTACT(isa_baseline)
#if defined(__x86_64__)
PALPATE_DECLARE_FIELD_CONTACT(isa_avx2)
PALPATE_DECLARE_FIELD_CONTACT(isa_avx512)
#endif
#undef PALPATE_DECLARE_FIELD_CONTACT

namespace {

FieldContactKernels kernels_for(Isa isa) {
#if defined(__x86_64__)
  if (isa == Isa::avx512) return isa_avx512::kFieldContact;
  if (isa == Isa::avx2) return isa_avx2::kFieldContact;
#endif
  (void)isa;
  return isa_baseline::kFieldContact;
}

}  // namespace

FieldContact::FieldContact(const Tool& tool, ThreadPool& pool, Isa isa)
    : tool_(&tool),
      pool_(&pool),
      kernels_(kernels_for(isa)),
      own_(tool, SphereVolumes::own),
      represented_(tool, SphereVolumes::represented) {
  const auto num_groups = static_cast<std::size_t>(
      std::max(own_.clusters.num_groups(), represented_.clusters.num_groups()));
  group_sums_.resize(num_groups);
  group_stiffness_.resize(num_groups);
}

MeasureJob FieldContact::job() const {
  const FieldElements& asked = elements();
  return {&asked.clusters,
          asked.radius.data(),
          asked.factor.data(),
          asked.counted.data(),
          asked.largest_radius.data(),
          field_,
          frame_of(field_.intrinsics, X_WT_, tool_->sphere_mass().centre_of_mass)};
}

Penetration FieldContact::measure(const Pose& X_WT, SphereVolumes volumes) noexcept {
  X_WT_ = X_WT;
  volumes_ = volumes;
  if (field_.num_levels == 0) {
    Penetration nothing;
    nothing.status = StepStatus::no_surface;
    return nothing;
  }
  const MeasureJob asked = job();
  const int num_groups = asked.clusters->num_groups();
  pool_->parallel_for(num_groups, [&](int group) {
    group_sums_[static_cast<std::size_t>(group)] = kernels_.measure_group(asked, group);
  });
  FieldSums sums;
  for (int group = 0; group < num_groups; ++group) {
    sums.add(group_sums_[static_cast<std::size_t>(group)]);
  }

  Penetration result;
  result.volume = sums.volume;
  result.potential = sums.potential;
  result.measure_W = {sums.force, sums.torque};
  result.num_boundary_spheres = static_cast<int>(sums.num_boundary);
  result.num_inside_spheres = static_cast<int>(sums.num_inside);
  return result;
}

Stiffness FieldContact::stiffness() const noexcept {
  const MeasureJob asked = job();
  const int num_groups = asked.clusters->num_groups();
  pool_->parallel_for(num_groups, [&](int group) {
    kernels_.measure_stiffness_group(asked, group,
                                     group_stiffness_[static_cast<std::size_t>(group)]);
  });
  StiffnessSums sums;
  for (int group = 0; group < num_groups; ++group) {
    sums.add(group_stiffness_[static_cast<std::size_t>(group)]);
  }
  return sums.stiffness();
}

void FieldContact::describe(std::span<SphereState> states,
                            std::span<Plane<float>> planes) const noexcept {
  std::fill(states.begin(), states.end(), SphereState::outside);
  std::fill(planes.begin(), planes.end(), Plane<float>{});
  const MeasureJob asked = job();
  const Vec3f p_TC = to_float(tool_->sphere_mass().centre_of_mass);
  const SphereCuts cuts{states.data(), planes.data(), {p_TC.x, p_TC.y, p_TC.z}};
  pool_->parallel_for(asked.clusters->num_groups(),
                      [&](int group) { kernels_.describe_group(asked, group, cuts); });
}

}  // namespace palpate
