// Cameras whose depth (Z16) the kernel gives by Video4Linux, without any library of their makers.
#include <linux/videodev2.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <span>
#include <utility>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/drivers/v4l2_system.h"
#include "src/cameras/stream/raw_frames.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace v4l2 {
namespace {

constexpr std::uint32_t kCapture = V4L2_BUF_TYPE_VIDEO_CAPTURE;
constexpr std::uint32_t kNumBuffers = 4;
constexpr int kMaxAnswers = 100;  // of a driver that never ends a list

template <class Data>
Data empty() {
  Data data;
  std::memset(&data, 0, sizeof data);
  return data;
}

template <std::size_t n>
std::string text_of(const std::uint8_t (&bytes)[n]) {
  return std::string(bytes, std::find(bytes, bytes + n, std::uint8_t{0}));
}

/// A device that is open, closed at the end.
class OpenDevice {
 public:
  OpenDevice(System& system, const std::string& file) : system_(system), id_(system.open(file)) {}
  OpenDevice(const OpenDevice&) = delete;
  OpenDevice& operator=(const OpenDevice&) = delete;
  ~OpenDevice() {
    if (id_ >= 0) system_.close(id_);
  }

  System& system() const { return system_; }
  int id() const { return id_; }
  template <class Data>
  bool control(unsigned long request, Data& data) const {
    return system_.control(id_, request, &data) >= 0;
  }
  /// The name of its maker, if it sends depth; else empty.
  std::string depth_camera() const {
    auto capability = empty<v4l2_capability>();
    if (id_ < 0 || !control(VIDIOC_QUERYCAP, capability)) return {};
    const std::uint32_t can = (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0
                                  ? capability.device_caps
                                  : capability.capabilities;
    constexpr std::uint32_t kNeeded = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
    if ((can & kNeeded) != kNeeded) return {};
    for (std::uint32_t i = 0; i < kMaxAnswers; ++i) {
      auto format = empty<v4l2_fmtdesc>();
      format.index = i;
      format.type = kCapture;
      if (!control(VIDIOC_ENUM_FMT, format)) return {};
      if (format.pixelformat == V4L2_PIX_FMT_Z16) return text_of(capability.card);
    }
    return {};
  }
  std::vector<ImageMode> modes() const {
    std::vector<ImageMode> modes;
    for (std::uint32_t i = 0; i < kMaxAnswers; ++i) {
      auto size = empty<v4l2_frmsizeenum>();
      size.index = i;
      size.pixel_format = V4L2_PIX_FMT_Z16;
      if (!control(VIDIOC_ENUM_FRAMESIZES, size) || size.type != V4L2_FRMSIZE_TYPE_DISCRETE) break;
      add_rates(size.discrete.width, size.discrete.height, modes);
    }
    return modes;
  }

 private:
  void add_rates(std::uint32_t width, std::uint32_t height, std::vector<ImageMode>& modes) const {
    const ImageMode any{static_cast<int>(width), static_cast<int>(height), 30};
    for (std::uint32_t i = 0; i < kMaxAnswers; ++i) {
      auto interval = empty<v4l2_frmivalenum>();
      interval.index = i;
      interval.pixel_format = V4L2_PIX_FMT_Z16;
      interval.width = width;
      interval.height = height;
      const bool is_one = control(VIDIOC_ENUM_FRAMEINTERVALS, interval) &&
                          interval.type == V4L2_FRMIVAL_TYPE_DISCRETE &&
                          interval.discrete.numerator > 0;
      if (!is_one && i == 0) modes.push_back(any);
      if (!is_one) return;
      modes.push_back(any);
      modes.back().rate = static_cast<int>(std::lround(
          static_cast<double>(interval.discrete.denominator) / interval.discrete.numerator));
    }
  }

  System& system_;
  const int id_;
};

class V4l2Source final : public MakersSource {
 public:
  V4l2Source(System& system, const std::string& file) : device_(system, file), file_(file) {}
  ~V4l2Source() override {
    if (is_started_) {
      int type = kCapture;
      device_.control(VIDIOC_STREAMOFF, type);
    }
    for (const auto& buffer : buffers_) device_.system().unmap(buffer.data(), buffer.size());
    if (!buffers_.empty()) request_buffers(0);
  }

