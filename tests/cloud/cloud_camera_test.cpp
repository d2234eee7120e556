// Clouds as depth images: against the image that they were made of, and against planes and balls.
#include "src/cloud/internal/cloud_camera.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "src/cloud/internal/frame_limits.h"

namespace palpate {
namespace {

constexpr int kWidth = 80, kHeight = 60;
constexpr Intrinsics kIntrinsics{70.25, 71.5, 39.5, 29.75};
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// A slanted wall with a box in front of it and a hole, in millimeters.
DepthFrame image() {
  DepthFrame frame{kWidth, kHeight, 0.001, {}, 0};
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const bool is_box = u > 20 && u < 45 && v > 15 && v<40, is_hole = u> 60 && v < 9;
      frame.pixels.push_back(static_cast<std::uint16_t>(is_hole ? 0 : is_box ? 700 : 1000 + 3 * u));
    }
  }
  return frame;
}

/// Points of an image, organized like it.
CloudPoints points_of(const DepthFrame& frame, const Intrinsics& k = kIntrinsics) {
  CloudPoints cloud{frame.width, frame.height, {}, {}};
  for (int v = 0; v < frame.height; ++v) {
    for (int u = 0; u < frame.width; ++u) {
      const double z = frame.unit * frame.pixels[static_cast<std::size_t>(v * frame.width + u)];
      const Vec3f p = to_float({(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z});
      cloud.points.push_back(z > 0 ? p : Vec3f{kNan, kNan, kNan});
    }
  }
  return cloud;
}

/// The measured points in any order.
CloudPoints shuffled(CloudPoints cloud) {
  std::erase_if(cloud.points, [](const Vec3f& p) { return !is_measured(p); });
  std::mt19937 random(5);
  std::shuffle(cloud.points.begin(), cloud.points.end(), random);
  cloud.width = static_cast<int>(cloud.points.size());
  cloud.height = 1;
  return cloud;
}

TEST(CloudCamera, AnOrganizedCloudIsItsImageToTheBit) {
  const DepthFrame expected = image();
  for (const Intrinsics& k : {kIntrinsics, Intrinsics{61.2345, 60, 40, 30.5},
                              Intrinsics{61.234568, 60.000123, 39.5, 29.512345},
                              Intrinsics{61.2345676f, 61.7654321f, 39.4321098f, 29.8765432f}}) {
    const CloudPoints cloud = points_of(expected, k);
    auto camera = CloudCamera::create(cloud.view(), {});
    ASSERT_TRUE(camera) << camera.error().message;
    EXPECT_EQ(camera->model().intrinsics, k);
    EXPECT_EQ(camera->unit(), 0.001);
    EXPECT_EQ(camera->X_FC(), Pose{});
    DepthFrame frame;
    EXPECT_TRUE(camera->take(cloud.view(), frame).is_image);
    EXPECT_EQ(frame.width, kWidth);
    EXPECT_EQ(frame.pixels, expected.pixels);
  }
}

TEST(CloudCamera, ByTheSameCameraPointsInAnyOrderAreTheSameImage) {
  const DepthFrame expected = image();
  const CloudPoints cloud = shuffled(points_of(expected));
  auto camera = CloudCamera::create(
      cloud.view(), {.intrinsics = kIntrinsics, .width = kWidth, .height = kHeight, .unit = 0.001});
  ASSERT_TRUE(camera) << camera.error().message;
  DepthFrame frame;
  const CloudShares shares = camera->take(cloud.view(), frame);
  EXPECT_FALSE(shares.is_image);
  EXPECT_EQ(shares.points, cloud.points.size());
  EXPECT_EQ(shares.hidden + shares.merged + shares.outside, 0u);
  EXPECT_EQ(frame.pixels, expected.pixels);
}

// Off the rays of every pinhole: k1 = -0.2 moves the corner by more than a pixel.
TEST(CloudCamera, ACloudOfABentLensIsNoImage) {
  CloudPoints cloud = points_of(image());
  ASSERT_TRUE(pinhole_of(cloud.view()));
  for (Vec3f& p : cloud.points) {
    const float r2 = (p.x * p.x + p.y * p.y) / (p.z * p.z);
    p.x *= 1 - 0.2f * r2;
    p.y *= 1 - 0.2f * r2;
  }
  EXPECT_FALSE(pinhole_of(cloud.view()));
  auto camera = CloudCamera::create(cloud.view(), {});
  ASSERT_TRUE(camera);
  DepthFrame frame;
  EXPECT_FALSE(camera->take(cloud.view(), frame).is_image);
  EXPECT_FALSE(pinhole_of(shuffled(points_of(image())).view()));
}

/// Points at random, as a scanner has them, on the plane n . p = d.
CloudPoints on_plane(const Vec3d& n, double d, std::size_t num, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> slope(-0.5, 0.5);
  CloudPoints cloud{static_cast<int>(num), 1, {}, {}};
  while (cloud.points.size() < num) {
    const Vec3d ray{slope(random), slope(random), 1};
    cloud.points.push_back(to_float(ray * (d / dot(n, ray))));
  }
  return cloud;
}

TEST(CloudCamera, ThePlaneOfScatteredPointsIsExactAtThePixels) {
  const Vec3d n = normalized(Vec3d{0.5, -0.3, -1});
  const double d = n.z * 0.8;
  const CloudPoints cloud = on_plane(n, d, 20000);
  auto camera = CloudCamera::create(cloud.view(), {.unit = 3e-5});
  ASSERT_TRUE(camera) << camera.error().message;
  const auto& [width, height, k, none] = camera->model();
  // Two points for each pixel.
  EXPECT_NEAR(20000.0 / (k.fx * k.fy), 2, 0.7);
  DepthFrame frame;
  const CloudShares shares = camera->take(cloud.view(), frame);
  EXPECT_EQ(shares.hidden + shares.outside, 0u);
  double worst = 0;
  int num_holes = 0, num = 0;
  for (int v = 5; v < height - 5; ++v) {
    for (int u = 5; u < width - 5; ++u) {
      const double z = frame.unit * frame.pixels[static_cast<std::size_t>(v * width + u)];
      const Vec3d ray{(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1};
      ++num;
      num_holes += z == 0;
      if (z > 0) worst = std::max(worst, std::abs(z - d / dot(n, ray)));
    }
  }
  EXPECT_LT(worst, 6e-5);
  EXPECT_LT(num_holes, num / 200);
}

TEST(CloudCamera, ABallHidesTheWallBehindItAndKeepsItsVolume) {
  constexpr double kRadius = 0.1, kDistance = 0.6;
  // Depth of the ball's front along the ray (r, 1), r away from the axis; 0: it passes.
  const auto front = [](double r) {
    const double a = 1 + r * r;
    const double root = kDistance * kDistance - a * (kDistance * kDistance - kRadius * kRadius);
    return root < 0 ? 0 : (kDistance - std::sqrt(root)) / a;
  };
  CloudPoints cloud = on_plane({0, 0, -1}, -1, 60000);
  for (Vec3f& p : cloud.points) {
    const double z = front(std::hypot(p.x, p.y));
    if (z > 0) p = to_float(to_double(p) * z);
  }
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 2000; ++i) {  // its far side, as from another viewpoint
    const Vec3d way = normalized(Vec3d{normal(random), normal(random), std::abs(normal(random))});
    cloud.points.push_back(to_float(way * kRadius + Vec3d{0, 0, kDistance + 0.02}));
  }
  cloud.width = static_cast<int>(cloud.points.size());
  auto camera = CloudCamera::create(cloud.view(), {.unit = 2e-5});
  ASSERT_TRUE(camera);
  DepthFrame frame;
  const CloudShares shares = camera->take(cloud.view(), frame);
  EXPECT_GT(shares.hidden, 1500u);
  const auto& [width, height, k, none] = camera->model();
  // The volume between the ball's front and the plane through its middle, over the rays.
  double volume = 0;
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const double z = frame.unit * frame.pixels[static_cast<std::size_t>(v * width + u)];
      if (z == 0 || z > kDistance) continue;
      volume += (std::pow(kDistance, 3) - std::pow(z, 3)) / (3 * k.fx * k.fy);
    }
  }
  double exact = 0;  // the same by rays, finely
  constexpr int kFine = 2000;
  for (int i = 0; i < kFine; ++i) {
    const double r = 0.2 * (i + 0.5) / kFine, z = front(r);
    if (z == 0) break;
    exact += 2 * std::numbers::pi * r * 0.2 / kFine * (std::pow(kDistance, 3) - std::pow(z, 3)) / 3;
  }
  EXPECT_NEAR(volume / exact, 1, 0.01);
}

