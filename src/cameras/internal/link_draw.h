// Cutting of triangles and drawing into an image of inverse depth. Shared by host and device: both
// draw the same bits.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// m. Nearer things are drawn by no camera, and one that is mounted in a housing looks out of it.
inline constexpr double kNearestLink = 0.05;

/// Number of depth shells. Exponent and first two mantissa bits of the depth of a triangle's
/// nearest corner select its shell, which spans at most 1 : 1.25; the last takes all that is
/// farther.
inline constexpr int kNumLinkShells = 48;

/// Returns the larger number; neither may be NaN. Compiles to one instruction.
template <class T>
PALPATE_HOSTDEV constexpr T larger(T a, T b) {
  return a < b ? b : a;
}
template <class T>
PALPATE_HOSTDEV constexpr T smaller(T a, T b) {
  return b < a ? b : a;
}
/// Clamps a pixel coordinate to [least, limit] and truncates it; NaN becomes `least`.
PALPATE_HOSTDEV inline int within(double value, int least, int limit) {
  return value > least ? (value < limit ? static_cast<int>(value) : limit) : least;
}

struct LinkCorner {
  float u, v, w;  // pixels, 1 / m
};

/// A corner of a mesh as the camera sees it.
struct LinkVertex {
  Vec3d p_C;
  LinkCorner corner;  ///< w is 0 where the vertex is nearer than kNearestLink
};

struct LinkTriangle {
  LinkCorner corners[3];

  PALPATE_HOSTDEV float nearest() const {
    return larger(larger(corners[0].w, corners[1].w), corners[2].w);
  }
  PALPATE_HOSTDEV float farthest() const {
    return smaller(smaller(corners[0].w, corners[1].w), corners[2].w);
  }
};

/// Columns and rows from `left` and `top` on, before `right` and `bottom`.
struct LinkWindow {
  int left = 0, top = 0, right = 0, bottom = 0;

  PALPATE_HOSTDEV int width() const { return right - left; }
  PALPATE_HOSTDEV int height() const { return bottom - top; }
  PALPATE_HOSTDEV bool is_empty() const { return right <= left || bottom <= top; }
  /// Returns the intersection of both.
  PALPATE_HOSTDEV LinkWindow common(const LinkWindow& b) const {
    return {larger(left, b.left), larger(top, b.top), smaller(right, b.right),
            smaller(bottom, b.bottom)};
  }
};

/// A camera that links are drawn for.
struct LinkCamera {
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double padding = 0;  // m
  double widest = 1;   // of directions in the image: 1 / cosine to the optical axis

  PALPATE_HOSTDEV LinkCorner corner_of(const Vec3d& p_C) const {
    const double w = 1 / p_C.z;
    return {static_cast<float>(fx * p_C.x * w + cx), static_cast<float>(fy * p_C.y * w + cy),
            static_cast<float>(w)};
  }
  PALPATE_HOSTDEV LinkVertex vertex_at(const Vec3d& p_C) const {
    return {p_C, p_C.z < kNearestLink ? LinkCorner{} : corner_of(p_C)};
  }
  /// Pixels, by which the padding reaches around what is at this inverse depth: the outline of a
  /// ball in perspective.
  PALPATE_HOSTDEV double reach_of(double w) const {
    const double share = smaller(padding * w, 0.95);
    return padding * widest * larger(fx, fy) * w / (1 - share * share);
  }
  PALPATE_HOSTDEV int radius_of(float nearest) const {
    return 1 + static_cast<int>(std::ceil(reach_of(static_cast<double>(nearest))));
  }
  /// Is a corner of this piece padded much wider than it needs?
  PALPATE_HOSTDEV bool is_padded_too_wide(const LinkTriangle& piece) const {
    constexpr double kMaxReach = 1.25, kFewPixels = 2;
    const double reach = reach_of(static_cast<double>(piece.nearest())),
                 least = reach_of(static_cast<double>(piece.farthest()));
    return reach > kMaxReach * least && reach > least + kFewPixels;
  }
};

/// Returns the shell of an inverse depth; shells are numbered from near to far.
PALPATE_HOSTDEV inline int shell_of(float w) {
  constexpr int kDigitsLeftOut = 21;
  const float depth[2] = {static_cast<float>(kNearestLink), 1 / w};
  std::uint32_t bits[2];
  std::memcpy(bits, depth, sizeof bits);
  const int number =
      static_cast<int>(bits[1] >> kDigitsLeftOut) - static_cast<int>(bits[0] >> kDigitsLeftOut);
  return larger(0, smaller(number, kNumLinkShells - 1));
}

