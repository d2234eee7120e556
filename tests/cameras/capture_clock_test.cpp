#include "src/cameras/capture_clock.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace palpate {
namespace {

struct Errors {
  double largest = 0, mean = 0;
};

/// A camera whose clock is `offset` off and drifts, and whose frames take `delay` and more.
Errors errors_after(double seconds, double from, double drift, double mean_delay,
                    double* found_drift = nullptr) {
  std::mt19937 random(7);
  std::exponential_distribution<double> more(1 / mean_delay);
  CaptureClock clock;
  Errors errors;
  int num = 0;
  for (int k = 0; k / 30.0 < seconds; ++k) {
    const double captured = 1000 + k / 30.0;                     // on our clock
    const double stamp = 5e5 + (1 + drift) * (captured - 1000);  // on the camera's
    const double arrival = captured + 0.004 + more(random);
    const double estimate = clock.add(stamp, arrival);
    EXPECT_LE(estimate, arrival);
    if (k / 30.0 < from) continue;
    // The smallest delay cannot be known from outside.
    const double error = estimate - (captured + 0.004);
    errors.largest = std::max(errors.largest, std::abs(error));
    errors.mean += error;
    ++num;
  }
  errors.mean /= num;
  if (found_drift != nullptr) *found_drift = clock.drift();
  return errors;
}

TEST(CaptureClock, FindsTheOffsetThroughJitter) {
  const Errors errors = errors_after(20, 2, 0, 0.005);
  EXPECT_LT(errors.largest, 0.0012);
}

TEST(CaptureClock, FollowsADriftForAnHour) {
  double drift = 0;
  const Errors errors = errors_after(3600, 60, 80e-6, 0.005, &drift);
  EXPECT_LT(errors.largest, 0.0012);
  EXPECT_NEAR(drift, 80e-6, 30e-6);
  EXPECT_LT(errors_after(600, 60, -150e-6, 0.005).largest, 0.0012);
}

TEST(CaptureClock, BeginsAnewWithTheCamera) {
  CaptureClock clock;
  for (int k = 0; k < 100; ++k) clock.add(500 + k / 30.0, 1000 + k / 30.0);
  EXPECT_EQ(clock.num_restarts(), 0);
  EXPECT_NEAR(clock.add(0.1, 1004), 1004, 1e-9);
  EXPECT_EQ(clock.num_restarts(), 1);
  EXPECT_NEAR(clock.add(0.2, 1004.13), 1004.1, 1e-9);
}

TEST(CaptureClock, OneLateFrameMovesNothing) {
  CaptureClock clock;
  for (int k = 0; k < 100; ++k) clock.add(k / 30.0, 1000 + k / 30.0);
  EXPECT_NEAR(clock.add(100 / 30.0, 1000 + 100 / 30.0 + 0.5), 1000 + 100 / 30.0, 1e-9);
}

}  // namespace
}  // namespace palpate
