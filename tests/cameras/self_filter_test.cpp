// Depth images after the self filter, against exact rays and closed forms.
#include "palpate/cameras/cameras.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/contact/contact.h"
#include "palpate/gpu/devices.h"
#include "palpate/mesh/mesh.h"
#include "scenes/scene.h"
#include "src/cameras/internal/link_image.h"
#include "tests/cameras/robot_scene.h"
#include "tests/test_util/hull_scenes.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using test::Random;

constexpr int kWidth = 640, kHeight = 480;
const Intrinsics kIntrinsics{525, 525, 319.5, 239.5};

std::size_t index(int u, int v) { return static_cast<std::size_t>(v * kWidth + u); }

constexpr Intrinsics kSmall{262.5, 262.5, 159.5, 119.5};
constexpr int kSmallWidth = 320, kSmallHeight = 240;

/// The largest number within so many pixels of each one, slowly.
std::vector<double> widened(const std::vector<double>& numbers, int radius) {
  std::vector<double> rows(numbers.size(), 0), all(numbers.size(), 0);
  const auto at = [](int u, int v) { return static_cast<std::size_t>(v * kSmallWidth + u); };
  for (int v = 0; v < kSmallHeight; ++v) {
    for (int u = 0; u < kSmallWidth; ++u) {
      for (int i = std::max(u - radius, 0); i <= std::min(u + radius, kSmallWidth - 1); ++i) {
        rows[at(u, v)] = std::max(rows[at(u, v)], numbers[at(i, v)]);
      }
    }
  }
  for (int v = 0; v < kSmallHeight; ++v) {
    for (int i = std::max(v - radius, 0); i <= std::min(v + radius, kSmallHeight - 1); ++i) {
      for (int u = 0; u < kSmallWidth; ++u) {
        all[at(u, v)] = std::max(all[at(u, v)], rows[at(u, i)]);
      }
    }
  }
  return all;
}

/// Exact inverse depth of the links alone, 0 where there is none.
std::vector<double> exact_front(const std::vector<RobotLink>& links,
                                const std::vector<Pose>& X_CL) {
  scenes::Scene scene;
  scene.intrinsics = kSmall;
  scene.width = kSmallWidth;
  scene.height = kSmallHeight;
  for (std::size_t i = 0; i < links.size(); ++i) {
    scene.bodies.push_back({links[i].name, links[i].mesh, nullptr, X_CL[i]});
  }
  std::vector<double> front;
  for (const float depth : scenes::render_depth(scene, 0)) {
    front.push_back(depth > 0 ? 1 / static_cast<double>(depth) : 0);
  }
  return front;
}

class LinkImageTest : public testing::TestWithParam<double> {};

/// Every pixel that shows a link is removed from the link's depth less the padding on, and none
/// that lies farther away than the padding can be seen.
TEST_P(LinkImageTest, LiesAroundExactRays) {
  const double padding = GetParam();
  Random random(7);
  int num_shown = 0, num_free = 0;
  LinkImage image(kSmall, padding);
  for (int round = 0; round < 6; ++round) {
    const std::vector<RobotLink> links = test::arm_links();
    std::vector<Pose> X_CL;
    image.begin(kSmallWidth, kSmallHeight);
    for (const RobotLink& link : links) {
      // From beside the image and right before the camera to far away.
      X_CL.push_back({random.in_box(0.45) + Vec3d{0, 0, 0.25 + 0.25 * round}, random.rotation(3)});
      image.add(link.mesh, X_CL.back());
    }
    image.draw();
    const std::vector<double> front = exact_front(links, X_CL);
    double nearest = 10;
    for (std::size_t k = 0; k < links.size(); ++k) {
      for (const Vec3d& p_L : links[k].mesh.vertices) {
        nearest = std::min(nearest, std::max((X_CL[k] * p_L).z, kNearestLink));
      }
    }
    const int reach = static_cast<int>(1.3 * padding * kSmall.fx / nearest) + 5;
    const std::vector<double> around = widened(front, reach);
    for (int v = 0; v < kSmallHeight; ++v) {
      for (int u = 0; u < kSmallWidth; ++u) {
        const auto i = static_cast<std::size_t>(v * kSmallWidth + u);
        const double limit = image.limit_at(u, v);
        if (front[i] > 0 && 1 / front[i] > kNearestLink) {
          ++num_shown;
          ASSERT_LE(limit, 1 / front[i] - padding + 1e-5) << u << " " << v << " of " << round;
        }
        // Links beside the image may reach into it.
        if (std::min({u, v, kSmallWidth - 1 - u, kSmallHeight - 1 - v}) <= reach) continue;
        num_free += around[i] == 0;
        ASSERT_GE(limit, around[i] > 0 ? 1 / around[i] - padding - 0.015 : 1e9)
            << u << " " << v << " of " << round;
      }
    }
  }
  EXPECT_GT(num_shown, 10000);
  EXPECT_GT(num_free, 20000);
}
INSTANTIATE_TEST_SUITE_P(Paddings, LinkImageTest, testing::Values(0.0, 0.01, 0.03));

