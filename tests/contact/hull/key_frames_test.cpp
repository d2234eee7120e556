// Key frames of a moving camera: against exact solids, and queries against their definition in
// double.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/contact/contact.h"
#include "src/field/internal/key_frames.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/hull_scenes.h"
#include "tests/test_util/hull_truth.h"

namespace palpate {
namespace {

using test::Random;

constexpr double kWall = 1.0, kBallRadius = 0.06, kToolRadius = 0.03;
constexpr Vec3d kBall{0, 0, 0.7};

test::Ray wall_with_ball(const std::optional<Vec3d>& ball) {
  return [ball](const Vec3d& p, const Vec3d& d) {
    const double wall = test::to_wall(p, d, kWall);
    return ball ? std::min(wall, test::to_ball(p, d, *ball, kBallRadius)) : wall;
  };
}

/// A camera that moves, one with a memory and one without.
class MovingCamera {
 public:
  explicit MovingCamera(int frames = 8, int num_threads = 1, double noise = 0)
      : noise_(noise),
        pool_(num_threads),
        remembers_(make(DepthMemory::on, frames)),
        forgets_(make(DepthMemory::off, frames)) {}

  void push(const Pose& X_WC, const std::optional<Vec3d>& ball) {
    DepthFrame frame{camera_.width, camera_.height, 0.0001, {}, 0};
    for (const float z : test::depth_seen(wall_with_ball(ball), camera_, X_WC)) {
      double seen = z > 0 ? static_cast<double>(z) + noise_ * random_.normal() : 0;
      if (random_.uniform(0, 1) < speckles_) seen *= random_.uniform(0.5, 1.5);
      frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(seen / frame.unit)));
    }
    frame.X_WC = X_WC;
    const std::size_t before = test::num_allocations();
    remembers_.push(frame, time_, pool_);
    num_allocations_ += test::num_allocations() - before;
    forgets_.push(frame, time_, pool_);
    time_ += 1.0 / 30;
  }
  /// Sets the share of pixels with random depth from now on.
  void speckle(double share) { speckles_ = share; }
  /// Moves the camera along an arc around the scene, x from -0.35 to 0.35 m.
  void pass(const std::optional<Vec3d>& ball) {
    for (int i = 0; i <= 14; ++i) push(eye(-0.35 + 0.05 * i), ball);
  }
  /// Rotates the camera until the whole scene is out of sight.
  void rotate_camera(const std::optional<Vec3d>& ball) {
    for (int i = 1; i <= 8; ++i) {
      push(test::look_at({0.35, 0, 0}, {0.35 + 0.25 * i, 0, 1}), ball);
    }
  }
  static Pose eye(double x) { return test::look_at({x, 0, 0}, {0, 0, 0.8}); }

  std::vector<SurfaceBlend> views(double progress = 1) {
    std::vector<SurfaceBlend> views{remembers_.at(time_)};
    for (const SurfaceBlend& kept : remembers_.key_frames()) views.push_back(kept);
    for (SurfaceBlend& view : views) view.progress = progress;
    return views;
  }
  /// Returns the share of the tool in contact.
  double felt(const Vec3d& at) {
    return query_->measure(views(), {at, {}}).penetration.volume / whole();
  }
  double felt_without(const Vec3d& at) {
    SurfaceBlend view = forgets_.at(time_);
    view.progress = 1;
    return query_->measure({&view, 1}, {at, {}}).penetration.volume / whole();
  }
  std::size_t num_key_frames() const { return remembers_.key_frames().size(); }
  std::size_t num_allocations() const { return num_allocations_; }
  const ContactQuery& query() const { return *query_; }
  const Tool& tool() const { return tool_; }

 private:
  double whole() const { return tool_.mesh_mass().volume; }
  SurfaceTimeline make(DepthMemory kind, int frames) const {
    DepthStreamInfo stream = test::stream_of(camera_);
    stream.is_moving = true;
    TimeOptions time;
    time.memory = {.kind = kind};
    time.memory.frames = frames;
    return SurfaceTimeline::create(stream, {.time = time}).value();
  }

  Camera camera_{320, 240, {262.5, 262.5, 159.5, 119.5}};
  double noise_, speckles_ = 0, time_ = 0;
  Random random_{61};
  ThreadPool pool_;
  SurfaceTimeline remembers_, forgets_;
  Tool tool_ = test::ball_tool(kToolRadius, 1500);
  std::unique_ptr<ContactQuery> query_ =
      make_contact_query(Place::cpu(), tool_, FieldMethod{SphereVolumes::represented}).value();
  std::size_t num_allocations_ = 0;
};

double exact_share(const std::optional<Vec3d>& ball, const Vec3d& center) {
  int num = 0, num_solid = 0;
  test::for_points_in_ball(center, kToolRadius, [&](const Vec3d& p) {
    ++num;
    num_solid += p.z > kWall || (ball && norm(p - *ball) < kBallRadius);
  });
  return static_cast<double>(num_solid) / num;
}

