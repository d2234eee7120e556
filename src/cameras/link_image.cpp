#include "src/cameras/link_image.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

namespace palpate::inline v0 {
namespace {

// Of single precision: exponent and the first two digits after the point make a shell.
constexpr int kDigitsLeftOut = 21;
constexpr std::size_t kNumShells = 48;
constexpr float kSteepest = 0.01f;  // m: of depth per pixel, and within what is not cut any more

std::uint32_t shell_number(float depth) {
  return std::bit_cast<std::uint32_t>(depth) >> kDigitsLeftOut;
}

/// The larger of both; of numbers without NaN. As processors have it in one instruction.
float larger(float a, float b) { return a < b ? b : a; }

/// to[i] = the largest of from[i] and from[i + apart].
void join(const float* __restrict from, const float* __restrict beside, float* __restrict to,
          int num) {
  for (int i = 0; i < num; ++i) to[i] = larger(from[i], beside[i]);
}

void join_to(const float* __restrict from, float* __restrict to, int num) {
  for (int i = 0; i < num; ++i) to[i] = larger(from[i], to[i]);
}

/// In a line: at most `limit` and at least `least`; NaN and infinities too.
int within(double value, int least, int limit) {
  return value > least ? (value < limit ? static_cast<int>(value) : limit) : least;
}

}  // namespace

LinkImage::LinkImage(const Intrinsics& intrinsics, double padding)
    : intrinsics_(intrinsics), padding_(padding), shells_(kNumShells) {}

void LinkImage::begin(int width, int height) {
  const auto& k = intrinsics_;
  const double x = std::max(std::abs(k.cx), std::abs(width - 1 - k.cx)) / k.fx,
               y = std::max(std::abs(k.cy), std::abs(height - 1 - k.cy)) / k.fy;
  widest_ = std::sqrt(1 + x * x + y * y);
  if (width != width_ || height != height_) {
    front_.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 0);
    width_ = width;
    height_ = height;
  } else {
    for (int v = covered_.top; v < covered_.bottom; ++v) {
      float* const row = front_.data() + static_cast<std::ptrdiff_t>(v) * width_;
      std::fill(row + covered_.left, row + covered_.right, 0.0f);
    }
  }
  covered_ = {width, height, 0, 0};
  for (Shell& shell : shells_) {
    shell.triangles.clear();
    shell.nearest = 0;
  }
}

LinkImage::Corner LinkImage::corner_of(const Vec3d& p_C) const {
  const double w = 1 / p_C.z;
  return {static_cast<float>(intrinsics_.fx * p_C.x * w + intrinsics_.cx),
          static_cast<float>(intrinsics_.fy * p_C.y * w + intrinsics_.cy), static_cast<float>(w)};
}

void LinkImage::add(const TriangleMesh& mesh, const Pose& X_CL) {
  const Mat3d R_CL = rotation_matrix(X_CL.rotation);
  points_.clear();
  for (const Vec3d& p_L : mesh.vertices) points_.push_back(R_CL * p_L + X_CL.translation);
  for (const auto& ids : mesh.triangles) {
    const Vec3d p_C[3] = {points_[ids[0]], points_[ids[1]], points_[ids[2]]};
    const int num_near =
        int(p_C[0].z < kNearest) + int(p_C[1].z < kNearest) + int(p_C[2].z < kNearest);
    if (num_near == 0) {
      add_triangle({{corner_of(p_C[0]), corner_of(p_C[1]), corner_of(p_C[2])}});
    } else if (num_near < 3) {
      add_clipped(p_C);
    }
  }
}

void LinkImage::add_clipped(const Vec3d (&p_C)[3]) {
  Corner corners[4];
  int num = 0;
  for (int i = 0; i < 3; ++i) {
    const Vec3d &a = p_C[i], &b = p_C[(i + 1) % 3];
    if (a.z >= kNearest) corners[num++] = corner_of(a);
    if ((a.z < kNearest) == (b.z < kNearest)) continue;
    Vec3d cut = a + (b - a) * ((kNearest - a.z) / (b.z - a.z));
    cut.z = kNearest;
    corners[num++] = corner_of(cut);
  }
  for (int i = 2; i < num; ++i) add_triangle({{corners[0], corners[i - 1], corners[i]}});
}