  Status open(const CameraUri& uri) {
    info_.name = "v4l2:" + file_;
    info_.is_live = true;
    if (device_.id() < 0) return failed("cannot be opened");
    const std::string model = device_.depth_camera();
    info_.sensor = sensor_of_model(model);
    if (model.empty()) {
      return Error{Errc::bad_input, info_.name +
                                        " sends no depth (Z16); palpate cameras lists "
                                        "those that do"};
    }
    if (const Status status = set_mode(uri); !status) return status;
    if (const Status status = map_buffers(); !status) return status;
    int type = kCapture;
    if (!device_.control(VIDIOC_STREAMON, type)) return failed("does not start");
    is_started_ = true;
    return Done{};
  }

  Result<bool> next(DepthFrame& frame) override {
    const double begin = monotonic_now();
    while (!is_cancelled_) {
      const int ready = device_.system().wait(device_.id(), kWaitMilliseconds);
      if (ready < 0) return failed("has been lost").error();
      if (ready > 0) {
        const auto got = take(frame);
        if (!got || *got) return got;
      }
      if (const Status status = check_silence(begin); !status) return status.error();
    }
    return false;
  }

 private:
  Status failed(const char* what) const {
    return Error{Errc::unavailable, info_.name + " " + what + ": " + std::strerror(errno)};
  }

  Status set_mode(const CameraUri& uri) {
    const auto modes = device_.modes();
    const auto best = choose_mode(modes, uri, {848, 480});
    if (!best) {
      return Error{Errc::invalid_argument,
                   info_.name + " has no such depth mode; it has " + listed(modes)};
    }
    auto format = empty<v4l2_format>();
    format.type = kCapture;
    format.fmt.pix.width = static_cast<std::uint32_t>(modes[*best].width);
    format.fmt.pix.height = static_cast<std::uint32_t>(modes[*best].height);
    format.fmt.pix.pixelformat = V4L2_PIX_FMT_Z16;
    format.fmt.pix.field = V4L2_FIELD_NONE;
    if (!device_.control(VIDIOC_S_FMT, format)) return failed("refuses its mode");
    const v4l2_pix_format& given = format.fmt.pix;
    if (given.pixelformat != V4L2_PIX_FMT_Z16 || given.width < 1 || given.height < 1 ||
        given.width > kMaxImageWidth || given.height > kMaxImageHeight) {
      return Error{Errc::unavailable, info_.name + " delivers another image format than requested"};
    }
    info_.width = static_cast<int>(given.width);
    info_.height = static_cast<int>(given.height);
    stride_ = std::max<std::size_t>(given.bytesperline, 2 * std::size_t{given.width});
    auto rate = empty<v4l2_streamparm>();  // not all drivers let it be chosen
    rate.type = kCapture;
    rate.parm.capture.timeperframe = {1, static_cast<std::uint32_t>(modes[*best].rate)};
    device_.control(VIDIOC_S_PARM, rate);
    info_.rate = uri.rate.value_or(modes[*best].rate);
    return Done{};
  }

  std::uint32_t request_buffers(std::uint32_t num) const {
    auto request = empty<v4l2_requestbuffers>();
    request.count = num;
    request.type = kCapture;
    request.memory = V4L2_MEMORY_MMAP;
    return device_.control(VIDIOC_REQBUFS, request) ? request.count : 0;
  }
  static v4l2_buffer buffer_of(std::uint32_t index) {
    auto buffer = empty<v4l2_buffer>();
    buffer.index = index;
    buffer.type = kCapture;
    buffer.memory = V4L2_MEMORY_MMAP;
    return buffer;
  }
  Status map_buffers() {
    const std::uint32_t num = request_buffers(kNumBuffers);
    if (num == 0) return failed("gives no memory for images; does another program use it?");
    for (std::uint32_t i = 0; i < num; ++i) {
      v4l2_buffer buffer = buffer_of(i);
      if (!device_.control(VIDIOC_QUERYBUF, buffer)) return failed("gives no memory for images");
      void* const memory = device_.system().map(device_.id(), buffer.length, buffer.m.offset);
      if (memory == nullptr) return failed("gives no memory for images");
      buffers_.emplace_back(static_cast<std::byte*>(memory), buffer.length);
      if (!device_.control(VIDIOC_QBUF, buffer)) return failed("takes no memory for images");
    }
    return Done{};
  }

