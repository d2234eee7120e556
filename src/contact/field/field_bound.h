// Bounds from the tiles of a depth field for all spheres in a ball at once, mostly that they lie
// wholly in front of the surface. Shared by host and device.
#pragma once

#include "palpate/field/sensor.h"
#include "palpate/math/geometry.h"
#include "src/contact/index/sphere_clusters.h"
#include "src/field/internal/needed_window.h"

namespace palpate { inline namespace v0 {

/// A field and the pose of the tool in its camera, in single precision.
struct FieldFrame {
  float fx = 0, fy = 0, cx = 0, cy = 0;
  float R_WT[3][3] = {};
  float p_WC[3] = {};  ///< of the center of mass, which centers of elements are relative to
};

/// Places the tool at a pose with a unit quaternion.
PALPATE_HOSTDEV inline void place_tool(const Pose& X_WT, const Vec3d& center_of_mass,
                                       FieldFrame& frame) {
  const Mat3d R_WT = rotation_matrix(X_WT.rotation);
  const Vec3d p_WC = X_WT * center_of_mass;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      frame.R_WT[row][column] = static_cast<float>(R_WT.m[row][column]);
    }
    frame.p_WC[row] = static_cast<float>(p_WC[row]);
  }
}

inline FieldFrame frame_of(const Intrinsics& k, const Pose& X_WT, const Vec3d& center_of_mass) {
  FieldFrame frame{static_cast<float>(k.fx),
                   static_cast<float>(k.fy),
                   static_cast<float>(k.cx),
                   static_cast<float>(k.cy),
                   {},
                   {}};
  place_tool(X_WT, center_of_mass, frame);
  return frame;
}

/// True if elements sample the same pixels of both, as in two frames of one camera.
inline bool have_one_grid(const DepthFieldView& a, const DepthFieldView& b) {
  const Intrinsics &k = a.intrinsics, &l = b.intrinsics;
  return a.num_levels == b.num_levels && a.levels[0].width == b.levels[0].width &&
         a.levels[0].height == b.levels[0].height && a.levels[0].stride == b.levels[0].stride &&
         a.tiles_wide == b.tiles_wide && a.tiles_high == b.tiles_high &&
         a.thickness == b.thickness && k.fx == l.fx && k.fy == l.fy && k.cx == l.cx && k.cy == l.cy;
}

/// True if a query reads pixels that one of two surfaces lacks. `from` counts below alpha = 1.
inline bool is_outside_window(const SurfaceView& from, const SurfaceView& to, double alpha,
                              const Vec3d& p_WC, double reach) {
  const auto is_outside = [&](const DepthFieldView& field) {
    return field.num_levels > 0 && !is_known_around(field, p_WC, reach);
  };
  return is_outside(to.field) || (alpha < 1 && is_outside(from.field));
}

/// Position of a ball, and the tiles that can show the samples of its elements.
struct BallWindow {
  float nearest = 0, farthest = 0;  ///< depths
  int left = 0, right = 0, top = 0, bottom = 0;
  float first_u = 0, last_u = 0, first_v = 0, last_v = 0;  ///< pixels, also beyond the image

  /// The ball has tiles only if it lies before the camera.
  PALPATE_FORMULA bool is_before_camera() const { return nearest > kMinDepth; }
  PALPATE_FORMULA int num_tiles() const { return (right - left + 1) * (bottom - top + 1); }
};

/// Finds the pixels of a row that show the range from x - reach to x + reach, with a margin.
/// Scales: 1 / depth of the nearest and farthest points.
PALPATE_FORMULA void find_pixels(float x, float reach, float near_scale, float far_scale,
                                 float focal, float middle, float margin, float& first,
                                 float& last) {
  const float low = focal * (x - reach) * (x < reach ? near_scale : far_scale) - margin;
  const float high = focal * (x + reach) * (x > -reach ? near_scale : far_scale) + margin;
  first = low + middle;
  last = high + middle;
}

/// Finds the first and last of `num` tiles in a row with pixels from `first_pixel` to `last_pixel`.
PALPATE_FORMULA void find_tiles(float first_pixel, float last_pixel, int num, int& first,
                                int& last) {
  const float most = static_cast<float>(num - 1);
  const float from = first_pixel * (1.0f / DepthFieldView::kTileSize);
  const float to = last_pixel * (1.0f / DepthFieldView::kTileSize);
  first = static_cast<int>(from > 0 ? (from < most ? from : most) : 0.0f);
  last = static_cast<int>(to > 0 ? (to < most ? to : most) : 0.0f);
}

/// Returns the tiles of the ball's image, and of the four and a half footprints around in which a
/// silhouette may be nearer than a radius.
PALPATE_FORMULA BallWindow window_of(const FieldFrame& frame, const Cluster& ball,
                                     float largest_radius, int tiles_wide, int tiles_high) {
  float at[3];
  for (int row = 0; row < 3; ++row) {
    const float(&r)[3] = frame.R_WT[row];
    at[row] = r[0] * ball.center.x + r[1] * ball.center.y + r[2] * ball.center.z + frame.p_WC[row];
  }
  const float reach = ball.reach * 1.0001f;
  BallWindow window;
  window.nearest = at[2] - reach;
  window.farthest = at[2] + reach;
  if (!window.is_before_camera()) return window;
  const float near_scale = 1.0f / window.nearest, far_scale = 1.0f / window.farthest;
  const float margin_u = 2.01f + 5 * kFootprint * largest_radius * frame.fx * near_scale;
  // Samples reach as many rows as columns around, also where pixels are higher.
  const float focal_v = frame.fx > frame.fy ? frame.fx : frame.fy;
  const float margin_v = 2.01f + 5 * kFootprint * largest_radius * focal_v * near_scale;
  find_pixels(at[0], reach, near_scale, far_scale, frame.fx, frame.cx, margin_u, window.first_u,
              window.last_u);
  find_pixels(at[1], reach, near_scale, far_scale, frame.fy, frame.cy, margin_v, window.first_v,
              window.last_v);
  find_tiles(window.first_u, window.last_u, tiles_wide, window.left, window.right);
  find_tiles(window.first_v, window.last_v, tiles_high, window.top, window.bottom);
  return window;
}

/// True if all planes of a tile stay farther away than `radius` at all depths to `farthest`.
PALPATE_FORMULA bool is_behind(const DepthTile& tile, float farthest, float radius) {
  return tile.min_slope * (tile.nearest - farthest) > radius;
}

}}  // namespace palpate::v0
