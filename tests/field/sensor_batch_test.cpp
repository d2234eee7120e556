// Many images at once on the CPU: the bits of one after the other.
#include <gtest/gtest.h>

#include "palpate/field/sensor.h"
#include "tests/field/device_views.h"
#include "tests/field/rough_images.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

void expect_same(const SurfaceBatch& got, Sensor& one_by_one,
                 const std::vector<DepthImageView>& images) {
  gpu::Stream stream(0, gpu::Priority::low);
  ASSERT_EQ(static_cast<std::size_t>(got.size()), images.size());
  for (std::size_t i = 0; i < images.size(); ++i) {
    SCOPED_TRACE(i);
    const SurfaceView surface = got[static_cast<int>(i)];
    EXPECT_EQ(surface.cloud.width, 0);
    EXPECT_EQ(surface.field.gpu, kHostMemory);
    test::expect_same_field(surface.field, one_by_one.update(images[i]).field, stream);
  }
}

TEST(SensorBatch, HasTheBitsOfSingleImages) {
  for (const auto& [width, height] : {std::pair{64, 64}, {33, 50}, {8, 8}}) {
    test::RoughImages images(width, height, 5, 1);
    if (width == 33) images.camera.distortion = {-0.28, 0.09, 0.001, -0.002, -0.01};
    std::vector<DepthImageView> in_counts, in_meters;
    for (int i = 0; i < 5; ++i) {
      in_counts.push_back(images.image(i));
      in_meters.push_back(images.image_in_meters(i));
    }
    Sensor single = Sensor::create(images.camera).value();
    for (const int num_threads : {1, 2, 7}) {
      SensorOptions options;
      options.num_threads = num_threads;
      Sensor sensor = Sensor::create(images.camera, Place::cpu(), options).value();
      expect_same(sensor.update_batch(images.image(0), 5), single, in_counts);
      expect_same(sensor.update_batch(images.image_in_meters(0), 5), single, in_meters);
      expect_same(sensor.update_batch(images.image(2), 2), single, {in_counts[2], in_counts[3]});
      EXPECT_TRUE(sensor.status());
    }
  }
}

TEST(SensorBatch, OnlyTheFirstOneAllocates) {
  const test::RoughImages images(40, 32, 4, 2);
  Sensor sensor = Sensor::create(images.camera).value();
  ASSERT_TRUE(sensor.reserve_batch(4));
  ASSERT_EQ(sensor.update_batch(images.image(0), 4).size(), 4);
  const test::AllocationCounter counter;
  for (int k = 0; k < 3; ++k) ASSERT_EQ(sensor.update_batch(images.image(0), 4).size(), 4);
  EXPECT_EQ(counter.count(), 0u);
}

TEST(SensorBatch, ImagesThatCannotBeTakenSayWhy) {
  const test::RoughImages images(40, 32, 2, 3);
  Sensor sensor = Sensor::create(images.camera).value();
  DepthImageView other = images.image(0);
  other.width = 20;
  EXPECT_EQ(sensor.update_batch(other, 2).size(), 0);
  ASSERT_FALSE(sensor.status());
  EXPECT_NE(sensor.status().error().message.find("20 x 32"), std::string::npos);
  other = images.image(0);
  other.gpu = 3;
  EXPECT_EQ(sensor.update_batch(other, 2).size(), 0);
  ASSERT_FALSE(sensor.status());
  EXPECT_EQ(sensor.update_batch(images.image(0), 0).size(), 0);
  EXPECT_TRUE(sensor.status());
}

}  // namespace
}  // namespace palpate
