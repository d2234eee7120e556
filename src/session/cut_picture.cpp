#include "src/session/cut_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

namespace palpate {
namespace {

constexpr int kOversampling = 2;       // per side; smooth edges
constexpr double kWallWidth = 1.3;     // half the width of the line around the cut, in pixels
constexpr double kDarkening = 0.55;    // of what lies deep below the cut
constexpr double kDarkeningDepth = 6;  // times deeper: the whole tool

constexpr Vec3d kWhole{0.20, 0.45, 0.90}, kFace{0.99, 0.80, 0.36}, kFaceRim{0.78, 0.52, 0.10};
constexpr Vec3d kOutside{0.74, 0.75, 0.78}, kInside{0.52, 0.55, 0.62}, kWall{0.86, 0.20, 0.24};

/// A picture point with its depth along the view.
struct Projected {
  double x, y, depth;
};

/// Nearest colours so far, behind the cut.
class Canvas {
 public:
  Canvas(const Cut& cut, double size)
      : view_(cut.view),
        size_(size),
        texels_(static_cast<std::size_t>(cut.view.width) *
                static_cast<std::size_t>(cut.view.height)) {
    const ScreenPoint at = view_.to_screen(cut.through);
    const double along = dot(cut.normal, view_.forward);
    slope_x_ = -dot(cut.normal, view_.right) / along / view_.scale;
    slope_y_ = -dot(cut.normal, view_.down) / along / view_.scale;
    offset_ = at.depth - slope_x_ * at.x - slope_y_ * at.y;
  }

  const View& view() const { return view_; }
  Projected project(const Vec3d& p) const {
    const ScreenPoint at = view_.to_screen(p);
    return {at.x, at.y, at.depth};
  }
  /// Depth of the cut at a pixel.
  double cut_depth(double x, double y) const { return offset_ + slope_x_ * x + slope_y_ * y; }

  /// Calls draw(x, y) for the pixels in a box.
  template <class Draw>
  void for_box(double x_low, double x_high, double y_low, double y_high, Draw draw) const {
    const int x0 = static_cast<int>(std::ceil(std::max(x_low, 0.0)));
    const int x1 = static_cast<int>(std::floor(std::min(x_high, view_.width - 1.0)));
    const int y0 = static_cast<int>(std::ceil(std::max(y_low, 0.0)));
    const int y1 = static_cast<int>(std::floor(std::min(y_high, view_.height - 1.0)));
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) draw(x, y);
    }
  }

  /// A point of something; what is deep below the cut is darker.
  void put(int x, int y, double depth, const Vec3d& colour) {
    const double below = std::max(0.0, depth - cut_depth(x, y)) / size_;
    const double light = 1 - kDarkening * (1 - std::exp(-kDarkeningDepth * below));
    Texel& texel = texels_[static_cast<std::size_t>(y) * static_cast<std::size_t>(view_.width) +
                           static_cast<std::size_t>(x)];
    if (depth < static_cast<double>(texel.depth)) {
      texel = {static_cast<float>(depth), to_float(colour * light)};
    }
  }

  /// Averages the samples of each pixel.
  std::vector<std::uint8_t> rgba() const {
    const int width = view_.width / kOversampling, height = view_.height / kOversampling;
    std::vector<std::uint8_t> bytes;
    bytes.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 4);
    constexpr int kSamples = kOversampling * kOversampling;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        Vec3f sum;
        int covered = 0;
        for (int k = 0; k < kSamples; ++k) {
          const int row = y * kOversampling + k / kOversampling;
          const Texel& texel =
              texels_[static_cast<std::size_t>(row) * static_cast<std::size_t>(view_.width) +
                      static_cast<std::size_t>(x * kOversampling + k % kOversampling)];
          if (std::isinf(texel.depth)) continue;
          sum += texel.colour;
          ++covered;
        }
        for (int c = 0; c < 3; ++c) {
          // Six bits a channel: no visible loss, a smaller file.
          const float value =
              covered > 0 ? std::clamp(sum[c] / static_cast<float>(covered), 0.0f, 1.0f) : 0.0f;
          bytes.push_back(static_cast<std::uint8_t>(std::lround(value * 63) * 255 / 63));
        }
        bytes.push_back(static_cast<std::uint8_t>(covered * 255 / kSamples));
      }
    }
    return bytes;
  }

 private:
  struct Texel {
    float depth = INFINITY;
    Vec3f colour;
  };
  View view_;
  double size_;
  double slope_x_ = 0, slope_y_ = 0, offset_ = 0;
  std::vector<Texel> texels_;
};

