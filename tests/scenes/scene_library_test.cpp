#include <gtest/gtest.h>

#include <map>

#include "palpate/mesh/mesh.h"
#include "scenes/body_shapes.h"
#include "scenes/depth_renderer.h"
#include "scenes/scene.h"
#include "scenes/truth.h"
#include "tests/scenes/column_quadrature.h"
#include "tests/test_util/random.h"

namespace palpate {
inline namespace v0 {
namespace scenes {
namespace {

/// Each edge occurs once in each direction, and the volume is positive.
void expect_closed(const TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  double volume = 0;
  for (const auto& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      ASSERT_LT(t[i], mesh.vertices.size());
      ++edges[{t[i], t[(i + 1) % 3]}];
    }
    volume += dot(mesh.vertices[t[0]], cross(mesh.vertices[t[1]], mesh.vertices[t[2]])) / 6;
  }
  EXPECT_GT(volume, 0);
  for (const auto& [edge, count] : edges) {
    ASSERT_EQ(count, 1);
    ASSERT_TRUE(edges.contains({edge.second, edge.first}));
  }
}

std::size_t pixel(const Scene& scene, int u, int v) {
  return static_cast<std::size_t>(v) * static_cast<std::size_t>(scene.width) +
         static_cast<std::size_t>(u);
}

/// Points evenly spread through a closed mesh.
std::vector<Vec3d> fill(const TriangleMesh& mesh, int n) {
  const Bounds box = bounds(mesh);
  const Vec3d step = (box.high - box.low) / n;
  std::vector<Vec3d> points;
  for (int i = 0; i < n * n; ++i) {
    const double x = box.low.x + (i % n + 0.5) * step.x, y = box.low.y + (i / n + 0.4999) * step.y;
    for (const auto& [low, high] : test::inside_spans(mesh, x, y)) {
      for (double z = low + step.z / 2; z < high; z += step.z) points.push_back({x, y, z});
    }
  }
  return points;
}

/// Share of the points behind the depth image.
double share_behind(const Scene& scene, std::span<const float> depth,
                    const std::vector<Vec3d>& points_T, const Pose& X_WT) {
  int behind = 0;
  for (const Vec3d& p_T : points_T) {
    const Vec3d p = X_WT * p_T;
    const int u =
        static_cast<int>(std::lround(scene.intrinsics.cx + scene.intrinsics.fx * p.x / p.z));
    const int v =
        static_cast<int>(std::lround(scene.intrinsics.cy + scene.intrinsics.fy * p.y / p.z));
    if (u < 0 || v < 0 || u >= scene.width || v >= scene.height) continue;
    behind += p.z > static_cast<double>(depth[pixel(scene, u, v)]);
  }
  return behind / static_cast<double>(points_T.size());
}

class EveryScene : public testing::TestWithParam<std::string> {
 protected:
  Scene scene_ = make_scene(GetParam()).value();
};

class SyntheticScene : public EveryScene {};

TEST_P(EveryScene, IsComplete) {
  EXPECT_EQ(scene_.name, GetParam());
  EXPECT_FALSE(scene_.title.empty());
  EXPECT_TRUE(scene_.environment || !scene_.bodies.empty());
  EXPECT_EQ(scene_.environment.has_value(), environment_of(GetParam()).has_value());
  for (const Body& body : scene_.bodies) {
    SCOPED_TRACE(body.name);
    expect_closed(body.mesh);
    if (body.motion) {
      EXPECT_EQ(body.motion(0), body.X_WB);
    }
  }
  EXPECT_TRUE(make_shape(scene_.tool_shape, scene_.tool_size));
}

TEST_P(EveryScene, PathIsUsable) {
  ASSERT_GE(scene_.path_times.size(), 2u);
  ASSERT_EQ(scene_.path_times.size(), scene_.path_poses.size());
  EXPECT_EQ(scene_.path_times.front(), 0);
  EXPECT_DOUBLE_EQ(scene_.path_times.back(), scene_.duration);
  for (std::size_t i = 0; i < scene_.path_times.size(); ++i) {
    const Quaternion& q = scene_.path_poses[i].rotation;
    EXPECT_NEAR(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w, 1, 1e-12);
    if (i == 0) continue;
    const double dt = scene_.path_times[i] - scene_.path_times[i - 1];
    ASSERT_GT(dt, 0);
    const double way =
        norm(scene_.path_poses[i].translation - scene_.path_poses[i - 1].translation);
    EXPECT_LT(way / dt, 0.5) << "m/s at " << scene_.path_times[i];
  }
}

// The thesis' scenes go to full depth in a line; the others press 5 to 35 % of the tool in.
TEST_P(EveryScene, PathStartsFreeAndTouches) {
  const std::vector<Vec3d> points = fill(*make_shape(scene_.tool_shape, scene_.tool_size), 40);
  ASSERT_GT(points.size(), 1000u);
  DepthRenderer renderer(scene_);
  const double full = scene_.environment ? 0.3 : 0.05;
  double deepest = 0;
  for (int i = 0; i <= 40; ++i) {
    const double t = scene_.duration * i / 40;
    std::size_t k = 0;
    while (k + 2 < scene_.path_times.size() && scene_.path_times[k + 1] <= t) ++k;
    const double share =
        (t - scene_.path_times[k]) / (scene_.path_times[k + 1] - scene_.path_times[k]);
    const Pose X_WT = interpolate(scene_.path_poses[k], scene_.path_poses[k + 1], share);
    const double behind = share_behind(scene_, renderer.render(t), points, X_WT);
    if (i == 0) {
      EXPECT_EQ(behind, 0);
    }
    if (i == 40 && !scene_.environment) {
      EXPECT_EQ(behind, 0);
    }
    deepest = std::max(deepest, behind);
  }
  EXPECT_GT(deepest, full);
  if (!scene_.environment) {
    EXPECT_LT(deepest, 0.35);
  }
}

TEST_P(EveryScene, FillsTheImageAndMovesSmoothly) {
  DepthRenderer renderer(scene_);
  const std::span<const float> now = renderer.render(1.0);
  int seen = 0;
  for (float z : now) seen += z > 0;
  EXPECT_GT(seen, 0.55 * static_cast<double>(now.size()));
  const std::vector<float> first(now.begin(), now.end());
  const std::span<const float> next = renderer.render(1.0 + 1 / scene_.rate);
  int changed = 0;
  for (std::size_t i = 0; i < first.size(); ++i) changed += first[i] != next[i] && first[i] > 0;
  const bool moves = std::any_of(scene_.bodies.begin(), scene_.bodies.end(),
                                 [](const Body& body) { return body.motion != nullptr; });
  EXPECT_EQ(changed > 0, moves);
}

// The synthetic scenes against rays written out by hand.
TEST_P(SyntheticScene, DepthIsExact) {
  const Environment& e = *scene_.environment;
  const std::vector<float> depth = render_depth(scene_, 0);
  for (int v = 3; v < scene_.height; v += 7) {
    for (int u = 2; u < scene_.width; u += 5) {
      const double x = (u - 319.5) / 575.8157, y = (v - 239.5) / 575.8157;
      const std::string& name = GetParam();
      double expected = 1;
      if (name.starts_with("sphere")) {
        const double radius = std::stod(name.substr(name.size() - 3)) / 575.8157;
        const bool out = name[7] == 'o';
        const double c = out ? 1 + radius : 1 - radius, q = 1 + x * x + y * y;
        const double root = c * c - q * (c * c - radius * radius);
        expected =
            root < 0 ? (out ? 3.0 : std::nan("")) : (c + (out ? -1 : 1) * std::sqrt(root)) / q;
        if (std::abs(root) < 1e-9) continue;
      } else if (name != "wall") {
        // z = 1 +- |x z| / tan(half the opening of the solid), seen along x z.
        const double opening = std::stod(name.substr(name.find('-') + 1)) / 180 * kPi;
        expected = 1 / (1 - std::abs(x) / std::tan(opening / 2));
      }
      const double z = static_cast<double>(depth[pixel(scene_, u, v)]);
      if (std::isnan(expected)) {
        EXPECT_TRUE(std::isnan(z));
        continue;
      }
      ASSERT_NEAR(z, expected, 3e-7) << u << " " << v;
      if (z < 2.9) {
        EXPECT_NEAR(signed_distance(e, {x * z, y * z, z}).distance, 0, 3e-7);
      }
    }
  }
}

std::string test_name(const testing::TestParamInfo<std::string>& name) {
  std::string id = name.param;
  std::replace(id.begin(), id.end(), '-', '_');
  return id;
}
INSTANTIATE_TEST_SUITE_P(Scenes, EveryScene, testing::ValuesIn(scene_names()), test_name);
INSTANTIATE_TEST_SUITE_P(Scenes, SyntheticScene, testing::ValuesIn(environment_names()), test_name);

TEST(SceneLibrary, UnknownNameListsTheKnownOnes) {
  const auto scene = make_scene("nowhere");
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, Errc::not_found);
  for (const std::string& name : scene_names()) {
    EXPECT_NE(scene.error().message.find(name), std::string::npos);
  }
}

// Triangles against a closed form: a turned and shifted box, whose front is a plane.
TEST(RenderDepth, MovingBodyStaysExact) {
  Scene scene;
  const auto motion = [](double t) {
    return Pose{{0.1 * t, 0, 1}, axis_angle({0, 1, 0}, 0.3 * t)};
  };
  scene.bodies.push_back({"plate", block({-0.2, -0.2, 0}, {0.2, 0.2, 0.1}), motion, {}});
  const std::vector<float> depth = render_depth(scene, 1);
  const Pose X_WB = motion(1);
  const Vec3d n = rotate(X_WB.rotation, {0, 0, 1});
  int checked = 0;
  for (int v = 0; v < scene.height; v += 3) {
    for (int u = 0; u < scene.width; u += 3) {
      const Vec3d ray{(u - 319.5) / 575.8157, (v - 239.5) / 575.8157, 1};
      const double z = dot(n, X_WB.translation) / dot(n, ray);
      const Vec3d p_B = inverse(X_WB) * (ray * z);
      if (std::abs(p_B.x) < 0.199 && std::abs(p_B.y) < 0.199) {
        ASSERT_NEAR(static_cast<double>(depth[pixel(scene, u, v)]), z, 1e-7);
        ++checked;
      }
    }
  }
  EXPECT_GT(checked, 4000);
}

// A single part is not blended with anything: its surface is known.
TEST(BodyShapes, OnePartHasItsExactSurface) {
  const BallChain cone{{{0.1, 0, 0}, 0.05}, {{0.1, 0.2, 0.1}, 0.02}};
  const TriangleMesh mesh = blended({&cone, 1}, {}, 0.01, 0.004);
  expect_closed(mesh);
  for (const Vec3d& p : mesh.vertices) {
    double nearest = 1;  // over the balls whose hull it is
    for (int i = 0; i <= 1000; ++i) {
      const double s = i / 1000.0;
      nearest = std::min(nearest, norm(p - Vec3d{0.1, 0.2 * s, 0.1 * s}) - (0.05 - 0.03 * s));
    }
    ASSERT_NEAR(nearest, 0, 4e-4);  // chords of 7 mm over a radius of 20 mm
  }
  const Ellipsoid egg{{1, 2, 3}, {0.1, 0.2, 0.3}};
  const TriangleMesh shell = blended({}, {&egg, 1}, 0.01, 0.005);
  expect_closed(shell);
  for (const Vec3d& p : shell.vertices) {
    ASSERT_NEAR(norm(Vec3d{(p.x - 1) / 0.1, (p.y - 2) / 0.2, (p.z - 3) / 0.3}), 1, 1e-3);
  }
}

// Two overlapping balls keep their far sides and gain material in the crease.
TEST(BodyShapes, BlendFillsTheCrease) {
  const Ellipsoid balls[] = {{{-0.04, 0, 0}, {0.05, 0.05, 0.05}},
                             {{0.04, 0, 0}, {0.05, 0.05, 0.05}}};
  const TriangleMesh mesh = blended({}, balls, 0.02, 0.004);
  expect_closed(mesh);
  double waist = 0, end = 0;
  for (const Vec3d& p : mesh.vertices) {
    if (std::abs(p.x) < 0.003) waist = std::max(waist, std::hypot(p.y, p.z));
    end = std::max(end, p.x);
  }
  EXPECT_NEAR(end, 0.09, 2e-4);
  EXPECT_GT(waist, 0.03 + 0.004);
  EXPECT_LT(waist, 0.05);
}

}  // namespace
}  // namespace scenes
}  // namespace v0
}  // namespace palpate
