// OpenNI2's own library with a driver of the tests, and .oni files that its own recorder wrote.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <OniCAPI.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <thread>

#include "palpate/cameras/cameras.h"
#include "src/cameras/camera_kinds.h"
#include "src/cameras/drivers/openni2_api.h"
#include "tests/cameras/conformance.h"
#include "tests/cameras/fake_openni2.h"

namespace palpate {
namespace {

using test::FakeOpenni2;

class Openni2 : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    setenv("OPENNI2_REDIST", OPENNI2_TEST_REDIST, 1);
    ASSERT_TRUE(openni2::api()) << openni2::api().error().message;
    void* const driver = dlopen(OPENNI2_TEST_DRIVER, RTLD_NOW | RTLD_NOLOAD);
    ASSERT_NE(driver, nullptr) << "OpenNI2 has not loaded the driver";
    control_ = reinterpret_cast<FakeOpenni2* (*)()>(dlsym(driver, "palpate_fake_openni2"))();
  }
  void SetUp() override {
    if (!control_->is_plugged) control_->plug(true);
    control_->is_stalled = false;
    control_->microseconds = 5000;
    control_->num_frames = -1;
    control_->num_sent = 0;
  }

  template <class Function>
  static Function* function(const char* name) {
    void* const library = dlopen(openni2::api()->path.c_str(), RTLD_NOW | RTLD_NOLOAD);
    return reinterpret_cast<Function*>(dlsym(library, name));
  }

  /// `num` frames of the camera, by the recorder of OpenNI2.
  static void record(const std::string& file, int num) {
    control_->num_frames = num;
    OniDeviceHandle device = nullptr;
    ASSERT_EQ(function<decltype(oniDeviceOpen)>("oniDeviceOpen")("fake:0", &device), 0);
    OniStreamHandle stream = nullptr;
    ASSERT_EQ(function<decltype(oniDeviceCreateStream)>("oniDeviceCreateStream")(
                  device, ONI_SENSOR_DEPTH, &stream),
              0);
    OniRecorderHandle recorder = nullptr;
    ASSERT_EQ(function<decltype(oniCreateRecorder)>("oniCreateRecorder")(file.c_str(), &recorder),
              0);
    ASSERT_EQ(
        function<decltype(oniRecorderAttachStream)>("oniRecorderAttachStream")(recorder, stream, 0),
        0);
    ASSERT_EQ(function<decltype(oniRecorderStart)>("oniRecorderStart")(recorder), 0);
    // The recorder takes no frames until its thread has begun; those that it took, it writes.
    test::sleep_seconds(0.2);
    ASSERT_EQ(function<decltype(oniStreamStart)>("oniStreamStart")(stream), 0);
    while (control_->num_sent < num) test::sleep_seconds(0.005);
    function<decltype(oniRecorderStop)>("oniRecorderStop")(recorder);
    function<decltype(oniRecorderDestroy)>("oniRecorderDestroy")(&recorder);
    function<decltype(oniStreamStop)>("oniStreamStop")(stream);
    function<decltype(oniStreamDestroy)>("oniStreamDestroy")(stream);
    function<decltype(oniDeviceClose)>("oniDeviceClose")(device);
  }

  inline static FakeOpenni2* control_ = nullptr;
};

TEST_F(Openni2, IsFoundWithItsVersionAndCamera) {
  for (const FoundCameras& found : find_cameras()) {
    if (found.kind != "openni2") continue;
    EXPECT_TRUE(found.is_usable);
    EXPECT_TRUE(found.version.starts_with("2.")) << found.version;
    EXPECT_EQ(found.devices, std::vector<std::string>{"openni2:fake:0"});
    return;
  }
  FAIL();
}

TEST_F(Openni2, ACameraConforms) {
  test::expect_camera([] { return open_camera("openni2?size=64x48"); }, 30, 64, 48);
  const auto camera = open_camera("openni2:fake:0?size=320x240").value();
  // Focal lengths follow from the field of view that the driver reports.
  EXPECT_NEAR(camera->info().intrinsics.fx, 160 / std::tan(1.0145 / 2), 1e-3);
  EXPECT_NEAR(camera->info().intrinsics.fy, 120 / std::tan(0.7898 / 2), 1e-3);
  EXPECT_EQ(camera->info().intrinsics.cx, 159.5);
  EXPECT_EQ(camera->info().sensor, SensorKind::structured_light);
  EXPECT_EQ(camera->info().rate, 30);
}

TEST_F(Openni2, TheUsualModeIsTheDefaultAndOthersAreTold) {
  EXPECT_EQ(open_camera("openni2").value()->info().width, 640);
  const auto refused = open_camera("openni2?size=100x100");
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("640x480 at 30 Hz"), std::string::npos)
      << refused.error().message;
}

TEST_F(Openni2, ItsRecordingsConform) {
  const std::string file =
      (std::filesystem::temp_directory_path() / ("palpate_" + std::to_string(getpid()) + ".oni"))
          .string();
  control_->width = 64;
  control_->height = 48;
  control_->microseconds = 10000;
  record(file, 30);
  for (int round = 0; round < 2; ++round) {
    test::expect_recording([&] { return open_camera("openni2:" + file); }, 30, 64, 48);
  }
  std::filesystem::remove(file);
  EXPECT_NE(open_camera("openni2:" + file).error().message.find("no such file"), std::string::npos);
  std::ofstream(file) << "not a recording";
  EXPECT_FALSE(open_camera("openni2:" + file));
  std::filesystem::remove(file);
}

TEST_F(Openni2, CanBeOpenedAgainWhenTheThreadThatReadItIsGone) {
  for (int round = 0; round < 3; ++round) {
    const auto camera = open_camera("openni2?size=64x48").value();
    DepthFrame frame;
    ASSERT_TRUE(*camera->next(frame));
    // The system keeps the memory of threads that have ended for new ones, up to some amount.
    std::vector<std::thread> others;
    for (int k = 0; k < 16; ++k) others.emplace_back([] { test::sleep_seconds(0.02); });
    for (std::thread& other : others) other.join();
  }
}

TEST_F(Openni2, OutlivesBeingUnpluggedAndAStall) {
  const auto open = [] { return open_camera("openni2?size=64x48"); };
  test::expect_outlives_unplugging(open, [](bool is_plugged) { control_->plug(is_plugged); });
  test::expect_outlives_a_stall(open, [](bool is_stalled) { control_->is_stalled = is_stalled; });
}

TEST_F(Openni2, AnotherImageSizeIsFollowed) {
  const auto camera = open_camera("openni2?size=64x48").value();
  DepthFrame frame;
  ASSERT_TRUE(*camera->next(frame));
  control_->width = 32;
  control_->height = 24;
  std::string notes;
  EXPECT_TRUE(test::next_until(
      *camera, frame,
      [&] { return (notes += test::all_notes(*camera)).find("64 x 48 to 32 x 24") != notes.npos; },
      2000))
      << notes;
  EXPECT_EQ(frame.width, 64);
}

TEST_F(Openni2, TenThousandFramesTakeNoMemory) {
  control_->microseconds = 0;
  const auto raw = open_openni2_camera(parse_camera_uri("openni2?size=64x48").value(), {});
  ASSERT_TRUE(raw);
  test::expect_no_growth(*raw->source, 10000);
}

}  // namespace
}  // namespace palpate
