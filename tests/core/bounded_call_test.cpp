#include "src/core/bounded_call.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
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

TEST(BoundedCall, OneThreadMakesItsCallsInTurn) {
  static BoundedThread& thread = *new BoundedThread;
  std::thread::id first, second, inner;
  EXPECT_TRUE(thread.call(600, [&] {
    first = std::this_thread::get_id();
    EXPECT_TRUE(thread.call(600, [&] { inner = std::this_thread::get_id(); }));
  }));
  EXPECT_TRUE(thread.call(600, [&] { second = std::this_thread::get_id(); }));
  EXPECT_EQ(first, second);
  EXPECT_EQ(first, inner);
  EXPECT_NE(first, std::this_thread::get_id());
  // After one that hangs, others wait for it; they are made once it comes back.
  const auto gate = std::make_shared<Gate>();
  const auto later = std::make_shared<std::atomic<bool>>(false);
  EXPECT_FALSE(thread.call(0.01, [gate] { gate->pass(); }));
  EXPECT_FALSE(thread.call(0.01, [later] { *later = true; }));
  EXPECT_FALSE(*later);
  gate->is_open = true;
  EXPECT_TRUE(wait_for([&] { return later->load(); }));
  EXPECT_TRUE(wait_for([] { return !is_any_call_hung(); }));
}

// Nothing that is thrown there may end the program.
TEST(BoundedCall, WhatIsThrownIsThrownByTheCall) {
  const auto work = [] { throw std::runtime_error("no"); };
  EXPECT_THROW(returns_within(60, work), std::runtime_error);
  static BoundedThread& thread = *new BoundedThread;
  EXPECT_THROW(thread.call(60, work), std::runtime_error);
  EXPECT_TRUE(thread.call(60, [] {}));
}

}  // namespace
}  // namespace palpate
