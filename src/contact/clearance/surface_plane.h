// The surface around the pixel that is nearest to a sphere: a plane through the depths of the
// pixels around it, which has less noise than the pixel itself. Shared by host and device.
#pragma once

#include <cmath>

#include "palpate/math/geometry.h"
#include "src/contact/clearance/clearance_search.h"
#include "src/contact/clearance/nearest_rules.h"

namespace palpate { inline namespace v0 {

/// A plane is taken if it changes a distance by no more than this and what the width of a pixel
/// explains, m at 1 m of depth and nearer; more where noise grows, with the square of the depth.
inline constexpr double kPlaneChange = 1e-3;

/// Half the diagonal of a pixel at a depth, m: a pixel's middle is farther than its surface by
/// less.
PALPATE_HOSTDEV inline double pixel_reach(const ClearanceImage& image, double depth) {
  return 0.71 * depth * static_cast<double>(greater(image.per_fx, image.per_fy));
}

/// Largest change that a plane makes at any depth up to this, m.
PALPATE_HOSTDEV inline double plane_change(const ClearanceImage& image, double depth) {
  return kPlaneChange * greater(1.0, depth * depth) + pixel_reach(image, depth);
}

/// Signed distance of a point, and its derivative by the point.
struct PointDistance {
  double phi = 0;
  Vec3d gradient = {};
};

/// The pixels that show one surface with (u, v).
struct SurfaceWindow {
  /// Largest change of depth from pixel to pixel of one surface, share.
  static constexpr double kSurfaceStep = 0.012;
  static constexpr int kMaxReach = 4;  ///< pixels on each side

  const ClearanceImage& image;
  int u, v;
  double depth;

  PALPATE_HOSTDEV double depth_at(int at_u, int at_v) const {
    return static_cast<double>(image.nearest[0][image.place(0, at_u, at_v)]);
  }

  PALPATE_HOSTDEV bool has(int i, int j) const {
    const int at_u = u + i, at_v = v + j;
    if (at_u < 0 || at_v < 0 || at_u >= image.width || at_v >= image.height) return false;
    return is_near(depth_at(at_u, at_v), i, j);
  }

  /// True if a depth above 0 is of one surface with the middle, so many pixels apart.
  PALPATE_HOSTDEV bool is_near(double here, int i, int j) const {
    const int steps = greater(greater(i < 0 ? -i : i, j < 0 ? -j : j), 1);
    return std::abs(here - depth) <= kSurfaceStep * steps * lesser(here, depth);
  }

