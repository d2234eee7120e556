// Robots against closed forms: where links are, how clear they are, and what the joints feel.
#include "palpate/robot/robot.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "palpate/io/files.h"
#include "src/io/internal/hashes.h"
#include "src/packing/internal/sphere_cover.h"
#include "tests/robot/robot_arm.h"
#include "tests/test_util/random.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::kWallDepth;

/// The base turns z of the arm sideways: at zero it lies along y, before the wall, and positive
/// angles turn it towards that.
Pose base() { return {{0, -0.25, 0.8}, axis_angle({1, 0, 0}, -kPi / 2)}; }

std::vector<double> random_joints(test::Random& random, std::size_t num) {
  std::vector<double> joints;
  for (std::size_t i = 0; i < num; ++i) {
    joints.insert(joints.end(), {random.uniform(-0.3, 0.25), random.uniform(-0.3, 0.25),
                                 random.uniform(0.001, 0.029)});
  }
  return joints;
}

TEST(Robot, Covers_are_inside_and_near_the_whole_surface) {
  const Vec3d size{0.1, 0.06, 0.3};
  for (const double standoff : {0.02, 0.006}) {
    const auto cover = cover_solid(make_box(size), standoff, 1000).value();
    EXPECT_EQ(cover.stop, PackStop::standoff);
    double farthest = 0;
    for (const Sphere& s : cover.spheres) {
      const auto r = static_cast<double>(s.radius);
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_LT(std::abs(static_cast<double>(s.center[axis])) + r, size[axis] / 2);
      }
    }
    for (int i = 0; i < 20 * 20 * 6; ++i) {  // points on the faces
      Vec3d p{(i % 20 / 19.0 - 0.5), (i / 20 % 20 / 19.0 - 0.5), i / 400 % 2 == 0 ? 0.5 : -0.5};
      for (int turns = i / 800; turns > 0; --turns) p = {p.z, p.x, p.y};
      p = {p.x * size.x, p.y * size.y, p.z * size.z};
      double least = 1;
      for (const Sphere& s : cover.spheres) {
        least = std::min(least, norm(p - to_double(s.center)) - static_cast<double>(s.radius));
      }
      farthest = std::max(farthest, least);
    }
    EXPECT_LE(farthest, 1.1 * standoff);  // between the points that are watched
    EXPECT_LE(farthest_standoff(make_box(size), cover.spheres), standoff);
    EXPECT_GT(farthest, 0.5 * standoff);  // no more spheres than are needed
  }
  EXPECT_EQ(cover_solid(make_box(size), 1e-4, 7).value().stop, PackStop::count);
  EXPECT_FALSE(cover_solid(make_box(size), 0, 7));
}

TEST(Robot, Links_are_where_the_joints_put_them) {
  const Robot robot = test::arm();
  ASSERT_EQ(robot.joints().size(), 3u);
  EXPECT_EQ(robot.joints()[0].name, "shoulder");
  EXPECT_EQ(robot.joints()[0].upper, 2);
  EXPECT_TRUE(std::isinf(robot.joints()[1].upper));
  EXPECT_FALSE(robot.joints()[2].turns);
  EXPECT_EQ(robot.joints()[2].upper, 0.03);  // of the one that follows
  ASSERT_EQ(std::vector(robot.links().begin(), robot.links().end()),
            (std::vector<std::string>{"upper", "fore", "left", "right"}));
  EXPECT_LE(robot.standoff(), 0.01);
  const double a = 0.4, b = -0.7, slide = 0.02;
  const std::vector<double> joints{a, b, slide};
  std::vector<Pose> X_WL(4);
  ASSERT_TRUE(robot.place(joints, {}, X_WL));
  const auto turned = [](double angle, const Vec3d& p) {
    return Vec3d{p.x, std::cos(angle) * p.y - std::sin(angle) * p.z,
                 std::sin(angle) * p.y + std::cos(angle) * p.z};
  };
  const Vec3d elbow = turned(a, {0, 0, 0.3});
  const Vec3d left = elbow + turned(a + b, {0, 0.01 + slide, 0.22}),
              right = elbow + turned(a + b, {0, -0.01 - slide, 0.22});
  EXPECT_LT(norm(X_WL[1].translation - elbow), 1e-12);
  EXPECT_LT(norm(X_WL[2].translation - left), 1e-12);
  EXPECT_LT(norm(X_WL[3].translation - right), 1e-12);
  const Vec3d p{0.1, 0.2, 0.3};
  EXPECT_LT(norm(X_WL[3] * p - right - turned(a + b, p)), 1e-12);
}

