// One question to a scene: against the calls that it joins, exact solids, and bad input.
#include "palpate/contact/scene.h"

#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/hull_scenes.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using test::Random;

constexpr double kBallRadius = 0.1, kWall = 1.0;
const Vec3d kBall{0.02, 0.01, 0.75};

/// A ball before a wall, as one camera sees it.
struct BallAndWall {
  explicit BallAndWall(double noise = 0, bool is_joined = false, const Pose& X_WC = {}) {
    const auto ray = [](const Vec3d& p, const Vec3d& d) {
      return std::min(test::to_ball(p, d, kBall, kBallRadius), test::to_wall(p, d, kWall));
    };
    SensorOptions options;
    options.num_threads = 1;
    options.field.one_of_several = is_joined;
    sensor.emplace(Sensor::create(test::vga(), Place::cpu(), options).value());
    std::vector<float> meters = test::depth_seen(ray, test::vga(), X_WC);
    Random random(3);
    for (float& z : meters) z += static_cast<float>(noise * random.normal());
    DepthImageView image(640, 480, meters.data());
    image.X_WC = X_WC;
    surface = sensor->update(image);
  }

  std::optional<Sensor> sensor;
  SurfaceView surface;
};

Tool small_ball(double radius) {
  SpherePacking packing;
  packing.spheres = {{{}, static_cast<float>(radius)}};
  return Tool::build(make_icosphere(1.001 * radius, 3), packing).value();
}

struct Answered {
  explicit Answered(std::size_t num)
      : volume(num), clearance(num), gradient(6 * num), status(num), nearest(num), decided(num) {
    answers.contact.volume = volume.data();
    answers.contact.status = status.data();
    answers.clearance = clearance.data();
    answers.clearance_gradient = gradient.data();
    answers.nearest = nearest.data();
    answers.decided = decided.data();
  }
  std::vector<double> volume, clearance, gradient;
  std::vector<std::uint32_t> status;
  std::vector<std::int32_t> nearest, decided;
  SceneAnswers answers;
};

SceneContact contact_of(const Tool& tool, int num_threads = 1) {
  const Tool* const one = &tool;
  return SceneContact::create({&one, 1}, FieldMethod{}, Place::cpu(), num_threads).value();
}

TEST(SceneContact, ClearanceIsThatOfExactSolids) {
  const Tool tool = small_ball(0.004);
  const SceneContact contact = contact_of(tool);
  for (const double noise : {0.0, 0.0015}) {
    const BallAndWall seen(noise);
    const Scene scene{.surfaces = {seen.surface}};
    Random random(5);
    std::vector<Pose> poses;
    std::vector<double> exact;
    std::vector<Vec3d> normals;
    while (poses.size() < 400) {
      const Vec3d p{random.uniform(-0.25, 0.25), random.uniform(-0.2, 0.2),
                    random.uniform(0.5, 0.99)};
      const double to_ball = norm(p - kBall) - kBallRadius, to_wall = kWall - p.z;
      // In front of both; the shadow of the ball starts at its rim.
      if (p.z > kBall.z - 0.04 && std::hypot(p.x, p.y) < 0.2) continue;
      const double phi = std::min(to_ball, to_wall) - 0.004;
      if (!(phi > 0 && phi < 0.02)) continue;
      poses.push_back({p, random.rotation(3)});
      exact.push_back(phi);
      normals.push_back(to_ball < to_wall ? normalized(p - kBall) : Vec3d{0, 0, -1});
    }
    Answered got(poses.size());
    ASSERT_TRUE(contact.measure(scene, {poses}, got.answers));
    double squares = 0, worst = 0, angles = 0;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const double error = got.clearance[i] - exact[i];
      squares += error * error;
      worst = std::max(worst, error);
      const double* const g = &got.gradient[6 * i];
      EXPECT_NEAR(norm(Vec3d{g[0], g[1], g[2]}), 1, 1e-6);
      const double cosine = dot(Vec3d{g[0], g[1], g[2]}, normals[i]);
      angles += std::acos(std::clamp(cosine, -1.0, 1.0)) * std::acos(std::clamp(cosine, -1.0, 1.0));
      EXPECT_EQ(got.decided[i], 0);
      EXPECT_EQ(got.nearest[i], 0);
      EXPECT_LT(got.volume[i], 1e-9);  // the field is as wide as the sphere
    }
    const auto num = static_cast<double>(poses.size());
    const double degrees = std::sqrt(angles / num) * 180 / kPi;
    RecordProperty("rms_mm", std::to_string(1e3 * std::sqrt(squares / num)));
    RecordProperty("degrees", std::to_string(degrees));
    EXPECT_LT(std::sqrt(squares / num), 0.001);
    EXPECT_LT(worst, 0.002 + 3 * noise);
    EXPECT_LT(degrees, 3 + 2000 * noise);
  }
}

