// Depth by Video4Linux, with a kernel of the tests.
#include <gtest/gtest.h>

#include "src/cameras/drivers/v4l2_system.h"
#include "tests/cameras/conformance.h"
#include "tests/cameras/fake_v4l2.h"
#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

using test::FakeV4l2;

constexpr const char* kSmall = "v4l2?size=64x48&intrinsics=60,60,31.5,23.5";

class V4l2 : public testing::Test {
 protected:
  ~V4l2() override {
    EXPECT_EQ(kernel_.num_open, 0);
    EXPECT_EQ(kernel_.num_mapped, 0);
  }
  Result<RawStream> raw(const char* text) {
    return v4l2::open_camera(kernel_, parse_camera_uri(text).value());
  }
  Result<std::unique_ptr<DepthSource>> open(const char* text) {
    const OpenRaw again = [this, text] { return raw(text); };
    auto first = again();
    if (!first) return first.error();
    return make_live(*std::move(first), again, parse_camera_uri(text).value());
  }
  void expect_refused(const char* text, const char* words) {
    const auto refused = raw(text);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().message.find(words), std::string::npos) << refused.error().message;
  }

  FakeV4l2 kernel_;
};

TEST_F(V4l2, IsFoundAmongOtherDevices) {
  const FoundCameras found = v4l2::find_cameras(kernel_);
  EXPECT_EQ(found.devices, std::vector<std::string>{"v4l2:/dev/video2"});
  EXPECT_EQ(found.reason, "RealSense Depth 435");
  kernel_.is_plugged = false;
  EXPECT_TRUE(v4l2::find_cameras(kernel_).devices.empty());
  expect_refused("v4l2?intrinsics=60,60,31.5,23.5", "no camera that sends depth");
}

TEST_F(V4l2, RefusesWhatItCannotDo) {
  expect_refused("v4l2", "intrinsics=");
  expect_refused("v4l2:/dev/video0?intrinsics=60,60,31.5,23.5", "no depth");
  expect_refused("v4l2:1?intrinsics=60,60,31.5,23.5", "no depth");
  expect_refused("v4l2:/dev/video7?intrinsics=60,60,31.5,23.5", "No such file");
  expect_refused("v4l2?intrinsics=60,60,31.5,23.5&size=100x100", "848x480 at 90 Hz");
  expect_refused("v4l2?intrinsics=60,60,31.5,23.5&mode=3", "no parameter 'mode'");
  const auto usual = raw("v4l2:2?intrinsics=400,400,423.5,239.5").value();
  EXPECT_EQ(usual.source->info().width, 848);
  EXPECT_EQ(usual.source->info().rate, 30);
  EXPECT_EQ(usual.source->info().sensor, SensorKind::active_stereo);
}

TEST_F(V4l2, Conforms) {
  kernel_.padding = 10;
  test::expect_camera([&] { return open(kSmall); }, 30, 64, 48);
  test::expect_outlives_unplugging([&] { return open(kSmall); },
                                   [&](bool is_plugged) { kernel_.is_plugged = is_plugged; });
  test::expect_outlives_a_stall([&] { return open(kSmall); },
                                [&](bool is_stalled) { kernel_.is_stalled = is_stalled; });
}

TEST_F(V4l2, ComesBackWithAnotherSize) {
  const auto camera = open("v4l2?intrinsics=60,60,31.5,23.5").value();
  ASSERT_EQ(camera->info().width, 848);
  DepthFrame frame;
  ASSERT_TRUE(*camera->next(frame));
  kernel_.is_plugged = false;
  kernel_.sizes = {{64, 48}};
  std::string notes;
  const auto is_told = [&](const char* words) {
    notes += test::all_notes(*camera);
    return notes.find(words) != std::string::npos;
  };
  EXPECT_TRUE(test::wait_for([&] { return is_told("was lost"); }));
  kernel_.is_plugged = true;
  EXPECT_TRUE(test::next_until(*camera, frame,
                               [&] { return is_told("from 848 x 480 to 64 x 48 pixels"); }));
  EXPECT_EQ(frame.width, 848);
}

TEST_F(V4l2, BelievesTimesOfItsOwnClockAndLeavesDamagedFramesOut) {
  kernel_.num_damaged = 6;
  double last = monotonic_now() - 0.02;  // exposed and transferred so much before it comes
  auto camera = open(kSmall).value();
  DepthFrame frame;
  for (int k = 0; k < 10; ++k) {
    ASSERT_TRUE(*camera->next(frame));
    EXPECT_GE(test::number_of(frame, 1000), 6);
    EXPECT_LT(frame.timestamp, monotonic_now() - 0.02);
    EXPECT_GT(frame.timestamp, last);
    last = frame.timestamp;
  }
  camera->cancel();
  const std::string notes = test::all_notes(*camera);
  EXPECT_NE(notes.find("by this computer's clock"), std::string::npos) << notes;
  camera.reset();
  kernel_.is_monotonic = false;
  const double before = monotonic_now();
  const auto other = open(kSmall).value();
  ASSERT_TRUE(*other->next(frame));
  EXPECT_GE(frame.timestamp, before - 0.02);
}

TEST_F(V4l2, TenThousandFramesTakeNoMemory) {
  kernel_.microseconds = 50;
  const auto camera = raw(kSmall).value();
  test::expect_no_growth(*camera.source, 10000);
}

}  // namespace
}  // namespace palpate
