// Bags of ROS 1 whose camera, stamps and types change in mid-stream.
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "tests/cameras/made_bag.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::Bytes, test::Shot, test::camera_info, test::image, test::kHeight, test::kWidth;

constexpr int kNumFrames = 10;
constexpr char kTopic[] = "/cam/depth/image_raw";

class BagCamera : public testing::Test {
 protected:
  void write(const std::function<Shot(int)>& shot_of, bool has_texts = false) {
    std::string records =
        test::ros1_connection(0, kTopic, "sensor_msgs/Image") +
        test::ros1_connection(1, "/cam/depth/camera_info", "sensor_msgs/CameraInfo") +
        test::ros1_connection(2, kTopic, "std_msgs/String");
    for (int k = 0; k < kNumFrames; ++k) {
      Shot shot = shot_of(k);
      records += test::ros1_message(0, 100, 0, image(shot)) +
                 test::ros1_message(1, 100, 0, camera_info(shot));
      if (has_texts) records += test::ros1_message(2, 100, 0, Bytes().text("hello").str());
    }
    std::ofstream(path_, std::ios::binary) << test::ros1_bag({test::ros1_chunk(records)});
  }
  void read() {
    frames_.clear();
    auto camera = open_camera("bag:" + path_);
    ASSERT_TRUE(camera) << camera.error().message;
    info_ = (*camera)->info();
    DepthFrame frame;
    for (;;) {
      const auto got = (*camera)->next(frame);
      ASSERT_TRUE(got) << got.error().message;
      if (!*got) break;
      frames_.push_back(frame);
    }
    notes_ = (*camera)->take_notes();
  }
  bool is_noted(const std::string& words) const {
    for (const std::string& note : notes_) {
      if (note.find(words) != std::string::npos) return true;
    }
    return false;
  }

  const test::TemporaryFolder folder_;
  const std::string path_ = (folder_.path() / "scene.bag").string();
  DepthStreamInfo info_;
  std::vector<DepthFrame> frames_;
  std::vector<std::string> notes_;
};

Shot in_time(int k) {
  Shot shot;
  shot.nanoseconds = static_cast<std::uint32_t>(k) * 50'000'000;
  return shot;
}

TEST_F(BagCamera, OfAStillCameraThereIsNothingToSay) {
  write(in_time);
  read();
  EXPECT_EQ(frames_.size(), 10u);
  EXPECT_NEAR(info_.rate, 20, 1e-6);
  EXPECT_TRUE(notes_.empty()) << notes_.front();
}

// camera_info is that of all that the camera sees: its pixels are 1 and, binned, 2 x 2 of those.
TEST_F(BagCamera, ShowsARegionOfWhatItsCameraSees) {
  struct Case {
    int width, height;
    std::uint32_t binning;
    std::array<std::uint32_t, 4> roi;
    Intrinsics expected;
  };
  for (const Case& one : {Case{16, 12, 0, {8, 6, 12, 16}, {30, 30, 7.5, 5.5}},
                          Case{16, 12, 1, {4, 2, 12, 16}, {30, 30, 11.5, 9.5}},
                          Case{32, 12, 1, {0, 10, 12, 32}, {30, 30, 15.5, 1.5}},
                          Case{8, 8, 2, {16, 8, 16, 16}, {15, 15, -0.5, 1.5}},
                          Case{16, 12, 2, {0, 0, 0, 0}, {15, 15, 7.5, 5.5}},
                          Case{16, 12, 2, {0, 0, 24, 32}, {15, 15, 7.5, 5.5}},
                          Case{32, 24, 0, {8, 6, 12, 16}, {30, 30, 15.5, 11.5}},
                          Case{32, 24, 0, {20, 6, 24, 32}, {30, 30, 15.5, 11.5}}}) {
    write([&](int k) {
      Shot shot = in_time(k);
      shot.width = one.width;
      shot.height = one.height;
      shot.binning = one.binning;
      shot.roi = one.roi;
      return shot;
    });
    read();
    EXPECT_EQ(info_.width, one.width);
    const Intrinsics& k = info_.intrinsics;
    EXPECT_NEAR(k.fx, one.expected.fx, 1e-12);
    EXPECT_NEAR(k.fy, one.expected.fy, 1e-12);
    EXPECT_NEAR(k.cx, one.expected.cx, 1e-12);
    EXPECT_NEAR(k.cy, one.expected.cy, 1e-12);
  }
}

