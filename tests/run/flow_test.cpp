// Surfaces that move along themselves, as an optical flow tells: against closed forms.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "src/haptics/internal/surface_motion.h"
#include "tests/run/ticked_pipeline.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

constexpr double kMu = 0.5, kWall = 0.5, kPeriod = test::kFramePeriod;

DepthStreamInfo camera_info() {
  DepthStreamInfo info = test::wall_stream();
  info.intrinsics.fy = 310;
  info.has_flow = true;
  return info;
}

/// A plane that moves: n.p = offset at time 0 of the world, and the velocity of each of its points
/// is V_W, about the world's origin.
struct MovingPlane {
  Vec3d n{0, 0, -1};
  double offset = -kWall;
  Twist V_W;

  /// As a camera at X_WC sees it that moves by V_C, of its own origin in W.
  DepthFrame seen(double time, const Pose& X_WC = {}, const Twist& V_C = {}) const {
    const DepthStreamInfo info = camera_info();
    DepthFrame frame{info.width, info.height, info.unit, {}, time, X_WC};
    const auto& k = info.intrinsics;
    const Pose X_CW = inverse(X_WC);
    const double now = offset + dot(n, V_W.linear) * time;  // turns about n alone
    for (int v = 0; v < info.height; ++v) {
      for (int u = 0; u < info.width; ++u) {
        const Vec3d ray_C{(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1};
        const double z = (now - dot(n, X_WC.translation)) / dot(n, rotate(X_WC.rotation, ray_C));
        const Vec3d p_C = z * ray_C, p_W = X_WC * p_C;
        const Vec3d of_surface = V_W.linear + cross(V_W.angular, p_W);
        const Vec3d of_camera = V_C.linear + cross(V_C.angular, p_W - X_WC.translation);
        const Vec3d w = rotate(X_CW.rotation, of_surface - of_camera);
        frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(z / info.unit)));
        frame.flow.push_back(static_cast<float>(k.fx * (w.x - ray_C.x * w.z) / z));
        frame.flow.push_back(static_cast<float>(k.fy * (w.y - ray_C.y * w.z) / z));
      }
    }
    return frame;
  }
};

SurfaceTimeline timeline_of(bool is_moving = false, int binning = 1) {
  DepthStreamInfo info = camera_info();
  info.is_moving = is_moving;
  return SurfaceTimeline::create(info, {.binning = binning}).value();
}

/// Expects the plane's motion at p_W, without the velocity along its normal.
void expect_motion(const MovingPlane& plane, const Twist& got, const Vec3d& p_W, double tolerance) {
  Vec3d v = plane.V_W.linear + cross(plane.V_W.angular, p_W);
  v = v - dot(v, plane.n) * plane.n;
  EXPECT_LT(norm(got.linear - v), tolerance) << "of " << norm(v);
  EXPECT_LT(norm(got.angular - plane.V_W.angular), 0.02 * norm(plane.V_W.angular) + 1e-3);
}

TEST(SurfaceMotion, IsThatOfPlanesOfAnyTilt) {
  ThreadPool pool(1);
  for (const Vec3d& tilt : {Vec3d{0, 0, -1}, Vec3d{0.4, -0.2, -1}, Vec3d{-0.1, 0.8, -1}}) {
    MovingPlane plane;
    plane.n = normalized(tilt);
    plane.offset = plane.n.z * kWall;
    const Vec3d along = normalized(cross(plane.n, Vec3d{0.3, 1, 0}));
    for (const double coming : {0.0, 0.03, -0.03}) {
      for (const double turning : {0.0, 0.7}) {
        plane.V_W = {0.1 * along + coming * plane.n, turning * plane.n};
        for (const int binning : {1, 2}) {
          SurfaceTimeline timeline = timeline_of(false, binning);
          timeline.push(plane.seen(0), 0, pool);
          EXPECT_EQ(timeline.at(0).flow.pixels, nullptr) << "nothing is known before";
          timeline.push(plane.seen(kPeriod), kPeriod, pool);
          const SurfaceBlend blend = timeline.at(kPeriod);
          for (const Vec3d& at : {Vec3d{0, 0, 1}, Vec3d{-0.2, 0.15, 1}}) {
            const Vec3d p = at * ((plane.offset + coming * kPeriod) / dot(plane.n, at));
            const TouchedDisc disc{p - 1e-3 * plane.n, 3.0 * plane.n, 0.01};
            expect_motion(plane, surface_motion({&blend, 1}, disc), p, 1e-3);
          }
        }
      }
    }
  }
}