TEST(SceneContact, GradientIsTheDerivative) {
  const BallAndWall seen;
  const Scene scene{.surfaces = {seen.surface}};
  const Tool tool = test::random_tool(20, 0.03, 4);
  const SceneContact contact = contact_of(tool);
  const Vec3d C_T = tool.sphere_mass().center_of_mass;
  Random random(6);
  int num_checked = 0, num_off = 0;
  for (int i = 0; i < 60; ++i) {
    const Pose X_WT{
        {random.uniform(-0.2, 0.2), random.uniform(-0.15, 0.15), random.uniform(0.6, 1.0)},
        random.rotation(3)};
    constexpr double kStep = 1e-6;
    std::vector<Pose> poses{X_WT};
    for (int k = 0; k < 12; ++k) {
      Vec3d shift, turn;
      (k < 6 ? shift : turn)[k % 6 / 2] = k % 2 == 0 ? kStep : -kStep;
      const Quaternion q{turn.x / 2, turn.y / 2, turn.z / 2, 1};
      Pose moved{{}, normalized(q) * X_WT.rotation};
      moved.translation = X_WT * C_T + shift - rotate(moved.rotation, C_T);
      poses.push_back(moved);
    }
    Answered got(poses.size());
    ASSERT_TRUE(contact.measure(scene, {poses}, got.answers));
    if (got.nearest[0] < 0) continue;
    for (int k = 0; k < 6; ++k) {
      const auto at = static_cast<std::size_t>(1 + 2 * k);
      const double slope = (got.clearance[at] - got.clearance[at + 1]) / (2 * kStep);
      ++num_checked;
      num_off += std::abs(slope - got.gradient[static_cast<std::size_t>(k)]) > 1e-4;
    }
  }
  EXPECT_GT(num_checked, 100);
  EXPECT_LE(num_off, num_checked / 50);  // where the nearest pixel changes within the step
}

TEST(SceneContact, AnyIsClearanceBelowTheMargin) {
  const BallAndWall one(0.0015, true);
  const Pose X_WC = test::look_at({0.5, 0.1, 0.1}, kBall);
  const BallAndWall other(0.0015, true, X_WC);
  const Tool tool = test::random_tool(40, 0.03, 4);
  const SceneContact contact = contact_of(tool);
  for (const Scene& scene :
       {Scene{.surfaces = {one.surface}}, Scene{.surfaces = {one.surface, other.surface}}}) {
    Random random(8);
    std::vector<Pose> poses;
    for (int i = 0; i < 400; ++i) {
      const double x = random.uniform(-0.3, 0.3), y = random.uniform(-0.2, 0.2);
      poses.push_back({{x, y, random.uniform(0.5, 1.1)}, random.rotation(3)});
    }
    Answered got(poses.size());
    ASSERT_TRUE(contact.measure(scene, {poses}, got.answers));
    int num_mixed = 0, num_apart = 0;
    for (const double margin : {-0.01, -0.002, 0.0, 0.01, 0.05}) {
      std::vector<std::uint8_t> hits(poses.size());
      ASSERT_TRUE(contact.any(scene, {poses}, margin, hits.data()));
      for (std::size_t i = 0; i < poses.size(); ++i) {
        EXPECT_EQ(hits[i] != 0, got.clearance[i] < margin) << got.clearance[i];
        num_mixed += hits[i];
      }
    }
    for (std::size_t i = 0; i < poses.size(); ++i) {
      // The contact's field is as wide as a sphere; both agree but for light touches and edges.
      num_apart +=
          (got.volume[i] > 0) != (got.clearance[i] < 0) && std::abs(got.clearance[i]) > 0.002;
    }
    EXPECT_GT(num_mixed, 100);
    EXPECT_LE(num_apart, 20);
  }
}

