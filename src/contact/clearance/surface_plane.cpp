#include "src/contact/clearance/surface_plane.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace palpate { inline namespace v0 {
namespace {

/// Largest change of depth from pixel to pixel of one surface, share.
constexpr double kSurfaceStep = 0.012;

double depth_at(const ClearanceImage& image, int u, int v) {
  return static_cast<double>(image.nearest[0][image.place(0, u, v)]);
}

/// The pixels within `reach` that show one surface with (u, v), and sums over their places.
struct Window {
  const ClearanceImage& image;
  int u, v;
  double depth;

  bool has(int i, int j) const {
    const int at_u = u + i, at_v = v + j;
    if (at_u < 0 || at_v < 0 || at_u >= image.width || at_v >= image.height) return false;
    const double here = depth_at(image, at_u, at_v);
    const int steps = std::max({std::abs(i), std::abs(j), 1});
    return std::abs(here - depth) <= kSurfaceStep * steps * std::min(here, depth);
  }
};

/// N with N . x = 1 on the plane: the inverse depth is linear in the image. Least squares. False:
/// the pixels lie on a line.
bool fit(const Window& w, int reach, Vec3d& N) {
  double n = 0, i1 = 0, j1 = 0, ii = 0, ij = 0, jj = 0, y = 0, iy = 0, jy = 0;
  for (int j = -reach; j <= reach; ++j) {
    for (int i = -reach; i <= reach; ++i) {
      if (!w.has(i, j)) continue;
      const double inverse = 1 / depth_at(w.image, w.u + i, w.v + j);
      n += 1;
      i1 += i;
      j1 += j;
      ii += i * i;
      ij += i * j;
      jj += j * j;
      y += inverse;
      iy += i * inverse;
      jy += j * inverse;
    }
  }
  const double a = ii - i1 * i1 / n, b = ij - i1 * j1 / n, c = jj - j1 * j1 / n;
  const double by_u = iy - i1 * y / n, by_v = jy - j1 * y / n, determinant = a * c - b * b;
  if (!(determinant > 0.1 * n)) return false;
  const double su = (c * by_u - b * by_v) / determinant, sv = (a * by_v - b * by_u) / determinant;
  const double at_zero = (y - su * i1 - sv * j1) / n - su * w.u - sv * w.v;
  const auto k = [](float x) { return static_cast<double>(x); };
  N = {su * k(w.image.fx), sv * k(w.image.fy), at_zero + su * k(w.image.cx) + sv * k(w.image.cy)};
  return true;
}

}  // namespace

PointDistance refined_distance(const ClearanceImage& image, const ClearanceHit& hit,
                               const Vec3d& p) {
  const double outward = hit.kind == ClearanceKind::open ? -1 : 1;
  if (hit.kind == ClearanceKind::border) {
    const float(&n)[3] = image.border[hit.pixel];
    const Vec3d normal{n[0], n[1], n[2]};
    // Free inside of the image: the border is solid. Solid inside of it: the border is free.
    const double d = dot(normal, p);
    if (image.is_blocked_outside != 0) return {d, normal};
    return {-d, -normal};
  }
  const int u = hit.pixel % image.width, v = hit.pixel / image.width;
  const double depth = depth_at(image, u, v);
  const Vec3d ray{(u - static_cast<double>(image.cx)) / static_cast<double>(image.fx),
                  (v - static_cast<double>(image.cy)) / static_cast<double>(image.fy), 1};
  const double along = dot(p, ray) / dot(ray, ray);
  const auto back = static_cast<double>(image.solid_behind);
  double t = outward > 0 ? std::clamp(along, depth, depth + back) : std::clamp(along, 0.0, depth);
  if (outward < 0 && back < static_cast<double>(kNoSurface)) {
    const double behind = std::max(along, depth + back);
    if (norm(p - behind * ray) < norm(p - t * ray)) t = behind;
  }
  const Vec3d apart = p - t * ray;
  const double distance = norm(apart);
  const PointDistance plain{outward * distance,
                            distance > 0 ? apart * (outward / distance) : Vec3d{0, 0, -1}};
  if (t != depth) return plain;  // beside a surface, or behind its back
  const Window window{image, u, v, depth};
  for (const int reach : {4, 2, 1}) {
    Vec3d N;
    if (!fit(window, reach, N)) continue;
    const double length = norm(N), off = (1 - dot(N, p)) / length;
    const Vec3d foot = p + N * (off / length);
    const double change = kPlaneChange * std::max(1.0, depth * depth);
    const double beyond = outward * (plain.phi - off);  // how much farther the pixel is
    const double explained = std::hypot(off, pixel_reach(image, depth)) - std::abs(off);
    if (!(foot.z > 0) || beyond < -change || beyond > change + explained) continue;
    const double i =
        foot.x / foot.z * static_cast<double>(image.fx) + static_cast<double>(image.cx) - u;
    const double j =
        foot.y / foot.z * static_cast<double>(image.fy) + static_cast<double>(image.cy) - v;
    if (!(std::abs(i) <= reach + 0.5 && std::abs(j) <= reach + 0.5)) continue;
    if (!window.has(static_cast<int>(std::lround(i)), static_cast<int>(std::lround(j)))) continue;
    return {off, N / -length};
  }
  return plain;
}

}}  // namespace palpate::v0
