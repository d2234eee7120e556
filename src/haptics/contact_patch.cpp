#include "palpate/haptics/local_contact.h"

#include <algorithm>

#include "src/haptics/tangents.h"
#include "src/math/internal/matrix.h"

namespace palpate { inline namespace v0 {
namespace {

/// Mean distance from the middle of an even ellipse with these variances along its axes: the
/// circumference over 3 pi (Ramanujan's, 4e-3 off at most, exact for a circle).
double mean_distance(double variance, double other) {
  const double a = 2 * std::sqrt(variance), b = 2 * std::sqrt(other);
  return a + b - std::sqrt((3 * a + b) * (a + 3 * b)) / 3;
}

/// Returns the share of the spread of the cut area along its long axis, 1/2 to 1.
///
/// With S = -A n n^T, a stiffness about C has in its torques A (l x n)(l x n)^T + (l.F) 1 - l F^T.
/// The moments give the last two terms; their removal leaves the second moments of the area, turned
/// by 90 degrees, which are then taken about its own center (parallel axis theorem).
double elongation(const Vec3d& n, const Stiffness& k, const VolumeMoments& moments) {
  const Vec3d t[2] = {first_tangent(n), cross(n, first_tangent(n))};
  const Mat3d force = block(k.m, 0, 0), turning = block(k.m, 3, 0);
  Mat3d torque = block(k.m, 3, 3);
  const auto& first = moments.first;
  const double virial = first[0][0] + first[1][1] + first[2][2];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) torque.m[i][j] += first[i][j] - (i == j ? virial : 0);
  }
  const double area = dot(n, force * n);
  if (!(area > 0)) return 0.5;
  const Vec3d middle = turning * n;
  const auto spread = [&](int i, int j) {
    return dot(t[i], torque * t[j]) - dot(t[i], middle) * dot(t[j], middle) / area;
  };
  const double sum = spread(0, 0) + spread(1, 1);
  const double difference = std::hypot(spread(0, 0) - spread(1, 1), spread(0, 1) + spread(1, 0));
  return sum > 0 && std::isfinite(difference) ? 0.5 + 0.5 * std::min(difference / sum, 1.0) : 0.5;
}

}  // namespace

ContactPatch contact_patch(const VolumeWrench& measure_W, double volume, const Stiffness& stiffness,
                           const VolumeMoments& moments) {
  ContactPatch patch;
  const double force = norm(measure_W.force);
  if (!(force > 0 && volume > 0)) return patch;
  const Vec3d n = measure_W.force / force;
  patch.lever_W = block(moments.first, 0, 0) * n / force;
  const Vec3d off = cross(patch.lever_W, n);
  const double variance = std::max(moments.polar / volume - dot(off, off), 0.0);
  const double along = elongation(n, stiffness, moments);
  patch.torsion_radius = mean_distance(along * variance, (1 - along) * variance);
  return patch;
}

ContactPatch guessed_patch(const VolumeWrench& measure_W, double volume, const MassProperties& tool,
                           const Quaternion& q_WT) {
  ContactPatch patch;
  const double force = norm(measure_W.force);
  if (!(force > 0 && volume > 0 && tool.volume > 0)) return patch;
  const Vec3d n = measure_W.force / force, n_T = rotate(conjugate(q_WT), n);
  // An ellipsoid with this inertia reaches sqrt(5) standard deviations far along n.
  const Mat3d& i = tool.inertia;
  const double half = (i.m[0][0] + i.m[1][1] + i.m[2][2]) / 2;
  const double reach = std::sqrt(std::max(5 * (half - dot(n_T, i * n_T)) / tool.volume, 0.0));
  const double widest = std::sqrt(5 * half / tool.volume);
  Vec3d aside = cross(n, measure_W.torque) / force;
  const double length = norm(aside);
  if (length > widest) aside = aside * (widest / length);
  patch.lever_W = aside - n * reach;
  // A cap is cut at an area of about 6 V^(2/3), see HeldContact; two thirds of that disc's radius.
  patch.torsion_radius = 0.92 * std::cbrt(volume);
  return patch;
}

ContactPatch joined(const ContactPatch& a, double force_a, const ContactPatch& b, double force_b) {
  const double sum = force_a + force_b;
  if (!(sum > 0)) return a;
  const double s = force_a / sum, t = force_b / sum;
  const Vec3d apart = b.lever_W - a.lever_W;
  const double inner =
      s * a.torsion_radius * a.torsion_radius + t * b.torsion_radius * b.torsion_radius;
  const Ground &g = a.ground, &h = b.ground;
  return {s * a.lever_W + t * b.lever_W,
          std::sqrt(inner + s * t * dot(apart, apart)),
          s * a.share + t * b.share,
          s * a.own_friction + t * b.own_friction,
          {s * g.share + t * h.share, s * g.friction + t * h.friction,
           s * g.static_friction + t * h.static_friction, s * g.viscous + t * h.viscous,
           s * g.ridges + t * h.ridges, s * g.grain + t * h.grain,
           s * g.velocity_W + t * h.velocity_W, s * g.turning_W + t * h.turning_W}};
}

}}  // namespace palpate::v0