TEST(Robot, Clearance_is_that_of_the_nearest_sphere_and_its_gradient_that_of_differences) {
  const test::SeenWall wall;
  const Robot robot = test::arm();
  const RobotContact contact = RobotContact::create(robot, Place::cpu(), 2).value();
  test::Random random(1);
  constexpr std::size_t kNum = 60;
  const std::vector<double> joints = random_joints(random, kNum);
  std::vector<double> clearance(kNum), gradient(3 * kNum), each(4 * kNum), each_gradient(12 * kNum);
  std::vector<std::int32_t> link(kNum);
  RobotAnswers to;
  to.clearance = clearance.data();
  to.link = link.data();
  to.clearance_by_joint = gradient.data();
  to.link_clearance = each.data();
  to.link_clearance_by_joint = each_gradient.data();
  to.clearance_limit = 0.5;
  ASSERT_TRUE(contact.measure(wall.scene, {joints, base()}, to));
  int num_outside = 0, num_links = 0;
  for (std::size_t i = 0; i < kNum; ++i) {
    std::vector<Pose> X_WL(4);
    double next = 1;  // m, of the second nearest sphere
    const auto exact_of = [&](std::size_t l, const std::vector<double>& at) {
      EXPECT_TRUE(robot.place(at, base(), X_WL));
      double least = 1;
      next = 1;
      for (const Sphere& s : robot.tool(l).spheres()) {
        const double z = (X_WL[l] * to_double(s.center)).z;
        next = std::min(next, kWallDepth - z - static_cast<double>(s.radius));
        if (next < least) std::swap(next, least);
      }
      return least;
    };
    const auto exact = [&](const std::vector<double>& at) {
      std::pair<double, int> least{1, -1};
      for (int l = 0; l < 4; ++l) {
        least = std::min(least, {exact_of(static_cast<std::size_t>(l), at), l});
      }
      return least;
    };
    const std::vector<double> at(joints.begin() + static_cast<std::ptrdiff_t>(3 * i),
                                 joints.begin() + static_cast<std::ptrdiff_t>(3 * i + 3));
    for (std::size_t l = 0; l < 4; ++l) {
      const double alone = exact_of(l, at);
      if (!(alone > 0.005 && alone < 0.4)) continue;
      EXPECT_NEAR(each[4 * i + l], alone, 2e-4);
      if (next < alone + 4e-4) continue;  // no derivative: either sphere may be the nearest one
      ++num_links;
      for (std::size_t j = 0; j < 3; ++j) {
        constexpr double kStep = 1e-6;
        std::vector<double> more = at, less = at;
        more[j] += kStep;
        less[j] -= kStep;
        EXPECT_NEAR(each_gradient[3 * (4 * i + l) + j],
                    (exact_of(l, more) - exact_of(l, less)) / (2 * kStep), 1e-4);
      }
    }
    const auto [value, decider] = exact(at);
    if (!(value > 0.005 && value < 0.4)) continue;
    ++num_outside;
    EXPECT_NEAR(clearance[i], value, 2e-4);
    EXPECT_EQ(link[i], decider);
    for (std::size_t j = 0; j < 3; ++j) {
      constexpr double kStep = 1e-6;
      std::vector<double> more = at, less = at;
      more[j] += kStep;
      less[j] -= kStep;
      EXPECT_NEAR(gradient[3 * i + j], (exact(more).first - exact(less).first) / (2 * kStep), 1e-4)
          << i << " " << j;
    }
  }
  EXPECT_GT(num_outside, 30);
  EXPECT_GT(num_links, 60);
  // Without those of the other links, which need not be found then: the same bits.
  for (const double limit : {0.5, 0.1}) {
    std::vector<double> few(kNum), few_gradient(3 * kNum);
    std::vector<std::int32_t> few_link(kNum);
    RobotAnswers all = to, least;
    all.clearance_limit = least.clearance_limit = limit;
    least.clearance = few.data();
    least.link = few_link.data();
    least.clearance_by_joint = few_gradient.data();
    ASSERT_TRUE(contact.measure(wall.scene, {joints, base()}, all));
    ASSERT_TRUE(contact.measure(wall.scene, {joints, base()}, least));
    EXPECT_EQ(few, clearance);
    EXPECT_EQ(few_link, link);
    EXPECT_EQ(few_gradient, gradient);
  }
  to.clearance_limit = 0.5;
  ASSERT_TRUE(contact.measure(wall.scene, {joints, base()}, to));
  std::vector<std::uint8_t> hits(kNum);
  for (const double margin : {0.0, 0.03}) {
    ASSERT_TRUE(contact.any(wall.scene, {joints, base()}, margin, hits.data()));
    for (std::size_t i = 0; i < kNum; ++i) EXPECT_EQ(hits[i] == 1, clearance[i] < margin);
  }
}

