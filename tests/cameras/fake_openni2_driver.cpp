// A driver that the real OpenNI2 loads: one depth camera whose every pixel is known. The test in
// the same process plugs it in and out, stalls it and changes its image. In other processes it can
// send the frames of a file, as a camera does: see `Recording`.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <thread>
#include <vector>

#define XN_NEW(type, arg) new type(arg)
#define XN_DELETE(object) delete object
#include <Driver/OniDriverAPI.h>

#include "tests/cameras/camera_fakes.h"
#include "tests/cameras/fake_openni2.h"

namespace {

using palpate::test::FakeOpenni2;

FakeOpenni2 control;
constexpr float kAcross = 1.0145f, kDown = 0.7898f;

/// PALPATE_FAKE_OPENNI2=FILE: raw frames of 640 x 480 pixels of 16 bits, sent again and again,
/// thirty a second by the clock.
class Recording {
 public:
  static const Recording& get() {
    static const Recording recording;
    return recording;
  }
  bool is_there() const { return !frames_.empty(); }
  const std::vector<std::uint16_t>& frame(int number) const {
    return frames_[static_cast<std::size_t>(number) % frames_.size()];
  }

 private:
  Recording() {
    const char* const name = std::getenv("PALPATE_FAKE_OPENNI2");
    std::ifstream file(name == nullptr ? "" : name, std::ios::binary);
    std::vector<std::uint16_t> frame(640 * 480);
    while (file.read(reinterpret_cast<char*>(frame.data()),
                     static_cast<std::streamsize>(2 * frame.size()))) {
      frames_.push_back(frame);
    }
  }
  std::vector<std::vector<std::uint16_t>> frames_;
};

class Stream : public oni::driver::StreamBase {
 public:
  ~Stream() override { stop(); }

  OniStatus start() override {
    is_running_ = true;
    thread_ = std::thread([this] { run(); });
    return ONI_STATUS_OK;
  }
  void stop() override {
    is_running_ = false;
    if (thread_.joinable()) thread_.join();
  }

  OniBool isPropertySupported(int property) override {
    switch (property) {
      case ONI_STREAM_PROPERTY_VIDEO_MODE:
      case ONI_STREAM_PROPERTY_HORIZONTAL_FOV:
      case ONI_STREAM_PROPERTY_VERTICAL_FOV:
      case ONI_STREAM_PROPERTY_MIRRORING:
      case ONI_STREAM_PROPERTY_STRIDE:
      case ONI_STREAM_PROPERTY_CROPPING:
      case ONI_STREAM_PROPERTY_MAX_VALUE: return true;
      default: return false;
    }
  }
  OniStatus getProperty(int property, void* data, int* size) override {
    const OniVideoMode mode = this->mode();
    const OniCropping whole{0, 0, 0, mode.resolutionX, mode.resolutionY};
    switch (property) {
      case ONI_STREAM_PROPERTY_VIDEO_MODE: return give(mode, data, size);
      case ONI_STREAM_PROPERTY_HORIZONTAL_FOV: return give(kAcross, data, size);
      case ONI_STREAM_PROPERTY_VERTICAL_FOV: return give(kDown, data, size);
      case ONI_STREAM_PROPERTY_MIRRORING: return give(OniBool(is_mirrored_), data, size);
      case ONI_STREAM_PROPERTY_STRIDE: return give(2 * mode.resolutionX, data, size);
      case ONI_STREAM_PROPERTY_CROPPING: return give(whole, data, size);
      case ONI_STREAM_PROPERTY_MAX_VALUE: return give(10000, data, size);
      default: return ONI_STATUS_NOT_SUPPORTED;
    }
  }
  OniStatus setProperty(int property, const void* data, int size) override {
    if (property == ONI_STREAM_PROPERTY_MIRRORING) {
      std::memcpy(&is_mirrored_, data, sizeof is_mirrored_);
      return ONI_STATUS_OK;
    }
    if (property == ONI_STREAM_PROPERTY_VIDEO_MODE && size == sizeof(OniVideoMode)) {
      OniVideoMode desired;
      std::memcpy(&desired, data, sizeof desired);
      control.width = desired.resolutionX;
      control.height = desired.resolutionY;
      return ONI_STATUS_OK;
    }
    return ONI_STATUS_NOT_SUPPORTED;
  }
  void notifyAllProperties() override {
    const OniVideoMode mode = this->mode();
    const OniCropping whole{0, 0, 0, mode.resolutionX, mode.resolutionY};
    tell(ONI_STREAM_PROPERTY_VIDEO_MODE, mode);
    tell(ONI_STREAM_PROPERTY_HORIZONTAL_FOV, kAcross);
    tell(ONI_STREAM_PROPERTY_VERTICAL_FOV, kDown);
    tell(ONI_STREAM_PROPERTY_MIRRORING, OniBool(is_mirrored_));
    tell(ONI_STREAM_PROPERTY_STRIDE, 2 * mode.resolutionX);
    tell(ONI_STREAM_PROPERTY_CROPPING, whole);
    tell(ONI_STREAM_PROPERTY_MAX_VALUE, 10000);
  }

