// Recordings with parts that cannot be read, or belong to another camera: a camera that needs them
// gets an error, and the rest is read.
#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "palpate/io/formats.h"
#include "tests/cameras/made_bag.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::Shot, test::camera_info, test::image;

constexpr char kTopic[] = "/cam/depth/image_raw", kInfo[] = "/cam/depth/camera_info";
constexpr char kImage[] = "sensor_msgs/Image", kCameraInfo[] = "sensor_msgs/CameraInfo";

class BagContents : public testing::Test {
 protected:
  struct Message {
    std::string topic, type, data;
  };
  void write(const std::vector<Message>& messages) const {
    std::string records;
    for (std::uint32_t i = 0; i < messages.size(); ++i) {
      const auto& [topic, type, data] = messages[i];
      records += test::ros1_connection(i, topic, type) + test::ros1_message(i, 100, i, data);
    }
    std::ofstream(path_, std::ios::binary) << test::ros1_bag({test::ros1_chunk(records)});
  }
  /// Reads all frames of the file, or of `path`; returns the error, empty if none.
  std::string read(const std::string& parameters = "", std::string path = "") {
    frames_.clear();
    notes_.clear();
    auto camera = open_camera("bag:" + (path.empty() ? path_ : path) + parameters);
    if (!camera) return camera.error().message;
    info_ = (*camera)->info();
    DepthFrame frame;
    for (;;) {
      const auto got = (*camera)->next(frame);
      if (!got) return got.error().message;
      if (!*got) break;
      frames_.push_back(frame);
    }
    for (const std::string& note : (*camera)->take_notes()) notes_ += note + "\n";
    return "";
  }
  static Shot at(int k) {
    Shot shot;
    shot.nanoseconds = static_cast<std::uint32_t>(k) * 50'000'000;
    return shot;
  }
  /// The usual image, 0.5 and 1 m away.
  void expect_depth(const DepthFrame& frame) const {
    ASSERT_EQ(frame.width, test::kWidth);
    for (int u = 0; u < frame.width; ++u) {
      EXPECT_NEAR(frame.pixels[static_cast<std::size_t>(u)] * frame.unit,
                  0.001 * test::count_at({}, u), 1e-9);
    }
  }

  const test::TemporaryFolder folder_;
  const std::string path_ = (folder_.path() / "scene.bag").string();
  DepthStreamInfo info_;
  std::vector<DepthFrame> frames_;
  std::string notes_;
};

#define EXPECT_WORDS(text, words) \
  EXPECT_NE(std::string(text).find(words), std::string::npos) << (text)

TEST_F(BagContents, WhatCannotBeReadOfAnotherCameraIsNoMatter) {
  Shot fisheye = at(0);
  fisheye.model = "equidistant";
  fisheye.distortion = {0.1, 0, 0, 0, 0};
  const Message tf{"/tf", "tf2_msgs/TFMessage", "damaged"};
  write({{"/a/fisheye/camera_info", kCameraInfo, camera_info(fisheye)},
         {"/b/camera_info", kCameraInfo, "damaged"},
         tf,
         {kInfo, kCameraInfo, camera_info(at(0))},
         {kTopic, kImage, image(at(0))}});
  EXPECT_EQ(read(), "");
  EXPECT_EQ(frames_.size(), 1u);
  EXPECT_EQ(notes_, "");
  EXPECT_EQ(info_.intrinsics.fx, 30);
  // Damaged messages that the camera needs are reported.
  EXPECT_WORDS(read("?world=map"), "a TFMessage is damaged");
  EXPECT_EQ(read("?world=cam"), "");
  EXPECT_WORDS(notes_, "a message of transforms is left out: a TFMessage is damaged");
  EXPECT_WORDS(read("?info=/a/fisheye/camera_info"),
               "/a/fisheye/camera_info: a camera_info has the distortion model 'equidistant'");
  write({{kInfo, kCameraInfo, camera_info(fisheye)}, {kTopic, kImage, image(at(0))}});
  EXPECT_WORDS(read(), std::string(kInfo) + ": a camera_info has the distortion model");
  EXPECT_EQ(read("?intrinsics=30,30,15.5,11.5"), "");
  EXPECT_WORDS(notes_, "/cam/depth/camera_info has messages that are left out");
  // One of many.
  write({{kInfo, kCameraInfo, "damaged"},
         {kInfo, kCameraInfo, camera_info(at(0))},
         {kTopic, kImage, image(at(0))}});
  EXPECT_EQ(read(), "");
  EXPECT_EQ(info_.intrinsics.fx, 30);
  EXPECT_WORDS(notes_, "a camera_info is damaged");
}