const Vec3d kLight = normalized(Vec3d{-0.45, -0.65, -1});  // in picture axes

void draw_spheres(const Cut& cut, std::span<const Sphere> spheres, Canvas& canvas) {
  const View& view = canvas.view();
  for (const Sphere& sphere : spheres) {
    const Vec3d centre = to_double(sphere.centre);
    const double radius = static_cast<double>(sphere.radius), half = radius * view.scale;
    if (dot(cut.normal, centre - cut.through) >= radius) continue;
    const Projected at = canvas.project(centre);
    const double rim = std::min(0.12 * half, 1.5);  // of the faces
    canvas.for_box(at.x - half, at.x + half, at.y - half, at.y + half, [&](int x, int y) {
      const double nx = (x - at.x) / half, ny = (y - at.y) / half, rest = 1 - nx * nx - ny * ny;
      if (rest < 0) return;
      const double nz = -std::sqrt(rest);
      const double front = at.depth + nz * radius, plane = canvas.cut_depth(x, y);
      if (plane > at.depth - nz * radius) return;
      if (plane > front) {
        const Vec3d q = (view.right * (nx * radius) + view.down * (ny * radius)) +
                        view.forward * (plane - at.depth);
        const double height = dot(cut.normal, cut.through - centre);
        const double face_radius = std::sqrt(std::max(0.0, radius * radius - height * height));
        const double from_rim = (face_radius - norm(q - cut.normal * height)) * view.scale;
        canvas.put(x, y, plane, from_rim < rim ? kFaceRim : kFace);
        return;
      }
      const double lit = std::max(0.0, nx * kLight.x + ny * kLight.y + nz * kLight.z);
      const double gloss = 0.25 * std::pow(lit, 24);
      canvas.put(x, y, front, kWhole * (0.36 + 0.64 * lit) + Vec3d{gloss, gloss, gloss});
    });
  }
}

/// The faces of the mesh behind the cut, filled; both sides can be seen.
void draw_walls(const TriangleMesh& mesh, Canvas& canvas) {
  const View& view = canvas.view();
  for (const auto& t : mesh.triangles) {
    const Vec3d corner[] = {mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]};
    const Projected a = canvas.project(corner[0]), b = canvas.project(corner[1]),
                    c = canvas.project(corner[2]);
    const double twice_area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if (twice_area == 0) continue;
    const Vec3d n = normalized(cross(corner[1] - corner[0], corner[2] - corner[0]));
    Vec3d n_view{dot(n, view.right), dot(n, view.down), dot(n, view.forward)};
    const bool seen_from_inside = n_view.z > 0;
    if (seen_from_inside) n_view = -n_view;
    const double lit = std::max(0.0, dot(n_view, kLight));
    const Vec3d colour = (seen_from_inside ? kInside : kOutside) * (0.5 + 0.5 * lit);
    canvas.for_box(
        std::min({a.x, b.x, c.x}), std::max({a.x, b.x, c.x}), std::min({a.y, b.y, c.y}),
        std::max({a.y, b.y, c.y}), [&](int x, int y) {
          const double wb = ((x - a.x) * (c.y - a.y) - (c.x - a.x) * (y - a.y)) / twice_area;
          const double wc = ((b.x - a.x) * (y - a.y) - (x - a.x) * (b.y - a.y)) / twice_area;
          if (wb < 0 || wc < 0 || wb + wc > 1) return;
          const double depth = a.depth + wb * (b.depth - a.depth) + wc * (c.depth - a.depth);
          if (depth >= canvas.cut_depth(x, y)) canvas.put(x, y, depth, colour);
        });
  }
}

/// Where the cut meets a triangle, if it does.
std::optional<std::pair<Vec3d, Vec3d>> meet(const Cut& cut, const std::array<Vec3d, 3>& corner) {
  Vec3d ends[2];
  int num_ends = 0;
  for (std::size_t k = 0; k < 3 && num_ends < 2; ++k) {
    const Vec3d &p = corner[k], &q = corner[(k + 1) % 3];
    const double hp = dot(cut.normal, p - cut.through), hq = dot(cut.normal, q - cut.through);
    if ((hp < 0) != (hq < 0)) ends[num_ends++] = p + (q - p) * (hp / (hp - hq));
  }
  if (num_ends < 2) return std::nullopt;
  return std::pair(ends[0], ends[1]);
}

