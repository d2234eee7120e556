// The obvious answer of the field method: every element by itself, in double.
#pragma once

#include <algorithm>
#include <cmath>

#include "palpate/contact/contact.h"
#include "src/contact/index/field_elements.h"
#include "src/field/internal/field_sample.h"

namespace palpate::test {

/// The longest gradient that a force follows.
inline constexpr double kLongest = 1.05;

/// U = sum f G(phi) and its parts by their definition.
inline Penetration field_truth(const Tool& tool, const DepthFieldView& field, const Pose& X_WT,
                               SphereVolumes volumes, double longest = kLongest) {
  const FieldElements elements(tool, volumes);
  Penetration sum;
  for (std::size_t i = 0; i < elements.factor.size(); ++i) {
    if (elements.clusters.sphere_id[i] < 0) continue;
    const Vec3d lever = rotate(
        X_WT.rotation,
        to_double(Vec3f{elements.clusters.x[i], elements.clusters.y[i], elements.clusters.z[i]}));
    const Vec3d c = X_WT * tool.sphere_mass().centre_of_mass + lever;
    const double r = elements.radius[i], factor = elements.factor[i];
    const FieldSample<double> at = sample_field(field, c, r);
    const double h = std::clamp(r - at.phi, 0.0, 2 * r);
    sum.volume += factor * cap_volume(r, at.phi);
    sum.potential += factor * (kPi / 12 * h * h * h * (4 * r - h) +
                               sphere_volume(r) * std::max(-at.phi - r, 0.0));
    const double too_long = std::max(norm(at.gradient) / longest, 1.0);
    const Vec3d force = factor * cap_volume(r, at.phi) / too_long * at.gradient;
    sum.measure_W.force += force;
    sum.measure_W.torque += cross(lever, force);
    sum.num_inside_spheres += elements.counted[i] > 0 && at.phi <= -r;
    sum.num_boundary_spheres += elements.counted[i] > 0 && at.phi > -r && at.phi < r;
  }
  return sum;
}

}  // namespace palpate::test