// A long one that leads away from the camera is padded everywhere as its pieces are.
TEST(LinkImage, PadsWhatIsLongAsItsPieces) {
  constexpr double kNear = -0.2, kFar = 1.0, kPadding = 0.02;
  constexpr int kPieces = 120;
  const auto rod = [](double from, double to, LinkImage& image) {
    image.add(make_box({0.02, 0.02, to - from}), {{0.05, 0, 0.5 * (from + to)}, {}});
  };
  LinkImage whole(kIntrinsics, kPadding), pieces(kIntrinsics, kPadding);
  whole.begin(kWidth, kHeight);
  rod(kNear, kFar, whole);
  whole.draw();
  pieces.begin(kWidth, kHeight);
  for (int i = 0; i < kPieces; ++i) {
    const double length = (kFar - kNear) / kPieces;
    rod(kNear + i * length, kNear + (i + 1) * length, pieces);
  }
  pieces.draw();
  int num_whole = 0, num_pieces = 0;
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      num_whole += whole.limit_at(u, v) < 0.5;
      num_pieces += pieces.limit_at(u, v) < 0.5;
    }
  }
  EXPECT_GT(num_pieces, kWidth * kHeight / 50);
  EXPECT_LT(num_whole, num_pieces + kWidth * kHeight / 20);
}

TEST(LinkImage, HonorsThePaddingAroundABall) {
  // All that is nearer than the padding to a ball, in space and not in the image, is removed.
  Random random(11);
  const double padding = 0.025;
  const TriangleMesh ball = make_icosphere(0.1, 4);
  double inner = 1;  // of the ball that lies inside the mesh
  for (const auto& ids : ball.triangles) {
    const Vec3d &a = ball.vertices[ids[0]], &b = ball.vertices[ids[1]], &c = ball.vertices[ids[2]];
    inner = std::min(inner, std::abs(dot(a, normalized(cross(b - a, c - a)))));
  }
  LinkImage image(kIntrinsics, padding);
  int num_near = 0, num_far = 0;
  for (int round = 0; round < 40; ++round) {
    // Every fourth one as near as its surface may be seen.
    const double nearest = round % 4 == 0 ? 0.2 : 0.75;
    const Vec3d center = random.in_box(0.1 + 0.4 * (round % 4 != 0)) +
                         Vec3d{0, 0, random.uniform(nearest, round % 4 == 0 ? 0.3 : 2.5)};
    image.begin(kWidth, kHeight);
    image.add(ball, {center, random.rotation(3)});
    image.draw();
    for (int i = 0; i < 3000; ++i) {
      const Vec3d p = center + random.in_box(0.2);
      const double u = kIntrinsics.fx * p.x / p.z + kIntrinsics.cx,
                   v = kIntrinsics.fy * p.y / p.z + kIntrinsics.cy;
      const int col = static_cast<int>(std::lround(u)), row = static_cast<int>(std::lround(v));
      if (col < 0 || row < 0 || col >= kWidth || row >= kHeight) continue;
      const double apart = norm(p - center);
      if (apart < inner + padding) {
        ++num_near;
        ASSERT_LE(image.limit_at(col, row), p.z + 1e-6) << apart;
      } else if (p.z < center.z - 0.1 - padding - 1e-3) {
        ++num_far;
        ASSERT_GT(image.limit_at(col, row), p.z);  // in front of all of it
      }
    }
  }
  EXPECT_GT(num_near, 1000);
  EXPECT_GT(num_far, 1000);
}

TEST(LinkImage, SeesWiresThinnerThanAPixel) {
  LinkImage image(kIntrinsics, 0);
  image.begin(kWidth, kHeight);
  const TriangleMesh wire = make_cylinder(0.0002, 0.6, 8);  // a seventh of a pixel wide
  const Pose X_CL{{0.013, -0.02, 1.0}, axis_angle({0.3, 1, 0.1}, 1.3)};
  image.add(wire, X_CL);
  image.draw();
  for (double along = -0.299; along < 0.299; along += 0.0005) {
    const Vec3d p = X_CL * Vec3d{0, 0, along};
    const int u = static_cast<int>(std::lround(kIntrinsics.fx * p.x / p.z + kIntrinsics.cx));
    const int v = static_cast<int>(std::lround(kIntrinsics.fy * p.y / p.z + kIntrinsics.cy));
    ASSERT_LE(image.limit_at(u, v), p.z) << along;
  }
}