TEST(SceneContact, SumsCamerasAndBodies) {
  const BallAndWall seen;
  const Tool tool = Tool::pack(make_box({0.03, 0.02, 0.05}), {.max_spheres = 60}).value();
  const Tool shape =
      Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 50}).value().with_solid_field();
  const Body body(shape, {{0.2, 0, 0.8}, {}});
  const Scene scene{.surfaces = {seen.surface}, .bodies = {body, body.at({{-0.2, 0, 0.8}, {}})}};
  const auto query = make_contact_query(Place::cpu(), tool, FieldMethod{}).value();
  const auto pair = make_body_pair_query(Place::cpu(), tool, shape).value();
  Random random(9);
  std::vector<Pose> poses;
  for (int i = 0; i < 100; ++i) {
    const double side = i % 2 == 0 ? 0.2 : -0.2;
    poses.push_back({{side + random.uniform(-0.1, 0.1), random.uniform(-0.05, 0.05),
                      random.uniform(0.72, 1.02)},
                     random.rotation(3)});
  }
  std::vector<double> unseen(poses.size());
  Answered first(poses.size()), second(poses.size());
  first.answers.unseen = unseen.data();
  ASSERT_TRUE(contact_of(tool, 1).measure(scene, {poses}, first.answers));
  ASSERT_TRUE(contact_of(tool, 2).measure(scene, {poses}, second.answers));
  EXPECT_EQ(first.volume, second.volume);
  EXPECT_EQ(first.clearance, second.clearance);
  EXPECT_EQ(first.gradient, second.gradient);
  int num_touching = 0, num_of_bodies = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    double want = query->measure(seen.surface, poses[i]).penetration.volume;
    double exact = 1;
    for (const Body& one : scene.bodies) {
      const Pose& X_WB = one.placed().X_WB;
      want += pair->measure(poses[i], X_WB).on_a.volume;
      for (const Sphere& sphere : tool.spheres()) {
        const Vec3d p = poses[i] * to_double(sphere.center) - X_WB.translation;
        const Vec3d q{std::abs(p.x) - 0.05, std::abs(p.y) - 0.05, std::abs(p.z) - 0.05};
        const Vec3d beyond{std::max(q.x, 0.0), std::max(q.y, 0.0), std::max(q.z, 0.0)};
        exact = std::min(exact, norm(beyond) + std::min(0.0, std::max({q.x, q.y, q.z})) -
                                    static_cast<double>(sphere.radius));
      }
    }
    EXPECT_EQ(first.volume[i], want);
    num_touching += want > 0;
    if (first.decided[i] < 1) continue;
    ++num_of_bodies;
    EXPECT_NEAR(first.clearance[i], std::max(exact, -kClearanceLimit), 0.0015);
  }
  EXPECT_GT(num_touching, 20);
  EXPECT_GT(num_of_bodies, 20);
  double in_bodies = -1;
  const ContactResult one = contact_of(tool).measure(scene, poses[0], {}, &in_bodies);
  EXPECT_EQ(one.penetration.volume, first.volume[0]);
  EXPECT_EQ(in_bodies, first.volume[0] - query->measure(seen.surface, poses[0]).penetration.volume);
}

// A ball in the face of a box: its force acts at the centroid of the cap inside.
TEST(SceneContact, MomentsOfBodiesAreThoseOfTheirForce) {
  constexpr double kRadius = 0.01, kDepth = 0.004;
  const Tool tool = Tool::pack(make_icosphere(kRadius, 4), {.max_spheres = 500}).value();
  const Tool box =
      Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 5}).value().with_solid_field();
  const Scene scene{.bodies = {Body(box)}};
  const Pose X_WT{{0.05 + kRadius - kDepth, 0.01, 0.02}, {}};
  double in_bodies = 0;
  const ContactResult r = contact_of(tool).measure(scene, X_WT, {.stiffness = true}, &in_bodies);
  const double cap = cap_volume(kRadius, kRadius - kDepth), reach = 2 * kRadius - kDepth;
  EXPECT_NEAR(in_bodies, cap, 0.05 * cap);
  EXPECT_EQ(in_bodies, r.penetration.volume);
  const double centroid = 3 * reach * reach / (4 * (3 * kRadius - kDepth));
  const Vec3d force = r.penetration.measure_W.force;
  EXPECT_NEAR(r.moments.first[0][0], -centroid * force.x, 0.05 * centroid * force.x);
  EXPECT_GT(r.moments.polar, 0);
}