TEST(CloudCamera, NormalsThatPointAwayHideTheirPoints) {
  CloudPoints cloud = on_plane({0, 0, -1}, -1, 5000);
  cloud.normals.assign(cloud.points.size(), {0, 0, 1});
  cloud.normals[7] = {0, 0, -1};
  auto camera = CloudCamera::create(cloud.view(), {});
  ASSERT_TRUE(camera);
  DepthFrame frame;
  EXPECT_EQ(camera->take(cloud.view(), frame).hidden, cloud.points.size() - 1);
}

TEST(CloudCamera, AViewpointMovesTheCameraAndNotThePoints) {
  const Vec3d n = normalized(Vec3d{0.2, 0.1, -1});
  const CloudPoints cloud = on_plane(n, n.z * 1.0, 20000);
  const Vec3d eye{0.1, 0, 0.3};
  CloudPoints from_eye = cloud;
  for (Vec3f& p : from_eye.points) p = to_float(to_double(p) - eye);
  auto camera = CloudCamera::create(from_eye.view(), {.viewpoint = eye, .unit = 3e-5});
  ASSERT_TRUE(camera);
  EXPECT_EQ(camera->X_FC().translation, eye);
  // A frame like that of a robot: x forward, z up.
  CloudPoints turned = cloud;
  for (Vec3f& p : turned.points) p = {p.z, -p.x, -p.y};
  auto other = CloudCamera::create(turned.view(), {.unit = 3e-5});
  ASSERT_TRUE(other) << other.error().message;
  for (CloudCamera* each : {&*camera, &*other}) {
    DepthFrame frame;
    each->take(each == &*camera ? from_eye.view() : turned.view(), frame);
    const auto& [width, height, k, none] = each->model();
    const std::size_t middle = static_cast<std::size_t>(height / 2 * width + width / 2);
    const double z = frame.unit * frame.pixels[middle];
    const Vec3d p_C{(width / 2 - k.cx) / k.fx * z, (height / 2 - k.cy) / k.fy * z, z};
    Vec3d p = each->X_FC() * p_C;
    if (each == &*other) p = {-p.y, -p.z, p.x};
    EXPECT_NEAR(dot(n, p), n.z, 4e-5);
  }
  // Upright: the image's y is down.
  EXPECT_LT(rotate(other->X_FC().rotation, {0, 1, 0}).z, -0.9);
}