TEST(SurfaceMotion, OfACameraThatMovesIsThatInTheWorld) {
  ThreadPool pool(1);
  MovingPlane plane;
  plane.n = normalized(Vec3d{0.2, -0.3, -1});
  plane.offset = plane.n.z * kWall;
  const Vec3d along = normalized(cross(plane.n, Vec3d{0, 1, 0}));
  const Twist V_C{{0.05, -0.02, 0.04}, {0.1, 0.2, -0.15}};
  for (const double speed : {0.0, 0.08}) {
    plane.V_W = {speed * along, {}};
    SurfaceTimeline timeline = timeline_of(true);
    for (int i = 0; i < 2; ++i) {
      const double time = i * kPeriod;
      const Pose X_WC{V_C.linear * time,
                      axis_angle(V_C.angular / norm(V_C.angular), norm(V_C.angular) * time)};
      timeline.push(plane.seen(time, X_WC, V_C), time, pool);
    }
    const SurfaceBlend blend = timeline.at(kPeriod);
    const Vec3d p{0, 0, kWall};
    // The flow is that of the moment, the camera's motion that since the frame before.
    expect_motion(plane, surface_motion({&blend, 1}, {p, plane.n, 0.01}), p, 2e-3);
  }
}

TEST(SurfaceMotion, OfWhatIsNotKnownIsThatOfTheRest) {
  ThreadPool pool(1);
  MovingPlane plane;
  plane.V_W = {{0.1, 0, 0}, {}};
  DepthFrame holes = plane.seen(kPeriod);
  for (std::size_t i = 0; i < holes.flow.size(); i += 6) {
    holes.flow[i] = std::numeric_limits<float>::quiet_NaN();
  }
  SurfaceTimeline timeline = timeline_of();
  timeline.push(plane.seen(0), 0, pool);
  timeline.push(holes, kPeriod, pool);
  SurfaceBlend blend = timeline.at(kPeriod);
  const TouchedDisc disc{{0, 0, kWall}, plane.n, 0.01};
  expect_motion(plane, surface_motion({&blend, 1}, disc), disc.p_W, 1e-3);
  holes.flow.assign(holes.flow.size(), std::numeric_limits<float>::quiet_NaN());
  timeline.push(holes, 2 * kPeriod, pool);
  blend = timeline.at(2 * kPeriod);
  EXPECT_EQ(norm(surface_motion({&blend, 1}, disc).linear), 0);
  holes.flow.clear();
  timeline.push(holes, 3 * kPeriod, pool);
  blend = timeline.at(3 * kPeriod);
  EXPECT_EQ(norm(surface_motion({&blend, 1}, disc).linear), 0);
  // Half of a disc that turns is known: its middle moves as the whole of it does.
  MovingPlane turning;
  turning.V_W = {{0.1, 0, 0}, {0, 0, 0.7}};
  DepthFrame half = turning.seen(4 * kPeriod);
  for (std::size_t i = 0; i < half.flow.size(); i += 2) {
    if (i / 2 % 320 < 160) half.flow[i] = std::numeric_limits<float>::quiet_NaN();
  }
  timeline.push(half, 4 * kPeriod, pool);
  blend = timeline.at(4 * kPeriod);
  expect_motion(turning, surface_motion({&blend, 1}, disc), disc.p_W, 1e-3);
  // A plane that is suddenly in front of it is another surface.
  plane.offset = -0.4;
  timeline.push(plane.seen(0), 5 * kPeriod, pool);
  blend = timeline.at(5 * kPeriod);
  EXPECT_EQ(norm(surface_motion({&blend, 1}, disc).linear), 0);
}

