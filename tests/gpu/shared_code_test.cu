// Functions marked PALPATE_HOSTDEV give the same numbers on the device as on the host.
#include <vector>

#include <gtest/gtest.h>

#include "palpate/math/geometry.h"
#include "src/gpu/internal/runtime.h"
#include "src/gpu/internal/team.cuh"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

constexpr int kNum = 1024;

struct Sample {
  double cap, lens;
  float cap_single;
  Vec3d moved;
};

PALPATE_HOSTDEV Sample sample(int i) {
  const double r = 0.01 + 0.001 * i, d = r * (-1.5 + 3.0 * i / kNum);
  const Pose X_WT{{0.1 * i, -0.2, 1.0}, normalized(Quaternion{0.1, 0.2 * i, 0.3, 1.0})};
  return {cap_volume(r, d), lens_volume(r, 0.5, 0.4 + r),
          cap_volume(static_cast<float>(r), static_cast<float>(d)), X_WT * Vec3d{d, r, 1.0}};
}

__global__ void sample_all(Sample* out) {
  for (int i = gpu::grid_thread(); i < kNum; i += gpu::grid_threads()) out[i] = sample(i);
}

TEST(SharedText, DeviceEqualsHost) {
  PALPATE_GPU_OR_SKIP();
  gpu::Memory memory(0);
  gpu::Stream stream(0, gpu::Priority::high);
  Sample* const on_device = memory.take<Sample>(kNum);
  Sample* const got = memory.take_pinned<Sample>(kNum);
  ASSERT_TRUE(memory.status()) << memory.status().error().message;
  gpu::launch(stream, {.blocks = 4, .threads = 128}, sample_all, on_device);
  stream.copy(got, on_device, kNum * sizeof(Sample));
  ASSERT_TRUE(stream.wait()) << stream.status().error().message;
  for (int i = 0; i < kNum; ++i) {
    const Sample want = sample(i);
    EXPECT_NEAR(got[i].cap, want.cap, 1e-14);
    EXPECT_NEAR(got[i].lens, want.lens, 1e-14);
    EXPECT_NEAR(got[i].cap_single, want.cap_single, 1e-6f * want.cap_single + 1e-12f);
    EXPECT_LT(norm(got[i].moved - want.moved), 1e-12);
  }
}

}  // namespace
}  // namespace palpate