/// The section of the mesh as a line on top of everything.
void draw_section(const Cut& cut, const TriangleMesh& mesh, Canvas& canvas) {
  const double half = kWallWidth * kOversampling;
  const double lift = 1 / canvas.view().scale;  // a pixel towards the eye: in front of the faces
  for (const auto& t : mesh.triangles) {
    const auto ends = meet(cut, {mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]});
    if (!ends) continue;
    const Projected p = canvas.project(ends->first), q = canvas.project(ends->second);
    const double dx = q.x - p.x, dy = q.y - p.y, length2 = dx * dx + dy * dy;
    canvas.for_box(std::min(p.x, q.x) - half, std::max(p.x, q.x) + half, std::min(p.y, q.y) - half,
                   std::max(p.y, q.y) + half, [&](int x, int y) {
                     const double along = (x - p.x) * dx + (y - p.y) * dy;
                     const double s = length2 > 0 ? std::clamp(along / length2, 0.0, 1.0) : 0.0;
                     const double away = std::hypot(x - p.x - s * dx, y - p.y - s * dy);
                     if (away <= half) canvas.put(x, y, canvas.cut_depth(x, y) - lift, kWall);
                   });
  }
}

}  // namespace

Cut cut_across(const TriangleMesh& mesh, int axis, int width) {
  const Bounds box = bounds(mesh);
  const Vec3d size = box.high - box.low;
  int along = (axis + 1) % 3;
  if (size[(axis + 2) % 3] > size[along]) along = (axis + 2) % 3;

  Cut cut;
  cut.through = (box.low + box.high) * 0.5;
  cut.normal[axis] = 1;
  View& view = cut.view;
  // Straight at the cut, then a little from above and from one side.
  Vec3d right;
  right[along] = 1;
  const Vec3d straight = -cut.normal, below = cross(straight, right);
  view.forward = normalized(straight + below * 0.42 + right * 0.30);
  view.right = normalized(right - view.forward * dot(right, view.forward));
  view.down = cross(view.forward, view.right);
  view.width = width;

  // Fits what is left of the mesh.
  view.centre_W = cut.through;
  Vec3d low{INFINITY, INFINITY, 0}, high{-INFINITY, -INFINITY, 0};
  const auto include = [&](const Vec3d& p) {
    const Vec3d q = p - cut.through;
    if (dot(cut.normal, q) > 0) return;
    const Vec3d at{dot(view.right, q), dot(view.down, q), 0};
    for (int k = 0; k < 2; ++k) {
      low[k] = std::min(low[k], at[k]);
      high[k] = std::max(high[k], at[k]);
    }
  };
  for (const auto& t : mesh.triangles) {
    const std::array<Vec3d, 3> corner{mesh.vertices[t[0]], mesh.vertices[t[1]],
                                      mesh.vertices[t[2]]};
    for (const Vec3d& p : corner) include(p);
    if (const auto ends = meet(cut, corner)) {
      include(ends->first - cut.normal * (1e-9 * norm(size)));
      include(ends->second - cut.normal * (1e-9 * norm(size)));
    }
  }
  const Vec3d middle = (low + high) * 0.5, extent = high - low;
  view.centre_W += view.right * middle.x + view.down * middle.y;
  constexpr double kUsed = 0.86;  // of the picture
  view.height =
      static_cast<int>(std::clamp(width * extent.y / extent.x, 0.45 * width, 0.8 * width));
  view.scale = kUsed * std::min(width / extent.x, view.height / extent.y);
  return cut;
}

std::string draw_cut_png(const Cut& cut, const TriangleMesh& mesh,
                         std::span<const Sphere> spheres) {
  Cut fine = cut;
  fine.view.width *= kOversampling;
  fine.view.height *= kOversampling;
  fine.view.scale *= kOversampling;
  const Bounds box = bounds(mesh);
  Canvas canvas(fine, norm(box.high - box.low));
  draw_walls(mesh, canvas);
  draw_spheres(fine, spheres, canvas);
  draw_section(fine, mesh, canvas);
  return encode_png(canvas.rgba(), cut.view.width, cut.view.height);
}

}  // namespace palpate