TEST(Robot, A_link_that_is_deep_inside_is_named_and_none_where_nothing_is_near) {
  const test::SeenWall wall;
  const RobotContact contact = RobotContact::create(test::arm(), Place::cpu(), 1).value();
  const std::vector<double> joints(3);
  for (const auto& [z, wanted] :
       {std::pair{3.0, -0.1}, std::pair{-0.8, 0.1}}) {  // m, behind and before
    double clearance = 0;
    std::int32_t link = -2;
    std::vector<double> gradient(3, 1.0), each(4);
    RobotAnswers to;
    to.clearance = &clearance;
    to.link = &link;
    to.clearance_by_joint = gradient.data();
    for (double* const all : {static_cast<double*>(nullptr), each.data()}) {
      to.link_clearance = all;
      ASSERT_TRUE(contact.measure(wall.scene, {joints, {{0, 0, z}, {}}}, to));
      EXPECT_EQ(clearance, wanted);
      EXPECT_EQ(gradient, std::vector<double>(3));
      if (wanted > 0) {
        EXPECT_EQ(link, -1);
      } else {
        ASSERT_TRUE(link >= 0 && link < 4);
      }
    }
    EXPECT_EQ(each[static_cast<std::size_t>(std::max(link, 0))], wanted);
  }
}

TEST(Robot, Joint_torques_do_the_work_of_the_wrenches) {
  const test::SeenWall wall;
  const Robot robot = test::arm();
  const RobotContact contact = RobotContact::create(robot, Place::cpu(), 1).value();
  const std::vector<double> joints{0.4, 0.3, 0.02, 0.1, 0.9, 0.01};  // into the wall
  std::vector<double> wrench(2 * 4 * 6), torque(2 * 3), volume(2), unseen(2);
  RobotAnswers to;
  to.wrench = wrench.data();
  to.joint_torque = torque.data();
  to.volume = volume.data();
  to.unseen = unseen.data();
  ASSERT_TRUE(contact.measure(wall.scene, {joints, base()}, to));
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_GT(volume[i], 1e-6);
    EXPECT_GT(unseen[i], 0);
    EXPECT_LT(unseen[i], 1);
    for (std::size_t j = 0; j < 3; ++j) {
      constexpr double kStep = 1e-6;
      std::vector<Pose> more(4), less(4);
      std::vector<double> at(joints.begin() + static_cast<std::ptrdiff_t>(3 * i),
                             joints.begin() + static_cast<std::ptrdiff_t>(3 * i + 3));
      at[j] += kStep;
      ASSERT_TRUE(robot.place(at, base(), more));
      at[j] -= 2 * kStep;
      ASSERT_TRUE(robot.place(at, base(), less));
      double work = 0;
      for (std::size_t l = 0; l < 4; ++l) {
        const double* w = wrench.data() + 6 * (4 * i + l);
        const Vec3d C = robot.tool(l).sphere_mass().center_of_mass;
        const Vec3d moved = (more[l] * C - less[l] * C) / (2 * kStep);
        const Quaternion turn = more[l].rotation * conjugate(less[l].rotation);
        const Vec3d spin = Vec3d{turn.x, turn.y, turn.z} * ((turn.w < 0 ? -2 : 2) / (2 * kStep));
        work += dot(Vec3d{w[0], w[1], w[2]}, moved) + dot(Vec3d{w[3], w[4], w[5]}, spin);
      }
      EXPECT_NEAR(torque[3 * i + j], work, 1e-6 * std::abs(work) + 1e-12);
    }
  }
}

