// Limit of a page's motions of the hand: the way of a hand in the time since its last pose.
#include <gtest/gtest.h>

#include <algorithm>

#include "palpate/haptics/device.h"

namespace palpate {
namespace {

// Poses come in bunches, up to 0.1 s late.
TEST(PageHandle, AHandComesNoFartherThanItsSpeedAllows) {
  constexpr PageNumber kPage = 3;
  const auto is_taken = [](double seconds, const Pose& X_BH) {
    PageHandle handle;
    EXPECT_TRUE(handle.hold(kPage, 50));
    EXPECT_TRUE(handle.move(kPage, {}, 50));
    return static_cast<bool>(handle.move(kPage, X_BH, 50 + seconds));
  };
  const Vec3d along = normalized(Vec3d{2, -1, 2});
  for (const double seconds : {0.0, 0.004, 0.5, 3.0}) {
    const double way = 3 * (seconds + 0.1);
    EXPECT_TRUE(is_taken(seconds, {0.999 * way * along, {}})) << seconds;
    EXPECT_FALSE(is_taken(seconds, {1.001 * way * along, {}})) << seconds;
  }
  for (const double seconds : {-1.0, 0.0, 0.0025}) {  // later a hand may have turned anywhere
    const double turn = 30 * (std::max(seconds, 0.0) + 0.1);
    EXPECT_TRUE(is_taken(seconds, {{}, axis_angle(along, 0.999 * turn)})) << seconds;
    EXPECT_FALSE(is_taken(seconds, {{}, axis_angle(along, 1.001 * turn)})) << seconds;
  }
}

}  // namespace
}  // namespace palpate
