#include "src/contact/field_contact.h"

#include <algorithm>

#include "src/contact/field_element.h"

namespace palpate {
namespace {

MeasureGroup kernel_for(Isa isa) {
#if defined(__x86_64__)
  if (isa == Isa::avx512) return isa_avx512::measure_group;
  if (isa == Isa::avx2) return isa_avx2::measure_group;
#endif
  (void)isa;
  return isa_baseline::measure_group;
}

}  // namespace

FieldContact::FieldContact(const Tool& tool, ThreadPool& pool, Isa isa)
    : tool_(&tool),
      pool_(&pool),
      measure_group_(kernel_for(isa)),
      own_(tool, SphereVolumes::own),
      represented_(tool, SphereVolumes::represented) {
  group_sums_.resize(static_cast<std::size_t>(
      std::max(own_.clusters.num_groups(), represented_.clusters.num_groups())));
}

Penetration FieldContact::measure(const Pose& X_WT, SphereVolumes volumes) noexcept {
  X_WT_ = X_WT;
  volumes_ = volumes;
  const FieldElements& asked = elements();
  MeasureJob job;
  job.clusters = &asked.clusters;
  job.radius = asked.radius.data();
  job.factor = asked.factor.data();
  job.counted = asked.counted.data();
  job.largest_radius = asked.largest_radius.data();
  job.field = field_;
  job.frame = frame_of(field_.intrinsics, X_WT, tool_->sphere_mass().centre_of_mass);

  const int num_groups = asked.clusters.num_groups();
  pool_->parallel_for(num_groups, [&](int group) {
    group_sums_[static_cast<std::size_t>(group)] = measure_group_(job, group);
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
  Stiffness sum;
  if (field_.num_levels == 0) return sum;
  const FieldElements& asked = elements();
  const SphereClusters& at = asked.clusters;
  const Mat3d R_WT = rotation_matrix(X_WT_.rotation);
  const Vec3d p_WC = X_WT_ * tool_->sphere_mass().centre_of_mass;
  for (std::size_t i = 0; i < asked.factor.size(); ++i) {
    const Vec3d lever = R_WT * to_double(Vec3f{at.x[i], at.y[i], at.z[i]});
    add_stiffness(field_, p_WC, lever, asked.radius[i], asked.factor[i], sum);
  }
  return sum;
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
