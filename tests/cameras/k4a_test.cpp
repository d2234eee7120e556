// libk4a and libk4arecord as pip gives them: recordings that its own recorder wrote, without a
// camera.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "palpate/cameras/open_camera.h"
#include "src/cameras/camera_kinds.h"
#include "tests/cameras/conformance.h"

namespace palpate {
namespace {

constexpr int kWidth = 640, kHeight = 576;
constexpr const char* kCamera = "?intrinsics=504,504,320,288";

struct Handle;
struct Configuration {
  int color_format, color_resolution, depth_mode, rate;
  bool only_synchronized;
  std::int32_t delay;
  int sync_mode;
  std::uint32_t subordinate_delay;
  bool no_light;
};

class K4a : public testing::Test {
 protected:
  static void SetUpTestSuite() { setenv("VIRTUAL_ENV", PALPATE_SOURCE_DIR "/build/python", 0); }
  void SetUp() override {
    found_ = find_k4a_cameras();
    if (!found_.is_usable) GTEST_SKIP() << found_.reason;
    if (found_.reason.find("no recordings") != std::string::npos) GTEST_SKIP() << found_.reason;
  }

  /// Whatever library of the two has it: both are loaded.
  template <class Function>
  Function* function(const char* name) const {
    const auto folder = std::filesystem::path(found_.library).parent_path();
    for (const auto& file : std::filesystem::directory_iterator(folder)) {
      void* const library = dlopen(file.path().c_str(), RTLD_NOW | RTLD_NOLOAD);
      void* const symbol = library == nullptr ? nullptr : dlsym(library, name);
      if (symbol != nullptr) return reinterpret_cast<Function*>(symbol);
    }
    throw std::runtime_error(std::string("no ") + name);
  }

  void record(const std::string& path, int num) const {
    const Configuration configuration{0, 0, 2, 2, false, 0, 0, 0, false};
    Handle* recording = nullptr;
    ASSERT_EQ((function<int(const char*, Handle*, Configuration, Handle**)>("k4a_record_create")(
                  path.c_str(), nullptr, configuration, &recording)),
              0);
    ASSERT_EQ(function<int(Handle*)>("k4a_record_write_header")(recording), 0);
    for (int k = 0; k < num; ++k) {
      constexpr int kDepth16 = 4;
      Handle *image = nullptr, *capture = nullptr;
      ASSERT_EQ((function<int(int, int, int, int, Handle**)>("k4a_image_create")(
                    kDepth16, kWidth, kHeight, 2 * kWidth, &image)),
                0);
      const auto pixels = test::pattern(kWidth, kHeight, k);
      std::memcpy(function<std::uint8_t*(Handle*)>("k4a_image_get_buffer")(image), pixels.data(),
                  2 * pixels.size());
      function<void(Handle*, std::uint64_t)>("k4a_image_set_device_timestamp_usec")(
          image, 1000000 + static_cast<std::uint64_t>(k) * 33333);
      ASSERT_EQ(function<int(Handle**)>("k4a_capture_create")(&capture), 0);
      function<void(Handle*, Handle*)>("k4a_capture_set_depth_image")(capture, image);
      ASSERT_EQ((function<int(Handle*, Handle*)>("k4a_record_write_capture")(recording, capture)),
                0);
      function<void(Handle*)>("k4a_image_release")(image);
      function<void(Handle*)>("k4a_capture_release")(capture);
    }
    ASSERT_EQ(function<int(Handle*)>("k4a_record_flush")(recording), 0);
    function<void(Handle*)>("k4a_record_close")(recording);
  }

  FoundCameras found_;
};

TEST_F(K4a, IsFoundWithItsVersion) {
  EXPECT_TRUE(found_.version.starts_with("1.")) << found_.version;
  EXPECT_NE(open_camera("k4a").error().message.find("number 0"), std::string::npos);
  EXPECT_NE(open_camera("k4a:first").error().message.find("NUMBER"), std::string::npos);
}

TEST_F(K4a, ItsRecordingsConform) {
  const std::string file =
      (std::filesystem::temp_directory_path() / ("palpate_" + std::to_string(getpid()) + ".mkv"))
          .string();
  record(file, 5);
  for (int round = 0; round < 2; ++round) {
    test::expect_recording([&] { return open_camera("k4a:" + file + kCamera); }, 5, kWidth,
                           kHeight);
  }
  // This one has no calibration.
  EXPECT_NE(open_camera("k4a:" + file).error().message.find("intrinsics="), std::string::npos);
  std::filesystem::remove(file);
  EXPECT_NE(open_camera("k4a:" + file).error().message.find("no such file"), std::string::npos);
  std::ofstream(file) << "not a recording";
  EXPECT_NE(open_camera("k4a:" + file).error().message.find("cannot be played"), std::string::npos);
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace palpate