/// Cuts off the part of a triangle that is too near. Returns the number of corners: 0, 3 or 4.
PALPATE_HOSTDEV inline int cut_at_nearest(const LinkCamera& camera,
                                          const LinkVertex* const (&vertices)[3],
                                          LinkCorner (&to)[4]) {
  int num = 0;
  for (int i = 0; i < 3; ++i) {
    const LinkVertex &a = *vertices[i], &b = *vertices[(i + 1) % 3];
    const bool a_is_near = a.p_C.z < kNearestLink, b_is_near = b.p_C.z < kNearestLink;
    if (!a_is_near) to[num++] = a.corner;
    if (a_is_near == b_is_near) continue;
    Vec3d cut = a.p_C + (b.p_C - a.p_C) * ((kNearestLink - a.p_C.z) / (b.p_C.z - a.p_C.z));
    cut.z = kNearestLink;
    to[num++] = camera.corner_of(cut);
  }
  return num;
}

/// A triangle and the halves into which it is cut, of which the last one is next.
class LinkPieces {
 public:
  PALPATE_HOSTDEV explicit LinkPieces(const LinkTriangle& whole) : num_(1) { waiting_[0] = whole; }

  PALPATE_HOSTDEV bool take(LinkTriangle& piece) {
    if (num_ == 0) return false;
    piece = waiting_[--num_];
    return true;
  }
  /// Cuts across the side along which depth changes most. Inverse depth is linear in the image.
  /// False: it has been cut so often that it stays as it is.
  PALPATE_HOSTDEV bool cut(const LinkTriangle& piece) {
    if (num_ + 2 > kMaxTriangles) return false;
    int first = 0;
    float most = -1;
    for (int i = 0; i < 3; ++i) {
      const float change = std::abs(piece.corners[i].w - piece.corners[(i + 1) % 3].w);
      if (change > most) {
        most = change;
        first = i;
      }
    }
    const LinkCorner &a = piece.corners[first], &b = piece.corners[(first + 1) % 3],
                     &c = piece.corners[(first + 2) % 3];
    const LinkCorner middle{0.5f * (a.u + b.u), 0.5f * (a.v + b.v), 0.5f * (a.w + b.w)};
    waiting_[num_++] = {{a, middle, c}};
    waiting_[num_++] = {{middle, b, c}};
    return true;
  }

 private:
  static constexpr int kMaxTriangles = 48;
  LinkTriangle waiting_[kMaxTriangles];
  int num_;
};

/// Pixels that a triangle touches, with the nearest depth that it has there, or a nearer one.
class LinkRaster {
 public:
  enum class Kind {
    small,    ///< few pixels, and all are covered: most triangles of fine meshes
    edge_on,  ///< it is seen along its plane, and ends where its neighbors do
    steep,    ///< it is to be cut: within a pixel it is everywhere between its nearest and its
              ///< farthest corner
    plain
  };

  /// All pixels that a triangle touches.
  PALPATE_HOSTDEV static LinkWindow box_of(const LinkTriangle& triangle) {
    const auto& [a, b, c] = triangle.corners;
    return {first_pixel(smaller(smaller(a.u, b.u), c.u)),
            first_pixel(smaller(smaller(a.v, b.v), c.v)), end_pixel(larger(larger(a.u, b.u), c.u)),
            end_pixel(larger(larger(a.v, b.v), c.v))};
  }

