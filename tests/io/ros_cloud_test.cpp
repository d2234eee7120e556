// sensor_msgs/PointCloud2: points wherever they lie, and one sentence for each message that lies.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "src/cloud/internal/cloud_camera.h"
#include "src/io/internal/ros_image.h"
#include "tests/io/made_cloud.h"

namespace palpate {
namespace {

using test::CloudLayout;

CloudPoints cloud() {
  CloudPoints points{5, 3, {}, {}};
  for (int i = 0; i < 15; ++i) {
    points.points.push_back({0.25f * static_cast<float>(i), -0.5f, 1 + static_cast<float>(i)});
  }
  points.points[7] = {std::nanf(""), std::nanf(""), std::nanf("")};
  return points;
}

void expect_same(const CloudPoints& read, const CloudPoints& expected) {
  ASSERT_EQ(read.width, expected.width);
  ASSERT_EQ(read.height, expected.height);
  ASSERT_EQ(read.points.size(), expected.points.size());
  for (std::size_t i = 0; i < read.points.size(); ++i) {
    if (std::isnan(expected.points[i].x)) {
      EXPECT_TRUE(std::isnan(read.points[i].x)) << i;
    } else {
      EXPECT_EQ(read.points[i], expected.points[i]) << i;
    }
  }
}

TEST(RosCloud, PointsAreReadWhereverTheyLie) {
  const CloudPoints expected = cloud();
  CloudPoints read;
  for (const CloudLayout& layout : CloudLayout::three()) {
    const Status status =
        read_point_cloud(test::cloud_message(expected.view(), layout), 1, {}, read);
    ASSERT_TRUE(status) << status.error().message;
    expect_same(read, expected);
    EXPECT_TRUE(read.normals.empty());
  }
}

TEST(RosCloud, WholeNumbersAreCountsOfAScale) {
  CloudPoints expected = cloud();
  expected.points[7] = {1, 2, 3};
  CloudPoints read;
  for (const std::uint8_t type : {3, 5}) {  // INT16, INT32
    const CloudLayout layout{{{"y", 4, type}, {"x", 0, type}, {"z", 8, type}}, 12, 0, true, 0.001};
    ASSERT_TRUE(read_point_cloud(test::cloud_message(expected.view(), layout), 0.001, {}, read));
    expect_same(read, expected);
  }
}

// In single precision they would be on a grid of 0.5 m.
TEST(RosCloud, FarFromTheOriginPointsKeepTheirDigits) {
  CloudPoints expected = cloud();
  for (Vec3f& p : expected.points) p = 0.001f * p;
  CloudLayout layout = CloudLayout::three()[2];
  layout.shift = {400'000, 5'000'000, 100};
  CloudPoints read;
  ASSERT_TRUE(
      read_point_cloud(test::cloud_message(expected.view(), layout), 1, layout.shift, read));
  for (std::size_t i = 0; i < read.points.size(); ++i) {
    if (i == 7) continue;
    EXPECT_LT(norm(to_double(read.points[i]) - to_double(expected.points[i])), 1e-8) << i;
  }
  // Zeros, which sensors send for no measurement, are none seen from anywhere.
  expected.points[3] = {};
  ASSERT_TRUE(read_point_cloud(test::cloud_message(expected.view()), 1, {1, 2, 3}, read));
  EXPECT_FALSE(is_measured(read.points[3]));
  EXPECT_TRUE(is_measured(read.points[4]));
}

TEST(RosCloud, NormalsAreReadIfThereAreThree) {
  CloudLayout layout{
      {{"x", 0}, {"y", 4}, {"z", 8}, {"normal_x", 0}, {"normal_y", 4}, {"normal_z", 8}}, 12};
  CloudPoints read;
  ASSERT_TRUE(read_point_cloud(test::cloud_message(cloud().view(), layout), 2, {}, read));
  ASSERT_EQ(read.normals.size(), 15u);
  EXPECT_EQ(read.normals[3], cloud().points[3]);
  EXPECT_EQ(read.points[3], 2.0f * cloud().points[3]);
  layout.fields.pop_back();
  ASSERT_TRUE(read_point_cloud(test::cloud_message(cloud().view(), layout), 1, {}, read));
  EXPECT_TRUE(read.normals.empty());
}

/// A message whose header says other than what its data are.
std::string with_size(std::uint32_t width, std::uint32_t height, std::uint32_t point_step,
                      std::uint32_t row_step, std::size_t num_bytes) {
  CdrWriter to;
  to.number(std::int32_t{1});
  to.number(std::uint32_t{0});
  to.text("cam");
  to.number(height);
  to.number(width);
  to.number(std::uint32_t{3});
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    to.text(std::string(1, static_cast<char>('x' + axis)));
    to.number(4 * axis);
    to.number(std::uint8_t{7});
    to.number(std::uint32_t{1});
  }
  to.number(std::uint8_t{0});
  to.number(point_step);
  to.number(row_step);
  const std::string data(num_bytes, '\0');
  to.bytes(data.data(), data.size());
  to.number(std::uint8_t{1});
  return to.take();
}

TEST(RosCloud, MessagesThatLieAreRefusedInASentence) {
  const auto refused = [](const std::string& message) {
    CloudPoints points;
    const Status status = read_point_cloud(message, 1, {}, points);
    EXPECT_TRUE(status || points.points.empty()) << "something was allocated";
    return status ? std::string() : status.error().message;
  };
  const auto expect = [&](const std::string& message, const std::string& words) {
    EXPECT_NE(refused(message).find(words), std::string::npos) << refused(message);
  };
  EXPECT_EQ(refused(with_size(4, 2, 12, 48, 96)), "");
  EXPECT_EQ(refused(with_size(4, 1, 12, 0, 48)), "");  // of one row, its step does not matter
  expect(with_size(4, 2, 11, 48, 96), "point_step of 11 bytes, and its field 'z' lies beyond");
  expect(with_size(4, 2, 12, 47, 96), "row_step of 47 bytes");
  expect(with_size(4, 2, 12, 48, 95), "claims more bytes than the 95");
  expect(with_size(4, 2, 12, 1'000'000, 96), "claims more bytes");
  expect(with_size(0, 2, 12, 48, 96), "has no points");
  expect(with_size(4, 0, 12, 48, 96), "has no points");
  expect(with_size(100'000'000, 1, 12, 0, 96), "has more than 16777216");
  expect(with_size(0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff, 96), "has more than 16777216");
  expect(with_size(16'777'216, 1, 12, 0, 96), "claims more bytes");
  expect(with_size(10'000'000, 1, 12, 0, 96), "claims more bytes");
  const CloudPoints points = cloud();
  const auto with = [&](std::vector<test::CloudField> fields) {
    return test::cloud_message(points.view(), {std::move(fields), 12});
  };
  expect(with({{"x", 0}, {"y", 4}, {"z", 8}, {"x", 0}}), "'x' twice");
  expect(with({{"x", 0}, {"y", 4}, {"Z", 8}}), "no field 'z' but x, y, Z");
  expect(with({}), "no field 'x' but none");
  expect(with({{"x", 0}, {"y", 4}, {"z", 8, 9}}), "'z' of the unknown type 9");
  expect(with({{"x", 0}, {"y", 4}, {"z", 0xfffffffe}}), "lies beyond");
  const std::string whole = test::cloud_message(points.view());
  for (std::size_t size = 0; size + 1 < whole.size(); size += 3) {
    EXPECT_NE(refused(whole.substr(0, size)), "") << size;
  }
}

}  // namespace
}  // namespace palpate