TEST(SceneContact, ShapesOfPastScenesAreDropped) {
  const Tool tool = small_ball(0.01);
  const Tool box =
      Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 5}).value().with_solid_field();
  const SceneContact contact = contact_of(tool);
  const std::vector<Pose> poses{{{0.05, 0, 0}, {}}};
  Answered first(1), got(1);
  Scene scene{.bodies = {Body(box)}};
  ASSERT_TRUE(contact.measure(scene, {poses}, first.answers));
  for (int i = 0; i < 3; ++i) {
    const std::weak_ptr<const ToolIndex> last = scene.bodies[0].placed().shape;
    scene.bodies = {Body(box), Body(box)};
    scene.bodies[1] = scene.bodies[1].at({{1, 0, 0}, {}});
    ASSERT_TRUE(contact.measure(scene, {poses}, got.answers));
    EXPECT_TRUE(last.expired());
    EXPECT_EQ(got.volume, first.volume);
    // The same shapes in another order, and fewer of them.
    const std::weak_ptr<const ToolIndex> kept = scene.bodies[0].placed().shape;
    const std::weak_ptr<const ToolIndex> dropped = scene.bodies[1].placed().shape;
    std::swap(scene.bodies[0], scene.bodies[1]);
    ASSERT_TRUE(contact.measure(scene, {poses}, got.answers));
    EXPECT_EQ(got.volume, first.volume);
    scene.bodies.erase(scene.bodies.begin());
    ASSERT_TRUE(contact.measure(scene, {poses}, got.answers));
    EXPECT_EQ(got.volume, first.volume);
    EXPECT_TRUE(dropped.expired());
    EXPECT_FALSE(kept.expired());
  }
  EXPECT_GT(first.volume[0], 0);
}

TEST(SceneContact, ToolsAndGroups) {
  const BallAndWall seen;
  const Scene scene{.surfaces = {seen.surface}};
  const Tool large = small_ball(0.02), small = small_ball(0.004);
  const Tool* const tools[] = {&large, &small};
  const SceneContact both = SceneContact::create(tools).value();
  const std::vector<Pose> poses{
      {{0.3, 0, 0.97}, {}}, {{0.3, 0, 0.97}, {}}, {{0.3, 0.1, 0.995}, {}}};
  const std::vector<std::int32_t> tool_of_pose{0, 1, 0}, group_of_pose{1, 1, 0};
  const ScenePoses asked{poses, tool_of_pose, group_of_pose, 3};
  Answered got(3);
  double group_clearance[3], group_volume[3];
  std::int32_t group_pose[3];
  got.answers.group_clearance = group_clearance;
  got.answers.group_pose = group_pose;
  got.answers.group_volume = group_volume;
  ASSERT_TRUE(both.measure(scene, asked, got.answers));
  EXPECT_NEAR(got.clearance[0], 0.01, 2e-4);
  EXPECT_NEAR(got.clearance[1], 0.026, 2e-4);
  EXPECT_NEAR(got.clearance[2], -0.015, 2e-4);
  EXPECT_EQ(group_pose[0], 2);
  EXPECT_EQ(group_pose[1], 0);
  EXPECT_EQ(group_pose[2], -1);
  EXPECT_EQ(group_clearance[1], got.clearance[0]);
  EXPECT_EQ(group_clearance[2], kClearanceLimit);
  EXPECT_EQ(group_volume[0], got.volume[2]);
  std::uint8_t hits[3];
  ASSERT_TRUE(both.any(scene, asked, 0, hits));
  EXPECT_EQ(hits[0] + 10 * hits[1] + 100 * hits[2], 1);
}

