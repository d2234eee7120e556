// Measurements against cameras at any pose in the world.
#include <algorithm>

#include "src/contact/blend.h"
#include "src/contact/hull/camera_seats.h"
#include "src/contact/noise/rotate_noise.h"
#include "src/core/internal/assert.h"
#include "src/math/internal/matrix.h"

namespace palpate { inline namespace v0 {
namespace {

/// Rotates a result from the frame of a camera to the world.
void turn(const Quaternion& q_WC, ContactResult& result) {
  VolumeWrench& measure = result.penetration.measure_W;
  measure = {rotate(q_WC, measure.force), rotate(q_WC, measure.torque)};
  if (result.noise) rotate_noise(rotation_matrix(q_WC), *result.noise);
  if (!result.stiffness) return;
  const Mat3d R_WC = rotation_matrix(q_WC);
  rotate_blocks(R_WC, result.stiffness->m);
  rotate_blocks(R_WC, result.moments.first);
}

/// The tool's pose in a camera.
struct Seat {
  explicit Seat(const SurfaceView& surface, const Pose& X_WT)
      : is_at_origin(surface.X_WC == Pose{}),
        q_WC(normalized(surface.X_WC.rotation)),
        X_CT(is_at_origin ? X_WT : inverse({surface.X_WC.translation, q_WC}) * X_WT) {}

  bool is_at_origin;
  Quaternion q_WC;
  Pose X_CT;
};

}  // namespace

ContactResult ContactQuery::measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                                    const ContactWants& wants) const noexcept {
  const auto is_valid = [](const SurfaceBlend& camera) {
    return is_finite(camera.from.X_WC) && is_finite(camera.to.X_WC);
  };
  if (!is_finite(X_WT) || !std::all_of(cameras.begin(), cameras.end(), is_valid)) {
    return unmeasured(StepStatus::non_finite_pose, wants, true);
  }
  if (cameras.empty() || cameras.size() > kMaxCameras) {
    return unmeasured(StepStatus::no_surface, wants, true);
  }
  const bool has_fields = std::ranges::all_of(cameras, [](const SurfaceBlend& camera) {
    return has_fields_of_role(camera.from) && has_fields_of_role(camera.to);
  });
  PALPATE_ASSERT(has_fields);
  if (!has_fields) return unmeasured(StepStatus::no_surface, wants, true);
  const Pose X{X_WT.translation, normalized(X_WT.rotation)};
  const SurfaceBlend& camera = cameras.front();
  if (cameras.size() > 1 || is_remembered(camera.to)) return measure_hull(cameras, X, wants);
  ContactResult result = has_in_front(camera.to) ? measure_alone(camera, X, wants)
                                                 : measure_camera(camera, X_WT, wants);
  if (result.penetration.status.is_unmeasured()) return result;
  std::fill(wants.deciders.begin(), wants.deciders.end(), 0);
  double& unseen = result.penetration.unseen_volume = 0;
  if (!wants.unseen_volume && wants.unseen.empty()) return result;
  if (camera.to.role == SurfaceRole::one_of_several) {
    unseen = measure_hull(cameras, X, {.unseen = wants.unseen}).penetration.unseen_volume;
  } else {
    std::fill(wants.unseen.begin(), wants.unseen.end(), 0);
    unseen = unseen_by_one(camera.to, Seat(camera.to, X).X_CT, wants.unseen);
  }
  return result;
}

/// Measures against a camera, which may have moved between its frames, at the pose of each.
ContactResult ContactQuery::measure_camera(const SurfaceBlend& camera, const Pose& X_WT,
                                           const ContactWants& wants) const noexcept {
  const SurfaceView &from = camera.from, &to = camera.to;
  const double progress = camera.progress;
  const auto measure_at = [&](const SurfaceView& a, const SurfaceView& b, double alpha,
                              const ContactWants& desired) {
    const Seat seat(b, X_WT);
    ContactResult result = measure_one(a, b, alpha, seat.X_CT, desired);
    if (!seat.is_at_origin) turn(seat.q_WC, result);
    return result;
  };
  if (!(progress < 1) || from.X_WC == to.X_WC) return measure_at(from, to, progress, wants);
  const ContactResult before =
      measure_at(from, from, 1, {.stiffness = wants.stiffness, .noise = wants.noise});
  const ContactResult now = measure_at(to, to, 1, wants);
  if (before.penetration.status.is_unmeasured()) {
    // There was no frame yet.
    if (!before.penetration.status.has(StepStatus::no_surface)) return before;
    return now;
  }
  return now.penetration.status.is_unmeasured() ? now : blend(before, now, progress);
}

/// Measures against the remembered surfaces and those before them, without seen-free space.
ContactResult ContactQuery::measure_alone(SurfaceBlend camera, const Pose& X_WT,
                                          const ContactWants& wants) const noexcept {
  for (SurfaceView* const surface : {&camera.from, &camera.to}) {
    if (surface->role == SurfaceRole::one_of_several) surface->role = SurfaceRole::with_memory;
    surface->seen_free = {};
  }
  return measure_hull({&camera, 1}, X_WT, wants);
}

double ContactQuery::unseen_by_one(const SurfaceView&, const Pose&,
                                   std::span<std::uint8_t>) const noexcept {
  return 0;
}

ContactResult ContactQuery::measure_hull(std::span<const SurfaceBlend>, const Pose&,
                                         const ContactWants& wants) const noexcept {
  return unmeasured(StepStatus::no_surface, wants, true);
}

}}  // namespace palpate::v0