/// Pixels, by which the padding reaches around what is at this inverse depth: the outline of a ball
/// in perspective.
double LinkImage::reach_of(double w) const {
  const double share = std::min(padding_ * w, 0.95);
  return padding_ * widest_ * std::max(intrinsics_.fx, intrinsics_.fy) * w / (1 - share * share);
}

/// In pieces of which no corner is padded much wider than it needs.
void LinkImage::add_triangle(const Triangle& triangle) {
  constexpr double kMostReach = 1.25, kFewPixels = 2;
  const auto& [a, b, c] = triangle.corners;
  const float nearest = std::max({a.w, b.w, c.w}), farthest = std::min({a.w, b.w, c.w});
  const double reach = reach_of(nearest), least = reach_of(farthest);
  if (reach > kMostReach * least && reach > least + kFewPixels) {
    const auto [one, other] = halves_of(triangle);
    add_triangle(one);
    add_triangle(other);
    return;
  }
  const std::uint32_t first = shell_number(static_cast<float>(kNearest)),
                      number = std::max(shell_number(1 / nearest), first) - first;
  Shell& shell = shells_[std::min<std::size_t>(number, kNumShells - 1)];
  shell.triangles.push_back(triangle);
  shell.nearest = larger(shell.nearest, nearest);
}

void LinkImage::draw() {
  for (const Shell& shell : shells_) {
    if (!shell.triangles.empty()) draw_shell(shell);
  }
}

void LinkImage::draw_shell(const Shell& shell) {
  const int radius = 1 + static_cast<int>(std::ceil(reach_of(shell.nearest)));
  // What is drawn beside the image reaches into it by the padding.
  Window drawn{width_ + radius, height_ + radius, -radius, -radius};
  const Window all{-radius, -radius, width_ + radius, height_ + radius};
  for (const auto& [corners] : shell.triangles) {
    const auto [left, right] = std::minmax({corners[0].u, corners[1].u, corners[2].u});
    const auto [top, bottom] = std::minmax({corners[0].v, corners[1].v, corners[2].v});
    const Window box{within(std::floor(left), all.left, all.right),
                     within(std::floor(top), all.top, all.bottom),
                     within(std::ceil(right) + 1.0, all.left, all.right),
                     within(std::ceil(bottom) + 1.0, all.top, all.bottom)};
    if (box.is_empty()) continue;
    drawn = {std::min(drawn.left, box.left), std::min(drawn.top, box.top),
             std::max(drawn.right, box.right), std::max(drawn.bottom, box.bottom)};
  }
  if (drawn.is_empty()) return;
  canvas_.assign(static_cast<std::size_t>(drawn.width()) * drawn.height(), 0);
  for (const Triangle& triangle : shell.triangles) draw_triangle(triangle, drawn);
  widen_rows(drawn, radius);
  const int width = drawn.width() + 2 * radius, height = drawn.height() + 2 * radius;
  widen_columns(width, height, radius);

  const int first_u = drawn.left - radius, first_v = drawn.top - radius;
  const Window box{std::max(first_u, 0), std::max(first_v, 0), std::min(first_u + width, width_),
                   std::min(first_v + height, height_)};
  for (int v = box.top; v < box.bottom; ++v) {
    float* const front = front_.data() + static_cast<std::ptrdiff_t>(v) * width_ + box.left;
    const float* const from =
        wide_.data() + static_cast<std::ptrdiff_t>(v - first_v) * width + (box.left - first_u);
    for (int i = 0; i < box.width(); ++i) front[i] = larger(front[i], from[i]);
  }
  if (box.is_empty()) return;
  covered_ = {std::min(covered_.left, box.left), std::min(covered_.top, box.top),
              std::max(covered_.right, box.right), std::max(covered_.bottom, box.bottom)};
}

