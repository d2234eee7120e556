// Pixels measured as farther than max_depth, in the fields and in the memory of a camera.
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/field/sensor.h"
#include "src/field/memory/field_memory.h"

namespace palpate {
namespace {

constexpr int kWidth = 120, kHeight = 90, kLeft = 40, kRight = 80, kTop = 30, kBottom = 60;
constexpr float kInfinite = std::numeric_limits<float>::infinity();
const Camera kCamera{kWidth, kHeight, {100, 100, 59.5, 44.5}};

bool is_object(int u, int v) { return u >= kLeft && u < kRight && v >= kTop && v < kBottom; }

/// An object at 1 m, nothing measured in the five columns left of it, elsewhere the background.
std::vector<float> image_before(float background) {
  std::vector<float> image;
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const bool is_hole = u >= kLeft - 5 && u < kLeft;
      image.push_back(is_hole ? NAN : is_object(u, v) ? 1.0f : background);
    }
  }
  return image;
}

TangentPlane plane_at(const DepthFieldView& field, int u, int v) {
  const float* const plane =
      field.levels[0].planes + 2 * (static_cast<std::ptrdiff_t>(v) * field.levels[0].stride + u);
  return {plane[0], plane[1]};
}

/// In what is shown and in what was seen to be free: up to `depth` where the background is, and
/// where nothing was measured beside the object.
void expect_free_up_to(const SurfaceView& surface, float depth) {
  for (const DepthFieldView* field : {&surface.field, &surface.seen_free}) {
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const TangentPlane plane = plane_at(*field, u, v);
        if (is_object(u, v)) {
          ASSERT_NEAR(plane.offset / plane.slope, 1, 1e-4) << u << " " << v;
        } else {
          ASSERT_EQ(plane.offset, depth) << u << " " << v;
          ASSERT_EQ(plane.slope, 1) << u << " " << v;
        }
      }
    }
  }
}

TEST(FarBackground, IsFreeUpToTheLimitInEveryField) {
  SensorOptions options;
  options.field.one_of_several = true;
  for (const double limit : {10.0, 2.5}) {
    options.surface.max_depth = limit;
    Sensor sensor = Sensor::create(kCamera, Place::cpu(), options).value();
    for (const float background : {10.01f, 12.0f, 500.0f, kInfinite}) {
      const std::vector<float> image = image_before(background);
      ASSERT_NO_FATAL_FAILURE(expect_free_up_to(sensor.update({kWidth, kHeight, image.data()}),
                                                static_cast<float>(limit)));
      std::vector<std::uint16_t> counts;
      for (const float z : image) {
        counts.push_back(std::isnan(z) ? std::uint16_t{0}
                         : z > 65.534f ? kFarCount
                                       : static_cast<std::uint16_t>(std::lround(1000 * z)));
      }
      ASSERT_NO_FATAL_FAILURE(expect_free_up_to(
          sensor.update({kWidth, kHeight, counts.data(), 0.001}), static_cast<float>(limit)));
    }
  }
}

TEST(FarBackground, WhatIsNotMeasuredIsNot) {
  Sensor sensor = Sensor::create(kCamera).value();
  for (const float background : {NAN, 0.0f, -1.0f, -kInfinite}) {
    const std::vector<float> image = image_before(background);
    const SurfaceView surface = sensor.update({kWidth, kHeight, image.data()});
    EXPECT_EQ(plane_at(surface.field, 5, 5).slope, 0) << background;
    EXPECT_NEAR(plane_at(surface.field, kRight + 2, 45).offset, 1, 0.01) << background;  // filled
  }
}

TEST(FarBackground, IsRememberedBehindWhatComesBeforeIt) {
  ThreadPool pool(1);
  SurfaceEstimator estimator =
      SurfaceEstimator::create(kWidth, kHeight, kCamera.intrinsics).value();
  MemoryOptions options;
  options.kind = DepthMemory::on;
  FieldMemory memory(kWidth, kHeight, options);
  std::vector<float> image(static_cast<std::size_t>(kWidth * kHeight), kInfinite);
  const auto see = [&] {
    estimator.update(image, pool);
    memory.update(estimator.cloud(), 1.0 / 30, pool);
  };
  for (int k = 0; k < kMinSeen; ++k) see();
  for (int v = kTop; v < kBottom; ++v) {
    for (int u = kLeft; u < kRight; ++u) image[static_cast<std::size_t>(v * kWidth + u)] = 1;
  }
  see();
  const std::size_t middle = 45 * kWidth + 60, beside = 45 * kWidth + 10;
  EXPECT_EQ(memory.behind()[middle].offset, 10);
  EXPECT_NEAR(memory.in_front()[middle].offset, 1, 1e-4);
  EXPECT_EQ(memory.behind()[beside].offset, 10);
  EXPECT_EQ(memory.in_front()[beside].offset, kNothingInFront);
}

}  // namespace
}  // namespace palpate
