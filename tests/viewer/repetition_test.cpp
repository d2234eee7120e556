// Moments of a recording, repeated to the bit.
#include "src/viewer/sources/repetition.h"

#include <gtest/gtest.h>

#include "tests/viewer/path_view.h"

namespace palpate {
namespace {

using namespace test::path_view;  // NOLINT: all of it
using test::TemporaryFolder;

TEST(Repetition, GivesTheSameBitsFromAnywhere) {
  const TemporaryFolder folder;
  const RunSettings settings = path_settings(TimeMode::predict);
  record_path(folder.path() / "run", settings);
  auto run = open_recorded_run(folder.path() / "run");
  ASSERT_TRUE(run);
  const auto always = [] { return true; };
  for (const int tick_number : {70, 20, 55}) {
    Repetition repetition(**run);
    const auto query = (*run)->query_at(tick_number / kRate);
    ASSERT_TRUE(query);
    ASSERT_TRUE(*repetition.go_to(*query, (*run)->settings(0), always));
    const Penetration repeated = repetition.measure();
    play_to(static_cast<std::size_t>(tick_number), settings, 12, [&](Pipeline& pipeline) {
      const Penetration& measured = pipeline.contact().penetration;
      EXPECT_GT(measured.volume, 0);
      EXPECT_EQ(repeated.volume, measured.volume);
      EXPECT_EQ(repeated.measure_W.force, measured.measure_W.force);
      EXPECT_EQ(repeated.measure_W.torque, measured.measure_W.torque);
    });
  }
}

// Frames that an abandoned jump has only passed are processed again before they give a force.
TEST(Repetition, GivesTheSameBitsAfterAJumpThatWasGivenUp) {
  const TemporaryFolder folder;
  RunSettings settings = path_settings(TimeMode::latest);
  settings.time.average.kind = DepthAverage::kalman;
  record_path(folder.path() / "run", settings);
  auto run = open_recorded_run(folder.path() / "run");
  ASSERT_TRUE(run);
  const auto always = [] { return true; };
  const auto far = (*run)->query_at(70 / kRate), near = (*run)->query_at(20 / kRate);
  ASSERT_TRUE(far && near);
  Repetition fresh(**run);
  ASSERT_TRUE(*fresh.go_to(*near, (*run)->settings(0), always));
  const Penetration expected = fresh.measure();
  EXPECT_GT(expected.volume, 0);
  for (int num_pushed = 1; num_pushed < 8; ++num_pushed) {
    Repetition repetition(**run);
    int num_left = num_pushed;
    const auto gone = repetition.go_to(*far, (*run)->settings(0), [&] { return num_left-- > 0; });
    ASSERT_TRUE(gone);
    ASSERT_FALSE(*gone);
    ASSERT_TRUE(*repetition.go_to(*near, (*run)->settings(0), always));
    EXPECT_EQ(repetition.measure().volume, expected.volume) << num_pushed;
    EXPECT_EQ(repetition.measure().measure_W.force, expected.measure_W.force) << num_pushed;
  }
}

TEST(Repetition, LooksBackAsFarAsTheTimeOptionsDo) {
  TimeOptions time;
  EXPECT_EQ(num_lead_frames(time), 1);
  time.mode = TimeMode::latest;
  EXPECT_EQ(num_lead_frames(time), 0);
  time.average = {DepthAverage::moving, 8, 0.25, 0.03, 0};
  EXPECT_EQ(num_lead_frames(time), 8);
  time.average.kind = DepthAverage::exponential;
  EXPECT_EQ(num_lead_frames(time), 49);  // 0.75^48.02 is a millionth
  time.average.weight = 1e-9;
  EXPECT_EQ(num_lead_frames(time), kMaxLeadFrames);
  time.average.weight = 1;
  EXPECT_EQ(num_lead_frames(time), 0);
  time.average.kind = DepthAverage::kalman;
  EXPECT_EQ(num_lead_frames(time), kMaxLeadFrames);
  time = {};
  time.memory.kind = DepthMemory::on;
  EXPECT_EQ(num_lead_frames(time), kMaxLeadFrames + 1);
}

}  // namespace
}  // namespace palpate
