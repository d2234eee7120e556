// Memory of a pixel, and the fields that are made of it.
#include "src/field/memory/field_memory.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/field/sensor.h"
#include "src/field/internal/field_point.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr float kInterval = 1.0f / 32;  // exact
constexpr float kTable = 1.0f, kHand = 0.7f;

/// A surface that is looked at squarely.
TangentPlane plane_at(float z) { return z > 0 ? TangentPlane{z, 1} : TangentPlane{}; }

/// Memory of one pixel and its measurements.
struct Pixel {
  MemoryRule rule = memory_rule({.kind = DepthMemory::on, .horizon = 2});
  PixelMemory memory;

  MemoryPlanes see(float z) { return remember(plane_at(z), z, rule, kInterval, memory); }
  void see(float z, int times) {
    for (int i = 0; i < times; ++i) see(z);
  }
};

bool is_nothing(const TangentPlane& plane) { return plane.offset == kNothingInFront; }

TEST(PixelMemory, ShowsWhatItSeesWhileNothingComesBeforeIt) {
  Pixel pixel;
  for (const float z : {1.0f, 1.01f, 0.99f, 1.3f, 1.3f, 1.31f}) {
    const MemoryPlanes planes = pixel.see(z);
    EXPECT_EQ(planes.behind.offset, z);
    EXPECT_TRUE(is_nothing(planes.in_front));
  }
}

TEST(PixelMemory, KeepsWhatAHandHides) {
  Pixel pixel;
  pixel.see(kTable, kMinSeen);
  pixel.see(1.004f);
  for (int i = 0; i < 20; ++i) {
    const float hand = kHand + 0.01f * static_cast<float>(i % 3);
    const MemoryPlanes planes = pixel.see(hand);
    EXPECT_EQ(planes.behind.offset, 1.004f);
    EXPECT_EQ(planes.in_front.offset, hand);
  }
  const MemoryPlanes after = pixel.see(kTable);
  EXPECT_EQ(after.behind.offset, kTable);
  EXPECT_TRUE(is_nothing(after.in_front));
}

TEST(PixelMemory, OneFrameContradicts) {
  Pixel pixel;
  pixel.see(kTable, 10);
  EXPECT_EQ(pixel.see(1.021f).behind.offset, 1.021f);
  pixel.see(1.021f, kMinSeen);
  pixel.see(kHand, 5);
  EXPECT_EQ(pixel.see(1.5f).behind.offset, 1.5f);
  // The surface that had been there before is not known any more.
  EXPECT_EQ(pixel.see(kHand).behind.offset, kHand);
}

TEST(PixelMemory, WhatWasSeenOnceIsNotRemembered) {
  Pixel pixel;
  pixel.see(kTable, kMinSeen - 1);
  const MemoryPlanes planes = pixel.see(kHand);
  EXPECT_EQ(planes.behind.offset, kHand);
  EXPECT_TRUE(is_nothing(planes.in_front));
}

TEST(PixelMemory, ForgetsAfterTheHorizon) {
  for (const double horizon : {0.0, 2.0, kForEver}) {
    Pixel pixel;
    pixel.rule = memory_rule({.kind = DepthMemory::on, .horizon = horizon});
    pixel.see(kTable, 5);
    int num = 0;
    while (num < 1000 && pixel.see(kHand).behind.offset == kTable) ++num;
    EXPECT_EQ(num, horizon == 0 ? 0 : (horizon == 2 ? 64 : 1000));
  }
}

TEST(PixelMemory, AHoleHidesAndContradictsNothing) {
  Pixel pixel;
  EXPECT_FALSE(pixel.see(0).behind.is_surface());
  pixel.see(kTable);
  EXPECT_FALSE(pixel.see(0).behind.is_surface());
  pixel.see(kTable, kMinSeen);
  for (const float hole : {0.0f, NAN}) {
    const MemoryPlanes planes = pixel.see(hole);
    EXPECT_EQ(planes.behind.offset, kTable);
    EXPECT_FALSE(planes.in_front.is_surface());
  }
  pixel.see(0, 70);
  EXPECT_FALSE(pixel.see(0).behind.is_surface());
}

TEST(PixelMemory, NoiseDoesNotMakeItCreep) {
  test::Random random(5);
  Pixel pixel;
  double last = 0;
  for (int i = 0; i < 100000; ++i) {
    const float z = kTable + 0.004f * static_cast<float>(random.normal());
    const MemoryPlanes planes = pixel.see(z);
    ASSERT_EQ(planes.behind.offset, z);
    ASSERT_TRUE(is_nothing(planes.in_front));
    last = z;
  }
  EXPECT_EQ(pixel.see(kHand).behind.offset, static_cast<float>(last));
}