TEST(Robot, Comes_back_from_its_file_and_no_other) {
  const test::TemporaryFolder folder;
  const Robot robot =
      test::arm()
          .with_tool(Tool::pack(make_box({0.02, 0.02, 0.1}), {.max_spheres = 9}).value(), "pen",
                     "fore", {{0, 0, 0.3}, {}})
          .value();
  const std::filesystem::path path = folder.path() / "arm.palprobot";
  ASSERT_TRUE(robot.save(path));
  const Robot again = Robot::open(path).value();
  EXPECT_EQ(*again.to_bytes(), *robot.to_bytes());
  EXPECT_EQ(again.links().back(), "pen");
  EXPECT_EQ(again.num_spheres(), robot.num_spheres());
  EXPECT_EQ(again.standoff(), robot.standoff());
  std::string bytes = *robot.to_bytes();
  bytes[bytes.size() / 2] ^= 1;
  EXPECT_NE(Robot::from_bytes(bytes).error().message.find("checksum"), std::string::npos);
  EXPECT_NE(
      Robot::from_bytes(*tool_to_bytes(robot.tool(0))).error().message.find("a tool, not a robot"),
      std::string::npos);
  EXPECT_NE(Robot::from_bytes("solid").error().message.find("neither a URDF"), std::string::npos);
  EXPECT_FALSE(load_tool(path));
}

TEST(Robot, Is_taken_out_of_an_image_with_what_it_holds) {
  const Robot robot =
      test::arm()
          .with_tool(Tool::pack(make_box({0.02, 0.02, 0.2}), {.max_spheres = 9}).value(), "pen",
                     "fore", {{0, 0, 0.4}, {}})
          .value();
  const std::vector<double> joints{0, 0, 0.01};
  std::vector<Pose> X_WL(5);
  ASSERT_TRUE(robot.place(joints, base(), X_WL));
  DepthFrame frame;
  frame.width = 320;
  frame.height = 240;
  frame.unit = 0.001;
  frame.pixels.assign(320 * 240, 900);  // behind the arm
  const Intrinsics k{200, 200, 159.5, 119.5};
  ASSERT_TRUE(robot.remove_from(frame, k, joints, base()));
  for (const Pose& X : X_WL) {
    const Vec3d p = X * Vec3d{0, 0, 0.01};
    const auto u = static_cast<std::size_t>(std::lround(k.fx * p.x / p.z + k.cx)),
               v = static_cast<std::size_t>(std::lround(k.fy * p.y / p.z + k.cy));
    EXPECT_TRUE(v >= 240 || frame.pixels[v * 320 + u] == 0) << u << " " << v;
  }
  EXPECT_EQ(frame.pixels[0], 900);
  EXPECT_GT(std::ranges::count(frame.pixels, 900), 50000);

  const auto told = [&](double padding) {
    const Status status = robot.remove_from(frame, k, joints, base(), padding);
    return status ? std::string() : status.error().message;
  };
  const std::vector<std::uint16_t> before = frame.pixels;
  for (const double padding : {-0.01, 0.2, static_cast<double>(NAN), HUGE_VAL}) {
    EXPECT_NE(told(padding).find("padding"), std::string::npos) << padding;
  }
  EXPECT_EQ(frame.pixels, before);
  EXPECT_EQ(told(0), "");
  frame.pixels.resize(320 * 120);
  EXPECT_NE(told(0).find("38400 for 320 x 240"), std::string::npos) << told(0);
  frame.height = 0;
  EXPECT_NE(told(0), "");
  frame.height = -120;
  frame.width = -320;
  EXPECT_NE(told(0), "");
}

TEST(Robot, A_missed_standoff_is_noted) {
  const Robot whole = test::arm();
  EXPECT_TRUE(whole.notes().empty());
  EXPECT_EQ(whole.tool(0).packing().stop, PackStop::standoff);
  RobotPacking packing;
  packing.max_spheres = 3;
  const Robot robot = Robot::from_urdf(test::kRobotUrdf, "arm.urdf", packing).value();
  ASSERT_FALSE(robot.notes().empty());
  EXPECT_EQ(robot.notes().front().find("link 'upper' has surface"), 0u);
  EXPECT_NE(robot.notes().front().find("not within 10 mm"), std::string::npos);
  EXPECT_EQ(robot.tool(0).packing().stop, PackStop::count);
  EXPECT_GT(robot.standoff(), packing.standoff);
}