// Longer than what a thread takes at a time, and than what is placed at once.
TEST(SceneContact, OneLongGroupHasTheSameAnswersOnSeveralThreads) {
  Random random(17);
  const test::HullScene seen = test::rough_scene(1, {}, random);
  const Scene scene{.surfaces = {seen.views[0].to}};
  const Tool tool = test::random_tool(30, 0.03, 4);
  const Tool* const tools[] = {&tool};
  std::vector<Pose> poses;
  std::vector<std::int32_t> group_of_pose;
  for (int i = 0; i < 700; ++i) {
    const double x = random.uniform(-0.3, 0.3), y = random.uniform(-0.2, 0.2);
    poses.push_back({{x, y, random.uniform(0.2, 0.9)}, random.rotation(3)});
    group_of_pose.push_back(i < 600 ? 0 : 1);
  }
  const ScenePoses asked{poses, {}, group_of_pose, 2};
  std::vector<double> each(700), group(2), volume(700);
  SceneAnswers answers;
  answers.contact.volume = volume.data();
  answers.clearance = each.data();
  answers.group_clearance = group.data();
  std::vector<double> least;
  for (const int num_threads : {1, 4}) {
    const SceneContact contact =
        SceneContact::create(tools, FieldMethod{}, Place::cpu(), num_threads).value();
    answers.only_least_of_groups = false;
    ASSERT_TRUE(contact.measure(scene, asked, answers));
    if (least.empty()) least = group;
    EXPECT_EQ(group, least);
    const std::vector<double> all = each;
    answers.only_least_of_groups = true;
    ASSERT_TRUE(contact.measure(scene, asked, answers));
    EXPECT_EQ(group, least);
    for (std::size_t i = 0; i < each.size(); ++i) EXPECT_GE(each[i], all[i]) << i;
    for (const double margin : {least[0] + 1e-6, least[0] - 1e-6}) {
      std::uint8_t hits[2];
      ASSERT_TRUE(contact.any(scene, asked, margin, hits));
      EXPECT_EQ(hits[0] != 0, least[0] < margin);
      EXPECT_EQ(hits[1] != 0, least[1] < margin);
    }
  }
  EXPECT_LT(least[0], kClearanceLimit);
}

TEST(SceneContact, UnseenSpaceIsAPolicyOfTheQuestion) {
  const BallAndWall seen;
  const Tool tool = small_ball(0.01);
  const SceneContact contact = contact_of(tool);
  const std::vector<Pose> behind_the_ball{{{0.025, 0.012, 0.92}, {}}};
  Answered got(1);
  double unseen = 0;
  got.answers.unseen = &unseen;
  Scene scene{.surfaces = {seen.surface}};
  ASSERT_TRUE(contact.measure(scene, {behind_the_ball}, got.answers));
  EXPECT_GT(got.volume[0], 0);
  EXPECT_LT(got.clearance[0], 0);
  EXPECT_NEAR(unseen, 1, 0.05);
  scene.unseen = UnseenSpace::free;
  ASSERT_TRUE(contact.measure(scene, {behind_the_ball}, got.answers));
  EXPECT_EQ(got.volume[0], 0);
  EXPECT_GT(got.clearance[0], 0);
}

TEST(SceneContact, SpheresAreDescribed) {
  const BallAndWall seen;
  const Scene scene{.surfaces = {seen.surface}};
  const Tool tool = small_ball(0.01);
  const std::vector<Pose> poses{{{0.3, 0, 0.995}, {}}, {{0.3, 0, 0.5}, {}}};
  float depth[2], volume[2], direction[6];
  std::int8_t decided[2];
  SceneAnswers answers;
  answers.sphere_depth = depth;
  answers.sphere_volume = volume;
  answers.sphere_direction = direction;
  answers.sphere_decided = decided;
  answers.max_spheres = 1;
  ASSERT_TRUE(contact_of(tool).measure(scene, {poses}, answers));
  EXPECT_NEAR(depth[0], 0.005, 2e-4);
  EXPECT_NEAR(volume[0], cap_volume(0.01, 0.005), 5e-8);
  EXPECT_NEAR(direction[2], -1, 1e-3);
  EXPECT_EQ(decided[0], 0);
  EXPECT_EQ(depth[1], 0);
  EXPECT_EQ(decided[1], kNoCamera);
}

