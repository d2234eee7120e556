#include "src/contact/field_contact.h"

#include <cmath>

#include "palpate/field/field_curvature.h"

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
    : tool_(&tool), pool_(&pool), measure_group_(kernel_for(isa)), elements_(tool) {
  group_sums_.resize(static_cast<std::size_t>(elements_.clusters.num_groups()));
}

Penetration FieldContact::measure(const Pose& X_WT, SphereVolumes volumes) noexcept {
  X_WT_ = X_WT;
  volumes_ = volumes;
  FieldJob job;
  job.clusters = &elements_.clusters;
  job.radius = elements_.radius.data();
  job.factor = elements_.factor(volumes).data();
  job.counted = elements_.counted.data();
  job.largest_radius = elements_.largest_radius.data();
  job.field = field_;
  const Mat3d R_WT = rotation_matrix(X_WT.rotation);
  const Vec3d p_WC = X_WT * tool_->sphere_mass().centre_of_mass;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      job.R_WT[row][column] = static_cast<float>(R_WT.m[row][column]);
    }
    job.p_WC[row] = static_cast<float>(p_WC[row]);
  }

  const int num_groups = elements_.clusters.num_groups();
  pool_->parallel_for(num_groups, [&](int group) {
    group_sums_[static_cast<std::size_t>(group)] = measure_group_(job, group);
  });
  FieldSums sums;
  for (const FieldSums& group : group_sums_) sums.add(group);

  Penetration result;
  result.volume = sums.volume;
  result.potential = sums.potential;
  result.measure_W = {sums.force, sums.torque};
  result.num_boundary_spheres = static_cast<int>(sums.num_boundary);
  result.num_inside_spheres = static_cast<int>(sums.num_inside);
  return result;
}

// F = sum f V(phi) n with n = grad phi, so dF = sum f (-A n n^T + V H) dc: A is the area of the cut
// disc, H holds the second derivatives of phi. A motion of the tool by `shift` and a small `turn`
// about C moves an element at lever l by dc = shift + turn x l, and its torque l x F changes with
// both factors.
Stiffness FieldContact::stiffness() const noexcept {
  Stiffness sum;
  if (field_.num_levels == 0) return sum;
  const SphereClusters& at = elements_.clusters;
  const std::vector<float>& factors = elements_.factor(volumes_);
  const Mat3d R_WT = rotation_matrix(X_WT_.rotation);
  const Vec3d p_WC = X_WT_ * tool_->sphere_mass().centre_of_mass;
  for (std::size_t i = 0; i < factors.size(); ++i) {
    const double factor = factors[i], r = elements_.radius[i];
    if (factor == 0) continue;
    const Vec3d l = R_WT * to_double(Vec3f{at.x[i], at.y[i], at.z[i]});
    if (sample_field(field_, p_WC + l, r).phi >= r) continue;
    const CurvedFieldSample s = sample_field_curvature(field_, p_WC + l, r);
    const double volume = factor * cap_volume(r, s.phi);
    const double area = s.phi > -r ? factor * kPi * (r * r - s.phi * s.phi) : 0;
    const Vec3d& n = s.gradient;
    const Vec3d force = volume * n;
    const Vec3d axes[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int column = 0; column < 6; ++column) {
      const Vec3d& axis = axes[column % 3];
      const Vec3d moved = column < 3 ? axis : cross(axis, l);
      const Vec3d more_force = volume * (s.hessian * moved) - area * dot(n, moved) * n;
      Vec3d more_torque = cross(l, more_force);
      if (column >= 3) more_torque += cross(moved, force);
      for (int row = 0; row < 3; ++row) {
        sum.m[row][column] -= more_force[row];
        sum.m[row + 3][column] -= more_torque[row];
      }
    }
  }
  return sum;
}

void FieldContact::describe(std::span<SphereState> states,
                            std::span<Plane<float>> planes) const noexcept {
  for (std::size_t id = 0; id < states.size(); ++id) {
    states[id] = SphereState::outside;
    planes[id] = {};
    if (field_.num_levels == 0) continue;
    const Sphere& sphere = tool_->spheres()[id];
    const double radius = sphere.radius;
    const Vec3d c_T = to_double(sphere.centre);
    const FieldSample<double> at = sample_field(field_, X_WT_ * c_T, radius);
    if (at.phi >= radius) continue;
    states[id] = at.phi > -radius ? SphereState::boundary : SphereState::inside;
    const Vec3d n_T = normalized(rotate(conjugate(X_WT_.rotation), at.gradient));
    planes[id] = {to_float(n_T), static_cast<float>(dot(n_T, c_T) - at.phi)};
  }
}

}  // namespace palpate
