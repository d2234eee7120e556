// Cooperation of threads, on the device and by the emulator.
#include <cstdint>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

#include "src/gpu/internal/runtime.h"
#include "src/gpu/internal/team.cuh"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::in_all_orders;

constexpr int kBlocks = 2, kThreads = 128, kNum = kBlocks * kThreads;

__global__ void __launch_bounds__(kThreads)
    pass_on(int* values, unsigned long long* barrier, int rounds) {
  const int i = gpu::grid_thread(), next = (i + 1) % kNum;
  for (int round = 0; round < rounds; ++round) {
    const int got = gpu::read_now(values + next);
    gpu::grid_barrier(barrier);
    values[i] = got;
    gpu::grid_barrier(barrier);
  }
}

TEST(Team, EveryThreadArrivesAtABarrierBeforeAnyGoesOn) {
  PALPATE_GPU_OR_SKIP();
  in_all_orders([] {
    gpu::Memory memory(0);
    gpu::Stream stream(0, gpu::Priority::high);
    std::vector<int> values(kNum);
    std::iota(values.begin(), values.end(), 0);
    int* const on_device = memory.copy_of(values);
    auto* const barrier = memory.take<unsigned long long>(1);
    ASSERT_GE(gpu::resident_blocks(0, reinterpret_cast<const void*>(pass_on), kThreads, 0),
              kBlocks);
    gpu::launch(stream, {.blocks = kBlocks, .threads = kThreads, .cooperative = true}, pass_on,
                on_device, barrier, 10);
    stream.copy(values.data(), on_device, kNum * sizeof(int));
    ASSERT_TRUE(stream.wait()) << stream.status().error().message;
    for (int i = 0; i < kNum; ++i) EXPECT_EQ(values[static_cast<std::size_t>(i)], (i + 10) % kNum);
  });
}

constexpr int kWarps = kThreads / gpu::kWarpSize;

__global__ void add_up(const double* values, double* partial, double* total,
                       unsigned long long* count) {
  auto& is_last = gpu::shared_memory<int>();
  double sums[2] = {0, 0};
  for (int i = gpu::grid_thread(); i < 10 * kNum; i += gpu::grid_threads()) {
    sums[0] += values[i];
    sums[1] += 1;
  }
  const unsigned warp = blockIdx.x * kWarps + static_cast<unsigned>(gpu::warp_id());
  for (unsigned k = 0; k < 2; ++k) {
    const double sum = gpu::warp_sum(sums[k]);
    if (gpu::lane_id() == 0) partial[2 * warp + k] = sum;
  }
  if (!gpu::is_last_block(count, &is_last) || threadIdx.x != 0) return;
  for (unsigned each = 0; each < gridDim.x * kWarps; ++each) {
    total[0] += partial[2 * each];
    total[1] += partial[2 * each + 1];
  }
}

TEST(Team, SumsAreRightAndAlwaysTheSameBits) {
  PALPATE_GPU_OR_SKIP();
  std::vector<double> values(10 * kNum);
  double want = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = 1.0 / (1.0 + static_cast<double>(i));
    want += values[i];
  }
  std::vector<double> results;
  in_all_orders([&] {
    gpu::Memory memory(0);
    gpu::Stream stream(0, gpu::Priority::low);
    double* const total = memory.take_pinned<double>(2);
    gpu::launch(stream, {.blocks = kBlocks, .threads = kThreads, .shared_bytes = sizeof(int)},
                add_up, memory.copy_of(values), memory.take<double>(2 * kBlocks * kWarps), total,
                memory.take<unsigned long long>(1));
    ASSERT_TRUE(stream.wait()) << stream.status().error().message;
    EXPECT_NEAR(total[0], want, 1e-12 * want);
    EXPECT_EQ(total[1], 10 * kNum);
    results.push_back(total[0]);
  });
  for (const double result : results) EXPECT_EQ(result, results[0]);
}

__global__ void query_warp(unsigned* out) {
  const int lane = gpu::lane_id();
  const unsigned odd = __ballot_sync(gpu::kWholeWarp, lane % 2);
  const int from_five = __shfl_sync(gpu::kWholeWarp, 10 * lane, 5);
  const int below = __shfl_up_sync(gpu::kWholeWarp, lane, 1);
  out[gpu::grid_thread()] = odd + static_cast<unsigned>(from_five + below);
}

TEST(Team, LanesOfAWarpSeeEachOther) {
  PALPATE_GPU_OR_SKIP();
  in_all_orders([] {
    gpu::Memory memory(0);
    gpu::Stream stream(0, gpu::Priority::low);
    auto* const out = memory.take_pinned<unsigned>(64);
    gpu::launch(stream, {.blocks = 1, .threads = 64}, query_warp, out);
    ASSERT_TRUE(stream.wait());
    for (unsigned i = 0; i < 64; ++i) {
      const unsigned lane = i % 32;
      EXPECT_EQ(out[i], 0xaaaaaaaau + 50 + (lane == 0 ? 0 : lane - 1));
    }
  });
}

__global__ void count_up(int* value) {
  if (gpu::grid_thread() == 0) ++*value;
}

TEST(Stream, ARecordedGraphRunsAsOftenAsItIsLaunched) {
  PALPATE_GPU_OR_SKIP();
  gpu::Memory memory(0);
  gpu::Stream stream(0, gpu::Priority::low);
  int* const value = memory.take<int>(1);
  int* const got = memory.take_pinned<int>(1);
  stream.begin_recording();
  gpu::launch(stream, {.blocks = 1, .threads = 32}, count_up, value);
  gpu::launch(stream, {.blocks = 1, .threads = 32}, count_up, value);
  stream.copy(got, value, sizeof(int));
  const gpu::Graph graph = stream.end_recording();
  EXPECT_EQ(*got, 0);
  for (int i = 0; i < 3; ++i) stream.launch(graph);
  ASSERT_TRUE(stream.wait()) << stream.status().error().message;
  EXPECT_EQ(*got, 6);
}

TEST(Memory, SaysWhenThereIsTooLittle) {
#if defined(PALPATE_EMULATE_CUDA)
  GTEST_SKIP() << "SKIPPED: needs a GPU: the emulator has no limit of memory";
#endif
  PALPATE_GPU_OR_SKIP();
  gpu::Memory memory(0);
  EXPECT_EQ(memory.take<char>(std::size_t{1} << 50), nullptr);
  ASSERT_FALSE(memory.status());
  EXPECT_NE(memory.status().error().message.find("ran out"), std::string::npos);
  EXPECT_EQ(memory.take<char>(16), nullptr) << "the first failure stays";
}

}  // namespace
}  // namespace palpate