// A lifted table: at first it is where it is seen, then it has left what was behind it.
TEST(PixelMemory, WhatRisesSlowlyComesBeforeWhereItWas) {
  Pixel pixel;
  pixel.rule.horizon = kForEver;
  pixel.see(kTable, 5);
  float z = kTable;
  for (; z > 0.981f; z -= 0.001f) EXPECT_EQ(pixel.see(z).behind.offset, z);
  for (z = 0.97f; z > 0.8f; z -= 0.001f) {
    const MemoryPlanes planes = pixel.see(z);
    EXPECT_NEAR(planes.behind.offset, 0.98f, 0.0021f);
    EXPECT_EQ(planes.in_front.offset, z);
  }
}

DepthStreamInfo stream_info() {
  DepthStreamInfo info;
  info.width = 64;
  info.height = 48;
  info.intrinsics = {60, 60, 31.5, 23.5};
  info.rate = 32;
  return info;
}

/// A table, before it a hand: a square of half the image.
DepthFrame frame_of(double table, double hand) {
  DepthFrame frame{64, 48, 0.0001, {}, 0};
  for (int v = 0; v < 48; ++v) {
    for (int u = 0; u < 64; ++u) {
      const bool is_hand = hand > 0 && u >= 16 && u < 48 && v >= 12 && v < 36;
      frame.pixels.push_back(
          static_cast<std::uint16_t>(std::lround((is_hand ? hand : table) / 0.0001)));
    }
  }
  return frame;
}

TimeOptions with_memory() {
  TimeOptions options;
  options.mode = TimeMode::latest;
  options.memory.kind = DepthMemory::on;
  return options;
}

TEST(FieldMemory, FieldsShowWhatIsBehindAndWhatIsInFront) {
  ThreadPool pool(2);
  auto timeline = SurfaceTimeline::create(stream_info(), {.time = with_memory()}).value();
  for (int i = 0; i < 5; ++i) timeline.push(frame_of(1.0, 0), i / 32.0, pool);
  const SurfaceView before = timeline.at(1).to;
  EXPECT_NEAR(sample_field(before.field, {0.0, 0.0, 0.95}, 0.005).phi, 0.05, 2e-4);
  EXPECT_GT(sample_field(before.in_front, {0.0, 0.0, 0.7}, 0.005).phi, 0.1);
  timeline.push(frame_of(1.0, 0.7), 5 / 32.0, pool);
  const SurfaceView now = timeline.at(1).to;
  EXPECT_NEAR(sample_field(now.field, {0.0, 0.0, 0.95}, 0.005).phi, 0.05, 2e-4);
  EXPECT_NEAR(sample_field(now.field, {0.0, 0.0, 1.02}, 0.005).phi, -0.02, 5e-4);
  // 60 mm thick: out of the front, out of the back, and past it.
  EXPECT_NEAR(sample_field(now.in_front, {0.0, 0.0, 0.69}, 0.005).phi, 0.01, 2e-4);
  EXPECT_NEAR(sample_field(now.in_front, {0.0, 0.0, 0.71}, 0.005).phi, -0.01, 2e-4);
  EXPECT_NEAR(sample_field(now.in_front, {0.0, 0.0, 0.75}, 0.005).phi, -0.01, 2e-4);
  EXPECT_NEAR(sample_field(now.in_front, {0.0, 0.0, 0.80}, 0.005).phi, 0.04, 2e-4);
  EXPECT_GT(sample_field(now.in_front, {0.35, 0.0, 0.71}, 0.005).phi, 0.02);
  timeline.push(frame_of(1.0, 0), 6 / 32.0, pool);
  const SurfaceView after = timeline.at(1).to;
  for (const double z : {0.6, 0.7, 0.73, 0.8}) {
    EXPECT_GT(sample_field(after.in_front, {0.0, 0.0, z}, 0.005).phi, 0.1);
  }
  EXPECT_EQ(sample_field(after.field, {0.0, 0.0, 0.95}, 0.005).phi,
            sample_field(before.field, {0.0, 0.0, 0.95}, 0.005).phi);
}