TEST_F(BagContents, TheLensOfAnotherCameraIsNotTakenWithoutAWord) {
  const auto with = [&](const char* frame, int width) {
    Shot other = at(0);
    other.frame = frame;
    other.info_width = width;
    write({{"/cam/color/camera_info", kCameraInfo, camera_info(other)},
           {kTopic, kImage, image(at(0))}});
    return read();
  };
  EXPECT_EQ(with("cam", 32), "");
  EXPECT_EQ(notes_, "");
  EXPECT_EQ(with("/cam", 32), "") << "as ROS 1 writes frames";
  EXPECT_EQ(notes_, "");
  EXPECT_EQ(with("color", 32), "");
  EXPECT_WORDS(notes_, "/cam/color/camera_info is of frame 'color' and 32 x 24 pixels");
  EXPECT_EQ(with("cam", 64), "");
  EXPECT_WORDS(notes_,
               "frame 'cam' and 64 x 24 pixels, the images on /cam/depth/image_raw are of "
               "frame 'cam' and 32 x 24 pixels");
  EXPECT_WORDS(with("color", 64), "; pass ?info=/TOPIC (/cam/color/camera_info) or ?intrinsics=");
  EXPECT_EQ(read("?info=/cam/color/camera_info"), "");
  EXPECT_EQ(notes_.find("frame"), std::string::npos) << "it was asked for";
  EXPECT_EQ(info_.intrinsics.fx, 15) << "half as large";
  EXPECT_EQ(read("?intrinsics=31,31,15.5,11.5"), "");
  EXPECT_EQ(info_.intrinsics.fx, 31);
  EXPECT_WORDS(read("?info=/nowhere"), "holds no camera_info on /nowhere");
  Shot fisheye = at(0);
  fisheye.frame = "fisheye";
  fisheye.model = "equidistant";
  fisheye.distortion = {0.1, 0, 0, 0};
  write({{"/fisheye/camera_info", kCameraInfo, camera_info(fisheye)},
         {kTopic, kImage, image(at(0))}});
  EXPECT_WORDS(read(), "/fisheye/camera_info: a camera_info has the distortion model");
  EXPECT_EQ(read("?intrinsics=31,31,15.5,11.5"), "");
  EXPECT_EQ(notes_, "");
}

// It lies beside them, and may be that of another camera all the same.
TEST_F(BagContents, TheLensBesideTheImagesIsCheckedToo) {
  const auto with = [&](const char* frame, int width) {
    Shot other = at(0);
    other.frame = frame;
    other.info_width = width;
    write({{kInfo, kCameraInfo, camera_info(other)}, {kTopic, kImage, image(at(0))}});
    return read();
  };
  EXPECT_EQ(with("cam", 64), "");
  EXPECT_EQ(notes_.find("camera_info"), std::string::npos) << "they are binned";
  EXPECT_EQ(info_.intrinsics.fx, 15);
  EXPECT_EQ(with("color", 32), "");
  EXPECT_WORDS(notes_, "is of frame 'color' and 32 x 24 pixels, the images on");
  EXPECT_WORDS(with("color", 64),
               "the camera_info on /cam/depth/camera_info is of frame 'color' and 64 x 24 pixels");
  EXPECT_EQ(read("?info=cam/depth/camera_info"), "") << "it was asked for, by its shorter name";
  EXPECT_EQ(notes_.find("camera_info"), std::string::npos);
  EXPECT_EQ(read("?topic=cam/depth/image_raw&intrinsics=31,31,15.5,11.5"), "");
  EXPECT_EQ(notes_, "");
  EXPECT_EQ(info_.intrinsics.fx, 31);
}