/// Cut across the side along which depth changes most. Inverse depth is linear in the image.
std::pair<LinkImage::Triangle, LinkImage::Triangle> LinkImage::halves_of(const Triangle& triangle) {
  const auto& corners = triangle.corners;
  int first = 0;
  float most = -1;
  for (int i = 0; i < 3; ++i) {
    const float change = std::abs(corners[i].w - corners[(i + 1) % 3].w);
    if (change > most) {
      most = change;
      first = i;
    }
  }
  const Corner &a = corners[first], &b = corners[(first + 1) % 3], &c = corners[(first + 2) % 3];
  const Corner middle{0.5f * (a.u + b.u), 0.5f * (a.v + b.v), 0.5f * (a.w + b.w)};
  return {{{a, middle, c}}, {{middle, b, c}}};
}

/// Every pixel that the triangle touches gets the nearest depth that it has there, or a nearer one.
void LinkImage::draw_triangle(const Triangle& triangle, const Window& canvas) {
  constexpr double kFar = std::numeric_limits<double>::infinity();
  constexpr double kHalf = 0.501;  // of a pixel, and a little for what is rounded
  const auto& [a, b, c] = triangle.corners;
  const auto [left, right] = std::minmax({a.u, b.u, c.u});
  const auto [top, bottom] = std::minmax({a.v, b.v, c.v});
  const Window box{within(std::ceil(double(left) - kHalf), canvas.left, canvas.right),
                   within(std::ceil(double(top) - kHalf), canvas.top, canvas.bottom),
                   within(std::floor(double(right) + kHalf) + 1, canvas.left, canvas.right),
                   within(std::floor(double(bottom) + kHalf) + 1, canvas.top, canvas.bottom)};
  if (box.is_empty()) return;
  const float nearest = std::max({a.w, b.w, c.w}), farthest = std::min({a.w, b.w, c.w});
  const auto row_of = [&](int v) {
    return canvas_.data() + static_cast<std::ptrdiff_t>(v - canvas.top) * canvas.width() -
           canvas.left;
  };
  // Of a few pixels all are covered: most triangles of fine meshes are as small as that.
  if (box.width() <= 3 && box.height() <= 3) {
    for (int v = box.top; v < box.bottom; ++v) {
      float* const row = row_of(v);
      for (int u = box.left; u < box.right; ++u) row[u] = larger(row[u], nearest);
    }
    return;
  }
  const double abu = double(b.u) - a.u, abv = double(b.v) - a.v, acu = double(c.u) - a.u,
               acv = double(c.v) - a.v, abw = double(b.w) - a.w, acw = double(c.w) - a.w;
  const double area = abu * acv - abv * acu;
  // One that is seen along its plane ends where its neighbours do.
  if (!(std::abs(area) > 1e-6)) return;
  const double per_u = (abw * acv - acw * abv) / area, per_v = (acw * abu - abw * acu) / area;
  // Within a pixel that it touches, one that is seen nearly along its plane is everywhere between
  // its nearest and its farthest corner: it is cut until that matters little.
  if ((std::abs(per_u) + std::abs(per_v)) > kSteepest * nearest * nearest &&
      nearest - farthest > kSteepest * nearest * farthest) {
    const auto [half, other] = halves_of(triangle);
    draw_triangle(half, canvas);
    draw_triangle(other, canvas);
    return;
  }
  const auto slope = static_cast<float>(per_u);
  const double corner = kHalf * (std::abs(per_u) + std::abs(per_v)) + a.w - per_u * a.u;

  // Sides as half-planes x * u + y * v + z >= 0, moved out by the corner of a pixel.
  struct Side {
    double y, z;                     // over x
    double least_from, greatest_to;  // infinite where the side bounds the other end of rows
  } sides[3];
  for (int i = 0; i < 3; ++i) {
    const Corner &p = triangle.corners[i], &q = triangle.corners[(i + 1) % 3];
    const double sign = area > 0 ? 1 : -1;
    const double across = sign * (double(p.v) - q.v), y = sign * (double(q.u) - p.u);
    const double x = across == 0 ? 1e-9 : across;
    const double z = kHalf * (std::abs(x) + std::abs(y)) - x * p.u - y * p.v;
    sides[i] = {y / x, z / x, x > 0 ? 0 : -kFar, x > 0 ? kFar : 0};
  }
  for (int v = box.top; v < box.bottom; ++v) {
    double from = box.left, to = box.right - 1;
    for (const Side& side : sides) {
      const double crossing = -(side.y * v + side.z);
      from = std::max(from, crossing + side.least_from);
      to = std::min(to, crossing + side.greatest_to);
    }
    const int first = within(std::ceil(from), box.left, box.right),
              end = within(std::floor(to) + 1, box.left, box.right);
    float* const row = row_of(v);
    const auto start = static_cast<float>(corner + per_v * (v - double(a.v)));
    for (int u = first; u < end; ++u) {
      const float w = start + slope * static_cast<float>(u);
      const float bounded = w < farthest ? farthest : nearest < w ? nearest : w;
      row[u] = larger(row[u], bounded);
    }
  }
}