TEST(KeyFrames, WhatIsBehindABallIsKnownFromWhereTheCameraWas) {
  for (const double noise : {0.0, 0.0015}) {
    MovingCamera camera(8, 1, noise);
    camera.pass(kBall);
    camera.push(MovingCamera::eye(0), kBall);
    EXPECT_GE(camera.num_key_frames(), 3u);
    // In the ball's shadow.
    EXPECT_GT(camera.felt_without({0, 0, 0.89}), 0.99);
    EXPECT_LT(camera.felt({0, 0, 0.89}), 0.01);
    for (const Vec3d& p :
         {Vec3d{0, 0, 0.99}, {0.1, 0, 0.985}, {0, 0, 0.62}, {0.07, 0, 0.68}, {0.15, 0.05, 0.8}}) {
      EXPECT_NEAR(camera.felt(p), exact_share(kBall, p), 0.03) << p.x << " " << p.z;
    }
  }
}

TEST(KeyFrames, WhatIsOutOfSightStaysFelt) {
  MovingCamera camera;
  camera.pass(kBall);
  camera.rotate_camera(kBall);
  EXPECT_EQ(camera.felt_without({0, 0, 0.99}), 0);
  for (const Vec3d& p :
       {Vec3d{0, 0, 0.99}, {-0.1, 0, 0.985}, {0, 0, 0.62}, {0.02, 0, 0.89}, {-0.2, 0.05, 0.7}}) {
    EXPECT_NEAR(camera.felt(p), exact_share(kBall, p), 0.04) << p.x << " " << p.z;
  }
}

TEST(KeyFrames, WhatHasGoneIsFeltNoMore) {
  MovingCamera camera;
  camera.pass(kBall);
  camera.push(MovingCamera::eye(0.35), std::nullopt);
  const auto expect_none = [&] {
    for (const Vec3d& p :
         {kBall, kBall - Vec3d{0, 0, 0.06}, kBall + Vec3d{0.06, 0, 0}, kBall + Vec3d{0, 0, 0.1}}) {
      EXPECT_EQ(camera.felt(p), 0) << p.x << " " << p.z;
    }
  };
  EXPECT_GT(exact_share(kBall, kBall), 0.99);
  expect_none();
  // It was there in frames that are kept; by the time it is out of sight it is in none.
  for (int i = 0; i < 4; ++i) camera.push(MovingCamera::eye(0.35), std::nullopt);
  camera.rotate_camera(std::nullopt);
  expect_none();
  EXPECT_NEAR(camera.felt({0, 0, 0.99}), exact_share({}, {0, 0, 0.99}), 0.04);
}

TEST(KeyFrames, WhatHasComeIsFeltOutOfSight) {
  MovingCamera camera;
  camera.pass(std::nullopt);
  EXPECT_EQ(camera.felt({0, 0, 0.62}), 0);
  camera.push(MovingCamera::eye(0.35), kBall);
  camera.rotate_camera(kBall);
  // The front that was seen.
  const Vec3d front = kBall + kBallRadius * normalized(Vec3d{0.35, 0, 0} - kBall);
  EXPECT_GT(camera.felt(front), 0.2);
  EXPECT_GT(camera.felt(kBall), 0.9);
  // And nothing beside it.
  EXPECT_LT(camera.felt(kBall - Vec3d{0.2, 0, 0}), 0.01);
}

TEST(KeyFrames, AreNoMoreThanAsked) {
  MovingCamera camera(2);
  camera.pass(kBall);
  camera.rotate_camera(kBall);
  EXPECT_EQ(camera.num_key_frames(), 2u);
  EXPECT_GT(MovingCamera(1).views().size(), 0u);
}

TEST(KeyFrames, TheOneThatAddsLeastMakesRoom) {
  MovingCamera camera(2);
  const Vec3d in_wall{0, 0, kWall + kToolRadius};
  for (const double x : {0.0, 3.0, 0.3}) {
    camera.push(test::look_at({x, 0, 0}, {x, 0, 1}), std::nullopt);
  }
  // The third sees much of what the first one knows, and takes its place.
  EXPECT_GT(camera.felt(in_wall + Vec3d{3.4, 0, 0}), 0.9);
  EXPECT_GT(camera.felt(in_wall + Vec3d{0.7, 0, 0}), 0.9);
  EXPECT_LT(camera.felt(in_wall - Vec3d{0.5, 0, 0}), 0.1);
}