  PALPATE_HOSTDEV explicit LinkRaster(const LinkTriangle& triangle)
      : box_(box_of(triangle)), nearest_(triangle.nearest()), farthest_(triangle.farthest()) {
    const auto& [a, b, c] = triangle.corners;
    if (box_.width() <= 3 && box_.height() <= 3) {
      kind_ = Kind::small;
      return;
    }
    const double abu = double(b.u) - a.u, abv = double(b.v) - a.v, acu = double(c.u) - a.u,
                 acv = double(c.v) - a.v, abw = double(b.w) - a.w, acw = double(c.w) - a.w;
    const double area = abu * acv - abv * acu;
    if (!(std::abs(area) > 1e-6)) {
      kind_ = Kind::edge_on;
      return;
    }
    const double per_u = (abw * acv - acw * abv) / area;
    per_v_ = (acw * abu - abw * acu) / area;
    constexpr float kSteepest =
        0.01f;  // m: largest change of depth per pixel, and within a piece that is not cut any more
    if (std::abs(per_u) + std::abs(per_v_) > kSteepest * nearest_ * nearest_ &&
        nearest_ - farthest_ > kSteepest * nearest_ * farthest_) {
      kind_ = Kind::steep;
    }
    slope_ = static_cast<float>(per_u);
    corner_ = kHalf * (std::abs(per_u) + std::abs(per_v_)) + a.w - per_u * a.u;
    from_v_ = static_cast<double>(a.v);
    for (int i = 0; i < 3; ++i) {
      const LinkCorner &p = triangle.corners[i], &q = triangle.corners[(i + 1) % 3];
      const double sign = area > 0 ? 1 : -1;
      const double across = sign * (double(p.v) - q.v), y = sign * (double(q.u) - p.u);
      const double x = across == 0 ? 1e-9 : across;
      const double z = kHalf * (std::abs(x) + std::abs(y)) - x * p.u - y * p.v;
      sides_[i] = {y / x, z / x, x > 0 ? 0 : -kNever, x > 0 ? kNever : 0};
    }
  }

  PALPATE_HOSTDEV Kind kind() const { return kind_; }
  PALPATE_HOSTDEV const LinkWindow& box() const { return box_; }

  /// Columns first to end of a row; `start`: inverse depth at column 0, 1 / m.
  struct Row {
    int first = 0, end = 0;
    float start = 0;
  };
  PALPATE_HOSTDEV Row row(int v, int left, int right) const {
    if (kind_ == Kind::small) return {left, right, nearest_};
    double from = left, to = right - 1;
    for (const Side& side : sides_) {
      const double crossing = -(side.y * v + side.z);
      from = larger(from, crossing + side.min_from);
      to = smaller(to, crossing + side.max_to);
    }
    return {within(std::ceil(from), left, right), within(std::floor(to) + 1, left, right),
            static_cast<float>(corner_ + per_v_ * (v - from_v_))};
  }
  /// 1 / m
  PALPATE_HOSTDEV float at(const Row& row, int u) const {
    const float w = row.start + slope_ * static_cast<float>(u);
    return w < farthest_ ? farthest_ : nearest_ < w ? nearest_ : w;
  }

 private:
  static constexpr double kHalf = 0.501;  // half a pixel, and a margin for rounding
  static constexpr int kFar = 1 << 28;    // pixels
  static constexpr double kNever = 1e300;

  /// A side as a half-plane x * u + y * v + z >= 0, moved out by the corner of a pixel.
  struct Side {
    double y, z;              // over x
    double min_from, max_to;  // kNever where the side bounds the other end of rows
  };

  PALPATE_HOSTDEV static int first_pixel(float at) {
    return within(std::ceil(static_cast<double>(at) - kHalf), -kFar, kFar);
  }
  PALPATE_HOSTDEV static int end_pixel(float at) {
    return within(std::floor(static_cast<double>(at) + kHalf) + 1, -kFar, kFar);
  }

  LinkWindow box_;
  Kind kind_ = Kind::plain;
  float nearest_, farthest_, slope_ = 0;
  double corner_ = 0, per_v_ = 0, from_v_ = 0;
  Side sides_[3];
};

/// Calls draw_row(v, row, raster) for each row of a triangle within `window`, cut where it is
/// steep.
template <class DrawRow>
PALPATE_HOSTDEV inline void draw_rows(const LinkTriangle& whole, const LinkWindow& window,
                                      const DrawRow& draw_row) {
  LinkPieces pieces(whole);
  for (LinkTriangle piece; pieces.take(piece);) {
    const LinkRaster raster(piece);
    const LinkWindow box = raster.box().common(window);
    if (box.is_empty() || raster.kind() == LinkRaster::Kind::edge_on) continue;
    if (raster.kind() == LinkRaster::Kind::steep && pieces.cut(piece)) continue;
    for (int v = box.top; v < box.bottom; ++v) {
      draw_row(v, raster.row(v, box.left, box.right), raster);
    }
  }
}

/// True if a pixel shows a drawn mesh or lies behind it: depth >= 1 / front - padding
PALPATE_HOSTDEV inline bool shows_link(std::uint16_t count, float unit, float padding,
                                       float front) {
  const float depth = static_cast<float>(count) * unit;
  return front > 0 && (depth + padding) * front >= 1 && count != 0;
}

}}  // namespace palpate::v0
