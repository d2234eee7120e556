#include "src/core/internal/bounded_call.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

using test::wait_for;

/// A call that hangs until it is let go.
struct Gate {
  std::atomic<bool> is_open = false, was_passed = false;
  void pass() {
    while (!is_open) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    was_passed = true;
  }
};

TEST(BoundedCall, WhatReturnsIsWaitedForAndWhatHangsIsNot) {
  int answer = 0;
  EXPECT_TRUE(returns_within(600, [&answer] { answer = 7; }));
  EXPECT_EQ(answer, 7);
  EXPECT_FALSE(is_any_call_hung());
  const auto gate = std::make_shared<Gate>();
  EXPECT_FALSE(returns_within(0.01, [gate] { gate->pass(); }));
  EXPECT_TRUE(is_any_call_hung());
  gate->is_open = true;
  EXPECT_TRUE(wait_for([] { return !is_any_call_hung(); }));
  EXPECT_TRUE(wait_for([&] { return gate.use_count() == 1; }));  // what it owns is free again
  EXPECT_TRUE(gate->was_passed);
}

// Nothing that is thrown there may end the program.
TEST(BoundedCall, WhatIsThrownIsThrownByTheCall) {
  const auto work = [] { throw std::runtime_error("no"); };
  EXPECT_THROW(returns_within(60, work), std::runtime_error);
}

LibraryThread& one() {
  static LibraryThread& thread = *new LibraryThread;
  return thread;
}

TEST(LibraryThread, DoesWhatManyAskForOneAfterTheOtherOnOneThread) {
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

TEST(LibraryThread, AnswersItselfAtOnceAndGivesWhatCanOnlyBeMoved) {
  const auto owned = one().call([] { return std::make_unique<int>(one().call([] { return 7; })); });
  EXPECT_EQ(*owned, 7);
}

TEST(LibraryThread, WhatAskedWorkThrowsReachesWhoAsked) {
  EXPECT_THROW(one().call([]() -> int { throw std::runtime_error("work"); }), std::runtime_error);
  EXPECT_EQ(one().call([] { return 8; }), 8);
}

TEST(LibraryThread, OneCallThatHangsHoldsUpTheNextButNotWhoAsked) {
  LibraryThread& thread = one();
  std::thread::id first, second, inner;
  EXPECT_TRUE(thread.returns_within(600, [&] {
    first = std::this_thread::get_id();
    EXPECT_TRUE(thread.returns_within(600, [&] { inner = std::this_thread::get_id(); }));
  }));
  EXPECT_TRUE(thread.returns_within(600, [&] { second = std::this_thread::get_id(); }));
  EXPECT_EQ(first, second);
  EXPECT_EQ(first, inner);
  EXPECT_NE(first, std::this_thread::get_id());
  // After one that hangs, others wait for it; they are made once it comes back.
  const auto gate = std::make_shared<Gate>();
  const auto later = std::make_shared<std::atomic<bool>>(false);
  EXPECT_FALSE(thread.returns_within(0.01, [gate] { gate->pass(); }));
  EXPECT_FALSE(thread.returns_within(0.01, [later] { *later = true; }));
  EXPECT_FALSE(*later);
  gate->is_open = true;
  EXPECT_TRUE(wait_for([&] { return later->load(); }));
  EXPECT_TRUE(wait_for([] { return !is_any_call_hung(); }));
}

}  // namespace
}  // namespace palpate
