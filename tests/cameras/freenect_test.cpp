// libfreenect's own player of recordings, fakenect, as the distribution gives it.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "palpate/cameras/cameras.h"
#include "src/cameras/camera_kinds.h"
#include "tests/cameras/conformance.h"

namespace palpate {
namespace {

constexpr int kWidth = 640, kHeight = 480;
constexpr int kNumSlow = 300, kNumFast = 14100;

/// Returns the depth by a Kinect's usual calibration, in its inventors' terms: reference plane at
/// 120 cm, base line of 7.5 cm, pixel of 0.1042 cm at the plane, 200 quarters of shift there.
std::uint16_t millimeters(int disparity) {
  if (disparity == 2047) return 0;
  const double shift = ((disparity - 4 * 200.0) / 4 - 0.375) * 0.1042;
  const double depth = 10 * (shift * 120 / (7.5 - shift) + 120);
  return shift < 7.5 && depth < 10000 ? static_cast<std::uint16_t>(std::lround(depth)) : 0;
}

std::vector<std::uint16_t> disparities(int number) {
  auto pixels = test::pattern(kWidth, kHeight, number % 30);
  for (auto& pixel : pixels) pixel &= 2047;
  return pixels;
}

std::vector<std::uint16_t> depths(int, int, int number) {
  auto pixels = disparities(number);
  for (auto& pixel : pixels) pixel = millimeters(pixel);
  return pixels;
}

/// Writes a recording as fakenect-record does: thirty images, shown again and again, two hundredths
/// of a second apart by the camera's clock, whose 32 bits overflow every 3579 images.
void write_recording(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  for (int k = 0; k < 30; ++k) {
    std::ofstream image(folder / ("image" + std::to_string(k)), std::ios::binary);
    const auto pixels = disparities(k);
    image << "P5 640 480 65535\n";
    image.write(reinterpret_cast<const char*>(pixels.data()),
                static_cast<std::streamsize>(2 * pixels.size()));
  }
  std::ofstream index(folder / "INDEX.txt");
  double time = 1000;
  std::uint32_t stamp = 4294967295U - 20 * 1200000U;
  for (int k = 0; k < kNumSlow + kNumFast; ++k) {
    char name[80];
    std::snprintf(name, sizeof name, "d-%.6f-%u.pgm", time, stamp);
    std::filesystem::create_symlink(folder / ("image" + std::to_string(k % 30)), folder / name);
    index << name << "\n";
    time += k < kNumSlow ? 0.005 : 0.00001;
    stamp += 1200000U;
  }
}

TEST(Freenect, ARecordingThatFakenectPlaysConforms) {
  if (!std::filesystem::exists(FAKENECT_LIBRARY)) GTEST_SKIP() << "SKIPPED: no " FAKENECT_LIBRARY;
  const auto folder =
      std::filesystem::temp_directory_path() / ("palpate_fakenect_" + std::to_string(getpid()));
  write_recording(folder);
  setenv("FREENECT_LIBRARY", FAKENECT_LIBRARY, 1);
  setenv("FAKENECT_PATH", folder.c_str(), 1);

  const FoundCameras found = find_freenect_cameras();
  EXPECT_TRUE(found.is_usable);
  EXPECT_EQ(found.library, FAKENECT_LIBRARY);
  EXPECT_EQ(found.devices, std::vector<std::string>{"freenect:0"});
  EXPECT_NE(open_camera("freenect:first").error().message.find("NUMBER"), std::string::npos);
  EXPECT_NE(open_camera("freenect:1").error().message.find("number 1"), std::string::npos);
  EXPECT_NE(open_camera("freenect?size=320x240").error().message.find("640x480"),
            std::string::npos);

  test::expect_camera([] { return open_camera("freenect"); }, 40, kWidth, kHeight, depths);

  // Fifty frames a second by the camera's clock, also where its 32 bits overflow.
  const auto raw = open_freenect_camera(parse_camera_uri("freenect").value(), {}).value();
  EXPECT_NEAR(raw.source->info().intrinsics.fx, 575.8, 0.1);
  EXPECT_EQ(raw.source->info().sensor, SensorKind::structured_light);
  DepthFrame frame;
  double last = -1;
  for (int k = 0; k < 4000; ++k) {
    ASSERT_TRUE(*raw.source->next(frame));
    if (k > 0) {
      EXPECT_NEAR(frame.timestamp - last, 0.02, 1e-9);
    }
    last = frame.timestamp;
  }
  // The rest of the recording, shorter the slower it is read, takes no memory. At its end the
  // camera is lost.
  test::expect_no_growth(*raw.source, 2000);
  Result<bool> got = true;
  while (got) got = raw.source->next(frame);
  EXPECT_NE(got.error().message.find("has been lost"), std::string::npos);
  std::filesystem::remove_all(folder);
}

TEST(Freenect, TheUsualCalibrationIsThatWhichOthersHaveMeasured) {
  // S. Magnenat's fit to a real Kinect, quoted ever since.
  for (int disparity = 400; disparity <= 1000; disparity += 50) {
    const double measured = 123.6 * std::tan(disparity / 2842.5 + 1.1863);
    EXPECT_NEAR(millimeters(disparity) / measured, 1, 0.03) << disparity;
  }
}

}  // namespace
}  // namespace palpate
