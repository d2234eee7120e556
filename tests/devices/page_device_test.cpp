#include "palpate/devices/devices.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <thread>

#include "src/core/internal/monotonic_clock.h"
#include "src/devices/device_kinds.h"
#include "src/devices/internal/twist_between.h"
#include "src/devices/software/page_hand.h"
#include "tests/devices/tick_log.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

constexpr double kTick = 1e-3;  // s
constexpr PageNumber kPage = 7, kOther = 8;

Pose at(double x, double y = 0, double z = 0) { return {{x, y, z}, {}}; }

/// A handle and the hand that follows it, on a clock of the test's.
class PageHandTest : public ::testing::Test {
 protected:
  PageHandTest() : handle_(std::make_shared<PageHandle>()), hand_(handle_) {
    EXPECT_TRUE(hand_.begin());
    tick();
  }

  const DeviceState& tick(int count = 1, const Wrench& felt = {}) {
    for (int i = 0; i < count; ++i) {
      state_.time = now_ += kTick;
      EXPECT_TRUE(hand_.write(felt));
      EXPECT_TRUE(hand_.read(state_));
    }
    return state_;
  }
  /// Takes hold at the origin of the page's poses.
  void hold() {
    ASSERT_TRUE(handle_->hold(kPage, now_));
    ASSERT_TRUE(handle_->move(kPage, {}, now_));
    tick();
  }
  std::string refusal(const Status& status) {
    EXPECT_FALSE(status);
    return status ? "" : status.error().message;
  }

  double now_ = 100;
  DeviceState state_;
  std::shared_ptr<PageHandle> handle_;
  PageHand hand_;
};

TEST_F(PageHandTest, RestsUntilSomebodyHoldsIt) {
  tick(50, {{5, 0, 0}, {}});
  EXPECT_TRUE(state_.is_valid);
  EXPECT_EQ(state_.X_BH, Pose{});
  EXPECT_EQ(state_.V_BH.linear, Vec3d{});
  EXPECT_EQ(state_.V_BH.angular, Vec3d{});
  EXPECT_EQ(state_.buttons, 0u);
}

TEST_F(PageHandTest, FollowsAStepAsACriticallyDampedSpring) {
  hold();
  EXPECT_EQ(state_.buttons, 1u);
  const double step = 0.02, start = now_;
  ASSERT_TRUE(handle_->move(kPage, at(step), now_));
  for (int i = 0; i < 100; ++i) {
    tick();
    const double wt = PageHand::kFollow * (now_ - start);
    EXPECT_NEAR(state_.X_BH.translation.x, step * (1 - (1 + wt) * std::exp(-wt)), 1e-12);
    EXPECT_NEAR(state_.V_BH.linear.x, step * PageHand::kFollow * wt * std::exp(-wt), 1e-10);
    EXPECT_EQ(state_.X_BH.rotation, Quaternion{});
  }
}

TEST_F(PageHandTest, TurnsByTheSameLaw) {
  hold();
  const Vec3d axis = normalized(Vec3d{1, -2, 0.5});
  const double angle = 0.3, start = now_;
  ASSERT_TRUE(handle_->move(kPage, {{}, axis_angle(axis, angle)}, now_));
  for (int i = 0; i < 100; ++i) {
    tick();
    const double wt = PageHand::kFollow * (now_ - start);
    const Vec3d turned = angle * (1 - (1 + wt) * std::exp(-wt)) * axis;
    EXPECT_LT(norm(rotation_vector(state_.X_BH.rotation) - turned), 1e-12);
  }
}

TEST_F(PageHandTest, IsBehindASteadyHandByTwoOverOmega) {
  hold();
  const double speed = 0.1, start = now_;
  double most = 0, least = 1;
  for (int i = 1; i <= 60; ++i) {  // poses 60 times a second, ticks between them
    const double due = start + i / 60.0;
    while (now_ + kTick <= due) {
      tick();
      if (i > 30) most = std::max(most, state_.V_BH.linear.y);
      if (i > 30) least = std::min(least, state_.V_BH.linear.y);
    }
    ASSERT_TRUE(handle_->move(kPage, at(0, speed * (due - start)), due));
  }
  // The page's steps are smoothed: the sampled ramp is half a frame behind the true one.
  const double behind = speed * (now_ - start) - state_.X_BH.translation.y;
  EXPECT_NEAR(behind, speed * (2 / PageHand::kFollow + 0.5 / 60), speed * 0.5 / 60);
  EXPECT_GT(least, 0.8 * speed);
  EXPECT_LT(most, 1.2 * speed);
}