  /// False: no image yet, or a damaged one.
  Result<bool> take(DepthFrame& frame) {
    v4l2_buffer buffer = buffer_of(0);
    if (!device_.control(VIDIOC_DQBUF, buffer)) {
      if (errno == EAGAIN || errno == EIO) return false;
      return failed("has been lost").error();
    }
    const std::size_t needed = stride_ * static_cast<std::size_t>(info_.height - 1) +
                               2 * static_cast<std::size_t>(info_.width);
    const bool is_whole = (buffer.flags & V4L2_BUF_FLAG_ERROR) == 0 && buffer.bytesused >= needed &&
                          buffer.index < buffers_.size() && buffers_[buffer.index].size() >= needed;
    if (is_whole) {
      copy_rows(buffers_[buffer.index].data(), static_cast<std::ptrdiff_t>(stride_), info_.width,
                info_.height, frame);
      frame.unit = info_.unit;
      // Stamps are by CLOCK_MONOTONIC, as all of the program; else of no known clock.
      const bool is_ours =
          (buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
      frame.timestamp = is_ours ? static_cast<double>(buffer.timestamp.tv_sec) +
                                      1e-6 * static_cast<double>(buffer.timestamp.tv_usec)
                                : monotonic_now();
    }
    if (!device_.control(VIDIOC_QBUF, buffer)) return failed("has been lost").error();
    return is_whole;
  }

  const OpenDevice device_;
  const std::string file_;
  std::vector<std::span<std::byte>> buffers_;
  std::size_t stride_ = 0;  // bytes
  bool is_started_ = false;
};

}  // namespace

Result<RawStream> open_camera(System& system, const CameraUri& uri) {
  if (const Status status = uri.check_extras(); !status) return status.error();
  if (!uri.intrinsics) {
    return Error{
        Errc::invalid_argument,
        "camera " + uri.text +
            ": the kernel does not report intrinsics; pass ?intrinsics=fx,fy,cx,cy in pixels"};
  }
  std::string file = uri.target;
  if (const auto number = camera_number(file); number && !file.empty()) {
    file = "/dev/video" + std::to_string(*number);
  }
  for (const std::string& each : system.devices()) {
    if (file.empty() && !OpenDevice(system, each).depth_camera().empty()) file = each;
  }
  if (file.empty()) {
    return Error{Errc::not_found,
                 "the kernel has no camera that sends depth (Z16 by Video4Linux); plug it in, and "
                 "see that you may use it (group video)"};
  }
  auto source = std::make_unique<V4l2Source>(system, file);
  if (const Status status = source->open(uri); !status) return status.error();
  return RawStream{std::move(source), StampClock::ours};
}

FoundCameras find_cameras(System& system) {
  std::vector<std::string> devices;
  std::string names;
  for (const std::string& file : system.devices()) {
    const std::string name = OpenDevice(system, file).depth_camera();
    if (name.empty()) continue;
    devices.push_back("v4l2:" + file);
    names += (names.empty() ? "" : ", ") + name;
  }
  FoundCameras found = always_there(
      names.empty() ? "no camera is plugged in whose depth the kernel gives (Z16)" : names);
  found.devices = std::move(devices);
  return found;
}

}  // namespace v4l2

Result<RawStream> open_v4l2_camera(const CameraUri& uri, const CameraOpening&) {
  return v4l2::open_camera(v4l2::kernel(), uri);
}
FoundCameras find_v4l2_cameras() { return v4l2::find_cameras(v4l2::kernel()); }

}}  // namespace palpate::v0
