// Depth fields where nothing was measured: in holes, and beyond the image.
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/field/depth_field.h"
#include "palpate/math/geometry.h"
#include "src/cloud/internal/tangent_plane.h"
#include "src/field/internal/field_point.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

struct Pixel {
  double offset = 0, slope = 0;

  bool is_surface() const { return slope > 0; }
  double depth() const { return offset / slope; }
  bool operator==(const Pixel&) const = default;
};

/// An image of planes, in double; a hole is a pixel without slope.
struct Image {
  int width, height;
  Intrinsics camera;
  std::vector<Pixel> pixels;

  Image(int wide, int high)
      : width(wide),
        height(high),
        camera{500, 510, 0.5 * wide - 0.5, 0.5 * high - 0.5},
        pixels(static_cast<std::size_t>(wide * high)) {}

  Pixel& at(int u, int v) { return pixels[static_cast<std::size_t>(v * width + u)]; }
  const Pixel& at(int u, int v) const { return pixels[static_cast<std::size_t>(v * width + u)]; }
  Vec3d ray(double u, double v) const {
    return {(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1};
  }
  /// The plane n . x = -offset, as a pixel sees it.
  Pixel seen(const Vec3d& n, double offset, int u, int v) const {
    return {static_cast<float>(offset), static_cast<float>(-dot(n, ray(u, v)))};
  }
  Pixel frontal(double depth, int u, int v) const { return seen({0, 0, -1}, depth, u, v); }

  DepthField field(const DepthFieldOptions& options = {}) const {
    std::vector<TangentPlane> given;
    for (const Pixel& p : pixels) {
      if (p.is_surface()) {
        given.push_back({static_cast<float>(p.offset), static_cast<float>(p.slope)});
      } else {
        given.push_back({});
      }
    }
    ThreadPool pool(2);
    DepthField made = std::move(DepthField::create(width, height, options)).value();
    made.update(given.data(), camera, pool);
    return made;
  }
};

Pixel shown(const DepthField& field, int u, int v) {
  const DepthFieldLevel& level = field.view().levels[0];
  const float* const plane = level.planes + 2 * (std::ptrdiff_t{v} * level.stride + u);
  return {plane[0], plane[1]};
}
bool is_filled_behind(const DepthField& field, int u, int v) {
  const DepthFieldView& view = field.view();
  return (view.filled_behind[v * view.filled_stride + u / 32] >> u % 32 & 1) != 0;
}

// The shadow that a projector leaves beside what is near, of any width and at any place: all of it
// shows what is far, along rows and along columns, whichever side is near.
TEST(FieldGaps, NothingNearGoesOnBeyondItsEdge) {
  for (const auto& [near, far] : {std::pair{1.0, 2.0}, {0.55, 1.1}, {0.7, 0.9}}) {
    for (int width = 1; width <= 64; width += width < 4 ? 1 : 5) {
      for (int begin = 96; begin < 128; ++begin) {
        for (const bool is_column : {false, true}) {
          const bool near_is_first = begin % 2 == 0;
          Image image(is_column ? 24 : 256, is_column ? 256 : 24);
          for (int v = 0; v < image.height; ++v) {
            for (int u = 0; u < image.width; ++u) {
              const int at = is_column ? v : u;
              if (at >= begin && at < begin + width) continue;
              image.at(u, v) = image.frontal((at < begin) == near_is_first ? near : far, u, v);
            }
          }
          const DepthField field = image.field();
          int num_wrong = 0, num_unmarked = 0;
          for (int i = begin; i < begin + width; ++i) {
            for (int beside = 0; beside < 24; ++beside) {
              const int u = is_column ? beside : i, v = is_column ? i : beside;
              num_wrong += std::abs(shown(field, u, v).depth() - far) > 1e-6;
              num_unmarked += !is_filled_behind(field, u, v);
            }
          }
          EXPECT_EQ(num_wrong, 0) << width << " from " << begin << (is_column ? " down" : "");
          EXPECT_EQ(num_unmarked, 0);
        }
      }
    }
  }
}

/// The ruling about a pixel of a hole, in double, with the end whose surface goes on, and
/// what kind of a pixel it is.
enum class Kind { unsure, by_row, by_column, silent };
struct Ruling {
  Kind kind = Kind::silent;
  Pixel filling;
};
Ruling ruling(const Image& image, int u, int v, bool is_column) {
  const int size = is_column ? image.height : image.width, at = is_column ? v : u;
  const auto pixel = [&](int i) { return is_column ? image.at(u, i) : image.at(i, v); };
  int first = at, last = at;
  while (first >= 0 && !pixel(first).is_surface()) --first;
  while (last < size && !pixel(last).is_surface()) ++last;
  if (first < 0 || last == size || last - first - 1 > 64) return {};
  Pixel near = pixel(first), far = pixel(last);
  if (near.depth() > far.depth()) std::swap(near, far);
  // Could a smooth surface at the slant of both join them, or one at 45 degrees?
  const double focal = is_column ? image.camera.fy : image.camera.fx;
  const double span = (last - first) / focal * near.depth();
  const double gap = far.offset - near.depth() * far.slope;
  const double least = std::min(near.slope, far.slope);
  const double most = span * (1 + std::sqrt(std::max(1 - least * least, 0.0)));
  if (std::abs(gap - most) < 1e-5 * span) return {Kind::unsure, {}};
  if (gap > most) return {is_column ? Kind::by_column : Kind::by_row, far};
  return {};
}

// Against brute force: slanted pieces in front of each other, holes of all sizes, through edges and
// at the border of the image. What the rule is silent about is filled as before.
TEST(FieldGaps, AreFilledByTheRuleOrAsBefore) {
  test::Random random(7);
  int num[4] = {};
  for (int turn = 0; turn < 12; ++turn) {
    Image image(210, 170);
    const auto fill = [&](int left, int top, int right, int bottom, const auto& pixel) {
      for (int v = std::max(top, 0); v < std::min(bottom, image.height); ++v) {
        for (int u = std::max(left, 0); u < std::min(right, image.width); ++u) {
          image.at(u, v) = pixel(u, v);
        }
      }
    };
    const auto box = [&](double largest, const auto& pixel) {
      const int u = static_cast<int>(random.uniform(-20, 200));
      const int v = static_cast<int>(random.uniform(-20, 160));
      fill(u, v, u + 1 + static_cast<int>(random.uniform(0, largest)),
           v + 1 + static_cast<int>(random.uniform(0, largest)), pixel);
    };
    for (int i = 0; i < 9; ++i) {
      const double lean = i % 3 == 0 ? 0.1 : 1.2;
      const Vec3d n =
          normalized(Vec3d{lean * random.uniform(-1, 1), lean * random.uniform(-1, 1), -1});
      const double offset = random.uniform(0.5, 1.5);
      const auto piece = [&](int u, int v) { return image.seen(n, offset, u, v); };
      i == 0 ? fill(0, 0, image.width, image.height, piece) : box(130, piece);
    }
    for (int i = 0; i < 14; ++i) box(i < 7 ? 20 : 90, [](int, int) { return Pixel{}; });
    for (Pixel& p : image.pixels) {
      if (random.uniform() < 0.01) p = {};
    }
    // Pieces that face away from the camera are none.
    for (Pixel& p : image.pixels) {
      if (p.slope < 0.02) p = {};
    }
    const DepthField field = image.field({.fill_levels = 1 + turn % 5});
    const DepthField before =
        image.field({.unknown = UnknownSpace::blocked, .fill_levels = 1 + turn % 5});
    Image by_rows = image;
    for (int v = 0; v < image.height; ++v) {
      for (int u = 0; u < image.width; ++u) {
        if (image.at(u, v).is_surface()) continue;
        const Ruling row = ruling(image, u, v, false);
        if (row.kind == Kind::unsure) ++num[0];
        if (row.kind == Kind::by_row) by_rows.at(u, v) = row.filling;
      }
    }
    int num_wrong = 0;
    for (int v = 0; v < image.height; ++v) {
      for (int u = 0; u < image.width; ++u) {
        const Pixel got = shown(field, u, v), was = shown(before, u, v);
        if (image.at(u, v).is_surface()) {
          num_wrong += got != image.at(u, v) || is_filled_behind(field, u, v);
          continue;
        }
        // Columns go by what rows have filled.
        Ruling want = ruling(image, u, v, false);
        if (want.kind == Kind::silent) want = ruling(by_rows, u, v, true);
        ++num[static_cast<int>(want.kind)];
        if (want.kind == Kind::unsure) continue;
        num_wrong += is_filled_behind(field, u, v) != (want.kind != Kind::silent);
        if (want.kind != Kind::silent) {
          num_wrong += got != want.filling;
        } else {
          const bool is_blocked = was.slope == 1 && std::abs(was.offset - 0.02) < 1e-6;
          num_wrong += is_blocked ? got.is_surface() : got != was;
        }
      }
    }
    EXPECT_EQ(num_wrong, 0) << turn;
  }
  EXPECT_EQ(num[0], 0);
  for (int kind = 1; kind < 4; ++kind) EXPECT_GT(num[kind], 3000) << kind;
}

// The ends of a wide hole in one slanted surface differ in depth, and are one surface all the same.
TEST(FieldGaps, OneSlantedSurfaceIsNotTwo) {
  test::Random random(8);
  for (int i = 0; i < 400; ++i) {
    Image image(128, 64);
    const double slant = random.uniform(0, 75) * kPi / 180, turn = random.uniform(0, 2 * kPi);
    const Vec3d n{std::sin(slant) * std::cos(turn), std::sin(slant) * std::sin(turn),
                  -std::cos(slant)};
    const int left = static_cast<int>(random.uniform(4, 50)), right = left + 1 + i % 64;
    for (int v = 0; v < 64; ++v) {
      for (int u = 0; u < 128; ++u) {
        // Normals err by several degrees, as measured ones do.
        const Vec3d estimated = normalized(n + 0.1 * random.direction());
        const Vec3d p = image.ray(u, v) * (-0.6 / dot(n, image.ray(u, v)));
        if (u < left || u >= right || v < 3 || v > 60) {
          image.at(u, v) = image.seen(estimated, -dot(estimated, p), u, v);
        }
        ASSERT_GT(p.z, 0);
      }
    }
    const DepthField field = image.field();
    int num = 0;
    for (int v = 0; v < 64; ++v) {
      for (int u = 0; u < 128; ++u) num += is_filled_behind(field, u, v);
    }
    EXPECT_EQ(num, 0) << slant << " " << right - left;
  }
}

// Nothing is filled if nobody asked for it, and what blocks is not taken to be free.
TEST(FieldGaps, StayWhereNothingIsToBeFilled) {
  Image image(64, 32);
  for (int v = 0; v < 32; ++v) {
    for (int u = 0; u < 64; ++u) {
      if (u < 20 || u >= 44) image.at(u, v) = image.frontal(u < 20 ? 1 : 2, u, v);
    }
  }
  for (const DepthFieldOptions& options :
       {DepthFieldOptions{.fill_levels = 0},
        DepthFieldOptions{.unknown = UnknownSpace::blocked, .fill_levels = 2}}) {
    const DepthField field = image.field(options);
    for (int u = 20; u < 44; ++u) EXPECT_FALSE(is_filled_behind(field, u, 16));
    EXPECT_EQ(shown(field, 32, 16).is_surface(), options.unknown == UnknownSpace::blocked);
  }
}

/// An endless plane in the image: what a sphere that is seen at `distance` pixels of its own level
/// from a border, within the image if positive, learns of it.
struct BorderErrors {
  double degrees = 0, meters = 0;  ///< the worst
  int num = 0;
};
BorderErrors errors_near_border(const DepthFieldOptions& options, double first, double last) {
  test::Random random(9);
  BorderErrors worst;
  for (int turn = 0; turn < 40; ++turn) {
    Image image(320, 256);  // halves evenly down to the widest level
    const double slant = random.uniform(0, 50) * kPi / 180, around = random.uniform(0, 2 * kPi);
    const Vec3d n{std::sin(slant) * std::cos(around), std::sin(slant) * std::sin(around),
                  -std::cos(slant)};
    for (int v = 0; v < image.height; ++v) {
      for (int u = 0; u < image.width; ++u) image.at(u, v) = image.seen(n, 0.7, u, v);
    }
    const DepthField field = image.field(options);
    for (int i = 0; i < 400; ++i) {
      const double radius = 0.001 * std::pow(30.0, random.uniform());
      const bool at_corner = i % 4 == 0;
      // Somewhere at the left or right border, by turns the upper or lower one, or at both.
      double u = random.uniform(60, 260), v = random.uniform(60, 200);
      const double depth = radius * random.uniform(-0.9, 3);  // of the center, behind the plane
      const double pixel = std::max(0.7 * radius * image.camera.fx / 0.9, 1.0);
      const auto place = [&](double size) {
        const double in = pixel * random.uniform(first, last) - 0.5;
        return random.uniform() < 0.5 ? in : size - 1 - in;
      };
      if (at_corner || i % 2 == 1) u = place(image.width);
      if (at_corner || i % 2 == 0) v = place(image.height);
      const Vec3d ray = image.ray(u, v);
      const Vec3d p = ray * ((-0.7 - depth) / dot(n, ray));
      if (p.z < 0.3 || p.z > 3) continue;
      const FieldSample<double> at = sample_field(field.view(), p, radius);
      if (at.phi > 0.95 * radius) {
        worst.meters = std::max(worst.meters, std::abs(at.phi + depth));
        continue;
      }
      const double angle = std::atan2(norm(cross(at.gradient, n)), dot(at.gradient, n));
      worst.degrees = std::max(worst.degrees, angle * 180 / kPi);
      // The maximum over levels is rounded where it is deep.
      worst.meters = std::max(worst.meters, std::abs(at.phi + depth) - 0.02 * std::abs(depth));
      ++worst.num;
    }
  }
  return worst;
}

// The image's border is no edge: a sphere beside it, or a pixel of its own level beyond it, is
// pushed out of the plane that goes on there.
TEST(FieldGaps, ThePlaneGoesOnBeyondTheImage) {
  const BorderErrors inside = errors_near_border({}, 0, 12),
                     outside = errors_near_border({}, -0.5, 0);
  EXPECT_GT(inside.num, 5000);
  EXPECT_GT(outside.num, 5000);
  EXPECT_LT(inside.degrees, 0.5);
  EXPECT_LT(outside.degrees, 0.5);
  EXPECT_LT(inside.meters, 2e-4);
  EXPECT_LT(outside.meters, 2e-4);
}

// Farther out space that nothing was measured in is free.
TEST(FieldGaps, TheWorldEndsBeyondAFootprint) {
  Image image(320, 256);
  for (int v = 0; v < image.height; ++v) {
    for (int u = 0; u < image.width; ++u) image.at(u, v) = image.frontal(0.8, u, v);
  }
  const DepthField field = image.field();
  for (const double radius : {0.001, 0.005, 0.02}) {
    const double pixel = std::max(0.7 * radius * image.camera.fx / 0.8, 1.0);
    const Vec3d p = image.ray(-14 * pixel, 100) * 0.805;
    EXPECT_GE(sample_field(field.view(), p, radius).phi, radius) << radius;
  }
}

}  // namespace
}  // namespace palpate
