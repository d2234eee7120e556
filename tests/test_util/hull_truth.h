// The depth hull by its definition: every element by itself, every camera in turn, in double. The
// arithmetic of joining cameras is written down here once more.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>

#include "palpate/contact/contact.h"
#include "tests/test_util/field_truth.h"

namespace palpate::test {

/// A field at a point of the world.
struct HullSample {
  double phi = 0;
  Vec3d gradient;
};

/// max(a, b), rounded where they are less than w apart.
inline HullSample rounded_max(const HullSample& a, const HullSample& b, double w) {
  const double apart = b.phi - a.phi;
  if (apart <= -w) return a;
  if (apart >= w) return b;
  const double share = (apart + w) / (2 * w);
  return {a.phi + w * share * share, a.gradient + share * (b.gradient - a.gradient)};
}
inline HullSample rounded_min(const HullSample& a, const HullSample& b, double w) {
  const HullSample most = rounded_max({-a.phi, -a.gradient}, {-b.phi, -b.gradient}, w);
  return {-most.phi, -most.gradient};
}

/// Cameras that agree to a few millimeters: between the mean and the greater one.
inline double agreement_of(double radius) { return 0.003 + 0.2 * radius; }
inline HullSample agreed_of(const HullSample& a, const HullSample& b, double wide) {
  const HullSample &less = a.phi < b.phi ? a : b, &more = a.phi < b.phi ? b : a;
  const double x = (more.phi - less.phi) / wide;
  if (x >= 1) return more;
  // From the mean on: s(x) = W / 2 (2 x^2 - x^3)
  const double share = 0.5 * (4 * x - 3 * x * x);
  return {0.5 * (a.phi + b.phi) + 0.5 * wide * x * x * (2 - x),
          (0.5 + share) * more.gradient + (0.5 - share) * less.gradient};
}

/// Samples one of a camera's fields at a point of the world for a ball, between its two moments.
/// Space that a camera has seen to be free is closed at its eye (`is_closed`).
inline HullSample hull_view(const SurfaceBlend& view, const Vec3d& p_W, double radius,
                            double extent, DepthFieldView SurfaceView::*field, bool is_closed,
                            bool joins_in_front = false) {
  const bool has_moved = !(view.from.X_WC == view.to.X_WC);
  const auto before_eye = [&](const HullSample& now, const Pose& X_WC) {
    const Vec3d z_W = rotate(X_WC.rotation, {0, 0, 1});
    return rounded_min(now, {(inverse(X_WC) * p_W).z - 0.02, z_W}, 0.1 * radius);
  };
  const auto at = [&](const SurfaceView& surface) {
    const Vec3d p_C = inverse(surface.X_WC) * p_W;
    const auto [phi, gradient] = sample_field(surface.*field, p_C, radius);
    const HullSample far{std::max(2 * radius + agreement_of(radius), extent + 0.25 * radius), {}};
    HullSample here =
        rounded_min({phi, rotate(surface.X_WC.rotation, gradient)}, far, 0.25 * radius);
    if (joins_in_front) {
      const auto front = sample_field(surface.in_front, p_C, radius);
      here = rounded_min(here, {front.phi, rotate(surface.X_WC.rotation, front.gradient)},
                         0.1 * radius);
    }
    return has_moved && is_closed ? before_eye(here, surface.X_WC) : here;
  };
  const double t = view.progress;
  HullSample now = at(view.to);
  if (t < 1) {
    const HullSample before = at(view.from);
    now = {(1 - t) * before.phi + t * now.phi, (1 - t) * before.gradient + t * now.gradient};
  }
  return is_closed && !has_moved ? before_eye(now, view.to.X_WC) : now;
}

/// Returns the state of a sphere with this field value.
inline SphereState state_at(double phi, double radius) {
  return phi >= radius   ? SphereState::outside
         : phi > -radius ? SphereState::boundary
                         : SphereState::inside;
}

/// Sample of all cameras together.
struct HullTruth {
  HullSample at;
  double seen_phi = 0;  ///< of the space that they have seen to be free, or remember to be
  int decider = -1;     ///< index of the deciding camera; -1 if none
};
inline bool is_remembered(const SurfaceBlend& view) { return view.to.remembered.num_levels > 0; }
/// The free space of a single camera is not queried, and nothing is behind its eye.
inline bool is_alone(std::span<const SurfaceBlend> views) {
  return views.size() == 1 && !is_remembered(views[0]);
}
inline HullTruth hull_of(std::span<const SurfaceBlend> views, const Vec3d& p_W, double radius,
                         double extent) {
  const double w = 0.1 * radius, wide = agreement_of(radius);
  if (is_alone(views)) {
    const bool joins = views[0].to.in_front.num_levels > 0;
    return {hull_view(views[0], p_W, radius, extent, &SurfaceView::field, false, joins), 0, 0};
  }
  std::optional<HullSample> seen, shown, known, least;
  int seer = -1, shower = -1, knower = -1;
  double max_seen = -1e9, min_shown = 1e9, max_known = -1e9;
  for (std::size_t k = 0; k < views.size(); ++k) {
    const auto evaluate = [&](DepthFieldView SurfaceView::*field, bool is_closed) {
      return hull_view(views[k], p_W, radius, extent, field, is_closed);
    };
    const bool has_in_front = views[k].to.in_front.num_levels > 0;
    if (views[k].to.seen_free.num_levels > 0) {
      const HullSample now = evaluate(&SurfaceView::seen_free, true);
      seen = seen ? agreed_of(*seen, now, wide) : now;
      if (now.phi > max_seen) seer = static_cast<int>(k);
      max_seen = std::max(max_seen, now.phi);
      const HullSample slab =
          evaluate(has_in_front ? &SurfaceView::in_front : &SurfaceView::field, false);
      if (slab.phi < min_shown) shower = static_cast<int>(k);
      min_shown = std::min(min_shown, slab.phi);
      shown = shown ? rounded_min(*shown, slab, w) : slab;
    }
    if (is_remembered(views[k])) {
      const HullSample before = evaluate(&SurfaceView::remembered, true);
      known = known ? agreed_of(*known, before, wide) : before;
      if (before.phi > max_known) knower = static_cast<int>(k);
      max_known = std::max(max_known, before.phi);
    }
    const HullSample there = evaluate(&SurfaceView::field, false);
    least = least ? rounded_min(*least, there, w) : there;
  }
  HullTruth hull{*seen, seen->phi, seer};
  const auto join = [&](const HullSample& other, double later, int who) {
    if (other.phi - later > hull.at.phi) hull.decider = who;
    hull.at = rounded_max(hull.at, {other.phi - later, other.gradient}, w);
  };
  if (known) {
    join(rounded_min(*known, *shown, w), w, known->phi < shown->phi ? knower : shower);
  }
  hull.seen_phi = hull.at.phi;
  join(*least, wide, -1);
  return hull;
}
inline HullTruth hull_of(std::span<const SurfaceBlend> views, const Vec3d& p_W, double radius) {
  return hull_of(views, p_W, radius, radius);
}

/// U = sum f G(phi) and its parts; the force follows gradients up to a length of `longest`.
inline Penetration hull_truth(const Tool& tool, std::span<const SurfaceBlend> views,
                              const Pose& X_WT, SphereVolumes volumes, double longest = kLongest) {
  const FieldElements elements(tool, volumes);
  const auto sample = [&](ElementTruth& e, const Vec3d& p_W, double extent) {
    const HullTruth hull = hull_of(views, p_W, e.radius, extent);
    e.phi = hull.at.phi;
    e.gradient = hull.at.gradient;
    e.is_unseen = hull.seen_phi < -kSeenBehind;
    if (!is_alone(views)) return;
    for (const SurfaceView* const at : {&views[0].from, &views[0].to}) {
      if (views[0].progress >= 1 && at == &views[0].from) continue;
      e.has_value &= (inverse(at->X_WC) * p_W).z > double{kMinDepth};
    }
  };
  return sum_of(elements_truth(tool, elements, X_WT, sample), longest);
}

}  // namespace palpate::test
