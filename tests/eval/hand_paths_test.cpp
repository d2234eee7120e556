// A recorded hand as the motion of a tool.
#include "eval/studies/hand_paths.h"

#include <gtest/gtest.h>

namespace palpate::eval {
namespace {

TEST(RecordedHand, IsScaledAndAboutItsMiddle) {
  std::vector<TimedPose> poses;
  for (int i = 0; i < 2001; ++i) {
    const double a = 2 * kPi * i / 200.0;
    poses.push_back({100 + 0.01 * i,
                     {{5 + 0.1 * std::sin(a), 0.3 * std::cos(a), 2 + 0.05 * std::sin(3 * a)},
                      axis_angle({1, 0, 0}, 0.7 + 0.1 * std::sin(a))}});
  }
  const HandMotion hand = recorded_hand(poses);
  double side = 0, up = 0, in = 0, turn = 0, means = 0;
  constexpr int kNum = 1000;
  for (int i = 0; i < kNum; ++i) {
    const HandShift at = hand(i / static_cast<double>(kNum));
    side += at.side * at.side / kNum, up += at.up * at.up / kNum, in += at.in * at.in / kNum;
    turn += at.turn.x * at.turn.x / kNum;
    means += (at.side + at.up + at.in + at.turn.x) / kNum;
  }
  EXPECT_NEAR(std::sqrt((side + up) / 2), 0.015, 1e-4);
  EXPECT_NEAR(std::sqrt(up / side), 3, 0.01);  // as it was
  EXPECT_NEAR(std::sqrt(in), std::sqrt(0.5), 1e-3);
  EXPECT_NEAR(std::sqrt(turn), 0.1 * std::sqrt(0.5), 1e-4);
  EXPECT_NEAR(means, 0, 2e-3);
}

}  // namespace
}  // namespace palpate::eval