TEST_F(BagContents, ALensOfZerosIsLeftOutIfOthersAreGood) {
  Shot zeros = at(0);
  zeros.fx = 0;
  const Message bad{kInfo, kCameraInfo, camera_info(zeros)},
      good{kInfo, kCameraInfo, camera_info(at(0))};
  for (const bool is_first : {true, false}) {
    write({is_first ? bad : good,
           is_first ? good : bad,
           {kInfo, kCameraInfo, camera_info(at(1))},
           {kTopic, kImage, image(at(0))},
           {kTopic, kImage, image(at(1))}});
    EXPECT_EQ(read(), "");
    EXPECT_EQ(frames_.size(), 2u);
    EXPECT_EQ(info_.intrinsics.fx, 30);
    EXPECT_EQ(notes_,
              "/cam/depth/camera_info has messages that are left out: a camera_info without "
              "intrinsics, as of a camera that is not calibrated; calibrate it\n");
  }
  write({bad, {kTopic, kImage, image(at(0))}});
  EXPECT_WORDS(read(), "/cam/depth/camera_info: a camera_info without intrinsics");
  EXPECT_WORDS(read(), "pass ?intrinsics=fx,fy,cx,cy");
  EXPECT_EQ(read("?intrinsics=30,30,15.5,11.5"), "");
}

// Rectified images are those of P, whatever lens they were taken by.
TEST_F(BagContents, OfALensThatIsNotKnownRectifiedImagesAreRead) {
  const auto with = [&](const char* topic, const char* model, std::vector<double> coefficients) {
    Shot shot = at(0);
    shot.model = model;
    shot.distortion = std::move(coefficients);
    write({{kInfo, kCameraInfo, camera_info(shot)}, {topic, kImage, image(at(0))}});
    return read();
  };
  const std::vector<double> tilted(14, 0.01);
  for (const char* model : {"equidistant", "rational_polynomial", "of the maker's own"}) {
    EXPECT_EQ(with("/cam/depth/image_rect_raw", model, tilted), "") << model;
    EXPECT_EQ(notes_, "");
    EXPECT_EQ(info_.intrinsics.fx, 30);
    ASSERT_EQ(frames_.size(), 1u);
    expect_depth(frames_[0]);
    EXPECT_WORDS(with(kTopic, model, tilted), "with 14 coefficients; known are");
    EXPECT_WORDS(with(kTopic, model, tilted),
                 "record undistorted images, or pass ?intrinsics=fx,fy,cx,cy in pixels");
  }
  // Without coefficients, these are no pinhole's: r = f theta.
  for (const char* model : {"equidistant", "fisheye", "Kannala_Brandt4"}) {
    EXPECT_WORDS(with(kTopic, model, {0, 0, 0, 0}), "has the distortion model '") << model;
    EXPECT_EQ(with("/cam/depth/image_rect_raw", model, {0, 0, 0, 0}), "") << model;
  }
  EXPECT_EQ(with(kTopic, "of the maker's own", {0, 0, 0, 0}), "");
}

// Among several lenses on other topics, the one with the images' frame is taken.
TEST_F(BagContents, TheLensOfTheSameFrameIsTaken) {
  Shot left = at(0), right = at(0);
  left.frame = "left";
  right.frame = "right";
  right.fx = 40;
  const auto with = [&](const char* frame) {
    Shot depth = at(0);
    depth.frame = frame;
    write({{"/left/camera_info", kCameraInfo, camera_info(left)},
           {"/right/camera_info", kCameraInfo, camera_info(right)},
           {kTopic, kImage, image(depth)}});
    return read();
  };
  EXPECT_EQ(with("right"), "");
  EXPECT_EQ(info_.intrinsics.fx, 40);
  EXPECT_WORDS(with("depth"),
               "no camera_info lies beside /cam/depth/image_raw; pass ?info=/TOPIC "
               "(/left/camera_info, /right/camera_info) or ?intrinsics=");
}

