// Sums of a query's threads on their way to the host: right, the same bits in any order of threads,
// and no wait without end.
#include "src/contact/cuda/query_answer.h"

#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/cuda/finish_measure.cuh"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

// A share of every value, different in each thread.
PALPATE_HOSTDEV MeasureTerms terms_of(int thread) {
  const double share = 1.0 / (1.0 + thread);
  MeasureTerms terms;
  terms.volume = share;
  terms.potential = -2 * share;
  for (int axis = 0; axis < 3; ++axis) {
    terms.force[axis] = (3 + axis) * share;
    terms.torque[axis] = (6 + axis) * share * share;
  }
  terms.num_boundary = thread % 3;
  terms.num_inside = thread % 5;
  terms.num_points = thread;
  terms.status = thread == 7 ? 6 : 0;
  terms.num_rounds = thread == 3 ? 42 : 0;
  return terms;
}

__global__ void tell(const MeasureOutput out) {
  finish_measure(out, terms_of(gpu::grid_thread()), gpu::shared_memory<FinishScratch>());
}

__global__ void answer_with_stiffness(const MeasureOutput out) {
  float stiffness[StiffnessSums::kNum];
  for (int k = 0; k < StiffnessSums::kNum; ++k) {
    stiffness[k] = static_cast<float>((k + 1) * (gpu::grid_thread() + 1));
  }
  finish_measure(out, terms_of(gpu::grid_thread()), stiffness,
                 gpu::shared_memory<FinishStiffnessScratch>());
}

__global__ void answer_nothing(int*) {}

void evaluate(AnswerBox& box, gpu::Stream& stream, int threads) {
  gpu::launch(
      stream,
      {.blocks = box.num_blocks(), .threads = threads, .shared_bytes = sizeof(FinishScratch)}, tell,
      box.next());
}

TEST(QueryAnswer, IsTheSumOfAllThreads) {
  PALPATE_GPU_OR_SKIP();
  for (const int blocks : {1, 2, 3, 7, 40}) {
    for (const int threads : {32, 96, 256}) {
      AnswerBox box(0, blocks);
      gpu::Stream stream(0, gpu::Priority::high);
      MeasureTerms want;
      for (int thread = 0; thread < blocks * threads; ++thread) {
        const MeasureTerms mine = terms_of(thread);
        want.volume += mine.volume;
        want.potential += mine.potential;
        for (int axis = 0; axis < 3; ++axis) {
          want.force[axis] += mine.force[axis];
          want.torque[axis] += mine.torque[axis];
        }
        want.num_boundary += mine.num_boundary;
        want.num_inside += mine.num_inside;
        want.num_points += mine.num_points;
      }
      for (int round = 0; round < 3; ++round) {
        evaluate(box, stream, threads);
        ASSERT_TRUE(box.await(stream)) << stream.status().error().message;
        const Penetration got = box.answer().penetration();
        EXPECT_NEAR(got.volume, want.volume, 1e-13 * want.volume);
        EXPECT_NEAR(got.potential, want.potential, -1e-13 * want.potential);
        for (int axis = 0; axis < 3; ++axis) {
          EXPECT_NEAR(got.measure_W.force[axis], want.force[axis], 1e-13 * want.force[axis]);
          EXPECT_NEAR(got.measure_W.torque[axis], want.torque[axis], 1e-13 * want.torque[axis]);
        }
        EXPECT_EQ(got.num_boundary_spheres, want.num_boundary);
        EXPECT_EQ(got.num_inside_spheres, want.num_inside);
        EXPECT_EQ(got.num_points, want.num_points);
        EXPECT_EQ(got.status.bits, 6u);
        EXPECT_EQ(box.answer().num_rounds, 42);
      }
    }
  }
}

TEST(QueryAnswer, HasTheSumsOfAStiffnessToo) {
  PALPATE_GPU_OR_SKIP();
  for (const int blocks : {1, 2, 5, 40}) {
    for (const int threads : {64, 96, 128}) {
      AnswerBox box(0, blocks, AnswerBox::kMaxNumbers);
      gpu::Stream stream(0, gpu::Priority::high);
      const double num = blocks * threads;
      for (int round = 0; round < 2; ++round) {
        gpu::launch(
            stream,
            {.blocks = blocks, .threads = threads, .shared_bytes = sizeof(FinishStiffnessScratch)},
            answer_with_stiffness, box.next());
        ASSERT_TRUE(box.await(stream)) << stream.status().error().message;
        const StiffnessSums got = box.stiffness();
        for (int k = 0; k < StiffnessSums::kNum; ++k) {
          EXPECT_EQ(got.numbers[k], (k + 1) * num * (num + 1) / 2);
        }
        double volume = 0, points = 0;
        for (int thread = 0; thread < blocks * threads; ++thread) {
          volume += terms_of(thread).volume;
          points += terms_of(thread).num_points;
        }
        EXPECT_NEAR(box.answer().volume, volume, 1e-13 * volume);
        EXPECT_EQ(box.answer().num_points, points);
      }
    }
  }
}

#if defined(PALPATE_EMULATE_CUDA)
TEST(QueryAnswer, IsTheSameInAnyOrderOfThreads) {
  QueryAnswer first;
  for (const std::uint32_t seed : {0u, 1u, 2u, 3u, 4u}) {
    emulator::set_order(seed);
    AnswerBox box(0, 9);
    gpu::Stream stream(0, gpu::Priority::high);
    evaluate(box, stream, 128);
    ASSERT_TRUE(box.await(stream));
    if (seed == 0) first = box.answer();
    const QueryAnswer now = box.answer();
    EXPECT_EQ(std::memcmp(&first, &now, sizeof first), 0);
  }
  emulator::set_order(0);
}
#endif

TEST(QueryAnswer, ThatNeverComesIsAnError) {
  PALPATE_GPU_OR_SKIP();
  AnswerBox box(0, 2);
  gpu::Stream stream(0, gpu::Priority::high);
  evaluate(box, stream, 64);
  ASSERT_TRUE(box.await(stream));
  box.next();
  gpu::launch(stream, {.blocks = 1, .threads = 32}, answer_nothing, nullptr);
  EXPECT_FALSE(box.await(stream));
  ASSERT_FALSE(stream.status());
  EXPECT_EQ(stream.status().error().code, Errc::unavailable);
  EXPECT_FALSE(box.await(stream)) << "and it stays one";
}

}  // namespace
}  // namespace palpate