// One of several cameras keeps the surface of the frame and the remembered one apart.
TEST(FieldMemory, OneOfSeveralTellsApartWhatItSeesAndRemembers) {
  ThreadPool pool(2);
  DepthFieldOptions field;
  field.one_of_several = true;
  TimeOptions without = with_memory();
  without.memory.kind = DepthMemory::off;
  auto timeline =
           SurfaceTimeline::create(stream_info(), {.field = field, .time = with_memory()}).value(),
       plain = SurfaceTimeline::create(stream_info(), {.field = field, .time = without}).value();
  for (int i = 0; i < 6; ++i) {
    const DepthFrame frame = frame_of(1.0, i < 5 ? 0 : 0.7);
    timeline.push(frame, i / 32.0, pool);
    plain.push(frame, i / 32.0, pool);
  }
  const SurfaceView now = timeline.at(1).to, want = plain.at(1).to;
  test::Random random(8);
  for (int k = 0; k < 200; ++k) {
    const Vec3d p{random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2), random.uniform(0.6, 1.1)};
    EXPECT_EQ(sample_field(now.field, p, 0.005).phi, sample_field(want.field, p, 0.005).phi);
    EXPECT_EQ(sample_field(now.seen_free, p, 0.005).phi,
              sample_field(want.seen_free, p, 0.005).phi);
  }
  EXPECT_NEAR(sample_field(now.remembered, {0.0, 0.0, 0.95}, 0.005).phi, 0.05, 2e-4);
  EXPECT_NEAR(sample_field(now.remembered, {0.0, 0.0, 1.02}, 0.005).phi, -0.02, 5e-4);
  EXPECT_LT(sample_field(now.remembered, {2.0, 0.0, 0.95}, 0.005).phi, -0.5);  // not looked at
  EXPECT_NEAR(sample_field(now.in_front, {0.0, 0.0, 0.71}, 0.005).phi, -0.01, 2e-4);
  EXPECT_GT(sample_field(now.in_front, {0.0, 0.0, 0.80}, 0.005).phi, 0.03);
  EXPECT_NEAR(sample_field(now.in_front, {-0.4, -0.3, 1.01}, 0.005).phi, -0.01, 5e-4);
}

// While nothing is hidden the field is that without a memory, in a window too.
TEST(FieldMemory, ChangesNothingThatIsSeen) {
  ThreadPool pool(2);
  TimeOptions without = with_memory();
  without.memory.kind = DepthMemory::off;
  auto with = SurfaceTimeline::create(stream_info(), {.time = with_memory()}).value(),
       plain = SurfaceTimeline::create(stream_info(), {.time = without}).value();
  for (int i = 0; i < 4; ++i) {
    const PixelWindow requested = i < 2 ? PixelWindow{} : PixelWindow{10, 10, 30, 30};
    with.push(frame_of(1.0 + 0.01 * i, 0.9 + 0.01 * i), i / 32.0, pool, requested);
    plain.push(frame_of(1.0 + 0.01 * i, 0.9 + 0.01 * i), i / 32.0, pool, requested);
    test::Random random(7);
    for (int k = 0; k < 200; ++k) {
      const Vec3d p{random.uniform(-0.2, 0.0), random.uniform(-0.2, 0.0), random.uniform(0.8, 1.1)};
      const auto a = sample_field(with.at(1).to.field, p, 0.005),
                 b = sample_field(plain.at(1).to.field, p, 0.005);
      EXPECT_EQ(a.phi, b.phi);
      EXPECT_EQ(a.gradient, b.gradient);
    }
  }
}

TEST(FieldMemory, AllocatesNothing) {
  ThreadPool pool(1);
  auto timeline = SurfaceTimeline::create(stream_info(), {.time = with_memory()}).value();
  const DepthFrame table = frame_of(1.0, 0), hand = frame_of(1.0, 0.7);
  timeline.push(table, 0, pool);
  const test::AllocationCounter counter;
  for (int i = 1; i < 6; ++i) timeline.push(i < 4 ? table : hand, i / 32.0, pool);
  EXPECT_EQ(counter.count(), 0);
}

TEST(FieldMemory, RefusesWhatItCannotRemember) {
  const auto error = [](DepthStreamInfo stream, TimeOptions time, bool has_field) {
    auto made = SurfaceTimeline::create(
        stream,
        {.field = has_field ? std::optional(DepthFieldOptions{}) : std::nullopt, .time = time});
    return made ? std::string() : made.error().message;
  };
  EXPECT_EQ(error(stream_info(), with_memory(), true), "");
  EXPECT_NE(error(stream_info(), with_memory(), false).find("method field"), std::string::npos);
  TimeOptions predict = with_memory();
  predict.mode = TimeMode::predict;
  EXPECT_NE(error(stream_info(), predict, true).find("interpolate"), std::string::npos);
  TimeOptions bad = with_memory();
  bad.memory.thickness = 0;
  EXPECT_NE(error(stream_info(), bad, true).find("memory_thickness"), std::string::npos);
}

}  // namespace
}  // namespace palpate