TEST_F(BagContents, ImagesThatCannotBeReadAreLeftOutAndTold) {
  Shot empty = at(0);
  empty.width = empty.height = 0;
  const Message info{kInfo, kCameraInfo, camera_info(at(0))};
  std::string color = image(at(2));
  color.replace(color.find("16UC1"), 5, "8UC1 ");
  write({info,
         {kTopic, kImage, image(empty)},
         {kTopic, kImage, image(at(1))},
         {kTopic, kImage, color},
         {kTopic, kImage, image(at(3)).substr(0, 300)},
         {kTopic, kImage, image(at(4))}});
  EXPECT_EQ(read(), "");
  ASSERT_EQ(frames_.size(), 2u);
  EXPECT_NEAR(frames_[1].timestamp - frames_[0].timestamp, 0.15, 1e-6);
  EXPECT_WORDS(notes_, "/cam/depth/image_raw: a message is left out: a depth image is damaged\n");
  EXPECT_WORDS(notes_, "3 messages on /cam/depth/image_raw have been left out\n");
  // None is good: the reason is told.
  write({info, {kTopic, kImage, image(empty)}, {"/a/color", kImage, color}});
  EXPECT_WORDS(read(), "has no depth images");
  EXPECT_WORDS(read(),
               "; /cam/depth/image_raw: a depth image is damaged; /a/color: an image is of "
               "the encoding '8UC1 '");
}

TEST_F(BagContents, ImagesOfTheTransportCompressed) {
  const Message info{kInfo, kCameraInfo, camera_info(at(0))};
  const std::string type = "sensor_msgs/CompressedImage",
                    topic = std::string(kTopic) + "/compressed";
  DepthFrame frame{test::kWidth, test::kHeight, 0.001, {}};
  for (int i = 0; i < test::kWidth * test::kHeight; ++i) {
    frame.pixels.push_back(test::count_at({}, i % test::kWidth));
  }
  const std::string png = encode_depth_png(frame, "x").value();
  for (const char* format : {"16UC1; png compressed ", "mono16; png compressed ", "png"}) {
    write({info, {topic, type, test::compressed_image(at(0), format, png)}});
    EXPECT_EQ(read(), "") << format;
    ASSERT_EQ(frames_.size(), 1u);
    expect_depth(frames_[0]);
    EXPECT_EQ(info_.intrinsics.fx, 30) << "that of the image itself";
  }
  // With the 12 bytes of compressedDepth before it, whatever it is called.
  for (const char* format : {"16UC1; compressedDepth png", "16UC1; compressedDepth ", "16UC1",
                             "png", "16UC1; compressedDepth zip"}) {
    write({info,
           {std::string(kTopic) + "/compressedDepth", type,
            test::compressed_image(at(0), format, std::string(12, '\0') + png)}});
    EXPECT_EQ(read(), "") << format;
    ASSERT_EQ(frames_.size(), 1u);
    expect_depth(frames_[0]);
  }
  write({info,
         {topic, type,
          test::compressed_image(at(0), "16UC1; tiff compressed ", std::string(99, 'x'))}});
  EXPECT_WORDS(read(), "is of the format '16UC1; tiff compressed '");
  const std::string jpeg = "\xff\xd8\xff\xe0 and more";
  write({info,
         {"/cam/color/compressed", type,
          test::compressed_image(at(0), "rgb8; jpeg compressed bgr8", jpeg)},
         {topic, type, test::compressed_image(at(0), "16UC1; jpeg compressed ", jpeg)}});
  EXPECT_WORDS(read(),
               topic + ": an image is a JPEG, which keeps 8 bits and so has lost the depth");
}

