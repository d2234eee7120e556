#include "src/session/scene_picture.h"

#include <png.h>

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int kOversampling = 2;  // per side; smooth edges
constexpr float kVeil = 0.45f;    // how much the surface hides the spheres behind it

constexpr Vec3d kInside{0.16, 0.42, 0.92}, kBoundary{0.62, 0.22, 0.80}, kOutside{0.88, 0.24, 0.20};
constexpr Vec3d kSurface{0.80, 0.79, 0.75};

struct Texel {
  float depth = INFINITY;
  Vec3f colour;
};

/// One layer of the picture with its depth test.
class Layer {
 public:
  Layer(int width, int height)
      : width_(width),
        texels_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {}

  void put(int x, int y, double depth, const Vec3d& colour) {
    Texel& texel = texels_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                           static_cast<std::size_t>(x)];
    if (depth < static_cast<double>(texel.depth)) {
      texel = {static_cast<float>(depth), to_float(colour)};
    }
  }
  const std::vector<Texel>& texels() const { return texels_; }

 private:
  int width_;
  std::vector<Texel> texels_;
};

/// The pixels of a square around a screen point, clipped to the picture.
template <class Draw>
void for_square(const View& view, const ScreenPoint& at, double half, Draw draw) {
  if (!(at.x + half >= 0 && at.x - half < view.width && at.y + half >= 0 &&
        at.y - half < view.height)) {
    return;
  }
  const int x0 = static_cast<int>(std::ceil(std::max(at.x - half, 0.0)));
  const int x1 = static_cast<int>(std::floor(std::min(at.x + half, view.width - 1.0)));
  const int y0 = static_cast<int>(std::ceil(std::max(at.y - half, 0.0)));
  const int y1 = static_cast<int>(std::floor(std::min(at.y + half, view.height - 1.0)));
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) draw(x, y, (x - at.x), (y - at.y));
  }
}

void draw_spheres(const View& view, std::span<const Sphere> spheres,
                  std::span<const SphereState> states, const Pose& X_WT, Layer& layer) {
  const Vec3d light = normalized(Vec3d{-0.45, -0.6, -1});  // in picture axes
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    const ScreenPoint at = view.to_screen(X_WT * to_double(spheres[i].centre));
    if (!(at.pixels_per_metre > 0)) continue;
    const double radius = static_cast<double>(spheres[i].radius);
    const double half = radius * at.pixels_per_metre;
    const Vec3d base = states[i] == SphereState::inside     ? kInside
                       : states[i] == SphereState::boundary ? kBoundary
                                                            : kOutside;
    for_square(view, at, half, [&](int x, int y, double dx, double dy) {
      const double nx = dx / half, ny = dy / half, rest = 1 - nx * nx - ny * ny;
      if (rest < 0) return;
      const double nz = -std::sqrt(rest);
      const double lit = std::max(0.0, nx * light.x + ny * light.y + nz * light.z);
      const double rim = 0.72 + 0.28 * std::min(1.0, -nz / 0.4);
      const double gloss = 0.25 * std::pow(lit, 24);
      const Vec3d colour = base * ((0.38 + 0.62 * lit) * rim) + Vec3d{gloss, gloss, gloss};
      layer.put(x, y, at.depth + nz * radius, colour);
    });
  }
}

/// Every point is a little disc across its normal, as large as the gap to its neighbours.
void draw_surface(const View& view, const PointCloudView& cloud, Layer& layer) {
  const Vec3d light_W = normalized(Vec3d{-0.45, -0.6, -1});
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!std::isfinite(cloud.x[i])) continue;
    const Vec3d p{cloud.x[i], cloud.y[i], cloud.z[i]}, n{cloud.nx[i], cloud.ny[i], cloud.nz[i]};
    const ScreenPoint at = view.to_screen(p);
    if (!(at.pixels_per_metre > 0)) continue;
    if (!view.perspective && std::abs(at.depth) > view.slab) continue;
    const double spacing = cloud.pinhole ? p.z / cloud.intrinsics.fx : 0.002;
    const double slant = std::max(0.3, -dot(n, normalized(p)));
    const double half = std::max(0.8 * spacing / slant * at.pixels_per_metre, 1.0);
    const Vec3d n_view{dot(n, view.right), dot(n, view.down), dot(n, view.forward)};
    const double lit = std::max(0.0, dot(n, light_W));
    const Vec3d colour = kSurface * (0.34 + 0.66 * lit);
    for_square(view, at, half, [&](int x, int y, double dx, double dy) {
      // Depth of the disc at this pixel, from n . q = 0; discs seen edge-on shrink to a stroke.
      const double tilt = std::max(std::abs(n_view.z), 1e-3);
      const double dz = (n_view.x * dx + n_view.y * dy) / tilt;
      if (dx * dx + dy * dy + dz * dz > half * half && dx * dx + dy * dy > 1) return;
      layer.put(x, y, at.depth, colour);
    });
  }
}

