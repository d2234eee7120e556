#include "src/haptics/internal/surface_motion.h"

#include <algorithm>
#include <cmath>

#include "src/field/internal/field_point.h"
#include "src/haptics/tangents.h"

namespace palpate { inline namespace v0 {
namespace {

/// Speed that no camera can follow, pixels per second.
constexpr float kFastest = 1e6F;
/// Smallest cosine of normal and ray: surfaces seen more edge-on are skipped.
constexpr double kMinCosine = 0.05;
/// Share of the depth that a surface can move between two frames: beyond it is another one.
constexpr double kLongestWay = 0.1;
/// Smallest second moment of the measured samples over that of the whole disc: with less no
/// rotation is fitted.
constexpr double kMinSpread = 0.05;

/// Returns the signed distance of a ball's center from the surfaces of a frame, m.
double distance_to(const SurfaceView& view, const Vec3d& p_W, double radius) {
  const Vec3d p_C = inverse(view.X_WC) * p_W;
  double distance = sample_field(view.field, p_C, radius).phi;
  if (view.in_front.num_levels > 0) {
    distance = std::min(distance, sample_field(view.in_front, p_C, radius).phi);
  }
  return distance;
}

/// Weighted sums over velocities on a disc, for the rigid motion that fits them best.
struct MotionSums {
  double weight = 0, spread = 0, turn = 0;
  Vec3d place, velocity;

  void add(const Vec3d& from_middle, const Vec3d& v, const Vec3d& n, double w) {
    weight += w;
    place += w * from_middle;
    velocity += w * v;
    spread += w * dot(from_middle, from_middle);
    turn += w * dot(n, cross(from_middle, v));
  }
  Twist fitted(const Vec3d& n, double radius) const {
    if (!(weight > 0)) return {};
    const Vec3d middle = place / weight, mean = velocity / weight;
    const double own_spread = spread / weight - dot(middle, middle);
    double turning = 0;
    if (own_spread > kMinSpread * radius * radius / 2) {
      turning = (turn / weight - dot(n, cross(middle, mean))) / own_spread;
    }
    return {mean - turning * cross(n, middle), turning * n};
  }
};

/// Adds the velocities that one camera measures under a disc.
void look_at(const SurfaceBlend& camera, const TouchedDisc& disc, const Vec3d& n,
             MotionSums& sums) {
  const FlowView& flow = camera.flow;
  const Pose &X_WC = camera.to.X_WC, X_CW = inverse(X_WC);
  const double depth = (X_CW * disc.p_W).z, radius = disc.radius();
  const bool has_fields = camera.from.field.num_levels > 0 && camera.to.field.num_levels > 0;
  if (flow.pixels == nullptr || !(depth > 0) || !(radius > 0) || !has_fields) return;
  const double now = distance_to(camera.to, disc.p_W, radius);
  const double came = distance_to(camera.from, disc.p_W, radius) - now;
  const double longest = kLongestWay * depth;
  if (!(std::abs(came) < longest && std::abs(now) < longest)) return;
  const double along_n = came / flow.interval;
  const Vec3d middle_W = disc.p_W - now * n;  // the contact lies behind what is seen
  const Intrinsics& k = flow.intrinsics;
  const Vec3d t = first_tangent(n), s = cross(n, t);
  for (const DiscSpot& spot : kDiscSpots) {
    const Vec3d from_middle = t * (radius * spot.x) + s * (radius * spot.y);
    const Vec3d p_W = middle_W + from_middle, p_C = X_CW * p_W;
    if (!(p_C.z > 0)) continue;
    const Vec3d ray_W = rotate(X_WC.rotation, p_C / p_C.z);
    const double cosine = dot(n, ray_W);
    if (!(-cosine > kMinCosine * norm(ray_W))) continue;
    double u = 0, v = 0, seen = 0;
    const PixelPosition<double> at = project(k, p_C);
    visit_pixels_around(at.u, at.v, flow.width, flow.height, [&](int column, int row, double w) {
      const float* pixel =
          flow.pixels + 2 * (static_cast<std::ptrdiff_t>(row) * flow.width + column);
      if (!(std::abs(pixel[0]) < kFastest && std::abs(pixel[1]) < kFastest)) return;
      u += w * static_cast<double>(pixel[0]);
      v += w * static_cast<double>(pixel[1]);
      seen += w;
    });
    if (!(seen > 0)) continue;
    // Points that stand still in the image of a moving camera move with it.
    const Vec3d taken_W = (p_W - camera.from.X_WC * p_C) / flow.interval;
    const double scale = p_C.z / seen;
    const Vec3d across_W =
        taken_W + rotate(X_WC.rotation, Vec3d{scale * u / k.fx, scale * v / k.fy, 0});
    const Vec3d velocity = across_W + ray_W * ((along_n - dot(n, across_W)) / cosine);
    sums.add(from_middle, velocity - along_n * n, n, seen);
  }
}

}  // namespace

Twist surface_motion(std::span<const SurfaceBlend> cameras, const TouchedDisc& disc) noexcept {
  const double length = norm(disc.n_W);
  if (!(length > 0)) return {};
  const Vec3d n = disc.n_W / length;
  MotionSums sums;
  for (const SurfaceBlend& camera : cameras) look_at(camera, disc, n, sums);
  return sums.fitted(n, disc.radius());
}

}}  // namespace palpate::v0