/// A wall that moves along itself as `motion` says at each frame, and a hand.
struct Belt : test::TickedPipeline {
  Belt(const Tool& tool, const RunSettings& settings, std::function<Twist(int frame)> motion)
      : TickedPipeline(tool, camera_info(), settings,
                       [motion = std::move(motion)](int frame, double time) {
                         MovingPlane plane;
                         plane.V_W = motion(frame);
                         return plane.seen(time);
                       }) {}
};

/// A hand that comes down on the wall in 0.2 s, with the foot of its tool `reach` below it.
Pose pressing(int tick, double reach, double press) {
  return {{0, 0, kWall - reach - 0.002 + (0.002 + press) * std::min(1.0, tick / 200.0)}, {}};
}

TEST(Flow, ABeltThatSlidesUnderAToolDragsItWithMuN) {
  const Tool tool = test::packed(make_box({0.04, 0.04, 0.04}), 400);
  const Vec3d way = normalized(Vec3d{1, 0.5, 0});
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling,
                                  CouplingKind::direct, CouplingKind::proxy}) {
    Belt belt(tool, test::coupled_by(kind, kMu), [&](int) { return Twist{0.1 * way, {}}; });
    const double press = kind == CouplingKind::none || kind == CouplingKind::direct ? 3e-3 : 5e-3;
    double worst = 0, into = 0;
    for (int i = 0; i < 900; ++i) {
      const Vec3d f = belt.to(pressing(i, 0.02, press)).step.contact_W.force;
      if (i < 600) continue;
      into = -f.z;
      const Vec3d along{f.x, f.y, 0};
      worst = std::max(worst, norm(along - kMu * into * way) / (kMu * into));
    }
    EXPECT_GT(into, 0.5) << name_of(kind);
    EXPECT_LT(worst, 0.01) << name_of(kind);
  }
}

TEST(Flow, WhatSticksIsStretchedByTheWayOfTheBelt) {
  const Tool tool = test::packed(make_box({0.04, 0.04, 0.04}), 400);
  RunSettings settings = test::coupled_by(CouplingKind::none, kMu);
  settings.coupling.friction.stiffness = 1500;
  const double speed = 2e-3;
  const int begin = 12, num = 6;  // frames in which it moves
  Belt belt(tool, settings, [&](int frame) {
    return Twist{{frame >= begin && frame < begin + num ? speed : 0, 0, 0}, {}};
  });
  TickRecord tick;
  for (int i = 0; i < 1000; ++i) tick = belt.to(pressing(i, 0.02, 3e-3));
  const Vec3d f = tick.step.contact_W.force;
  const double stretch = speed * num * kPeriod;
  EXPECT_LT(1500 * stretch, 0.9 * kMu * -f.z) << "it has to stick";
  EXPECT_NEAR(f.x, 1500 * stretch, 0.02 * 1500 * stretch);
  EXPECT_NEAR(f.y, 0, 0.02 * f.x);
}

TEST(Flow, AToolThatGoesWithTheBeltFeelsNothingOfIt) {
  const Tool tool = test::packed(make_box({0.04, 0.04, 0.04}), 400);
  const double speed = 0.05;
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling}) {
    Belt belt(tool, test::coupled_by(kind, kMu), [&](int) { return Twist{{speed, 0, 0}, {}}; });
    double most = 0, into = 0;
    for (int i = 0; i < 900; ++i) {
      Pose X_BH = pressing(i, 0.02, 4e-3);
      X_BH.translation.x = speed * 1e-3 * i - 0.02;
      const Vec3d f = belt.to(X_BH).step.contact_W.force;
      if (i < 400) continue;
      into = -f.z;
      most = std::max(most, std::hypot(f.x, f.y) / (kMu * into));
    }
    EXPECT_GT(into, 0.3) << name_of(kind);
    EXPECT_LT(most, 0.15) << name_of(kind);
  }
}