TEST_F(BagContents, FloatsInMillimetersAreToldAndRead) {
  write({{kInfo, kCameraInfo, camera_info(at(0))},
         {kTopic, kImage, test::float_image(at(0), 0.001)}});
  EXPECT_EQ(read(), "");
  EXPECT_WORDS(notes_, "32FC1 in millimeters? Then give scale=0.001");
  EXPECT_EQ(read("?scale=0.001"), "");
  EXPECT_EQ(notes_, "");
  ASSERT_EQ(frames_.size(), 1u);
  expect_depth(frames_[0]);
  EXPECT_WORDS(read("?scale=mm"), "'scale' must be meters per number");
  write({{kInfo, kCameraInfo, camera_info(at(0))}, {kTopic, kImage, image(at(0))}});
  EXPECT_WORDS(read("?scale=0.001"), "are counts: pass ?unit=METERS");
  write({{kInfo, kCameraInfo, camera_info(at(0))}, {kTopic, kImage, test::float_image(at(0), 1)}});
  EXPECT_EQ(read(), "");
  EXPECT_EQ(notes_, "");
  expect_depth(frames_[0]);
}

TEST_F(BagContents, ALaterPartAloneKnowsWhatWasSentOnceInTheFirstOne) {
  write({{"/tf_static", "tf2_msgs/TFMessage", test::transform("map", "cam", {0, 0, 0, 1})},
         {kInfo, kCameraInfo, camera_info(at(0))},
         {kTopic, kImage, image(at(0))}});
  std::filesystem::rename(path_, folder_ / "first.bag");
  write({{kTopic, kImage, image(at(1))}});
  EXPECT_WORDS(read("?world=map"), "no transform joins");
  std::ofstream(folder_ / "metadata.yaml")
      << "a:\n  relative_file_paths:\n  - first.bag\n  - scene.bag\n";
  EXPECT_EQ(read("?world=map"), "");
  ASSERT_EQ(frames_.size(), 1u);
  EXPECT_EQ(frames_[0].X_WC.translation.x, 1);
  EXPECT_EQ(info_.intrinsics.fx, 30);
  EXPECT_WORDS(notes_, "is a part of a recording: what is sent once is read in " +
                           (folder_ / "first.bag").string());
}

TEST_F(BagContents, PartsThatAreMissingAreToldWithWhatIsNotFound) {
  write({{kInfo, kCameraInfo, camera_info(at(0))}, {kTopic, kImage, image(at(0))}});
  std::filesystem::rename(path_, folder_ / "x_0.bag");
  write({{kTopic, kImage, image(at(1))}});
  std::filesystem::rename(path_, folder_ / "x_2.bag");
  std::ofstream(folder_ / "metadata.yaml")
      << "a:\n  relative_file_paths:\n  - x_0.bag\n  - x_1.bag\n  - x_2.bag\n";
  const std::string lacks = folder_.path().string() + " lacks parts of its recording: ";
  EXPECT_EQ(read("", folder_.path().string()), "");
  EXPECT_EQ(frames_.size(), 2u);
  EXPECT_EQ(notes_, lacks + "x_1.bag\n");
  std::filesystem::remove(folder_ / "x_0.bag");
  EXPECT_WORDS(read("", folder_.path().string()), "unknown intrinsics; pass ?intrinsics=");
  EXPECT_WORDS(read("", folder_.path().string()), "; " + lacks + "x_0.bag, x_1.bag");
  EXPECT_WORDS(read("?world=map&intrinsics=30,30,15.5,11.5", folder_.path().string()), lacks);
}

TEST_F(BagContents, TransformsWithoutARotationAreNamed) {
  const std::string tf = "tf2_msgs/TFMessage";
  const auto with = [&](const std::array<double, 4>& q) {
    write({{"/tf_static", tf, test::transform("map", "cam", q)},
           {"/tf_static", tf, test::transform("map", "other", {0, 0, 0, 0})},
           {kInfo, kCameraInfo, camera_info(at(0))},
           {kTopic, kImage, image(at(0))}});
    return read("?world=map");
  };
  EXPECT_EQ(with({0, 0, 0, 1}), "");
  EXPECT_EQ(frames_.at(0).X_WC.translation.x, 1);
  EXPECT_EQ(notes_, "") << "that of the other frame is no matter";
  EXPECT_WORDS(with({0, 0, 0, 0}),
               "what it says of cam, other is no pose: its quaternion is not 1 long, as 0 0 0 0");
}

}  // namespace
}  // namespace palpate
