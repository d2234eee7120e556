// The distance field of a solid against closed forms and brute force over all triangles.
#include "palpate/packing/packing.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "src/packing/solid/triangle_bvh.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

SolidField field_of(const TriangleMesh& mesh, int num_threads = 2) {
  ThreadPool pool(num_threads);
  return SolidField::of(mesh, pool);
}

/// Calls visit(value, its place) for every node of a level.
template <class Visit>
void for_each_node(const SolidField& field, int level, const Visit& visit) {
  const SolidField::Level& grid = field.levels()[static_cast<std::size_t>(level)];
  const auto [nx, ny, nz] = grid.num_nodes;
  const std::span<const float> values = field.values(level);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const int node = static_cast<int>(i);
    const Vec3d ijk{static_cast<double>(node % nx - SolidField::kMargin),
                    static_cast<double>(node / nx % ny - SolidField::kMargin),
                    static_cast<double>(node / nx / ny - SolidField::kMargin)};
    visit(static_cast<double>(values[i]), field.layout().origin + grid.spacing * ijk);
  }
}

double distance_to_box(const Vec3d& p, const Vec3d& half) {
  Vec3d outside;
  double inside = -1e300;
  for (int axis = 0; axis < 3; ++axis) {
    const double off = std::abs(p[axis]) - half[axis];
    outside[axis] = std::max(off, 0.0);
    inside = std::max(inside, off);
  }
  return inside < 0 ? inside : norm(outside);
}

TEST(SolidField, IsTheDistanceToABox) {
  const Vec3d size{0.1, 0.06, 0.03};
  const SolidField field = field_of(make_box(size));
  ASSERT_GE(field.levels().size(), 4u);
  std::size_t finest = 1;
  for (const std::int32_t n : field.levels()[0].num_nodes) {
    finest *= static_cast<std::size_t>(n);
  }
  EXPECT_LE(finest, SolidField::kMaxNodes);
  EXPECT_GT(finest, SolidField::kMaxNodes * 9 / 10) << "as fine as the bound allows";
  for (int level = 0; level < static_cast<int>(field.levels().size()); ++level) {
    int num_inside = 0;
    Vec3d low{1, 1, 1}, high{-1, -1, -1};
    for_each_node(field, level, [&](double value, const Vec3d& p) {
      ASSERT_NEAR(value, distance_to_box(p, size * 0.5), 2e-8) << p.x << " " << p.y << " " << p.z;
      num_inside += value < 0;
      for (int axis = 0; axis < 3; ++axis) {
        low[axis] = std::min(low[axis], p[axis]);
        high[axis] = std::max(high[axis], p[axis]);
      }
    });
    EXPECT_GT(num_inside, 0) << level;
    const double margin =
        (SolidField::kMargin - 1e-6) * field.levels()[static_cast<std::size_t>(level)].spacing;
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_LE(low[axis], -size[axis] / 2 - margin);
      EXPECT_GE(high[axis], size[axis] / 2 + margin);
    }
  }
}

/// The solid angle that a triangle covers, over 4 pi (van Oosterom and Strackee).
double winding(const Triangle& t, const Vec3d& p) {
  const Vec3d a = t.a - p, b = t.b - p, c = t.c - p;
  const double la = norm(a), lb = norm(b), lc = norm(c);
  return std::atan2(dot(a, cross(b, c)),
                    la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb) /
         (2 * kPi);
}

/// A hole through it, a cavity in it, thin tips.
std::vector<TriangleMesh> solids() {
  TriangleMesh hollow = make_box({0.1, 0.1, 0.1});
  const TriangleMesh cavity = make_box({0.06, 0.05, 0.04});
  const auto first = static_cast<std::uint32_t>(hollow.vertices.size());
  for (const Vec3d& v : cavity.vertices) hollow.vertices.push_back(v + Vec3d{0.01, 0, 0});
  for (const auto& [a, b, c] : cavity.triangles) {
    hollow.triangles.push_back({first + a, first + c, first + b});
  }
  return {make_torus(0.07, 0.02, 24, 12), hollow, make_shape("tetrahedron", 0.1).value()};
}

TEST(SolidField, EqualsBruteForceWithTheSignOfTheWindingNumber) {
  for (const TriangleMesh& mesh : solids()) {
    const SolidField field = field_of(mesh);
    test::Random random(3);
    int num_inside = 0, num = 0;
    for (int level = 0; level < 2; ++level) {
      for_each_node(field, level, [&](double value, const Vec3d& p) {
        // Near the surface more are looked at.
        if (random.uniform() > (std::abs(value) < 0.005 ? 0.02 : 0.002)) return;
        double distance = 1e300, turns = 0;
        for (const auto& [a, b, c] : mesh.triangles) {
          const Triangle triangle{mesh.vertices[a], mesh.vertices[b], mesh.vertices[c]};
          distance = std::min(distance, norm(p - closest_point(triangle, p)));
          turns += winding(triangle, p);
        }
        ++num;
        num_inside += value < 0;
        ASSERT_NEAR(std::abs(value), distance, 1.1e-4 * distance + 1e-8);
        if (distance > 1e-7) {
          ASSERT_EQ(value<0, turns> 0.5) << turns;
        }
      });
    }
    EXPECT_GT(num, 1000);
    EXPECT_GT(num_inside, 100);
  }
}

TEST(SolidField, SameBitsForAnyNumberOfThreads) {
  const TriangleMesh mesh = make_torus(0.07, 0.03, 12, 8);
  EXPECT_TRUE(field_of(mesh, 1) == field_of(mesh, 4));
}

TEST(SolidField, PlatesAndNeedlesStayWithinTheBound) {
  for (const Vec3d& size : {Vec3d{1, 1, 0.001}, Vec3d{1, 0.001, 0.001}, Vec3d{1e-3, 1, 0.02}}) {
    const SolidField field = field_of(make_box(size));
    EXPECT_LE(field.levels().size(), static_cast<std::size_t>(SolidField::kMaxLevels));
    std::size_t num = 1;
    for (const std::int32_t n : field.levels()[0].num_nodes) num *= static_cast<std::size_t>(n);
    EXPECT_LE(num, SolidField::kMaxNodes);
    EXPECT_LT(field.num_bytes(), SolidField::kMaxNodes * sizeof(float) * 3 / 2);
  }
}

TEST(SolidField, IsRestoredFromItsParts) {
  const SolidField field = field_of(make_box({0.1, 0.05, 0.05}));
  std::vector<float> values(field.values().begin(), field.values().end());
  const auto same = SolidField::restore(field.layout(), values);
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_TRUE(*same == field);

  const auto expect_error = [](const Result<SolidField>& result, const char* words) {
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, Errc::bad_input);
    EXPECT_NE(result.error().message.find(words), std::string::npos) << result.error().message;
  };
  for (const double bad : {0.0, -1.0, std::nan(""), 1e308 * 10}) {
    SolidField::Layout layout = field.layout();
    layout.spacing = bad;
    expect_error(SolidField::restore(layout, values), "no grid");
  }
  for (const std::int32_t bad : {0, -5, 513, std::numeric_limits<std::int32_t>::max()}) {
    SolidField::Layout layout = field.layout();
    layout.num_cells[1] = bad;
    expect_error(SolidField::restore(layout, values), "no grid");
  }
  expect_error(SolidField::restore(field.layout(), std::span(values).subspan(1)), "of its grid");
  for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity(), -10.0f}) {
    std::vector<float> wrong = values;
    wrong[values.size() / 2] = bad;
    expect_error(SolidField::restore(field.layout(), wrong), "not a distance");
  }
}

}  // namespace
}  // namespace palpate
