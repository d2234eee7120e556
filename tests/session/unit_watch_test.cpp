// A wall at half a meter and a tool that goes to it, with depth in every unit read as every other.
#include "src/session/recording/unit_watch.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

constexpr int kSize = 120;

/// Returns the doubt about counts of `stored` meters that are read as `reported`; the tool goes
/// from `from` to `to`.
std::string doubt(double stored, double reported, double from, double to, double wall = 0.5) {
  const Tool tool = test::small_tool();
  DepthStreamInfo stream;
  stream.width = stream.height = kSize;
  stream.intrinsics = {150, 150, 59.5, 59.5};
  stream.name = "camera";
  NewestFrames seen({stream});
  UnitWatch watch(tool, 1);
  FrameRecord record;
  record.unit = reported;
  const auto count = static_cast<std::uint16_t>(std::lround(wall / stored));
  seen.take(record, {kSize, kSize, reported, std::vector<std::uint16_t>(kSize * kSize, count)});
  for (int k = 0; k <= 100; ++k) {
    const double z = from + (to - from) * k / 100;
    if (seen.is_due(0.05 * k)) watch.look(seen.all(), {{0, 0, z}, {}});
  }
  const std::vector<std::string> doubts = watch.doubts();
  EXPECT_TRUE(watch.doubts().empty()) << "once";
  return doubts.empty() ? "" : doubts.front();
}

TEST(UnitWatch, NamesTheRightUnitWhateverItIsReadAs) {
  const double units[] = {0.001, 0.00025, 0.0002, 0.000125, 0.0001};
  for (const double stored : units) {
    for (const double reported : units) {
      if (std::abs(std::log(stored / reported)) < std::log(2.2)) continue;
      char right[80];
      std::snprintf(right, sizeof right, "--depth-unit %g (of a --camera ?unit=%g) would", stored,
                    stored);
      EXPECT_NE(doubt(stored, reported, 0.4, 0.49).find(right), std::string::npos)
          << stored << " read as " << reported << ": " << doubt(stored, reported, 0.4, 0.49);
    }
    EXPECT_EQ(doubt(stored, stored, 0.4, 0.49), "");
  }
}

TEST(UnitWatch, HasNoDoubtsWhereTheToolMeetsSomethingOrMayBeElsewhere) {
  EXPECT_EQ(doubt(0.001, 0.001, 0.1, 0.45), "") << "it comes from far away";
  EXPECT_EQ(doubt(0.001, 0.001, 0.45, 0.7), "") << "it goes through";
  EXPECT_EQ(doubt(0.001, 0.001, 0.15, 0.16), "") << "no two units are 3.1 times apart";
  EXPECT_EQ(doubt(0.001, 0.0002, -0.5, -0.4), "") << "it is behind the camera";
}

TEST(UnitWatch, HasNoDoubtsWithoutMeasurements) {
  EXPECT_EQ(doubt(0.001, 0.0002, 0.4, 0.49, 0), "");
}

}  // namespace
}  // namespace palpate
