#include "src/gpu/internal/emulator.h"

#include <array>
#include <boost/context/fiber.hpp>
#include <boost/context/pooled_fixedsize_stack.hpp>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <memory>
#include <numeric>
#include <random>
#include <vector>
#if __has_include(<sanitizer/asan_interface.h>)
#include <sanitizer/asan_interface.h>
#else
#define ASAN_UNPOISON_MEMORY_REGION(address, size)
#endif

#include "src/core/internal/assert.h"

namespace palpate { inline namespace v0 { namespace emulator {
namespace {

namespace context = boost::context;

struct Thread;

/// Threads that wait for each other. Only those that can go on are in the scheduler's queue.
struct Barrier {
  std::vector<Thread*> waiting;

  void wait(int expected);
};

struct Warp {
  std::array<std::array<std::byte, 16>, 32> slots{};
  std::array<Barrier, 32> barriers;  // by the lowest lane of their mask
};

struct Block {
  Barrier barrier;
  std::vector<Warp> warps;
  std::vector<std::max_align_t> shared;
  int threads = 0;

  Block(int num_threads, std::size_t shared_bytes)
      : warps(static_cast<std::size_t>(num_threads) / 32),
        shared(shared_bytes / sizeof(std::max_align_t) + 1),
        threads(num_threads) {}
};

struct Thread {
  ThreadPlace place;
  Block* block = nullptr;
  context::fiber fiber, scheduler;
};

Thread* running = nullptr;
std::deque<Thread*> ready;  // in the order in which they go on
std::uint32_t order_seed = 0;
bool is_gpu_lost = false;

// Switches back to the scheduler.
void pause() {
  Thread* const self = running;
  self->scheduler = std::move(self->scheduler).resume();
}

void Barrier::wait(int expected) {
  if (static_cast<int>(waiting.size()) + 1 < expected) {
    waiting.push_back(running);
    return pause();
  }
  ready.insert(ready.end(), waiting.begin(), waiting.end());
  waiting.clear();
}

Warp& warp() { return running->block->warps[running->place.thread.x / 32]; }

std::vector<int> shuffled(int num) {
  std::vector<int> order(static_cast<std::size_t>(num));
  std::iota(order.begin(), order.end(), 0);
  std::mt19937 random(order_seed);
  if (order_seed != 0) std::shuffle(order.begin(), order.end(), random);
  return order;
}

/// Stacks of threads, used again and again. What the address sanitizer marked in the last use,
/// whose outermost functions never returned, is cleared.
struct Stacks : context::pooled_fixedsize_stack {
  Stacks() : context::pooled_fixedsize_stack(128 * 1024) {}

  context::stack_context allocate() {
    const context::stack_context stack = context::pooled_fixedsize_stack::allocate();
    ASAN_UNPOISON_MEMORY_REGION(static_cast<std::byte*>(stack.sp) - stack.size, stack.size);
    return stack;
  }
};

// Runs some blocks of a grid at the same time.
void run_blocks(const std::vector<int>& numbers, int num_blocks, int num_threads,
                std::size_t shared_bytes, const std::function<void()>& kernel) {
  static Stacks stacks;
  std::vector<std::unique_ptr<Block>> blocks;
  std::vector<std::unique_ptr<Thread>> threads;
  const std::vector<int> order = shuffled(num_threads);
  for (const int number : numbers) {
    blocks.push_back(std::make_unique<Block>(num_threads, shared_bytes));
    for (const int t : order) {
      auto thread = std::make_unique<Thread>();
      thread->place = {{static_cast<unsigned>(t), 0, 0},
                       {static_cast<unsigned>(number), 0, 0},
                       {static_cast<unsigned>(num_threads), 1, 1},
                       {static_cast<unsigned>(num_blocks), 1, 1}};
      thread->block = blocks.back().get();
      thread->fiber = context::fiber(std::allocator_arg, stacks,
                                     [&kernel, self = thread.get()](context::fiber&& scheduler) {
                                       self->scheduler = std::move(scheduler);
                                       kernel();
                                       return std::move(self->scheduler);
                                     });
      threads.push_back(std::move(thread));
    }
  }
  for (const auto& thread : threads) ready.push_back(thread.get());
  std::size_t num_done = 0;
  while (!ready.empty()) {
    running = ready.front();
    ready.pop_front();
    running->fiber = std::move(running->fiber).resume();
    if (!running->fiber) ++num_done;
  }
  if (num_done < threads.size()) {
    std::fprintf(stderr, "emulator: %zu threads wait at a barrier for others that never come\n",
                 threads.size() - num_done);
    std::abort();
  }
  running = nullptr;
}

}  // namespace

const ThreadPlace& place() { return running->place; }
int lane() { return static_cast<int>(running->place.thread.x % 32); }
void* lane_slot(int lane) { return warp().slots[static_cast<std::size_t>(lane)].data(); }
void* shared_memory() { return running->block->shared.data(); }
void set_order(std::uint32_t seed) { order_seed = seed; }
void lose_gpu(bool is_lost) { is_gpu_lost = is_lost; }

void yield() {
  ready.push_back(running);
  pause();
}

void block_barrier() { running->block->barrier.wait(running->block->threads); }

void warp_barrier(unsigned mask) {
  const int lowest = __builtin_ctz(mask);
  warp().barriers[static_cast<std::size_t>(lowest)].wait(__builtin_popcount(mask));
}

void run_grid(int blocks, int threads, std::size_t shared_bytes, bool cooperative,
              const std::function<void()>& kernel) {
  PALPATE_ASSERT(blocks > 0 && threads > 0 && threads % 32 == 0);
  if (is_gpu_lost) return;
  const std::vector<int> order = shuffled(blocks);
  if (cooperative) return run_blocks(order, blocks, threads, shared_bytes, kernel);
  for (const int block : order) run_blocks({block}, blocks, threads, shared_bytes, kernel);
}

}}}  // namespace palpate::v0::emulator