// -s ln(e^(-limit/s) + sum(e^(-c/s) - e^(-limit/s))) over the clearances of balls by themselves.
TEST(SceneContact, SmoothMinimumIsItsFormulaAndGradientTheDerivative) {
  const BallAndWall seen;
  const Tool shape =
      Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 50}).value().with_solid_field();
  const Scene scene{.surfaces = {seen.surface}, .bodies = {Body(shape, {{0.22, 0, 0.8}, {}})}};
  const Tool tool = test::random_tool(8, 0.03, 4);
  const SceneContact contact = contact_of(tool);
  const Vec3d C_T = tool.sphere_mass().center_of_mass;
  constexpr std::size_t kNum = 20, kEach = 13;  // each with twelve neighbors
  constexpr double kStep = 1e-6;
  Random random(6);
  std::vector<Pose> poses;
  for (std::size_t i = 0; i < kNum; ++i) {
    const double x = random.uniform(0, 0.3), y = random.uniform(-0.15, 0.15);
    const Pose X_WT{{x, y, random.uniform(0.6, 1.02)}, random.rotation(3)};
    poses.push_back(X_WT);
    for (int k = 0; k < 12; ++k) {
      Vec3d shift, turn;
      (k < 6 ? shift : turn)[k % 6 / 2] = k % 2 == 0 ? kStep : -kStep;
      const Quaternion q{turn.x / 2, turn.y / 2, turn.z / 2, 1};
      Pose moved{{}, normalized(q) * X_WT.rotation};
      moved.translation = X_WT * C_T + shift - rotate(moved.rotation, C_T);
      poses.push_back(moved);
    }
  }
  int num_checked = 0, num_off = 0, num_below = 0, num_deep = 0;
  for (const double smoothing : {0.005, 0.001}) {
    Answered got(poses.size()), least(poses.size());
    got.answers.contact = least.answers.contact = {};
    got.answers.clearance_smoothing = smoothing;
    ASSERT_TRUE(contact.measure(scene, {poses}, least.answers));
    ASSERT_TRUE(contact.measure(scene, {poses}, got.answers));
    const double floor = std::exp(-kClearanceLimit / smoothing);
    std::vector<double> sums(kNum, floor);
    for (const Sphere& sphere : tool.spheres()) {
      const Tool ball = small_ball(static_cast<double>(sphere.radius));
      const SceneContact alone = contact_of(ball);
      std::vector<Pose> at;
      for (std::size_t i = 0; i < kNum; ++i) {
        at.push_back({poses[kEach * i] * to_double(sphere.center), {}});
      }
      for (const Scene& part : {Scene{.surfaces = scene.surfaces}, Scene{.bodies = scene.bodies}}) {
        Answered of_ball(kNum);
        of_ball.answers.contact = {};
        ASSERT_TRUE(alone.measure(part, {at}, of_ball.answers));
        for (std::size_t i = 0; i < kNum; ++i) {
          sums[i] += std::exp(-of_ball.clearance[i] / smoothing) - floor;
        }
      }
    }
    for (std::size_t i = 0; i < kNum; ++i) {
      const std::size_t at = kEach * i;
      const double want = -smoothing * std::log(sums[i]);
      EXPECT_NEAR(got.clearance[at], std::max(want, -kClearanceLimit), 1e-6);
      if (!(std::abs(got.clearance[at]) < kClearanceLimit)) continue;
      EXPECT_EQ(got.nearest[at], least.nearest[at]);
      EXPECT_LE(got.clearance[at], least.clearance[at]);
      num_below += got.clearance[at] < least.clearance[at] - 1e-4;
      num_deep += least.clearance[at] < -31 * smoothing;
      for (std::size_t k = 0; k < 6; ++k) {
        const double slope =
            (got.clearance[at + 1 + 2 * k] - got.clearance[at + 2 + 2 * k]) / (2 * kStep);
        ++num_checked;
        num_off += std::abs(slope - got.gradient[6 * at + k]) > 1e-3;
      }
    }
  }
  EXPECT_GT(num_below, 5);
  EXPECT_GT(num_deep, 0);
  EXPECT_GT(num_checked, 60);
  EXPECT_LE(num_off, num_checked / 20);  // where a nearest pixel changes within the step
}