TEST(LinkImage, LooksOutOfAHousing) {
  // A camera in a box of 6 cm with a plate behind it sees nothing of either.
  LinkImage image(kIntrinsics, 0.01);
  image.begin(kWidth, kHeight);
  image.add(make_box({0.06, 0.06, 0.06}), {});
  image.add(make_box({2, 2, 0.1}), {{0, 0, -0.5}, {}});
  image.draw();
  DepthFrame frame{kWidth, kHeight, 0.001, std::vector<std::uint16_t>(index(0, kHeight), 500)};
  EXPECT_EQ(image.remove_from(frame), 0);
  // One that reaches from behind the camera to far in front of it is cut, not lost.
  image.begin(kWidth, kHeight);
  image.add(make_box({0.02, 0.02, 3}), {{0.1, 0, 0}, {}});
  image.draw();
  EXPECT_LE(image.limit_at(static_cast<int>(319.5 + 525 * 0.1 / 0.5), 240), 0.5);
  EXPECT_TRUE(std::isinf(image.limit_at(100, 240)));
}

TEST(LinkImage, ForgetsTheImageBefore) {
  LinkImage used(kIntrinsics, 0.02), fresh(kIntrinsics, 0.02);
  const TriangleMesh box = make_box({0.1, 0.2, 0.3});
  for (int i = 0; i < 20; ++i) {
    used.begin(kWidth, kHeight);
    used.add(box, {{0.05 * i - 0.5, 0.02 * i, 0.4 + 0.05 * i}, {}});
    used.draw();
  }
  fresh.begin(kWidth, kHeight);
  fresh.add(box, {{0.05 * 19 - 0.5, 0.02 * 19, 0.4 + 0.05 * 19}, {}});
  fresh.draw();
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) ASSERT_EQ(used.limit_at(u, v), fresh.limit_at(u, v));
  }
}

TEST(SelfFilter, TakesTheRobotAndNothingElse) {
  // A camera that moves along, a table, and an arm that swings in front of it.
  const auto X_WC = [](double t) {
    return Pose{{0.1 * t, 0, -0.05 * t}, axis_angle({0, 1, 0}, 0.1 * t)};
  };
  const auto with = test::frames_of_arm(X_WC, true), without = test::frames_of_arm(X_WC, false);
  SelfFilterOptions options;
  options.padding = 0.01;
  const auto filter =
      SelfFilter::create(test::arm_links(), std::make_shared<test::SwingingArm>(), options);
  ASSERT_TRUE(filter);
  auto source = filter->applied_to(std::make_unique<test::FrameList>(with)).value();
  DepthFrame frame;
  for (std::size_t k = 0; k < with.size(); ++k) {
    ASSERT_TRUE(source->next(frame).value());
    EXPECT_EQ(frame.X_WC, with[k].X_WC);
    int num_arm = 0, num_lost = 0, num_table = 0;
    for (std::size_t i = 0; i < frame.pixels.size(); ++i) {
      const bool is_arm = with[k].pixels[i] != without[k].pixels[i];
      num_arm += is_arm;
      const int desired = is_arm || frame.pixels[i] == 0 ? 0 : without[k].pixels[i];
      ASSERT_EQ(frame.pixels[i], desired) << i << " of frame " << k;
      num_lost += !is_arm && frame.pixels[i] == 0;
      num_table += !is_arm;
    }
    EXPECT_GT(num_arm, 8000);
    EXPECT_LT(num_lost, num_arm);  // the padding
    EXPECT_LT(num_lost, num_table / 10);
  }
  EXPECT_FALSE(source->next(frame).value());
  EXPECT_TRUE(source->take_notes().empty());
}

