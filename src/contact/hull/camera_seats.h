// The pose of a tool in a camera, for the two frames of its blend: the newer one first.
#pragma once

#include <algorithm>
#include <span>

#include "palpate/field/sensor.h"
#include "src/contact/field/field_bound.h"

namespace palpate { inline namespace v0 {

inline bool has_in_front(const SurfaceView& surface) { return surface.in_front.num_levels > 0; }
inline bool is_remembered(const SurfaceView& surface) { return surface.remembered.num_levels > 0; }
/// True if a surface has the fields of its role, which it is given with them, or none yet.
inline bool has_fields_of_role(const SurfaceView& surface) {
  const bool has_seen_free = surface.seen_free.num_levels > 0;
  switch (surface.role) {
    case SurfaceRole::frame:
      return !has_seen_free && !has_in_front(surface) && !is_remembered(surface);
    case SurfaceRole::with_memory:
      return !has_seen_free && has_in_front(surface) && !is_remembered(surface);
    case SurfaceRole::one_of_several:
      return has_seen_free && (has_in_front(surface) || !is_remembered(surface));
    case SurfaceRole::key_frame:
      return !has_seen_free && !has_in_front(surface) && is_remembered(surface);
  }
  return false;
}
/// True if the surface shows seen-free space: by `seen_free`, or by `field` of a lone camera.
inline bool is_seen(const SurfaceView& surface, bool is_alone) {
  return is_alone || surface.role == SurfaceRole::one_of_several;
}
/// True if the surface has the fields that join cameras. A single camera needs `field` only.
inline bool has_fields(const SurfaceView& surface, bool is_alone) {
  return surface.field.num_levels > 0 && (is_seen(surface, is_alone) || is_remembered(surface));
}
inline bool are_alike(const SurfaceView& a, const SurfaceView& b) {
  return a.role == b.role && has_in_front(a) == has_in_front(b) &&
         is_remembered(a) == is_remembered(b);
}

/// True if two lists of surfaces show the same, which fields without a stamp never do.
inline bool show_same(std::span<const SurfaceView> a, std::span<const SurfaceView> b) {
  const auto is_field = [](const DepthFieldView& k, const DepthFieldView& l) {
    if (k.num_levels == 0 || l.num_levels == 0) return k.num_levels == l.num_levels;
    return k.stamp != 0 && k.stamp == l.stamp && k.thickness == l.thickness && k.gpu == l.gpu;
  };
  return std::ranges::equal(a, b, [&](const SurfaceView& k, const SurfaceView& l) {
    return k.role == l.role && k.X_WC == l.X_WC && is_field(k.field, l.field) &&
           is_field(k.seen_free, l.seen_free) && is_field(k.in_front, l.in_front) &&
           is_field(k.remembered, l.remembered);
  });
}

/// True for one camera that is sampled by itself, without its seen-free space.
inline bool is_alone(std::span<const SurfaceBlend> cameras) {
  return cameras.size() == 1 && cameras.front().to.role != SurfaceRole::one_of_several;
}

struct CameraSeats {
  CameraSeats(const SurfaceBlend& view, const Pose& X_WT, bool is_alone) {
    const bool is_between = view.progress < 1 && has_fields(view.from, is_alone) &&
                            are_alike(view.from, view.to) &&
                            have_one_grid(view.from.field, view.to.field);
    num_moments = is_between ? 2 : 1;
    has_moved = is_between && !(view.from.X_WC == view.to.X_WC);
    place(0, view.to.X_WC, X_WT);
    if (has_moved) {
      place(1, view.from.X_WC, X_WT);
    } else {
      q_WC[1] = q_WC[0];
      X_CT[1] = X_CT[0];
    }
  }

  /// True if the tool has left the window of the fields. `p_TC`, `reach`: a ball around it.
  bool is_outside_window(const SurfaceBlend& view, const Vec3d& p_TC, double reach) const {
    const SurfaceView &from = view.from, &to = view.to;
    const double progress = view.progress;
    if (!has_moved) return palpate::is_outside_window(from, to, progress, X_CT[0] * p_TC, reach);
    return palpate::is_outside_window(to, to, 1, X_CT[0] * p_TC, reach) ||
           palpate::is_outside_window(from, from, 1, X_CT[1] * p_TC, reach);
  }

  void write_rotations(float (&R_WC)[2][3][3]) const {
    for (int f = 0; f < 2; ++f) {
      const Mat3d R = rotation_matrix(q_WC[f]);
      for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 3; ++column) {
          R_WC[f][row][column] = static_cast<float>(R.m[row][column]);
        }
      }
    }
  }

  int num_moments = 1;
  bool has_moved = false;
  Quaternion q_WC[2];
  Pose X_CT[2];

 private:
  void place(int f, const Pose& X_WC, const Pose& X_WT) {
    q_WC[f] = normalized(X_WC.rotation);
    X_CT[f] = inverse({X_WC.translation, q_WC[f]}) * X_WT;
  }
};

}}  // namespace palpate::v0