 private:
  template <class Value>
  static OniStatus give(const Value& value, void* data, int* size) {
    if (*size < int(sizeof value)) return ONI_STATUS_BAD_PARAMETER;
    std::memcpy(data, &value, sizeof value);
    *size = sizeof value;
    return ONI_STATUS_OK;
  }
  template <class Value>
  void tell(int property, const Value& value) {
    raisePropertyChanged(property, &value, sizeof value);
  }
  static OniVideoMode mode() {
    return {ONI_PIXEL_FORMAT_DEPTH_1_MM, control.width, control.height, 30};
  }

  void run() {
    using Clock = std::chrono::steady_clock;
    const Recording& recording = Recording::get();
    auto next = Clock::now();
    for (int number = 0; is_running_;) {
      if (recording.is_there()) {
        next += std::chrono::nanoseconds(33333333);
        std::this_thread::sleep_until(next);
      } else if (control.microseconds > 0) {
        std::this_thread::sleep_for(std::chrono::microseconds(control.microseconds));
      }
      if (control.is_stalled || !control.is_plugged || number == control.num_frames) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        continue;
      }
      OniFrame* const frame = getServices().acquireFrame();
      if (frame == nullptr) continue;
      auto pixels = recording.is_there()
                        ? recording.frame(number)
                        : palpate::test::pattern(control.width, control.height, number);
      for (auto row = pixels.begin(); is_mirrored_ != 0 && row != pixels.end();
           row += control.width) {
        std::reverse(row, row + control.width);
      }
      frame->dataSize = static_cast<int>(2 * pixels.size());
      std::memcpy(frame->data, pixels.data(), 2 * pixels.size());
      frame->frameIndex = number;
      frame->sensorType = ONI_SENSOR_DEPTH;
      frame->timestamp = static_cast<std::uint64_t>(++number) * 33333;
      frame->videoMode = mode();
      frame->width = control.width;
      frame->height = control.height;
      frame->croppingEnabled = false;
      frame->cropOriginX = frame->cropOriginY = 0;
      frame->stride = 2 * control.width;
      raiseNewFrame(frame);
      getServices().releaseFrame(frame);
      control.num_sent = number;
    }
  }

  std::atomic<bool> is_running_ = false;
  OniBool is_mirrored_ = true;  // as of real ones
  std::thread thread_;
};

class Device : public oni::driver::DeviceBase {
 public:
  OniStatus getSensorInfoList(OniSensorInfo** sensors, int* num) override {
    static OniVideoMode modes[] = {{ONI_PIXEL_FORMAT_DEPTH_1_MM, 320, 240, 30},
                                   {ONI_PIXEL_FORMAT_DEPTH_1_MM, 640, 480, 30},
                                   {ONI_PIXEL_FORMAT_DEPTH_1_MM, 64, 48, 30}};
    static OniSensorInfo depth{ONI_SENSOR_DEPTH, 3, modes};
    *sensors = &depth;
    *num = 1;
    return ONI_STATUS_OK;
  }
  oni::driver::StreamBase* createStream(OniSensorType) override { return new Stream; }
  void destroyStream(oni::driver::StreamBase* stream) override { delete stream; }
};

class Driver : public oni::driver::DriverBase {
 public:
  using DriverBase::DriverBase;

  OniStatus initialize(oni::driver::DeviceConnectedCallback connected,
                       oni::driver::DeviceDisconnectedCallback disconnected,
                       oni::driver::DeviceStateChangedCallback changed, void* cookie) override {
    DriverBase::initialize(connected, disconnected, changed, cookie);
    control.plug = [](bool is_plugged) {
      control.is_plugged = is_plugged;
      is_plugged ? self_->deviceConnected(&info_) : self_->deviceDisconnected(&info_);
    };
    self_ = this;
    control.plug(true);
    return ONI_STATUS_OK;
  }
  oni::driver::DeviceBase* deviceOpen(const char*, const char*) override {
    return control.is_plugged ? new Device : nullptr;
  }
  void deviceClose(oni::driver::DeviceBase* device) override { delete device; }
  OniStatus tryDevice(const char*) override { return ONI_STATUS_ERROR; }
  void shutdown() override {}

 private:
  inline static Driver* self_ = nullptr;
  inline static OniDeviceInfo info_{"fake:0", "Palpate", "a camera of the tests", 0, 0};
};

}  // namespace

ONI_EXPORT_DRIVER(Driver)

extern "C" __attribute__((visibility("default"))) FakeOpenni2* palpate_fake_openni2() {
  return &control;
}