TEST(SelfFilter, TakesTheSameOnAGpuAndSaysWhereThereIsNone) {
  const auto frames = test::frames_of_arm([](double) { return Pose{}; }, true);
  const auto filter = SelfFilter::create(test::arm_links(), std::make_shared<test::SwingingArm>());
  const auto on_cpu = filter->applied_to(std::make_unique<test::FrameList>(frames)).value();
  const auto on_gpu =
      filter->applied_to(std::make_unique<test::FrameList>(frames), Place::cuda()).value();
  DepthFrame want, got;
  for (std::size_t k = 0; k < 3; ++k) {
    ASSERT_TRUE(on_cpu->next(want).value());
    ASSERT_TRUE(on_gpu->next(got).value());
    EXPECT_NE(want.pixels, frames[k].pixels);
    EXPECT_EQ(got.pixels, want.pixels);
  }
  EXPECT_TRUE(on_cpu->take_notes().empty());
  const auto notes = on_gpu->take_notes();
  if (find_gpus()) {
    EXPECT_TRUE(notes.empty()) << notes[0];
  } else {
    ASSERT_EQ(notes.size(), 1u);
    EXPECT_NE(notes[0].find("the robot is removed on the CPU: "), std::string::npos) << notes[0];
  }
}

TEST(SelfFilter, RefusesMeshesThatAreNoNumbers) {
  std::vector<RobotLink> links = test::arm_links();
  links[1].mesh.vertices[3].y = std::numeric_limits<double>::quiet_NaN();
  const auto filter = SelfFilter::create(links, std::make_shared<test::SwingingArm>());
  ASSERT_FALSE(filter);
  EXPECT_NE(filter.error().message.find("'forearm'"), std::string::npos) << filter.error().message;
}

TEST(SelfFilter, LeavesAHandInFrontOfTheArm) {
  auto frames = test::frames_of_arm([](double) { return Pose{}; }, true);
  frames.resize(1);
  const auto arm = frames[0].pixels;
  const auto table = test::frames_of_arm([](double) { return Pose{}; }, false)[0].pixels;
  std::vector<std::size_t> hand;
  for (std::size_t i = 0; i < arm.size(); ++i) {
    if (arm[i] == table[i] || i % 3 != 0) continue;
    hand.push_back(i);
    frames[0].pixels[i] = static_cast<std::uint16_t>(arm[i] * 0.6);  // 30 cm and more in front
  }
  const auto filter = SelfFilter::create(test::arm_links(), std::make_shared<test::SwingingArm>());
  auto source = filter->applied_to(std::make_unique<test::FrameList>(frames)).value();
  DepthFrame frame;
  ASSERT_TRUE(source->next(frame).value());
  ASSERT_GT(hand.size(), 1000u);
  for (const std::size_t i : hand) ASSERT_EQ(frame.pixels[i], frames[0].pixels[i]);
}

TEST(SelfFilter, LeavesFramesOutForWhichNobodyKnowsThePoses) {
  const auto frames = test::frames_of_arm([](double) { return Pose{}; }, true);
  auto poses = std::make_shared<test::SwingingArm>();
  poses->unknown_from = frames[2].timestamp;
  poses->unknown_to = frames[4].timestamp;
  const auto filter = SelfFilter::create(test::arm_links(), poses);
  auto source = filter->applied_to(std::make_unique<test::FrameList>(frames)).value();
  DepthFrame frame;
  std::vector<double> stamps;
  while (*source->next(frame)) stamps.push_back(frame.timestamp);
  EXPECT_EQ(stamps.size(), frames.size() - 3);
  EXPECT_EQ(std::ranges::count(stamps, frames[3].timestamp), 0);
  const auto notes = source->take_notes();
  ASSERT_EQ(notes.size(), 2u);
  EXPECT_NE(notes[0].find("the arm is asleep"), std::string::npos) << notes[0];
  EXPECT_NE(notes[1].find("3 depth images were dropped"), std::string::npos) << notes[1];
}

TEST(SelfFilter, RefusesWhatIsOutOfRange) {
  SelfFilterOptions options;
  options.padding = -0.01;
  const auto filter = SelfFilter::create({}, std::make_shared<test::SwingingArm>(), options);
  ASSERT_FALSE(filter);
  EXPECT_NE(filter.error().message.find("robot.padding"), std::string::npos);
}

/// Contact of a tool in images of an arm in front of a table.
class ArmInContact : public testing::Test {
 protected:
  static std::vector<DepthFrame> filtered(const std::vector<DepthFrame>& frames) {
    const auto filter =
        SelfFilter::create(test::arm_links(), std::make_shared<test::SwingingArm>());
    auto source = filter->applied_to(std::make_unique<test::FrameList>(frames)).value();
    std::vector<DepthFrame> out;
    DepthFrame frame;
    while (*source->next(frame)) out.push_back(frame);
    return out;
  }
  /// Valid as long as the test.
  SurfaceBlend look_at(const DepthFrame& frame) {
    SensorOptions options;
    options.num_threads = 1;
    options.field.one_of_several = true;
    const Camera camera{kWidth, kHeight, kIntrinsics};
    sensors_.push_back(Sensor::create(camera, Place::cpu(), options).value());
    const SurfaceView surface = sensors_.back().update(frame);
    return {surface, surface, 1};
  }
  Penetration felt(const SurfaceBlend& view, const Vec3d& at) const {
    return query_->measure({&view, 1}, Pose{at, {}}, {.unseen_volume = true}).penetration;
  }