TEST(KeyFrames, QueriesEqualTheirDefinition) {
  MovingCamera camera;
  camera.pass(kBall);
  camera.rotate_camera(kBall);
  Random random(62);
  const Tool tool = test::random_tool(33, 0.06, 3);
  const double scale = tool.sphere_mass().volume;
  const auto query =
      make_contact_query(Place::cpu(), tool, FieldMethod{SphereVolumes::own}).value();
  int num_with_force = 0;
  for (const double progress : {1.0, 0.3}) {
    const std::vector<SurfaceBlend> views = camera.views(progress);
    for (int i = 0; i < 60; ++i) {
      const Pose X_WT{
          {random.uniform(-0.3, 1.4), random.uniform(-0.1, 0.1), random.uniform(0.6, 1.05)},
          random.rotation(3.0)};
      const Penetration want = test::hull_truth(tool, views, X_WT, SphereVolumes::own);
      const Penetration got = query->measure(views, X_WT).penetration;
      num_with_force += want.volume > 0.01 * scale && want.volume < 0.99 * scale;
      EXPECT_NEAR(got.volume, want.volume, 3e-5 * scale);
      EXPECT_NEAR(norm(got.measure_W.force - want.measure_W.force), 0, 2e-4 * scale);
    }
  }
  EXPECT_GT(num_with_force, 15);
}

TEST(KeyFrames, GiveTheSameBitsWithAnyThreadsAndAllocateNothing) {
  MovingCamera one(8, 1, 0.0015), many(8, 3, 0.0015);
  for (MovingCamera* camera : {&one, &many}) {
    camera->pass(kBall);
    camera->rotate_camera(std::nullopt);
  }
  EXPECT_EQ(one.num_key_frames(), many.num_key_frames());
  EXPECT_EQ(one.num_allocations(), 0u);
  Random random(63);
  for (int i = 0; i < 40; ++i) {
    const Vec3d p{random.uniform(-0.3, 1.0), random.uniform(-0.1, 0.1), random.uniform(0.6, 1.05)};
    EXPECT_EQ(one.felt(p), many.felt(p));
  }
}

TEST(KeyFrames, AreOfCountsInHostMemory) {
  const Camera camera{64, 48, {52, 52, 31.5, 23.5}};
  DepthStreamInfo stream = test::stream_of(camera);
  stream.is_moving = true;
  TimeOptions time;
  time.memory.kind = DepthMemory::on;
  auto timeline = SurfaceTimeline::create(stream, {.time = time}).value();
  ThreadPool pool(1);
  const std::vector<float> meters(64 * 48, 1.0f);
  timeline.push(DepthImageView(64, 48, meters.data()), 0, pool);
  ASSERT_FALSE(timeline.status());
  EXPECT_NE(timeline.status().error().message.find("16-bit depth images in host memory"),
            std::string::npos);
  const std::vector<std::uint16_t> counts(64 * 48, 1000);
  timeline.push(DepthImageView(64, 48, counts.data(), 0.001), 0.1, pool);
  EXPECT_TRUE(timeline.status());
  EXPECT_EQ(timeline.key_frames().size(), 1u);
}

// If all has gone, or something has come before all of it, all points say so but those of the
// border, which have too few neighbors.
TEST(FrameEvidence, OfTheBorderNothingIsConcluded) {
  DepthGrid kept{9, 7, {8, 8, 4, 3}, {}, std::vector<float>(63, 1.0f)}, now = kept;
  FrameEvidence evidence(63, {});
  for (const float seen : {2.0f, 0.5f}) {
    now.depth.assign(63, seen);
    evidence.look(kept, now);
    for (int i = 0; i < 63; ++i) {
      const int u = i % 9, v = i / 9;
      const bool is_inner = u > 0 && u < 8 && v > 0 && v < 6;
      EXPECT_EQ(evidence.gone(i).value_or(-1), is_inner && seen > 1 ? seen : -1) << u << " " << v;
      EXPECT_EQ(evidence.come(i), is_inner && seen < 1 ? seen : 0) << u << " " << v;
    }
  }
}

TEST(KeyFrames, NoiseContradictsNothing) {
  for (const bool has_speckles : {false, true}) {
    // A speckle more at the ball's edge, which two frames sample otherwise, may be too much.
    const std::optional<Vec3d> ball = has_speckles ? std::nullopt : std::optional(kBall);
    MovingCamera camera(8, 1, 0.003);
    camera.pass(ball);
    for (int i = 0; i < 4; ++i) camera.push(MovingCamera::eye(0), ball);
    const auto stamps = [&] {
      std::vector<std::uint64_t> all;
      for (const SurfaceBlend& view : camera.views()) all.push_back(view.to.field.stamp);
      all.erase(all.begin());  // of the newest frame
      return all;
    };
    const std::vector<std::uint64_t> before = stamps();
    if (has_speckles) camera.speckle(0.01);
    for (int i = 0; i < 10; ++i) camera.push(MovingCamera::eye(0), ball);
    EXPECT_EQ(stamps(), before);
    EXPECT_GE(before.size(), 2u);
  }
}

}  // namespace
}  // namespace palpate
