// A recorded run is repeated to the bit, as a whole and part by part.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>

#include "palpate/session/run.h"
#include "src/session/internal/run_folder.h"

namespace palpate::test {

/// Nothing differs and nothing is left out.
inline ReplayOutcome repeated(const std::filesystem::path& run, const ReplayOptions& options = {}) {
  const auto replay = replay_run(run, options);
  EXPECT_TRUE(replay) << replay.error().message;
  if (!replay) return {};
  EXPECT_EQ(replay->difference, "") << run;
  EXPECT_EQ(replay->note, "") << run;
  return *replay;
}

inline void expect_repeats(const std::filesystem::path& run, const RunOutcome& outcome,
                           const ReplayOptions& options = {}) {
  const ReplayOutcome replay = repeated(run, options);
  EXPECT_EQ(replay.num_ticks, outcome.loop.num_ticks);
  EXPECT_EQ(replay.num_contacts, outcome.loop.num_contacts);
}

inline void expect_parts_repeat(const std::filesystem::path& run, const RunOutcome& outcome) {
  expect_repeats(run, outcome);
  std::size_t num_ticks = 0;
  for (const auto& part : recording_parts(run)) num_ticks += repeated(part).num_ticks;
  EXPECT_EQ(num_ticks, outcome.loop.num_ticks);
}

}  // namespace palpate::test