// Each image is seen by the lens of its time, whichever message comes first, and turned into the
// first one.
TEST_F(BagCamera, ALensThatChangesIsFollowed) {
  write([](int k) {
    Shot shot = in_time(k);
    if (k >= 5) shot.fx = 60;
    return shot;
  });
  read();
  ASSERT_EQ(frames_.size(), 10u);
  EXPECT_EQ(info_.intrinsics.fx, 30);
  for (std::size_t k = 0; k < frames_.size(); ++k) {
    const auto row = frames_[k].pixels.begin() + 12 * kWidth;
    // A lens of twice the focal length sees the inner half only.
    EXPECT_EQ(row[2] != 0, k < 5) << k;
    EXPECT_EQ(row[12], 500) << k;
    EXPECT_EQ(row[20], 1000) << k;
  }
  EXPECT_TRUE(is_noted("camera_info changes"));
}

TEST_F(BagCamera, ASizeThatChangesIsFollowed) {
  write([](int k) {
    Shot shot = in_time(k);
    if (k >= 5) shot.width = 2 * kWidth, shot.height = 2 * kHeight;
    return shot;
  });
  read();
  ASSERT_EQ(frames_.size(), 10u);
  for (const DepthFrame& frame : frames_) {
    EXPECT_EQ(frame.width, kWidth);
    const auto row = frame.pixels.begin() + 12 * kWidth;
    for (int u = 1; u < kWidth - 1; ++u) EXPECT_EQ(row[u], 2 * u < kWidth ? 500 : 1000) << u;
  }
  EXPECT_TRUE(is_noted("size of its images changes"));
}

TEST_F(BagCamera, OtherTypesOnItsTopicAreLeftOutAndTold) {
  write(in_time, true);
  read();
  EXPECT_EQ(frames_.size(), 10u);
  EXPECT_TRUE(is_noted("10 messages on /cam/depth/image_raw are left out"));
}

TEST_F(BagCamera, StampsThatGoBackAreToldWithTheirNumber) {
  write([](int k) {
    Shot shot = in_time(k);
    if (k >= 6) shot.seconds = 90;
    return shot;
  });
  read();
  EXPECT_EQ(frames_.size(), 6u);
  EXPECT_TRUE(is_noted("4 of its 10 frames are left out"));
}

// The rate is that of most frames, and the hour is told.
TEST_F(BagCamera, AnHourBetweenTwoFramesIsTold) {
  write([](int k) {
    Shot shot = in_time(k);
    if (k >= 6) shot.seconds += 3600;
    return shot;
  });
  read();
  EXPECT_EQ(frames_.size(), 10u);
  EXPECT_NEAR(info_.rate, 20, 1e-6);
  EXPECT_TRUE(is_noted("3600 s lie between two of its frames"));
}

TEST_F(BagCamera, AUnitThatCannotBeIsRefusedUnlessAnotherIsGiven) {
  const Shot shot;
  const std::string unit = "/cam/option/Depth_Units/value";
  std::ofstream(path_, std::ios::binary) << test::ros1_bag({test::ros1_chunk(
      test::ros1_connection(0, kTopic, "sensor_msgs/Image") +
      test::ros1_connection(1, "/cam/depth/camera_info", "sensor_msgs/CameraInfo") +
      test::ros1_connection(2, unit, "std_msgs/Float32") +
      test::ros1_message(2, 100, 0, test::bytes_of(0x40200000)) +
      test::ros1_message(0, 100, 0, image(shot)) +
      test::ros1_message(1, 100, 0, camera_info(shot)))});
  const auto refused = open_camera("bag:" + path_);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("declares a unit of 2.5 m per count"), std::string::npos)
      << refused.error().message;
  const auto camera = open_camera("bag:" + path_ + "?unit=0.002");
  ASSERT_TRUE(camera) << camera.error().message;
  DepthFrame frame;
  ASSERT_TRUE((*camera)->next(frame).value());
  EXPECT_EQ(frame.unit, 0.002);
}

TEST_F(BagCamera, OneThatIsCutBeforeItsFirstImageSaysSo) {
  write(in_time);
  std::string bytes;
  {
    std::ifstream file(path_, std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(file), {});
  }
  std::ofstream(path_, std::ios::binary) << bytes.substr(0, bytes.size() / 2);
  const auto camera = open_camera("bag:" + path_);
  ASSERT_FALSE(camera);
  EXPECT_NE(camera.error().message.find("the file was cut off"), std::string::npos)
      << camera.error().message;
}

}  // namespace
}  // namespace palpate