  /// N with N . x = 1 on the plane through those within `reach` pixels: the inverse depth is linear
  /// in the image. Least squares. False: the pixels lie on a line.
  PALPATE_HOSTDEV bool fit(int reach, Vec3d& N) const {
    // All loops over columns have the same length, and no branches: vectors take them.
    constexpr int kWide = 2 * kMaxReach + 1;
    std::int32_t places[kWide];  // of columns in a row; -1: there is none
    for (int k = 0; k < kWide; ++k) {
      const int i = k - kMaxReach, at_u = u + i;
      const bool is_there = i >= -reach && i <= reach && at_u >= 0 && at_u < image.width;
      places[k] = is_there ? image.place(0, at_u, 0) : -1;
    }
    int count = 0, sum_i = 0, sum_j = 0, sum_ii = 0, sum_ij = 0, sum_jj = 0;
    double y = 0, iy = 0, jy = 0;
    for (int j = -reach; j <= reach; ++j) {
      const int at_v = v + j;
      if (at_v < 0 || at_v >= image.height) continue;
      const float* const row = image.nearest[0] + image.place(0, 0, at_v);
      double here[kWide], inverse[kWide];  // inverse 0: of another surface
      for (int k = 0; k < kWide; ++k) {
        here[k] = places[k] < 0 ? -1.0 : static_cast<double>(row[places[k]]);
      }
      for (int k = 0; k < kWide; ++k) {
        const double by_here = 1 / here[k];
        inverse[k] = is_near(here[k], k - kMaxReach, j) ? by_here : 0.0;
      }
      int in_row = 0, row_i = 0, row_ii = 0;
      for (int k = 0; k < kWide; ++k) {
        const int i = k - kMaxReach, is_there = inverse[k] > 0 ? 1 : 0;
        in_row += is_there;
        row_i += is_there * i;
        row_ii += is_there * i * i;
        y += inverse[k];
        iy += i * inverse[k];
        jy += j * inverse[k];
      }
      count += in_row;
      sum_i += row_i;
      sum_j += j * in_row;
      sum_ii += row_ii;
      sum_ij += j * row_i;
      sum_jj += j * j * in_row;
    }
    const double n = count, i1 = sum_i, j1 = sum_j, ii = sum_ii, ij = sum_ij, jj = sum_jj;
    const double a = ii - i1 * i1 / n, b = ij - i1 * j1 / n, c = jj - j1 * j1 / n;
    const double by_u = iy - i1 * y / n, by_v = jy - j1 * y / n, determinant = a * c - b * b;
    if (!(determinant > 0.1 * n)) return false;
    const double su = (c * by_u - b * by_v) / determinant, sv = (a * by_v - b * by_u) / determinant;
    const double at_zero = (y - su * i1 - sv * j1) / n - su * u - sv * v;
    const double fx = image.fx, fy = image.fy, cx = image.cx, cy = image.cy;
    N = {su * fx, sv * fy, at_zero + su * cx + sv * cy};
    return true;
  }
};

/// Returns the distance of a sphere's center that a search has found, in the camera frame.
/// Distances to surfaces are those to a plane through up to 9 x 9 pixels of one surface, if the
/// foot of the point lies among them, else those to the pixel.
PALPATE_HOSTDEV inline PointDistance refined_distance(const ClearanceImage& image,
                                                      const ClearanceHit& hit, const Vec3d& p) {
  const double outward = hit.kind == ClearanceKind::open ? -1 : 1;
  if (hit.kind == ClearanceKind::border) {
    const float(&n)[3] = image.border[hit.pixel];
    const Vec3d normal{n[0], n[1], n[2]};
    // Free inside of the image: the border is solid. Solid inside of it: the border is free.
    const double d = dot(normal, p);
    if (image.is_blocked_outside != 0) return {d, normal};
    return {-d, -normal};
  }
  const double fx = image.fx, fy = image.fy, cx = image.cx, cy = image.cy;
  const int u = hit.pixel % image.width, v = hit.pixel / image.width;
  const double depth = static_cast<double>(image.nearest[0][image.place(0, u, v)]);
  const SurfaceWindow window{image, u, v, depth};
  const Vec3d ray{(u - cx) / fx, (v - cy) / fy, 1};
  const double along = dot(p, ray) / dot(ray, ray), back = image.solid_behind;
  double t = outward > 0 ? lesser(greater(along, depth), depth + back)
                         : lesser(greater(along, 0.0), depth);
  if (outward < 0 && back < static_cast<double>(kNoSurface)) {
    const double behind = greater(along, depth + back);
    if (norm(p - behind * ray) < norm(p - t * ray)) t = behind;
  }
  const Vec3d apart = p - t * ray;
  const double distance = norm(apart);
  const PointDistance plain{outward * distance,
                            distance > 0 ? apart * (outward / distance) : Vec3d{0, 0, -1}};
  if (t != depth) return plain;  // beside a surface, or behind its back
  for (int reach = SurfaceWindow::kMaxReach; reach > 0; reach /= 2) {
    Vec3d N;
    if (!window.fit(reach, N)) continue;
    const double length = norm(N), off = (1 - dot(N, p)) / length;
    const Vec3d foot = p + N * (off / length);
    const double change = kPlaneChange * greater(1.0, depth * depth);
    const double beyond = outward * (plain.phi - off);  // how much farther the pixel is
    const double pixel = pixel_reach(image, depth);
    const double explained = std::sqrt(off * off + pixel * pixel) - std::abs(off);
    if (!(foot.z > 0) || beyond < -change || beyond > change + explained) continue;
    const double i = foot.x / foot.z * fx + cx - u, j = foot.y / foot.z * fy + cy - v;
    if (!(std::abs(i) <= reach + 0.5 && std::abs(j) <= reach + 0.5)) continue;
    if (!window.has(static_cast<int>(std::floor(i + 0.5)), static_cast<int>(std::floor(j + 0.5)))) {
      continue;
    }
    return {off, N / -length};
  }
  return plain;
}

}}  // namespace palpate::v0