TEST(Flow, ADiscThatTurnsUnderAToolTurnsIt) {
  const double radius = 0.015;
  const Tool tool = test::packed(make_cylinder(radius, 0.03, 96), 2000);
  Belt belt(tool, test::coupled_by(CouplingKind::none, kMu), [](int) {
    return Twist{{}, {0, 0, 1.5}};
  });
  double sum = 0;
  for (int i = 0; i < 800; ++i) {
    const Wrench& F = belt.to(pressing(i, 0.015, 3e-3)).step.contact_W;
    if (i >= 600) sum += F.torque.z / (kMu * -F.force.z) / 200;
  }
  EXPECT_NEAR(sum, 2 * radius / 3, 0.05 * 2 * radius / 3);
}

// With flow there is a belt under the block, which takes it along.
TEST(Flow, ABeltCarriesWhatLiesOnIt) {
  const Tool tool = test::box_tool();
  const auto block = std::make_shared<const Tool>(test::packed(make_box({0.06, 0.06, 0.03}), 800));
  RunSettings settings = test::coupled_by(CouplingKind::none, kMu);
  settings.objects = {{block, {{-0.03, 0, kWall - 0.015}, {}}, {}, true, 0.1}};
  settings.bodies.gravity_y = 0;
  settings.bodies.gravity_z = 9.81;
  const double speed = 0.04;
  // It has fallen asleep before the belt starts.
  Belt belt(tool, settings, [&](int frame) { return Twist{{frame >= 45 ? speed : 0, 0, 0}, {}}; });
  double start = 0, before = 0;
  for (int i = 0; i < 3000; ++i) {
    belt.to({{0, 0.1, 0.2}, {}});
    const double x = belt.pipeline().contact().bodies.of[0].translation.x;
    if (i == 1480) start = x;
    if (i == 2000) before = x;
    if (i < 2999) continue;
    EXPECT_NEAR(x - before, speed * 0.999, 0.02 * speed);
  }
  EXPECT_NEAR(start, -0.03, 1e-4);
}

TEST(Flow, TicksDoNotAllocate) {
  Belt belt(test::box_tool(), test::coupled_by(CouplingKind::virtual_coupling, kMu), [](int) {
    return Twist{{0.05, 0, 0}, {}};
  });
  for (int i = 0; i < 40; ++i) belt.to({{0, 0, kWall - 0.024}, {}});
  const test::AllocationCounter counter;
  for (int i = 0; i < 20; ++i) belt.to({{1e-4 * i, 0, kWall - 0.022}, {}});
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_GT(norm(belt.pipeline().contact().contact.patch.ground.velocity_W), 0.01);
}

TEST(Flow, WhatCannotUseItIsRefused) {
  const auto refused = [&](const auto& change) {
    RunSettings settings = test::coupled_by(CouplingKind::none, kMu);
    change(settings);
    const auto made =
        Pipeline::create(test::box_tool(), camera_info(), test::device_info(), settings);
    return !made && made.error().message.find("optical flow") != std::string::npos;
  };
  EXPECT_FALSE(refused([](RunSettings&) {}));
  EXPECT_TRUE(refused([](RunSettings& s) { s.contact.method = MethodKind::weighted; }));
  EXPECT_TRUE(refused([](RunSettings& s) { s.time.mode = TimeMode::latest; }));
  EXPECT_TRUE(refused([](RunSettings& s) { s.backend = Backend::cuda; }));
}

}  // namespace
}  // namespace palpate
