#include "palpate/core/core.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <stdexcept>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/sanitized.h"

namespace palpate {
namespace {

TEST(ThreadPool, RunsEveryTaskOnce) {
  for (int num_threads : {1, 2, 4, 7}) {
    ThreadPool pool(num_threads);
    EXPECT_EQ(pool.num_threads(), num_threads);
    for (int num_tasks : {0, 1, 2, 5, 1000}) {
      std::vector<std::atomic<int>> runs(static_cast<std::size_t>(num_tasks));
      pool.parallel_for(num_tasks, [&](int task) { ++runs[static_cast<std::size_t>(task)]; });
      for (const std::atomic<int>& count : runs) EXPECT_EQ(count.load(), 1);
    }
  }
}

// Many short loops in a row: a worker that is late must not take tasks of the next loop.
TEST(ThreadPool, ShortLoopsInARow) {
  ThreadPool pool(4);
  std::vector<int> sums(8, 0);
  for (int loop = 0; loop < 20000; ++loop) {
    pool.parallel_for(8, [&](int task) { sums[static_cast<std::size_t>(task)] += task; });
  }
  for (int task = 0; task < 8; ++task)
    EXPECT_EQ(sums[static_cast<std::size_t>(task)], 20000 * task);
}

std::atomic<bool> is_held{true};

// A loop does not wait for threads that the system has not started yet.
TEST(ThreadPool, WaitsForNoThreadThatHasNotBegun) {
  is_held = true;
  ThreadPool pool(3, [] { is_held.wait(true); });
  for (int loop = 0; loop < 100; ++loop) {
    int sum = 0;  // of the calling thread alone
    pool.parallel_for(10, [&](int task) { sum += task; });
    EXPECT_EQ(sum, 45);
  }
  is_held = false;
  is_held.notify_all();
  std::atomic<int> num_waiting{0};
  // Each of three tasks waits for the other two: now all threads take part.
  pool.parallel_for(3, [&](int) {
    ++num_waiting;
    while (num_waiting < 3) std::this_thread::yield();
  });
  EXPECT_EQ(num_waiting, 3);
}

TEST(ThreadPool, DoesNotAllocatePerLoop) {
  ThreadPool pool(3);
  const test::AllocationCounter counter;
  int total = 0;
  for (int loop = 0; loop < 100; ++loop) pool.parallel_for(1, [&](int) { ++total; });
  std::atomic<int> shared{0};
  for (int loop = 0; loop < 100; ++loop) pool.parallel_for(10, [&](int) { ++shared; });
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_EQ(total, 100);
  EXPECT_EQ(shared.load(), 1000);
}

// As in a plain loop: the caller gets the exception, and no task runs any more.
TEST(ThreadPool, WhatATaskThrowsReachesTheCaller) {
  ThreadPool pool(3);
  for (int loop = 0; loop < 200; ++loop) {
    std::atomic<int> num_inside{0};
    const auto task = [&](int number) {
      ++num_inside;
      if (number % 2 == loop % 2) throw std::runtime_error("task");  // here and on other threads
      --num_inside;
    };
    EXPECT_THROW(pool.parallel_for(50, task), std::runtime_error);
    const int num_thrown = num_inside;
    EXPECT_TRUE(num_thrown >= 1 && num_thrown <= 3) << num_thrown;
    std::atomic<int> sum{0};
    pool.parallel_for(100, [&](int number) { sum += number; });
    EXPECT_EQ(sum, 4950);
  }
}

TEST(ThreadPoolDeathTest, RefusesALoopInsideALoop) {
#if defined(NDEBUG)
  GTEST_SKIP() << "SKIPPED: no assertions in Release";
#else
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_DEATH(
      {
        ThreadPool pool(2);
        pool.parallel_for(4, [&](int) { pool.parallel_for(4, [](int) {}); });
      },
      "assertion failed");
#endif
}

TEST(ThreadPool, ZeroMeansOnePerCore) {
  EXPECT_EQ(ThreadPool(0).num_threads(), std::max(1u, std::thread::hardware_concurrency()));
}

// In a process of its own that may map little more than it has: some stack is the last one.
TEST(ThreadPoolDeathTest, WorksWithAsManyThreadsAsTheSystemStarts) {
  if (test::kIsSanitized) GTEST_SKIP() << "sanitizers map memory of their own for each thread";
  EXPECT_EXIT(
      {
        std::size_t num_pages = 0;
        std::ifstream("/proc/self/statm") >> num_pages;
        const rlim_t most =
            num_pages * static_cast<std::size_t>(getpagesize()) + (std::size_t{100} << 20);
        rlimit limit;
        limit.rlim_cur = limit.rlim_max = most;
        setrlimit(RLIMIT_AS, &limit);
        ThreadPool pool(1000);
        std::atomic<int> sum{0};
        pool.parallel_for(100, [&](int task) { sum += task; });
        const int num = pool.num_threads();
        std::fprintf(stderr, "%d threads\n", num);
        std::_Exit(num > 1 && num < 1000 && sum == 4950 ? 0 : 1);
      },
      testing::ExitedWithCode(0), "threads");
}

TEST(Isa, NamesAreKnown) {
  EXPECT_STREQ(isa_name(Isa::baseline), "baseline");
  EXPECT_STREQ(isa_name(Isa::avx2), "avx2");
  EXPECT_STREQ(isa_name(Isa::avx512), "avx512");
}

TEST(Isa, EnvironmentCanOnlyLowerIt) {
  const Isa best = best_isa();
  setenv("PALPATE_ISA", "baseline", 1);
  EXPECT_EQ(best_isa(), Isa::baseline);
  setenv("PALPATE_ISA", "avx512", 1);
  EXPECT_EQ(best_isa(), best);
  setenv("PALPATE_ISA", "nonsense", 1);
  EXPECT_EQ(best_isa(), best);
  unsetenv("PALPATE_ISA");
}

}  // namespace
}  // namespace palpate