// A hand 0.65 to 0.75 m away has come before a table at 1 m, which a camera remembers.
TEST(SceneContact, SpaceBehindAHandIsFreeIfItIsRemembered) {
  const auto frame_of = [](bool has_hand) {
    const auto ray = [has_hand](const Vec3d& p, const Vec3d& d) {
      const double table = test::to_wall(p, d, 1.0);
      return has_hand ? std::min(table, test::to_ball(p, d, {0, 0, 0.7}, 0.05)) : table;
    };
    DepthFrame frame{640, 480, 0.0001, {}, 0};
    for (const float z : test::depth_seen(ray, test::vga(), {})) {
      frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(z / 0.0001f)));
    }
    return frame;
  };
  const DepthFrame table = frame_of(false), hand = frame_of(true);
  test::HullScene seen;
  test::add_memory(seen, test::vga(), {table, table, table, table, hand}, {}, 1, false);
  const SurfaceView& remembers = seen.views[0].to;
  ASSERT_EQ(remembers.role, SurfaceRole::with_memory);
  const Tool tool = small_ball(0.004);
  const SceneContact contact = contact_of(tool);
  const std::vector<Pose> poses{
      {{0.002, 0.001, 0.93}, {}}, {{0, 0, 0.645}, {}}, {{0, 0, 0.67}, {}}};
  Answered got(3);
  const Status known = contact.measure({.surfaces = {remembers}}, {poses}, got.answers);
  ASSERT_TRUE(known) << known.error().message;
  EXPECT_NEAR(got.clearance[0], 0.066, 5e-4);
  EXPECT_NEAR(got.gradient[2], -1, 1e-3);
  EXPECT_EQ(got.decided[0], 0);
  EXPECT_EQ(got.volume[0], 0);
  EXPECT_NEAR(got.clearance[1], 0.001, 5e-4);  // to the hand
  EXPECT_LT(got.clearance[2], -0.02);
  std::uint8_t hits[3];
  ASSERT_TRUE(contact.any({.surfaces = {remembers}}, {poses}, 0.003, hits));
  EXPECT_EQ(hits[0] + 10 * hits[1] + 100 * hits[2], 110);
  // Joined with others it is refused.
  test::HullScene joined;
  test::add_memory(joined, test::vga(), {table, table, table, table, hand}, {}, 1, true);
  const Scene two{.surfaces = {joined.views[0].to, joined.views[0].to}};
  const Status status = contact.measure(two, {poses}, got.answers);
  ASSERT_FALSE(status);
  EXPECT_NE(status.error().message.find("has a memory"), std::string::npos);
}

TEST(SceneContact, RefusesInOneSentence) {
  const BallAndWall seen;
  const Tool tool = small_ball(0.01);
  const Tool* const tools[] = {&tool, &tool};
  const SceneContact contact = SceneContact::create(tools).value();
  const std::vector<Pose> poses{{{0, 0, 0.5}, {}}};
  const Scene scene{.surfaces = {seen.surface}};
  Answered got(1);
  const auto message = [&](const Scene& given, const std::vector<std::int32_t>& of_pose) {
    const Status status = contact.measure(given, {poses, of_pose}, got.answers);
    return status ? std::string() : status.error().message;
  };
  EXPECT_NE(message({}, {0}).find("the scene is empty"), std::string::npos);
  EXPECT_NE(message(scene, {2}).find("tool_of_pose of pose 0 is 2, but there are 2 tools"),
            std::string::npos);
  EXPECT_NE(message(scene, {0, 1}).find("one number for each pose"), std::string::npos);
  EXPECT_NE(message(scene, {}).find("give the tool of each pose"), std::string::npos);
  Scene two{.surfaces = {seen.surface, seen.surface}};
  EXPECT_NE(message(two, {0}).find("one_of_several"), std::string::npos);
  two.surfaces[1].field.gpu = 1;
  EXPECT_NE(message(two, {0}).find("the memory of GPU 1"), std::string::npos);
  EXPECT_EQ(message(scene, {1}), "");
  const SceneContact by_points = SceneContact::create({tools, 1}, WeightedMethod{}).value();
  const Status status = by_points.measure(scene, {poses}, got.answers);
  ASSERT_FALSE(status);
  EXPECT_NE(status.error().message.find("not with weighted"), std::string::npos);
  double volume_std = -7;
  const Status unsure = by_points.measure(scene, {poses}, {.contact = {.volume_std = &volume_std}});
  ASSERT_FALSE(unsure);
  EXPECT_NE(unsure.error().message.find("not with weighted"), std::string::npos);
  EXPECT_EQ(volume_std, -7);
  EXPECT_FALSE(SceneContact::create({}));
  // Poses that are not finite are answered by their status.
  const std::vector<Pose> broken{{{NAN, 0, 0.5}, {}}};
  const std::vector<std::int32_t> zero{0};
  ASSERT_TRUE(contact.measure(scene, {broken, zero}, got.answers));
  EXPECT_NE(got.status[0] & static_cast<std::uint32_t>(StepStatus::non_finite_pose), 0U);
  EXPECT_EQ(got.clearance[0], 0);
}

}  // namespace
}  // namespace palpate
