// A recorded run is repeated to the bit.
#pragma once

#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>

#include "palpate/session/run.h"

namespace palpate::test {

/// Nothing differs and, unless records were `lost`, nothing is left out.
inline ReplayOutcome repeated(const std::filesystem::path& run, const ReplayOptions& options = {},
                              bool lost = false) {
  const auto replay = replay_run(run, options);
  EXPECT_TRUE(replay) << replay.error().message;
  if (!replay) return {};
  EXPECT_EQ(replay->difference, "") << run;
  if (!lost) {
    EXPECT_EQ(replay->note, "") << run;
  }
  return *replay;
}

/// A computer that is busy with other things may have lost records, which the run counts: then
/// what is there repeats.
inline void expect_repeats(const std::filesystem::path& run, const RunOutcome& outcome,
                           const ReplayOptions& options = {}) {
  const bool lost = outcome.loop.num_lost_records > 0;
  if (lost) {
    std::printf("%llu records were lost and counted\n",
                static_cast<unsigned long long>(outcome.loop.num_lost_records));
  }
  const ReplayOutcome replay = repeated(run, options, lost);
  if (lost) return;
  EXPECT_EQ(replay.num_ticks, outcome.loop.num_ticks);
  EXPECT_EQ(replay.num_contacts, outcome.loop.num_contacts);
}

/// The outcome of `run`, which runs again if records were lost on a busy computer.
template <class Run>
Result<RunOutcome> without_losses(const Run& run) {
  Result<RunOutcome> outcome = run();
  for (int k = 0; k < 4 && outcome && outcome->loop.num_lost_records > 0; ++k) outcome = run();
  return outcome;
}

}  // namespace palpate::test
