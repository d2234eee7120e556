// A GPU that is lost in the middle of a live run: by a kernel that traps, after which no kernel of
// this process runs on it any more. In a program of its own.
#include <algorithm>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/run/live_loop_fixtures.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

__global__ void trap() { asm volatile("trap;"); }

TEST(GpuLoss, TheRunGoesOnWithTheCpu) {
  PALPATE_GPU_OR_SKIP();
  test::WallSource source({});
  test::ScriptedDevice device({.hand = [](double) { return Vec3d{0, 0, 0.04}; }});
  RunSettings settings = test::patient_settings();
  settings.backend = Backend::cuda;
  std::vector<TickRecord> ticks;
  RunObserver observer;
  observer.on_ticks = [&](std::span<const TickRecord> some) {
    ticks.insert(ticks.end(), some.begin(), some.end());
  };
  auto loop = RunLoop::create(test::box_tool(), source, device, settings, observer);
  ASSERT_TRUE(loop) << loop.error().message;
  ASSERT_TRUE((*loop)->start());
  TickRecord newest;
  const auto is_felt = [&] {
    newest = (*loop)->latest().value_or(newest);
    return norm(newest.F_H_B.force) > 0.5 && newest.safety.is_engaged();
  };
  ASSERT_TRUE(test::wait_for(is_felt));
  EXPECT_EQ((*loop)->settings().backend, Backend::cuda);

  trap<<<1, 1>>>();
  EXPECT_NE(cudaDeviceSynchronize(), cudaSuccess);

  EXPECT_TRUE(test::wait_for([&] { return (*loop)->settings().backend == Backend::cpu; }));
  // The hand stays in contact, so it has to query.
  EXPECT_TRUE(test::wait_for([&] {
    (*loop)->request_force();
    return is_felt();
  })) << newest.F_H_B.force.z;
  EXPECT_TRUE((*loop)->is_running());
  EXPECT_TRUE((*loop)->status());
  (*loop)->stop();
  const LoopReport report = (*loop)->report();
  EXPECT_EQ(report.fault, Fault::stopped);
  EXPECT_TRUE(std::any_of(report.notes.begin(), report.notes.end(), [](const std::string& note) {
    return note.find("the GPU is lost") != std::string::npos;
  }));
  // Faded in between, and never with a jump.
  bool was_off = false;
  for (std::size_t k = 1; k < ticks.size(); ++k) {
    was_off =
        was_off || (ticks[k].safety.fault == Fault::backend && norm(ticks[k].F_H_B.force) == 0);
    const double jump = norm(ticks[k].F_H_B.force - ticks[k - 1].F_H_B.force);
    EXPECT_LE(jump, settings.safety.max_slew * 0.02 + 1e-9) << k;
  }
  EXPECT_TRUE(was_off);
}

}  // namespace
}  // namespace palpate