/// Puts the layers together and averages the samples of each pixel.
std::vector<std::uint8_t> compose(const View& fine, const Layer& surface, const Layer& spheres) {
  const int width = fine.width / kOversampling, height = fine.height / kOversampling;
  std::vector<std::uint8_t> rgba;
  rgba.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 4);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      Vec3f sum;
      float covered = 0;
      for (int k = 0; k < kOversampling * kOversampling; ++k) {
        const int fx = x * kOversampling + k % kOversampling;
        const int fy = y * kOversampling + k / kOversampling;
        const std::size_t i = static_cast<std::size_t>(fy) * static_cast<std::size_t>(fine.width) +
                              static_cast<std::size_t>(fx);
        const Texel &veil = surface.texels()[i], &sphere = spheres.texels()[i];
        if (std::isinf(veil.depth) && std::isinf(sphere.depth)) continue;
        covered += 1;
        if (std::isinf(sphere.depth)) {
          sum += veil.colour;
        } else if (sphere.depth < veil.depth) {
          sum += sphere.colour;
        } else {
          sum += veil.colour * kVeil + sphere.colour * (1 - kVeil);
        }
      }
      for (int c = 0; c < 3; ++c) {
        // Five bits a channel: no visible loss, half the file.
        const float value = covered > 0 ? std::clamp(sum[c] / covered, 0.0f, 1.0f) : 0.0f;
        rgba.push_back(static_cast<std::uint8_t>(std::lround(value * 31) * 255 / 31));
      }
      rgba.push_back(
          static_cast<std::uint8_t>(std::lround(covered / (kOversampling * kOversampling) * 255)));
    }
  }
  return rgba;
}

View orthographic(const Vec3d& right, const Vec3d& down, const Vec3d& centre_W, double radius) {
  View view;
  view.right = right;
  view.down = down;
  view.forward = cross(right, down);
  view.centre_W = centre_W;
  view.scale = 0.31 * view.height / radius;
  view.slab = radius;
  return view;
}

}  // namespace

ScreenPoint View::to_screen(const Vec3d& p_W) const {
  if (perspective) {
    if (!(p_W.z > 1e-3)) return {};
    return {width * 0.5 + scale * (p_W.x / p_W.z - centre_W.x / centre_W.z),
            height * 0.5 + scale * (p_W.y / p_W.z - centre_W.y / centre_W.z), p_W.z, scale / p_W.z};
  }
  const Vec3d q = p_W - centre_W;
  return {width * 0.5 + scale * dot(right, q), height * 0.5 + scale * dot(down, q), dot(forward, q),
          scale};
}

View camera_view(const Vec3d& centre_W, double radius) {
  View view = orthographic({1, 0, 0}, {0, 1, 0}, centre_W, radius);
  view.perspective = true;
  view.scale = 0.25 * view.height / radius * centre_W.z;
  return view;
}

View birds_eye_view(const Vec3d& centre_W, double radius) {
  return orthographic({1, 0, 0}, {0, 0, -1}, centre_W, radius);
}

View side_view(const Vec3d& centre_W, double radius) {
  return orthographic({0, 0, 1}, {0, 1, 0}, centre_W, radius);
}

std::string draw_scene_png(const View& view, const PointCloudView& cloud,
                           std::span<const Sphere> spheres, std::span<const SphereState> states,
                           const Pose& X_WT) {
  View fine = view;
  fine.width *= kOversampling;
  fine.height *= kOversampling;
  fine.scale *= kOversampling;
  Layer surface(fine.width, fine.height), tool(fine.width, fine.height);
  draw_surface(fine, cloud, surface);
  draw_spheres(fine, spheres, states, X_WT, tool);
  return encode_png(compose(fine, surface, tool), view.width, view.height);
}

std::string encode_png(const std::vector<std::uint8_t>& rgba, int width, int height) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width);
  image.height = static_cast<png_uint_32>(height);
  image.format = PNG_FORMAT_RGBA;
  png_alloc_size_t size = 0;
  if (!png_image_write_to_memory(&image, nullptr, &size, 0, rgba.data(), 0, nullptr)) return {};
  std::string bytes(size, '\0');
  if (!png_image_write_to_memory(&image, bytes.data(), &size, 0, rgba.data(), 0, nullptr))
    return {};
  bytes.resize(size);
  return bytes;
}

}  // namespace palpate
