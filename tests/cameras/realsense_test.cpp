// librealsense2 as pip gives it: its software device live, its recorder and its player.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <thread>

#include "palpate/cameras/cameras.h"
#include "src/cameras/camera_kinds.h"
#include "src/cameras/drivers/python_packages.h"
#include "src/cameras/drivers/realsense_api.h"
#include "tests/cameras/conformance.h"

namespace palpate {
namespace {

using realsense::Api;
using realsense::CameraIntrinsics;
using realsense::Device;
using realsense::Failure;
using realsense::Profile;
using realsense::Sensor;

constexpr int kWidth = 64, kHeight = 48;
constexpr double kUnit = 0.0001;

// Types of functions that only the tests call (rs_internal.h).
struct VideoStream {
  int type, index, id, width, height, rate, bytes_per_pixel, format;
  CameraIntrinsics intrinsics;
};
struct VideoFrame {
  void* pixels;
  void (*deleter)(void*);
  int stride, bytes_per_pixel;
  double milliseconds;
  int domain, number;
  const Profile* profile;
  float unit;
};

class Realsense : public testing::Test {
 protected:
  static void SetUpTestSuite() { setenv("VIRTUAL_ENV", PALPATE_SOURCE_DIR "/build/python", 0); }
  void SetUp() override {
    if (!realsense::api()) GTEST_SKIP() << "SKIPPED: " << realsense::api().error().message;
  }
  static const Api& api() { return *realsense::api(); }
};

/// A camera in memory, and the thread that sends its frames.
class SoftwareCamera {
 public:
  SoftwareCamera(const Api& api, void* library, int lens = realsense::kBrownConrady, float k1 = 0)
      : api_(api), library_(library) {
    Failure* error = nullptr;
    device_ = call<Device*(Failure**)>("rs2_create_software_device")(&error);
    call<void(Device*, int, const char*, Failure**)>("rs2_software_device_register_info")(
        device_, realsense::kSerial, "1234", &error);
    sensor_ = call<Sensor*(Device*, const char*, Failure**)>("rs2_software_device_add_sensor")(
        device_, "Depth", &error);
    const CameraIntrinsics camera{kWidth, kHeight, 31.5f, 23.5f, 60, 61, lens, {k1, 0, 0, 0, 0}};
    profile_ = call<Profile*(Sensor*, VideoStream, Failure**)>(
        "rs2_software_sensor_add_video_stream")(
        sensor_, {realsense::kDepthStream, 0, 1, kWidth, kHeight, 30, 2, realsense::kZ16, camera},
        &error);
    call<void(Sensor*, int, float, Failure**)>("rs2_software_sensor_add_read_only_option")(
        sensor_, 28, static_cast<float>(kUnit), &error);
    call<void(Sensor*, int, float, float, float, float, int, Failure**)>(
        "rs2_software_sensor_add_option")(sensor_, realsense::kPreset, 0, 5, 1, 1, 1, &error);
    EXPECT_EQ(error, nullptr) << (error != nullptr ? api.message(error) : "");
  }
  /// Returns the visual preset that has been set.
  float preset() const {
    Failure* error = nullptr;
    return call<float(const Sensor*, int, Failure**)>("rs2_get_option")(sensor_, realsense::kPreset,
                                                                        &error);
  }
  ~SoftwareCamera() {
    stop();
    api_.delete_sensor(sensor_);
    if (device_ != nullptr) api_.delete_device(device_);
  }

  void send(int number) {
    auto* const pixels = new std::uint16_t[kWidth * kHeight];
    const auto all = test::pattern(kWidth, kHeight, number);
    std::memcpy(pixels, all.data(), 2 * all.size());
    const VideoFrame frame{pixels,
                           [](void* memory) { delete[] static_cast<std::uint16_t*>(memory); },
                           2 * kWidth,
                           2,
                           1000 + number * 1000 / 30.0,
                           1,
                           number,
                           profile_,
                           static_cast<float>(kUnit)};
    Failure* error = nullptr;
    call<void(Sensor*, VideoFrame, Failure**)>("rs2_software_sensor_on_video_frame")(sensor_, frame,
                                                                                     &error);
    if (error != nullptr) api_.free_error(error);
  }
  /// Until stopped, from a thread of its own.
  void start(double seconds) {
    is_running_ = true;
    thread_ = std::thread([this, seconds] {
      for (int k = 0; is_running_; ++k) {
        if (!is_stalled_) send(k);
        test::sleep_seconds(seconds);
      }
    });
  }
  void stop() {
    is_running_ = false;
    if (thread_.joinable()) thread_.join();
  }
  void stall(bool is_stalled) { is_stalled_ = is_stalled; }
  Device* device() const { return device_; }
  /// Returns the device, which the caller deletes.
  Device* hand_over() { return std::exchange(device_, nullptr); }