TEST_F(PageHandTest, NeverMovesFasterThanAHandDoes) {
  hold();
  ASSERT_TRUE(handle_->move(kPage, {{0.25, 0, 0}, axis_angle({0, 0, 1}, 2.5)}, now_));
  const double start = now_;
  double fastest = 0, turned = 0;
  while (now_ < start + 0.2) {
    tick();
    fastest = std::max(fastest, norm(state_.V_BH.linear));
    turned = std::max(turned, norm(state_.V_BH.angular));
  }
  EXPECT_LE(fastest, PageHand::kFastest * (1 + 1e-12));
  EXPECT_GT(fastest, 0.9 * PageHand::kFastest);
  EXPECT_LE(turned, PageHand::kFastestTurn * (1 + 1e-12));
  EXPECT_GT(turned, 0.9 * PageHand::kFastestTurn);
}

TEST_F(PageHandTest, TheFirstPoseOfAHoldMovesNothing) {
  hold();
  ASSERT_TRUE(handle_->move(kPage, {{0.03, 0, 0}, axis_angle({0, 1, 0}, 0.2)}, now_));
  tick(250);
  const Pose before = state_.X_BH;
  // The same page anew, and another one: their first pose is where the handle is.
  for (const PageNumber page : {kPage, kOther}) {
    if (page == kOther) handle_->release(kPage);
    ASSERT_TRUE(handle_->hold(page, now_));
    const Pose reported{{5, -3, 2}, axis_angle({1, 0, 0}, 1.5)};
    ASSERT_TRUE(handle_->move(page, reported, now_));
    tick(100);
    EXPECT_LT(norm(state_.X_BH.translation - before.translation), 1e-6);
    EXPECT_LT(norm(rotation_between(state_.X_BH.rotation, before.rotation)), 1e-6);
  }
  // The handle moves by the difference to the first pose.
  ASSERT_TRUE(handle_->move(kOther, {{5, -3, 2.01}, axis_angle({1, 0, 0}, 1.5)}, now_));
  tick(250);
  EXPECT_LT(norm(state_.X_BH.translation - before.translation - Vec3d{0, 0, 0.01}), 1e-6);
}

TEST_F(PageHandTest, WhoIsSilentHoldsNothing) {
  hold();
  const int silence = static_cast<int>(PageHand::kSilence / kTick);
  const int giving_way = static_cast<int>(PageHand::kGivesWay / kTick);
  tick(silence - 10);
  EXPECT_EQ(state_.X_BH, Pose{});
  tick(20 + giving_way - 20);
  EXPECT_EQ(state_.buttons, 1u);  // it still gives way
  tick(20);
  EXPECT_EQ(state_.buttons, 0u);
  EXPECT_TRUE(state_.is_valid);
  // A pose that comes after all holds it again.
  ASSERT_TRUE(handle_->move(kPage, at(0.001), now_));
  tick();
  EXPECT_EQ(state_.buttons, 1u);
}

TEST_F(PageHandTest, LetGoItGivesWayToASpringAndThenStays) {
  hold();
  ASSERT_TRUE(handle_->move(kPage, at(0.02), now_));
  tick(250);
  const double x = state_.X_BH.translation.x;
  handle_->release(kPage);
  // A spring from the origin, as stiff as the device allows, and a tick of delay.
  const double stiffness = PageHandle::limits().max_stiffness;
  double expected = x, felt = 0;
  for (int i = 0; i < 400; ++i) {
    felt = -stiffness * state_.X_BH.translation.x;
    tick(1, {{felt, 0, 0}, {}});
    expected *= 1 - kTick / PageHand::kYield;
    ASSERT_NEAR(state_.X_BH.translation.x, expected, 1e-9);
  }
  EXPECT_LT(std::abs(felt), 1e-3);
  tick(200);
  EXPECT_EQ(state_.buttons, 0u);
  const Pose rest = state_.X_BH;
  tick(50, {{8, 8, 8}, {0.1, 0, 0}});
  EXPECT_EQ(state_.X_BH, rest);
  EXPECT_EQ(state_.V_BH.linear, Vec3d{});
  EXPECT_EQ(state_.V_BH.angular, Vec3d{});
}

TEST_F(PageHandTest, StaysWithinItsWorkspace) {
  hold();
  for (int i = 1; i <= 200; ++i) {
    ASSERT_TRUE(handle_->move(kPage, at(0.01 * i, 0.01 * i), now_));
    tick(20);
  }
  EXPECT_NEAR(norm(state_.X_BH.translation), PageHandle::limits().workspace_radius, 1e-9);
}

