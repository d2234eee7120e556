// Functions marked PALPATE_HOSTDEV give the same numbers on the device as on the host.
#include <cuda_runtime.h>

#include <vector>

#include <gtest/gtest.h>

#include "palpate/math/pose.h"
#include "palpate/math/sphere.h"

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
  const int i = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (i < kNum) out[i] = sample(i);
}

TEST(SharedText, DeviceEqualsHost) {
  int num_devices = 0;
  if (cudaGetDeviceCount(&num_devices) != cudaSuccess || num_devices == 0) {
    GTEST_SKIP() << "SKIPPED: no CUDA device or driver on this machine";
  }
  Sample* on_device = nullptr;
  ASSERT_EQ(cudaMalloc(&on_device, kNum * sizeof(Sample)), cudaSuccess);
  sample_all<<<kNum / 128, 128>>>(on_device);
  std::vector<Sample> got(kNum);
  ASSERT_EQ(cudaMemcpy(got.data(), on_device, kNum * sizeof(Sample), cudaMemcpyDeviceToHost),
            cudaSuccess);
  EXPECT_EQ(cudaFree(on_device), cudaSuccess);
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
