// A run that is recorded once and given to every method gives what each measures at those poses.
#include "eval/studies/recorded_run.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "eval/studies/interaction.h"

namespace palpate::eval {
namespace {

TEST(RecordedRun, GivesEveryMethodTheSameHandAndFrame) {
  Settings settings;
  settings.quick = true;
  Context context(settings);
  const auto scene = simulated_interaction(context);
  ASSERT_TRUE(scene) << scene.error().message;
  const auto tool = context.tool(scene->shape, scene->size, 300);
  ASSERT_TRUE(tool) << tool.error().message;
  const auto path = hand_path(scene->frame, **tool, 0.2, 120);
  ASSERT_TRUE(path) << path.error().message;
  const auto run = RecordedRun::record(**tool, scene->picture, path->X_WT);
  ASSERT_TRUE(run) << run.error().message;
  auto query = query_on(scene->frame, **tool);
  for (const Method& method : all_methods()) {
    SCOPED_TRACE(method.name);
    const auto measured = run->by(method.options);
    ASSERT_TRUE(measured) << measured.error().message;
    ASSERT_EQ(measured->size(), path->X_WT.size());
    int num_in_contact = 0;
    for (std::size_t i = 0; i < measured->size(); ++i) {
      const Penetration want = query->query(path->X_WT[i], method.options);
      EXPECT_EQ((*measured)[i].penetration.volume, want.volume) << i;
      EXPECT_EQ((*measured)[i].penetration.measure_W.force, want.measure_W.force) << i;
      num_in_contact += want.volume > 0;
    }
    EXPECT_GT(num_in_contact, 60);
  }
}

/// A wall that comes nearer, in frames at 30 Hz.
std::vector<DepthFrame> coming_wall(DepthStreamInfo& stream) {
  constexpr int kWidth = 80, kHeight = 60;
  stream = {kWidth, kHeight, {80, 80, 39.5, 29.5}, 0.001, 30, std::nullopt, "a wall"};
  std::vector<DepthFrame> frames;
  for (int k = 0; k < 30; ++k) {
    const auto depth = static_cast<std::uint16_t>(600 - k);
    frames.push_back({kWidth, kHeight, 0.001,
                      std::vector<std::uint16_t>(static_cast<std::size_t>(kWidth * kHeight), depth),
                      5 + k / 30.0});
  }
  return frames;
}

// The hand that is recorded felt the wall; who replays it is where it was, whatever they feel.
TEST(RecordedRun, OfAHandThatFeelsGivesEveryMethodTheSamePoses) {
  Settings settings;
  settings.quick = true;
  Context context(settings);
  const auto tool = context.tool("box", 0.05, 300);
  ASSERT_TRUE(tool) << tool.error().message;
  DepthStreamInfo stream;
  const auto frames = coming_wall(stream);
  const auto intended = [](double time) {
    return Pose{{0, 0, 0.57 + 0.03 * std::min(1.0, 3 * time)}, {}};
  };
  const auto run = RecordedRun::touch(**tool, stream, frames, intended);
  ASSERT_TRUE(run) << run.error().message;
  const auto difference = run->repeat();
  ASSERT_TRUE(difference) << difference.error().message;
  EXPECT_EQ(*difference, "");
  std::vector<Pose> poses;
  for (const Method& method : all_methods_alike()) {
    SCOPED_TRACE(method.name);
    const auto ticks = run->by(method.options);
    ASSERT_TRUE(ticks) << ticks.error().message;
    ASSERT_NEAR(static_cast<double>(ticks->size()), 1000, 2);  // as long as 30 frames last
    double deepest = 0;
    for (std::size_t i = 0; i < ticks->size(); ++i) {
      const TickRecord& tick = (*ticks)[i];
      if (method.options.method == MethodKind::weighted) poses.push_back(tick.step.X_WT);
      EXPECT_EQ(norm(tick.step.X_WT.translation - poses.at(i).translation), 0) << i;
      deepest = std::max(deepest, tick.penetration.volume / full_volume(**tool, method.options));
    }
    EXPECT_GT(deepest, 0.05);
    // At rest, the wall holds it back.
    const TickRecord& last = ticks->back();
    EXPECT_GT(intended(last.time).translation.z - last.step.X_WT.translation.z, 0.005);
  }
}

}  // namespace
}  // namespace palpate::eval