TEST_F(PageHandTest, OnePageHoldsItAtATime) {
  EXPECT_FALSE(handle_->is_held());
  EXPECT_NE(refusal(handle_->move(kPage, {}, now_)).find("not held"), std::string::npos);
  hold();
  EXPECT_TRUE(handle_->is_held());
  EXPECT_NE(refusal(handle_->hold(kOther, now_)).find("another page"), std::string::npos);
  EXPECT_NE(refusal(handle_->move(kOther, at(0.01), now_)).find("another page"), std::string::npos);
  handle_->release(kOther);  // without effect: it does not hold
  handle_->release(0);
  EXPECT_TRUE(handle_->is_held());
  tick(100);
  EXPECT_EQ(state_.X_BH, Pose{});

  handle_->release(kPage);
  EXPECT_FALSE(handle_->is_held());
  ASSERT_TRUE(handle_->hold(kOther, now_));
  EXPECT_FALSE(handle_->move(kPage, {}, now_));
  // A page that is silent for kPatience does not keep others from the handle.
  const double later = now_ + PageHandle::kPatience;
  EXPECT_FALSE(handle_->hold(kPage, later - 0.01));
  EXPECT_TRUE(handle_->hold(kPage, later + 0.01));
  EXPECT_FALSE(handle_->move(kOther, {}, later + 0.02));
}

TEST_F(PageHandTest, RefusesWhatIsNoPoseOfAHand) {
  hold();
  const double nan = std::nan(""), inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -inf, 101.0, 1e300}) {
    EXPECT_NE(refusal(handle_->move(kPage, at(bad), now_)).find("finite"), std::string::npos);
    EXPECT_FALSE(handle_->move(kPage, {{}, {0, 0, bad, 1}}, now_));
  }
  for (const Quaternion& q : {Quaternion{0, 0, 0, 0}, Quaternion{0, 0, 0, 1.01},
                              Quaternion{1, 1, 1, 1}, Quaternion{1e200, 0, 0, 0}}) {
    EXPECT_NE(refusal(handle_->move(kPage, {{}, q}, now_)).find("unit quaternion"),
              std::string::npos);
  }
  EXPECT_NE(refusal(handle_->move(kPage, at(0.5), now_)).find("jumped"), std::string::npos);
  EXPECT_NE(refusal(handle_->move(kPage, {{}, {1, 0, 0, 0}}, now_ - 5)).find("jumped"),
            std::string::npos);
  tick(100);
  EXPECT_EQ(state_.X_BH, Pose{});  // none of them has moved it

  // In the time that a hand needs, it may be there.
  EXPECT_TRUE(handle_->move(kPage, at(0.5), now_ + 0.2));
  // Nearly unit is made unit.
  EXPECT_TRUE(handle_->move(kPage, {{0.5, 0, 0}, {0, 0, 0, 1.0005}}, now_ + 0.2));
  tick(10);
  EXPECT_EQ(state_.X_BH.rotation, Quaternion{});
}

TEST_F(PageHandTest, TickingAllocatesNothing) {
  hold();
  ASSERT_TRUE(handle_->move(kPage, {{0.05, 0, 0}, axis_angle({0, 0, 1}, 0.5)}, now_));
  const test::AllocationCounter counter;
  tick(50);
  handle_->release(kPage);
  tick(50, {{1, 2, 3}, {}});
  EXPECT_EQ(counter.count(), 0u);
}

TEST(PageDevice, TicksAndStartsAnewHeldByNobody) {
  const auto handle = std::make_shared<PageHandle>();
  const auto device = make_page_device(handle);
  EXPECT_EQ(device->info().kind, "page");
  EXPECT_EQ(device->info().num_buttons, 1);
  test::TickLog log;
  ASSERT_TRUE(device->start(log.tick()));
  ASSERT_TRUE(handle->hold(kPage, monotonic_now()));
  EXPECT_TRUE(test::eventually(
      [&] { return handle->move(kPage, {}, monotonic_now()) && log.last().buttons == 1; }));
  device->stop();
  const std::size_t before = log.size();
  ASSERT_TRUE(device->start(log.tick()));
  EXPECT_TRUE(test::eventually([&] { return log.size() > before + 20; }));
  EXPECT_EQ(log.last().buttons, 0u);
  EXPECT_TRUE(device->status());
}

TEST(PageDevice, IsOpenedByTheProgramThatServesThePage) {
  const auto device = open_device("page");
  ASSERT_FALSE(device);
  EXPECT_NE(device.error().message.find("palpate touch"), std::string::npos);
  EXPECT_EQ(open_device("page:1").error().code, Errc::invalid_argument);
}

}  // namespace
}  // namespace palpate
