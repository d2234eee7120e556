#include "src/core/lasting_thread.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

namespace palpate {
namespace {

LastingThread& one() {
  static LastingThread& thread = *new LastingThread;
  return thread;
}

TEST(LastingThread, DoesWhatManyAskForOneAfterTheOtherOnOneThread) {
  constexpr int kNumAskers = 8, kNumTimes = 200;
  std::vector<int> order;  // written without a lock
  std::atomic<int> num_inside = 0;
  std::vector<std::set<std::thread::id>> ids(kNumAskers);
  std::vector<std::thread> askers;
  for (std::size_t k = 0; k < kNumAskers; ++k) {
    askers.emplace_back([&, k] {
      for (int i = 0; i < kNumTimes; ++i) {
        const int given = one().call([&] {
          EXPECT_EQ(++num_inside, 1);
          order.push_back(i);
          ids[k].insert(std::this_thread::get_id());
          --num_inside;
          return i + static_cast<int>(k);
        });
        EXPECT_EQ(given, i + static_cast<int>(k));
      }
    });
  }
  for (std::thread& asker : askers) asker.join();
  EXPECT_EQ(order.size(), std::size_t{kNumAskers * kNumTimes});
  for (const auto& each : ids) {
    EXPECT_EQ(each.size(), 1U);
    EXPECT_EQ(each, ids[0]);
    EXPECT_NE(*each.begin(), std::this_thread::get_id());
  }
}

TEST(LastingThread, AnswersItselfAtOnceAndGivesWhatCanOnlyBeMoved) {
  const auto owned = one().call([] { return std::make_unique<int>(one().call([] { return 7; })); });
  EXPECT_EQ(*owned, 7);
}

TEST(LastingThread, WhatAskedWorkThrowsReachesWhoAsked) {
  EXPECT_THROW(one().call([]() -> int { throw std::runtime_error("work"); }), std::runtime_error);
  EXPECT_EQ(one().call([] { return 8; }), 8);
}

}  // namespace
}  // namespace palpate