  const std::vector<DepthFrame> with_ = test::frames_of_arm([](double) { return Pose{}; }, true),
                                without_ =
                                    test::frames_of_arm([](double) { return Pose{}; }, false);
  const Tool tool_ = test::ball_tool(0.03, 600);
  const std::unique_ptr<ContactQuery> query_ =
      make_contact_query(Place::cpu(), tool_, FieldMethod{}).value();
  const double volume_ = tool_.sphere_mass().volume;
  std::vector<Sensor> sensors_;
};

TEST_F(ArmInContact, IsNotThere) {
  const SurfaceBlend with = look_at(with_[0]), without = look_at(without_[0]),
                     left = look_at(filtered(with_)[0]);
  const Vec3d in_arm = test::SwingingArm::middle_of_link(1, with_[0].timestamp);
  EXPECT_GT(felt(with, in_arm).volume, 0.9 * volume_);
  EXPECT_EQ(felt(left, in_arm).volume, 0);
  // Half way between arm and table: solid before, not measured now, and it says so.
  const Vec3d behind = in_arm * (0.5 * (in_arm.z + test::kTableDepth) / in_arm.z);
  EXPECT_GT(felt(with, behind).volume, 0.9 * volume_);
  EXPECT_EQ(felt(left, behind).volume, 0);
  // The rims of the hole are filled, 40 pixels wide: some spheres lie within 2 cm of them.
  EXPECT_GT(felt(left, behind).unseen_volume, 0.75 * volume_);
  EXPECT_EQ(felt(without, behind).unseen_volume, 0);
}

TEST_F(ArmInContact, LeavesTheTableAsItIs) {
  constexpr int kFar = 120;  // pixels from the arm
  const DepthFrame frame = filtered(with_)[0];
  const SurfaceBlend left = look_at(frame), without = look_at(without_[0]);
  const auto is_near_arm = [&](const Vec3d& p) {
    const int u = static_cast<int>(kIntrinsics.fx * p.x / p.z + kIntrinsics.cx);
    const int v = static_cast<int>(kIntrinsics.fy * p.y / p.z + kIntrinsics.cy);
    for (int row = std::max(v - kFar, 0); row < std::min(v + kFar, kHeight); ++row) {
      for (int col = std::max(u - kFar, 0); col < std::min(u + kFar, kWidth); ++col) {
        if (frame.pixels[index(col, row)] != without_[0].pixels[index(col, row)]) return true;
      }
    }
    return false;
  };
  int num = 0;
  for (double x = -0.7; x < 0.71; x += 0.07) {
    for (double y = -0.5; y < 0.51; y += 0.1) {
      const Vec3d at{x, y, test::kTableDepth - 0.01};
      if (is_near_arm(at)) continue;
      ++num;
      const Penetration one = felt(left, at), other = felt(without, at);
      EXPECT_GT(other.volume, 0.1 * volume_);
      EXPECT_EQ(one.volume, other.volume);
      EXPECT_EQ(one.measure_W.force, other.measure_W.force);
      EXPECT_EQ(one.measure_W.torque, other.measure_W.torque);
    }
  }
  EXPECT_GT(num, 10);
}

TEST_F(ArmInContact, WithAMemoryTheTableBehindItStays) {
  // The table is seen first, then the arm comes.
  std::vector<DepthFrame> frames(4, without_[0]);
  const DepthFrame hidden = filtered(with_)[0];
  frames.insert(frames.end(), 3, hidden);
  test::HullScene scene;
  test::add_memory(scene, {kWidth, kHeight, kIntrinsics}, frames, {}, 1, false);
  const Vec3d in_arm = test::SwingingArm::middle_of_link(1, with_[0].timestamp);
  const Vec3d on_table = in_arm * ((test::kTableDepth - 0.01) / in_arm.z);
  const double want = felt(look_at(without_[0]), on_table).volume;
  ASSERT_GT(want, 0.2 * volume_);
  EXPECT_LT(felt(look_at(hidden), on_table).volume, 0.1 * want);  // nothing is measured there
  EXPECT_NEAR(felt(scene.views[0], on_table).volume, want, 0.01 * volume_);
  EXPECT_EQ(felt(scene.views[0], in_arm).volume, 0);
}

}  // namespace
}  // namespace palpate