TEST(CloudCamera, ARoomAllRoundIsRefusedAndSeenByAnImageForEachDirection) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  CloudPoints room;
  for (int i = 0; i < 60000; ++i) {  // a cube of 2 m around the scanner
    const Vec3d way = normalized(Vec3d{normal(random), normal(random), normal(random)});
    const double far = std::max({std::abs(way.x), std::abs(way.y), std::abs(way.z)});
    room.points.push_back(to_float(way / far));
  }
  room.width = static_cast<int>(room.points.size());
  const auto refused = CloudCamera::create(room.view(), {});
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("surrounds its viewpoint"), std::string::npos);
  std::size_t num_seen = 0;
  for (const Vec3d& look :
       {Vec3d{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}) {
    auto camera = CloudCamera::create(room.view(), {.look = look});
    ASSERT_TRUE(camera) << camera.error().message;
    EXPECT_LT(norm(rotate(camera->X_FC().rotation, {0, 0, 1}) - look), 1e-12);
    DepthFrame frame;
    const CloudShares shares = camera->take(room.view(), frame);
    num_seen += shares.points - shares.outside - shares.hidden;
    const auto& [width, height, k, none] = camera->model();
    for (int v = 6; v < height - 6; ++v) {  // the rest shows the next wall
      for (int u = 6; u < width - 6; ++u) {
        const std::uint16_t count = frame.pixels[static_cast<std::size_t>(v * width + u)];
        if (count > 0) {
          ASSERT_NEAR(count * frame.unit, 1, 0.002);
        }
      }
    }
  }
  EXPECT_GE(num_seen, room.points.size());
}

TEST(CloudCamera, CloudsWithoutPointsAreErrorsOrEmptyImages) {
  CloudPoints none{10, 10, std::vector<Vec3f>(100, {kNan, kNan, kNan}), {}};
  EXPECT_FALSE(CloudCamera::create(none.view(), {}));
  none.points.assign(100, {});
  EXPECT_FALSE(CloudCamera::create(none.view(), {}));
  none.points[5] = {0, 0, 1};
  EXPECT_FALSE(CloudCamera::create(none.view(), {}));  // one tells no size
  auto camera = CloudCamera::create(none.view(), {.width = 20, .height = 20});
  ASSERT_TRUE(camera);
  none.points[5] = {0, 0, -1};
  DepthFrame frame;
  EXPECT_EQ(camera->take(none.view(), frame).outside, 1u);
  EXPECT_EQ(std::ranges::count(frame.pixels, 0), std::ssize(frame.pixels));
}

}  // namespace
}  // namespace palpate
