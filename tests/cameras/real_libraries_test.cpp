// Libraries of makers that are there without any camera: what they answer, and that what we declare
// of them is what they have.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "palpate/cameras/cameras.h"
#include "src/cameras/camera_kinds.h"
#include "src/cameras/drivers/orbbec_api.h"
#include "tests/cameras/camera_fakes.h"

namespace palpate {
namespace {

TEST(RealFreenect, SeesNoKinect) {
  const FoundCameras found = find_freenect_cameras();
  if (found.library.empty()) GTEST_SKIP() << "SKIPPED: " << found.reason;
  EXPECT_EQ(found.library, "libfreenect.so.0.5");
  EXPECT_EQ(found.version, "0.5");
  if (!found.devices.empty()) GTEST_SKIP() << "SKIPPED: a Kinect is plugged in";
  const auto refused = open_camera("freenect");
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find(found.is_usable ? "sees no camera" : "cannot use USB"),
            std::string::npos)
      << refused.error().message;
}

class RealOrbbec : public testing::Test {
 protected:
  static void SetUpTestSuite() { setenv("VIRTUAL_ENV", PALPATE_SOURCE_DIR "/build/python", 0); }
  void SetUp() override {
    if (!orbbec::api()) GTEST_SKIP() << "SKIPPED: " << orbbec::api().error().message;
  }
  static const orbbec::Api& api() { return *orbbec::api(); }
  template <class Function>
  static Function* function(const char* name) {
    void* const library = dlopen(api().path.c_str(), RTLD_NOW | RTLD_NOLOAD);
    return reinterpret_cast<Function*>(dlsym(library, name));
  }
};

TEST_F(RealOrbbec, IsFoundAndSeesNoCamera) {
  const bool had_log = std::filesystem::exists("Log");
  const FoundCameras found = find_orbbec_cameras();
  EXPECT_TRUE(found.is_usable);
  EXPECT_TRUE(found.version.starts_with("2.")) << found.version;
  if (!found.devices.empty()) GTEST_SKIP() << "SKIPPED: a camera is plugged in";
  const auto refused = open_camera("orbbec");
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("sees no camera"), std::string::npos);
  EXPECT_EQ(std::filesystem::exists("Log"), had_log) << "it has written a log";
  orbbec::Failure* error = nullptr;
  orbbec::DeviceList* const list = api().query_devices(api().context, &error);
  EXPECT_EQ(api().device(list, 3, &error), nullptr);
  ASSERT_NE(error, nullptr);
  EXPECT_NE(std::string(api().message(error)).find("index"), std::string::npos);
  api().delete_error(error);
  api().delete_list(list, &error);
}

TEST_F(RealOrbbec, ItsProfilesAndFramesAreAsWeDeclareThem) {
  using namespace orbbec;
  constexpr int kDepthStream = 3, kWidth = 64, kHeight = 48;
  Failure* error = nullptr;
  Profile* const profile =
      function<Profile*(int, int, std::uint32_t, std::uint32_t, std::uint32_t, Failure**)>(
          "ob_create_video_stream_profile")(kDepthStream, kY16, kWidth, kHeight, 30, &error);
  ASSERT_EQ(error, nullptr) << api().message(error);
  function<void(Profile*, CameraIntrinsic, Failure**)>("ob_video_stream_profile_set_intrinsic")(
      profile, {60, 61, 31.5f, 23.5f, kWidth, kHeight}, &error);
  function<void(Profile*, CameraDistortion, Failure**)>("ob_video_stream_profile_set_distortion")(
      profile, {1, 2, 3, 4, 5, 6, 7, 8, kBrownConrady6}, &error);
  ASSERT_EQ(error, nullptr) << api().message(error);
  EXPECT_EQ(api().format(profile, &error), kY16);
  EXPECT_EQ(api().profile_width(profile, &error), std::uint32_t{kWidth});
  EXPECT_EQ(api().profile_height(profile, &error), std::uint32_t{kHeight});
  EXPECT_EQ(api().rate(profile, &error), 30U);
  const CameraIntrinsic camera = api().intrinsic(profile, &error);
  EXPECT_EQ(camera.fy, 61);
  EXPECT_EQ(camera.cy, 23.5f);
  EXPECT_EQ(camera.height, kHeight);
  const CameraDistortion bent = api().distortion(profile, &error);
  EXPECT_EQ(bent.k6, 6);
  EXPECT_EQ(bent.p2, 8);
  EXPECT_EQ(bent.model, kBrownConrady6);

  Frame* const frame = function<Frame*(const Profile*, Failure**)>(
      "ob_create_frame_from_stream_profile")(profile, &error);
  ASSERT_EQ(error, nullptr) << api().message(error);
  const auto pixels = test::pattern(kWidth, kHeight, 7);
  function<void(Frame*, const void*, std::uint32_t, Failure**)>("ob_frame_update_data")(
      frame, pixels.data(), static_cast<std::uint32_t>(2 * pixels.size()), &error);
  function<void(Frame*, std::uint64_t, Failure**)>("ob_frame_set_timestamp_us")(frame, 1234567,
                                                                                &error);
  function<void(Frame*, float, Failure**)>("ob_depth_frame_set_value_scale")(frame, 0.1f, &error);
  Frame* const frames = function<Frame*(Failure**)>("ob_create_frameset")(&error);
  function<void(Frame*, const Frame*, Failure**)>("ob_frameset_push_frame")(frames, frame, &error);
  ASSERT_EQ(error, nullptr) << api().message(error);

  Frame* const depth = api().depth_of(frames, &error);
  ASSERT_NE(depth, nullptr);
  EXPECT_EQ(api().width(depth, &error), std::uint32_t{kWidth});
  EXPECT_EQ(api().height(depth, &error), std::uint32_t{kHeight});
  EXPECT_EQ(api().num_bytes(depth, &error), 2 * pixels.size());
  EXPECT_EQ(std::memcmp(api().data(depth, &error), pixels.data(), 2 * pixels.size()), 0);
  EXPECT_EQ(api().microseconds(depth, &error), 1234567U);
  EXPECT_EQ(api().millimeters(depth, &error), 0.1f);
  Profile* const same = api().profile_of(depth, &error);
  EXPECT_EQ(api().intrinsic(same, &error).fx, 60);
  EXPECT_EQ(error, nullptr);
  api().delete_profile(same, &error);
  for (const Frame* each : {depth, frames, frame}) api().delete_frame(each, &error);
  api().delete_profile(profile, &error);
}

}  // namespace
}  // namespace palpate
