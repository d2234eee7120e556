#include "src/haptics/internal/friction.h"

#include <algorithm>

#include "src/haptics/tangents.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kMaxIterations = 30;  // three to six do
constexpr double kClose = 1e-13;    // of the limit

/// Lengths (m) and friction coefficients above these mean that the contact is wrong.
constexpr double kFarthest = 1e3, kMaxCoefficient = 100;

/// Texture lengths after which the distance wraps around: a whole number, so that nothing jumps.
constexpr double kTextureLengths = 4096;
/// Speed at which texture has half its strength; at rest it has none.
constexpr double kTextureSpeed = 5e-3;  // m/s

Vec3d operator*(const Mat3s& a, const Vec3d& v) {
  return {a.xx * v.x + a.xy * v.y + a.xz * v.z, a.xy * v.x + a.yy * v.y + a.yz * v.z,
          a.xz * v.x + a.yz * v.y + a.zz * v.z};
}

/// Returns (diagonal 1 + scale a)^-1; all eigenvalues are positive.
Mat3s inverse_of_sum(double diagonal, double scale, const Mat3s& a) {
  const double xx = diagonal + scale * a.xx, yy = diagonal + scale * a.yy,
               zz = diagonal + scale * a.zz;
  const double xy = scale * a.xy, xz = scale * a.xz, yz = scale * a.yz;
  const double cx = yy * zz - yz * yz, cy = xz * yz - xy * zz, cz = xy * yz - yy * xz;
  const double by = 1 / (xx * cx + xy * cy + xz * cz);
  return {by * cx,
          by * cy,
          by * cz,
          by * (xx * zz - xz * xz),
          by * (xy * xz - xx * yz),
          by * (xx * yy - xy * xy)};
}

/// Returns a b for matrices that commute.
Mat3s product(const Mat3s& a, const Mat3s& b) {
  return {a.xx * b.xx + a.xy * b.xy + a.xz * b.xz, a.xx * b.xy + a.xy * b.yy + a.xz * b.yz,
          a.xx * b.xz + a.xy * b.yz + a.xz * b.zz, a.xy * b.xy + a.yy * b.yy + a.yz * b.yz,
          a.xy * b.xz + a.yy * b.yz + a.yz * b.zz, a.xz * b.xz + a.yz * b.yz + a.zz * b.zz};
}

double dot6(const Vec6& a, const Vec6& b) {
  return dot(a.linear, b.linear) + dot(a.angular, b.angular);
}

/// True if a step is long enough to divide a motion by it.
bool is_time(double dt) { return dt > 1e-9; }

/// Returns the gain of a texture wave at a frequency, Hz: 1 up to half the bandwidth, falling to 0
/// at the bandwidth.
double passed(double frequency, double bandwidth) {
  const double x = std::clamp(2 * frequency / bandwidth - 1, 0.0, 1.0);
  return 1 - x * x * (3 - 2 * x);
}

}  // namespace

Vec3d TouchedPatch::slid_by(const Vec6& motion) const {
  return {dot6(slides[0], motion), dot6(slides[1], motion), dot6(slides[2], motion)};
}

Vec6 TouchedPatch::wrench(const Vec3d& force) const {
  return force.x * slides[0] + force.y * slides[1] + force.z * slides[2];
}

Mat3s TouchedPatch::compliance(const Factor6& factor, Vec6 (&motions)[3]) const {
  for (int i = 0; i < 3; ++i) motions[i] = factor.solve(slides[i]);
  return {dot6(slides[0], motions[0]), dot6(slides[0], motions[1]), dot6(slides[0], motions[2]),
          dot6(slides[1], motions[1]), dot6(slides[1], motions[2]), dot6(slides[2], motions[2])};
}

PatchFriction::PatchFriction(const CouplingOptions& options, double stiffness, double damping_time)
    : options_(options.friction),
      texture_(options.texture),
      stiffness_(options.friction.stiffness > 0 ? options.friction.stiffness / options.motion_scale
                                                : stiffness),
      damping_time_(damping_time) {}

bool PatchFriction::is_on(const LocalContact& contact) const {
  return options_.coefficient > 0 || options_.contact_damping > 0 ||
         contact.patch.own_friction > 0 || contact.patch.ground.static_friction > 0 ||
         contact.patch.ground.viscous > 0;
}

bool PatchFriction::touch(const LocalContact& contact, const Wrench& contact_W, double dt,
                          TouchedPatch& patch) noexcept {
  const double force = norm(contact_W.force);
  const Ground& ground = contact.patch.ground;
  const bool is_known = norm(contact.patch.lever_W) < kFarthest &&
                        contact.patch.torsion_radius >= 0 &&
                        contact.patch.torsion_radius < kFarthest &&
                        norm(ground.velocity_W) < kFarthest && norm(ground.turning_W) < kFarthest;
  if (!(force > 0 && std::isfinite(force) && is_known)) {
    state_ = {};
    return false;
  }
  const Vec3d n = contact_W.force / force;
  // The bristle keeps its length; only its direction turns with the surface.
  if (!(dot(state_.normal_W, n) > 0)) state_.bristle_rotation = 0;
  state_.bristle_W = rotated_along(state_.bristle_W, state_.normal_W, n);
  state_.normal_W = n;

  const double mu =
      std::clamp(contact.patch.share * options_.coefficient + contact.patch.own_friction, 0.0,
                 kMaxCoefficient);
  patch.normal_force = force;
  patch.limit = mu * force;
  if (state_.is_sliding) {
    patch.limit *= 1 + wave(texture_.kind, texture_.depth, dt);
    patch.limit += force * (ground.friction + wave(TextureKind::ridges, ground.ridges, dt) +
                            wave(TextureKind::grain, ground.grain, dt));
  } else {
    patch.limit *= options_.static_ratio;
    patch.limit += force * ground.static_friction;
  }
  patch.slope = mu > 0 ? options_.viscous * force * (1 - ground.share) : 0;
  patch.slope += force * ground.viscous;
  const Vec3d r = contact.patch.lever_W, t = first_tangent(n), u = cross(n, t);
  patch.slides[0] = {t, cross(r, t)};
  patch.slides[1] = {u, cross(r, u)};
  patch.slides[2] = {{}, contact.patch.torsion_radius * n};
  patch.approach = {n, cross(r, n)};
  patch.carried = dt * Vec3d{dot(t, ground.velocity_W), dot(u, ground.velocity_W),
                             contact.patch.torsion_radius * dot(n, ground.turning_W)};
  return true;
}

