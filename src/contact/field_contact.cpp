#include "src/contact/field_contact.h"

#include <algorithm>

#include "src/contact/field_element.h"

namespace palpate {
namespace {

struct Kernels {
  MeasureGroup measure_group;
  StiffnessOfGroup stiffness_of_group;
};

Kernels kernels_for(Isa isa) {
#if defined(__x86_64__)
  if (isa == Isa::avx512) return {isa_avx512::measure_group, isa_avx512::stiffness_of_group};
  if (isa == Isa::avx2) return {isa_avx2::measure_group, isa_avx2::stiffness_of_group};
#endif
  (void)isa;
  return {isa_baseline::measure_group, isa_baseline::stiffness_of_group};
}

}  // namespace

FieldContact::FieldContact(const Tool& tool, ThreadPool& pool, Isa isa)
    : tool_(&tool),
      pool_(&pool),
      measure_group_(kernels_for(isa).measure_group),
      stiffness_of_group_(kernels_for(isa).stiffness_of_group),
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
  const MeasureJob asked = job();
  const int num_groups = asked.clusters->num_groups();
  pool_->parallel_for(num_groups, [&](int group) {
    group_sums_[static_cast<std::size_t>(group)] = measure_group_(asked, group);
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
    group_stiffness_[static_cast<std::size_t>(group)] = stiffness_of_group_(asked, group);
  });
  StiffnessSums sums;
  for (int group = 0; group < num_groups; ++group) {
    sums.add(group_stiffness_[static_cast<std::size_t>(group)]);
  }
  return sums.stiffness();
}

void FieldContact::describe(std::span<SphereState> states,
                            std::span<Plane<float>> planes) const noexcept {
  for (std::size_t id = 0; id < states.size(); ++id) {
    const SphereCut cut = field_.num_levels == 0
                              ? SphereCut{}
                              : cut_of(field_, X_WT_, felt_ball(*tool_, id, volumes_));
    states[id] = cut.state;
    planes[id] = cut.plane;
  }
}

}  // namespace palpate