  template <class Function>
  Function* call(const char* name) const {
    auto* const found = reinterpret_cast<Function*>(dlsym(library_, name));
    if (found == nullptr) throw std::runtime_error(std::string("no ") + name);
    return found;
  }

 private:
  const Api& api_;
  void* const library_;
  Device* device_ = nullptr;
  Sensor* sensor_ = nullptr;
  const Profile* profile_ = nullptr;
  std::atomic<bool> is_running_ = false, is_stalled_ = false;
  std::thread thread_;
};

void* library() { return dlopen(realsense::api()->path.c_str(), RTLD_NOW | RTLD_NOLOAD); }

/// `num` frames by the library's own recorder.
void record(const std::string& file, int num) {
  const Api& api = *realsense::api();
  SoftwareCamera camera(api, library());
  Failure* error = nullptr;
  Device* const recorder = camera.call<Device*(const Device*, const char*, Failure**)>(
      "rs2_create_record_device")(camera.device(), file.c_str(), &error);
  ASSERT_EQ(error, nullptr) << api.message(error);
  {
    auto* const sensors = api.query_sensors(recorder, &error);
    Sensor* const sensor = api.create_sensor(sensors, 0, &error);
    auto* const profiles = api.profiles(sensor, &error);
    auto* const queue = api.create_queue(num, &error);
    api.open(sensor, api.profile(profiles, 0, &error), &error);
    api.start(sensor, queue, &error);
    ASSERT_EQ(error, nullptr) << api.message(error);
    for (int k = 0; k < num; ++k) {
      camera.send(k);
      test::sleep_seconds(0.01);
    }
    test::sleep_seconds(0.3);
    api.stop(sensor, &error);
    api.close(sensor, &error);
    api.delete_queue(queue);
    api.delete_profiles(profiles);
    api.delete_sensor(sensor);
    api.delete_sensors(sensors);
  }
  api.delete_device(recorder);
}

TEST(PythonPackages, NameTheLibraryOfTheirPython) {
  EXPECT_EQ(python_library_of("/x/pyrealsense2.cpython-311-x86_64-linux-gnu.so"),
            "libpython3.11.so.1.0");
  EXPECT_EQ(python_library_of("/usr/lib/librealsense2.so"), "");
}

TEST_F(Realsense, IsFoundWithItsVersion) {
  const FoundCameras found = find_realsense_cameras();
  EXPECT_TRUE(found.is_usable);
  EXPECT_TRUE(found.version.starts_with("2.")) << found.version;
  EXPECT_NE(open_camera("realsense:no-such").error().message.find("serial number no-such"),
            std::string::npos);
}

/// The library lists no software devices: this one is handed to the source.
Result<std::unique_ptr<DepthSource>> open_live(SoftwareCamera& software) {
  const CameraUri uri = parse_camera_uri("realsense").value();
  auto raw = realsense::open_device(software.hand_over(), uri, "");
  if (!raw) return raw.error();
  return make_live({*std::move(raw)}, {}, uri);
}

TEST_F(Realsense, ACameraConforms) {
  SoftwareCamera software(api(), library());
  software.start(0.005);
  test::expect_camera([&] { return open_live(software); }, 30, kWidth, kHeight);
}

TEST_F(Realsense, TellsItsIntrinsicsUnitAndSilence) {
  SoftwareCamera software(api(), library());
  software.start(0.005);
  const auto camera = open_live(software).value();
  EXPECT_EQ(camera->info().intrinsics, (Intrinsics{60, 61, 31.5, 23.5}));
  EXPECT_EQ(camera->info().sensor, SensorKind::active_stereo);
  DepthFrame frame;
  ASSERT_TRUE(*camera->next(frame));
  EXPECT_DOUBLE_EQ(frame.unit, kUnit);
  software.stall(true);
  Result<bool> got = true;
  while (got) got = camera->next(frame);
  EXPECT_NE(got.error().message.find("sends no frames"), std::string::npos);
}

TEST_F(Realsense, MeasuresByThePresetThatIsGiven) {
  SoftwareCamera usual(api(), library()), chosen(api(), library()), refusing(api(), library());
  const auto open = [](SoftwareCamera& software, const char* text) {
    return realsense::open_device(software.hand_over(), parse_camera_uri(text).value(), "");
  };
  const auto left_alone = open(usual, "realsense");
  ASSERT_TRUE(left_alone);
  EXPECT_EQ(usual.preset(), 1);
  const auto accurate = open(chosen, "realsense?preset=3");
  ASSERT_TRUE(accurate) << accurate.error().message;
  EXPECT_EQ(chosen.preset(), 3);
  const auto refused = open(refusing, "realsense?preset=9");
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("no preset '9'"), std::string::npos)
      << refused.error().message;
}

TEST_F(Realsense, SaysThatALensIsNotKnown) {
  constexpr int kInverseBrownConrady = 2;
  const auto is_noted = [](int lens, float k1, const char* uri) {
    SoftwareCamera software(api(), library(), lens, k1);
    const auto raw =
        realsense::open_device(software.hand_over(), parse_camera_uri(uri).value(), "").value();
    return test::all_notes(*raw).find("distortion is of a model that is not known") !=
           std::string::npos;
  };
  EXPECT_TRUE(is_noted(kInverseBrownConrady, 0.1f, "realsense"));
  EXPECT_FALSE(is_noted(kInverseBrownConrady, 0.1f, "realsense?distortion=0.1,0,0,0"));
  EXPECT_FALSE(is_noted(kInverseBrownConrady, 0, "realsense"));
  EXPECT_FALSE(is_noted(realsense::kBrownConrady, 0.1f, "realsense"));
}

TEST_F(Realsense, ComesBackAsAnotherDevice) {
  SoftwareCamera first(api(), library()), second(api(), library());
  const CameraUri uri = parse_camera_uri("realsense").value();
  std::atomic<bool> is_plugged = true;
  const auto open = [&](SoftwareCamera& software) -> Result<RawStream> {
    if (!is_plugged) return Error{Errc::not_found, "no camera"};
    auto raw = realsense::open_device(software.hand_over(), uri, "");
    if (!raw) return raw.error();
    return RawStream{*std::move(raw)};
  };
  first.start(0.005);
  second.start(0.005);
  const auto open_both = [&]() -> Result<std::unique_ptr<DepthSource>> {
    auto raw = open(first);
    if (!raw) return raw.error();
    return make_live(
        *std::move(raw), [&] { return open(second); }, uri);
  };
  test::expect_outlives(
      open_both,
      [&](bool is_out) {
        first.stall(true);
        is_plugged = !is_out;
      },
      3.5);
}

TEST_F(Realsense, ItsRecordingsConform) {
  const std::string file =
      (std::filesystem::temp_directory_path() / ("palpate_" + std::to_string(getpid()) + ".db3"))
          .string();
  record(file, 10);
  for (int round = 0; round < 2; ++round) {
    test::expect_recording([&] { return open_camera("realsense:" + file); }, 10, kWidth, kHeight);
  }
  std::filesystem::remove(file);
  EXPECT_NE(open_camera("realsense:" + file).error().message.find("no such file"),
            std::string::npos);
  std::ofstream(file) << "not a recording";
  const auto refused = open_camera("realsense:" + file);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("cannot be played"), std::string::npos)
      << refused.error().message;
  std::filesystem::remove(file);
}

TEST_F(Realsense, TenThousandFramesTakeNoMemory) {
  SoftwareCamera software(api(), library());
  const auto raw =
      realsense::open_device(software.hand_over(), parse_camera_uri("realsense").value(), "");
  ASSERT_TRUE(raw);
  software.start(0.0001);
  test::expect_no_growth(**raw, 10000);
}

}  // namespace
}  // namespace palpate