/// The force is -s z with z = K (bristle + slid) + B slid / dt and s = 1 where it sticks, or such
/// that |s z| is the limit where it slides; slid itself is a + W force. Multiplied out,
/// (1/s + (K + B / dt) W) (s z) = K bristle + (K + B / dt) a: the length of the solution falls as
/// 1/s rises, and one over it rises nearly evenly, so Newton's method comes from s = 1 without
/// ever going too far (More and Sorensen 1983).
PatchFriction::Grip PatchFriction::hold(const TouchedPatch& patch, const Vec3d& slid,
                                        const Mat3s& compliance, double dt) const noexcept {
  const Vec3d t = patch.slides[0].linear, u = patch.slides[1].linear;
  const Vec3d before{dot(state_.bristle_W, t), dot(state_.bristle_W, u), state_.bristle_rotation};
  const double damping = is_time(dt) ? damping_time_ * stiffness_ / dt : 0,
               k = stiffness_ + damping;
  // Viscous friction is a damper in parallel with the bristle.
  Vec3d a = slid - patch.carried;
  Mat3s w = compliance;
  const double slope = is_time(dt) ? patch.slope / dt : 0;
  if (slope > 0) {
    const Mat3s eased = inverse_of_sum(1, slope, compliance);
    a = eased * a;
    w = product(eased, compliance);
  }

  const Vec3d desired = stiffness_ * before + k * a;
  Grip grip;
  Mat3s inverse = inverse_of_sum(1, k, w);
  Vec3d held = inverse * desired;  // s z
  double length = norm(held);
  grip.is_sliding = length > patch.limit;
  if (grip.is_sliding && patch.limit > 0) {
    double over = 1;  // 1 / s
    for (int i = 0; i < kMaxIterations && length > patch.limit * (1 + kClose); ++i) {
      over += length * length / dot(held, inverse * held) * (length - patch.limit) / patch.limit;
      inverse = inverse_of_sum(over, k, w);
      held = inverse * desired;
      length = norm(held);
    }
    held = held * (patch.limit / length);
  } else if (grip.is_sliding) {
    held = {};
  }
  const Vec3d all = a - w * held;
  grip.slid = all;
  grip.force = -1.0 * held - slope * all;
  grip.bristle = (held + damping * before) / k;
  return grip;
}

void PatchFriction::keep(const TouchedPatch& patch, const Grip& grip, double dt) noexcept {
  const Vec3d t = patch.slides[0].linear, u = patch.slides[1].linear;
  const Vec3d before{dot(state_.bristle_W, t), dot(state_.bristle_W, u), state_.bristle_rotation};
  const double slipped = grip.is_sliding ? norm(grip.slid - (grip.bristle - before)) : 0;
  state_.bristle_W = grip.bristle.x * t + grip.bristle.y * u;
  state_.bristle_rotation = grip.bristle.z;
  state_.is_sliding = grip.is_sliding;
  state_.speed = is_time(dt) ? slipped / dt : 0;
  state_.distance = std::fmod(state_.distance + slipped, kTextureLengths * texture_.length);
}

double PatchFriction::contact_damping(double normal_force, double speed) const noexcept {
  const double damping = options_.contact_damping * normal_force;
  return damping * speed > normal_force ? normal_force / speed : damping;
}

/// Returns the texture's change of the limit, -depth to depth. Grain is a sum of shorter waves with
/// unrelated phases: irregular, but the same for the same path.
double PatchFriction::wave(TextureKind kind, double depth, double dt) const noexcept {
  if (kind == TextureKind::none || !is_time(dt)) return 0;
  const double bandwidth = std::min(texture_.bandwidth, 0.2 / dt);
  const double turns = state_.distance / texture_.length, rate = state_.speed / texture_.length;
  const double strength = depth * state_.speed / (state_.speed + kTextureSpeed);
  if (kind == TextureKind::ridges) {
    return strength * passed(rate, bandwidth) * std::sin(2 * kPi * turns);
  }
  // Waves per 64 lengths, and phases: whole numbers, so that 4096 lengths end where they began.
  constexpr int kWaves[] = {64, 107, 173, 281, 449, 727};
  constexpr double kPhases[] = {0.0, 2.4, 4.8, 0.9, 3.3, 5.7};
  constexpr double kSum = 6;
  double sum = 0;
  for (int i = 0; i < 6; ++i) {
    const double waves = kWaves[i] / 64.0;
    sum += passed(waves * rate, bandwidth) * std::sin(2 * kPi * waves * turns + kPhases[i]);
  }
  return strength * sum / kSum;
}

}}  // namespace palpate::v0
