#include "src/core/internal/guarded.h"

#include <gtest/gtest.h>

#include <thread>

#include "tests/test_util/own_nice.h"

namespace palpate {
namespace {

using test::own_nice;

int rank_of_a_thread(ThreadRank rank) {
  int reported = 0, seen = 0;
  std::thread([&] {
    reported = take_rank(rank);
    seen = own_nice();
  }).join();
  EXPECT_EQ(reported, seen);
  return seen;
}

TEST(ThreadRank, SurfacesComeBeforeTheRecorderThenFramesThenTheViewer) {
  const int usual = own_nice();
  if (usual > 12) GTEST_SKIP() << "SKIPPED: nice leaves no room for an order";
  const int surface = rank_of_a_thread(ThreadRank::surface),
            recorder = rank_of_a_thread(ThreadRank::recorder),
            frames = rank_of_a_thread(ThreadRank::frames),
            viewer = rank_of_a_thread(ThreadRank::viewer);
  EXPECT_LE(surface, usual);  // before other programs where that is allowed
  EXPECT_LT(usual, recorder);
  EXPECT_LT(recorder, frames);
  EXPECT_LT(frames, viewer);
  EXPECT_EQ(own_nice(), usual);  // of the others nobody's
}

}  // namespace
}  // namespace palpate