/// From `canvas_` into `wide_`, which has `radius` more pixels on all sides: the largest number
/// within `radius` columns.
void LinkImage::widen_rows(const Window& drawn, int radius) {
  const int span = 2 * radius + 1, width = drawn.width() + 2 * radius;
  const auto length = static_cast<std::size_t>(width + span);
  wide_.assign(static_cast<std::size_t>(width) * (drawn.height() + 2 * radius), 0);
  row_.assign(length, 0);
  other_row_.assign(length, 0);
  for (int v = 0; v < drawn.height(); ++v) {
    const float* const from = canvas_.data() + static_cast<std::ptrdiff_t>(v) * drawn.width();
    std::fill(row_.begin(), row_.end(), 0.0f);
    // A number is in the windows of the `span` columns from here on.
    std::copy(from, from + drawn.width(), row_.begin() + 2 * radius);
    int reach = 1;  // row_[i] is the largest of so many from i on
    for (; 2 * reach <= span; reach *= 2) {
      join(row_.data(), row_.data() + reach, other_row_.data(), width + span - (2 * reach - 1));
      std::swap(row_, other_row_);
    }
    float* const to = wide_.data() + static_cast<std::ptrdiff_t>(v + 2 * radius) * width;
    join(row_.data(), row_.data() + (span - reach), to, width);
  }
}

/// In place: the largest number within `radius` rows, of rows of which the first 2 * radius are
/// empty.
void LinkImage::widen_columns(int width, int height, int radius) {
  const int span = 2 * radius + 1;
  // Row v becomes the largest of those from v to v + span - 1; beyond the last one they are empty.
  const auto join_rows = [&](int apart) {
    for (int v = 0; v + apart < height; ++v) {
      float* const row = wide_.data() + static_cast<std::ptrdiff_t>(v) * width;
      join_to(row + static_cast<std::ptrdiff_t>(apart) * width, row, width);
    }
  };
  int reach = 1;
  for (; 2 * reach <= span; reach *= 2) join_rows(reach);
  join_rows(span - reach);
}

int LinkImage::remove_from(DepthFrame& frame) const {
  int num = 0;
  const auto padding = static_cast<float>(padding_), unit = static_cast<float>(frame.unit);
  for (int v = covered_.top; v < covered_.bottom; ++v) {
    const std::ptrdiff_t begin = static_cast<std::ptrdiff_t>(v) * width_ + covered_.left;
    std::uint16_t* const pixels = frame.pixels.data() + begin;
    const float* const front = front_.data() + begin;
    for (int i = 0; i < covered_.width(); ++i) {
      const float depth = static_cast<float>(pixels[i]) * unit;
      // depth >= 1 / front - padding
      const bool is_removed = front[i] > 0 && (depth + padding) * front[i] >= 1 && pixels[i] != 0;
      num += is_removed;
      pixels[i] = is_removed ? std::uint16_t(0) : pixels[i];
    }
  }
  return num;
}

double LinkImage::limit_at(int u, int v) const {
  const double front =
      double(front_[static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) + u]);
  return front > 0 ? 1 / front - padding_ : std::numeric_limits<double>::infinity();
}

}  // namespace palpate::inline v0
