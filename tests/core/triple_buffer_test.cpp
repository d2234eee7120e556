#include "src/core/internal/triple_buffer.h"

#include <gtest/gtest.h>

#include <array>
#include <thread>

#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

TEST(TripleBuffer, NothingIsNewUntilSomethingIsPublished) {
  TripleBuffer<int> buffer(7);
  EXPECT_FALSE(buffer.refresh());
  EXPECT_EQ(buffer.value(), 7);
  buffer.draft() = 1;
  EXPECT_FALSE(buffer.refresh());
  buffer.publish();
  EXPECT_TRUE(buffer.refresh());
  EXPECT_EQ(buffer.value(), 1);
  EXPECT_FALSE(buffer.refresh());
  EXPECT_EQ(buffer.value(), 1);
}

TEST(TripleBuffer, TheNewestValueWins) {
  TripleBuffer<int> buffer;
  for (int round = 0; round < 50; ++round) {
    for (int i = 0; i <= round % 7; ++i) buffer.publish(100 * round + i);
    ASSERT_TRUE(buffer.refresh());
    ASSERT_EQ(buffer.value(), 100 * round + round % 7);
    ASSERT_FALSE(buffer.refresh());
  }
}

TEST(TripleBuffer, TheReadersValueStaysWhileTheWriterGoesOn) {
  TripleBuffer<int> buffer;
  buffer.publish(1);
  ASSERT_TRUE(buffer.refresh());
  for (int i = 2; i < 20; ++i) {
    buffer.draft() = -i;
    EXPECT_EQ(buffer.value(), 1);
    buffer.publish(i);
    EXPECT_EQ(buffer.value(), 1);
  }
}

TEST(TripleBuffer, DoesNotAllocate) {
  TripleBuffer<std::array<double, 64>> buffer;
  const test::AllocationCounter counter;
  for (int i = 0; i < 100; ++i) {
    buffer.draft().fill(i);
    buffer.publish();
    buffer.refresh();
  }
  EXPECT_EQ(counter.count(), 0u);
}

// Values are large, so that a torn one would show; they only get newer, and the last one arrives.
TEST(TripleBuffer, TwoThreadsSeeWholeValuesInOrder) {
  constexpr int kNumValues = 100'000;
  using Value = std::array<int, 100>;
  TripleBuffer<Value> buffer;
  std::thread writer([&buffer] {
    for (int i = 1; i <= kNumValues; ++i) {
      buffer.draft().fill(i);
      buffer.publish();
    }
  });
  int last = 0, num_torn = 0, num_older = 0;
  while (last < kNumValues) {
    if (!buffer.refresh()) {
      std::this_thread::yield();
      continue;
    }
    const Value& value = buffer.value();
    for (int x : value) num_torn += x != value[0];
    num_older += value[0] <= last;
    last = value[0];
  }
  writer.join();
  EXPECT_EQ(num_torn, 0);
  EXPECT_EQ(num_older, 0);
  EXPECT_FALSE(buffer.refresh());
}

}  // namespace
}  // namespace palpate
