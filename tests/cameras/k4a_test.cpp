// libk4a and libk4arecord as pip gives them: recordings that its own recorder wrote, without a
// camera.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "palpate/cameras/cameras.h"
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

/// Lens of a sensor of 1024 x 1024 pixels; the narrow mode shows 640 x 576 from (192, 180) on.
constexpr double kCx = 0.5122, kCy = 0.4945, kFx = 0.4921, kFy = 0.4923;  // shares of the sensor
const Distortion kLens{3.13, 2.32, 8e-5, -5e-5, 0.13, 3.46, 3.35, 0.66};

/// As a camera gives it, with what the library insists on.
std::string calibration_json() {
  const std::string still =
      R"("Rt": {"Rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "Translation": [0, 0, 0]})";
  const auto camera = [&](const std::string& location, int width, int height) {
    char numbers[300];
    std::snprintf(numbers, sizeof numbers,
                  "[%.9g, %.9g, %.9g, %.9g, %.9g, %.9g, %.9g, %.9g, %.9g, %.9g, 0, 0, %.9g, %.9g]",
                  kCx, kCy, kFx, kFy, kLens.k1, kLens.k2, kLens.k3, kLens.k4, kLens.k5, kLens.k6,
                  kLens.p2, kLens.p1);
    return R"({"Intrinsics": {"ModelParameterCount": 14, "ModelParameters": )" +
           std::string(numbers) +
           R"(, "ModelType": "CALIBRATION_LensDistortionModelBrownConrady"}, "Location": )" +
           R"("CALIBRATION_CameraLocation)" + location + R"(", "MetricRadius": 1.74, )" + still +
           R"(, "SensorWidth": )" + std::to_string(width) + R"(, "SensorHeight": )" +
           std::to_string(height) + "}";
  };
  const auto inertial = [&](const std::string& type) {
    return R"({"SensorType": "CALIBRATION_InertialSensorType_)" + type + R"(", )" + still +
           R"(, "BiasTemperatureModel": [0], "BiasUncertainty": [0, 0, 0], )" +
           R"("MixingMatrixTemperatureModel": [1], "ModelTypeMask": 16, "Noise": [0], )" +
           R"("SecondOrderScaling": [0], "TemperatureBounds": [5, 60], "TemperatureC": 25})";
  };
  return R"({"CalibrationInformation": {"Cameras": [)" + camera("D0", 1024, 1024) + ", " +
         camera("PV0", 4096, 3072) + R"(], "InertialSensors": [)" + inertial("Gyro") + ", " +
         inertial("Accelerometer") + "]}}";
}

class K4a : public testing::Test {
 protected:
  static void SetUpTestSuite() { setenv("VIRTUAL_ENV", PALPATE_SOURCE_DIR "/build/python", 0); }
  void SetUp() override {
    found_ = find_k4a_cameras();
    if (!found_.is_usable) GTEST_SKIP() << "SKIPPED: " << found_.reason;
    if (found_.reason.find("no recordings") != std::string::npos)
      GTEST_SKIP() << "SKIPPED: " << found_.reason;
  }

  /// Returns a function of either library: both are loaded.
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

  void record(const std::string& path, int num, std::string calibration = "") const {
    const Configuration configuration{0, 0, 2, 2, false, 0, 0, 0, false};
    Handle* recording = nullptr;
    ASSERT_EQ((function<int(const char*, Handle*, Configuration, Handle**)>("k4a_record_create")(
                  path.c_str(), nullptr, configuration, &recording)),
              0);
    if (!calibration.empty()) {
      ASSERT_EQ(
          (function<int(Handle*, const char*, const std::uint8_t*, std::size_t)>(
              "k4a_record_add_attachment")(
              recording, "calibration.json",
              reinterpret_cast<const std::uint8_t*>(calibration.c_str()), calibration.size() + 1)),
          0);
    }
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

// Frames are undistorted by the calibration as the library reads it.
TEST_F(K4a, TheCalibrationInARecordingIsTaken) {
  const std::string file = (std::filesystem::temp_directory_path() /
                            ("palpate_lens_" + std::to_string(getpid()) + ".mkv"))
                               .string();
  record(file, 3, calibration_json());
  const Intrinsics want{1024 * kFx, 1024 * kFy, 1024 * kCx - 192 - 0.5, 1024 * kCy - 180 - 0.5};
  {
    const auto raw = open_k4a_camera(parse_camera_uri("k4a:" + file).value(), {}).value();
    const Intrinsics& got = raw.source->info().intrinsics;
    for (const auto member : {&Intrinsics::fx, &Intrinsics::fy, &Intrinsics::cx, &Intrinsics::cy}) {
      EXPECT_NEAR(got.*member, want.*member, 1e-3);
    }
    const Distortion& bent = raw.source->info().distortion;
    for (const auto member : {&Distortion::k1, &Distortion::k2, &Distortion::p1, &Distortion::p2,
                              &Distortion::k3, &Distortion::k4, &Distortion::k5, &Distortion::k6}) {
      EXPECT_NEAR(bent.*member, kLens.*member, 1e-6);
    }
    EXPECT_EQ(raw.source->info().sensor, SensorKind::tof);
  }
  const auto camera = open_camera("k4a:" + file).value();
  EXPECT_EQ(camera->info().distortion, Distortion{});
  DepthFrame frame;
  for (int number = 0; number < 3; ++number) {
    ASSERT_TRUE(camera->next(frame).value());
    const auto sent = test::pattern(kWidth, kHeight, number);
    int num_seen = 0, num_wrong = 0;
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        // As the documentation of OpenCV's calib3d writes it.
        const double x = (u - want.cx) / want.fx, y = (v - want.cy) / want.fy;
        const double r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
        const Distortion& d = kLens;
        const double radial =
            (1 + d.k1 * r2 + d.k2 * r4 + d.k3 * r6) / (1 + d.k4 * r2 + d.k5 * r4 + d.k6 * r6);
        const double u_raw =
            want.fx * (x * radial + 2 * d.p1 * x * y + d.p2 * (r2 + 2 * x * x)) + want.cx;
        const double v_raw =
            want.fy * (y * radial + d.p1 * (r2 + 2 * y * y) + 2 * d.p2 * x * y) + want.cy;
        const double du = std::abs(u_raw - std::floor(u_raw) - 0.5),
                     dv = std::abs(v_raw - std::floor(v_raw) - 0.5);
        if (du < 1e-3 || dv < 1e-3) continue;  // single precision decides which is nearest
        const double un = std::round(u_raw), vn = std::round(v_raw);
        const bool is_inside = un >= 0 && vn >= 0 && un < kWidth && vn < kHeight;
        const int want_count = is_inside ? sent[static_cast<std::size_t>(vn * kWidth + un)] : 0;
        num_seen += is_inside;
        num_wrong += frame.pixels[static_cast<std::size_t>(v * kWidth + u)] != want_count;
      }
    }
    EXPECT_EQ(num_wrong, 0) << number;
    EXPECT_GT(num_seen, kWidth * kHeight * 3 / 4);
  }
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace palpate
