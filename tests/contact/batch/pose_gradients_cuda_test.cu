// Derivatives by the numbers of poses on the GPU, against those of the CPU.
#include <cmath>

#include "tests/contact/batch/pose_gradients.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

template <class Real>
void expect_those_of_the_cpu(bool is_matrix) {
  test::PosesOfSprings<Real> asked(300, is_matrix, 1);
  asked.numbers[asked.each] = static_cast<Real>(NAN);
  gpu::Memory memory(0);
  gpu::Stream stream(0, gpu::Priority::low);
  for (const bool is_second : {false, true}) {
    PoseGradients job = asked.job(is_second);
    ASSERT_TRUE(put_pose_gradients(job));
    const std::vector<Real> to = asked.to, by_scale = asked.by_scale;
    job.poses.gpu = 0;
    job.poses.numbers = memory.copy_of(asked.numbers);
    job.p_TC = memory.copy_of(
        std::vector<double>{asked.spring.p_TC.x, asked.spring.p_TC.y, asked.spring.p_TC.z});
    const double* const wrench = memory.copy_of(asked.wrench);
    job.by_shift = wrench;
    job.by_turn = wrench + 3 * asked.num;
    job.scale = memory.copy_of(asked.scale);
    Real* const there = memory.take<Real>(to.size());
    Real* const by_scale_there = memory.take<Real>(asked.num);
    job.to = there;
    if (is_second) {
      job.along = memory.copy_of(asked.along);
      job.stiffness = memory.copy_of(asked.stiffness);
      job.by_scale = by_scale_there;
    }
    ASSERT_TRUE(put_pose_gradients_cuda(job, {stream.handle()}));
    stream.copy(asked.to.data(), there, to.size() * sizeof(Real));
    stream.copy(asked.by_scale.data(), by_scale_there, asked.num * sizeof(Real));
    ASSERT_TRUE(stream.wait());
    const double tolerance = sizeof(Real) == sizeof(float) ? 1e-6 : 1e-14;
    for (std::size_t k = 0; k < to.size(); ++k) {
      ASSERT_NEAR(asked.to[k], to[k], tolerance * (1 + std::abs(to[k]))) << k;
    }
    for (std::size_t k = 0; is_second && k < asked.num; ++k) {
      ASSERT_NEAR(asked.by_scale[k], by_scale[k], tolerance * (1 + std::abs(by_scale[k]))) << k;
    }
    std::vector<double> seven(7 * asked.num), expected(7 * asked.num);
    double* const seven_there = memory.take<double>(seven.size());
    ASSERT_TRUE(put_plain_poses_cuda(job.poses, seven_there, {stream.handle()}));
    stream.copy(seven.data(), seven_there, seven.size() * sizeof(double));
    ASSERT_TRUE(stream.wait());
    ASSERT_TRUE(put_plain_poses(asked.job(false).poses, expected.data()));
    for (std::size_t k = 0; k < seven.size(); ++k) {
      ASSERT_EQ(std::isfinite(seven[k]), std::isfinite(expected[k])) << k;
      if (!std::isfinite(expected[k])) continue;
      ASSERT_NEAR(seven[k], expected[k], 1e-14) << k;
    }
  }
}

TEST(PoseGradientsCuda, AreThoseOfTheCpu) {
  PALPATE_GPU_OR_SKIP();
  for (const bool is_matrix : {false, true}) {
    expect_those_of_the_cpu<double>(is_matrix);
    expect_those_of_the_cpu<float>(is_matrix);
  }
}

}  // namespace
}  // namespace palpate