TEST(Robot, Limits_without_a_position_are_refused_in_files_too) {
  std::string bytes = *test::arm().to_bytes();
  const auto bytes_of = [](double lower, double upper) {
    const double limits[2] = {lower, upper};
    std::string text(sizeof limits, 0);
    std::memcpy(text.data(), limits, sizeof limits);
    return text;
  };
  const std::size_t at = bytes.find(bytes_of(-2, 2));
  ASSERT_NE(at, std::string::npos);
  const auto told = [&](double lower, double upper) {
    bytes.replace(at, 16, bytes_of(lower, upper)).resize(bytes.size() - 8);
    const std::uint64_t sum = xxh3_of_long(bytes);
    bytes.append(reinterpret_cast<const char*>(&sum), sizeof sum);
    const auto robot = Robot::from_bytes(bytes);
    return robot ? std::string() : robot.error().message;
  };
  EXPECT_EQ(told(-1, 1), "");
  EXPECT_EQ(told(-HUGE_VAL, HUGE_VAL), "");
  for (const double at_infinity : {HUGE_VAL, -HUGE_VAL, 1e7}) {
    EXPECT_NE(told(at_infinity, at_infinity).find("'shoulder' has no position"), std::string::npos);
  }
}

TEST(Robot, Bad_input_is_refused_in_a_sentence) {
  const Robot robot = test::arm();
  const RobotContact contact = RobotContact::create(robot, Place::cpu(), 1).value();
  const test::SeenWall wall;
  double clearance[2] = {};
  std::uint8_t held[2] = {};
  RobotAnswers to;
  to.clearance = clearance;
  to.held = held;
  const auto told = [&](const RobotPoses& poses) {
    const Status status = contact.measure(wall.scene, poses, to);
    return status ? std::string() : status.error().message;
  };
  const auto has = [](const std::string& text, const char* part) {
    return text.find(part) != std::string::npos;
  };
  std::vector<double> joints{0, 0, 0.01, 5, 0, 0.01};
  EXPECT_TRUE(has(told({std::span(joints).first(4)}), "3 joints"));
  EXPECT_TRUE(has(told({joints, {}, true}), "joint 'shoulder' of configuration 1 is at 5"));
  EXPECT_EQ(told({joints}), "");
  EXPECT_EQ(held[0], 0);
  EXPECT_EQ(held[1], 1);
  const double at_limit = clearance[1];
  joints[3] = 2;
  EXPECT_EQ(told({joints}), "");
  EXPECT_EQ(clearance[1], at_limit);
  joints[1] = std::nan("");
  EXPECT_TRUE(has(told({joints}), "joint 'elbow' of configuration 0 is not a number"));
  EXPECT_TRUE(has(told({std::span(joints).first(0), {{NAN, 0, 0}, {}}}), "base"));

  const auto error = [](std::string text, const std::string& from = "", const std::string& by = "",
                        const RobotPacking& packing = {}) {
    if (!from.empty()) text.replace(text.find(from), from.size(), by);
    return Robot::from_urdf(text, "arm.urdf", packing).error().message;
  };
  const std::string& arm = test::kRobotUrdf;
  EXPECT_TRUE(has(error(arm, "lower=\"-2\"", "lower=\"low\""), "no numbers"));
  EXPECT_TRUE(has(error(arm, "lower=\"-2\"", "lower=\"3\""), "no position within"));
  EXPECT_TRUE(has(error(arm, "type=\"revolute\"", "type=\"floating\""), "floating"));
  RobotPacking packing;
  packing.skip = {"uper"};
  EXPECT_TRUE(has(error(arm, "", "", packing), "the nearest one is 'upper'"));
  packing.skip = {"upper", "fore", "left", "right"};
  EXPECT_TRUE(has(error(arm, "", "", packing), "no link has a shape"));
  EXPECT_TRUE(has(error("<robot><link name='a'/></robot>"), "no joint moves"));
  packing.standoff = 0;
  EXPECT_TRUE(has(error(arm, "", "", packing), "standoff"));
  EXPECT_TRUE(has(robot.with_tool(robot.tool(0), "pen", "hand").error().message, "no link 'hand'"));
  EXPECT_TRUE(has(robot.with_tool(robot.tool(0), "fore", "fore").error().message, "no link has"));
}

}  // namespace
}  // namespace palpate
