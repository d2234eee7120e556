// A kernel of the tests: video devices that answer as real drivers do.
#pragma once

#include <linux/videodev2.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <deque>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "src/cameras/drivers/v4l2_system.h"
#include "src/core/internal/monotonic_clock.h"
#include "tests/cameras/camera_fakes.h"

namespace palpate::test {

/// /dev/video0 sends color, /dev/video1 is no camera at all, /dev/video2 sends depth.
class FakeV4l2 final : public v4l2::System {
 public:
  std::atomic<bool> is_plugged = true, is_stalled = false, is_monotonic = true;
  std::atomic<int> microseconds = 5000;  ///< between frames
  std::atomic<int> num_damaged = 0;      ///< so many of the next frames are
  std::atomic<int> padding = 0;          ///< bytes after every row
  std::atomic<int> num_open = 0, num_mapped = 0;
  std::vector<std::pair<int, int>> sizes = {{32, 24}, {64, 48}, {848, 480}, {1280, 720}};

  std::vector<std::string> devices() override {
    return is_plugged ? std::vector<std::string>{"/dev/video0", "/dev/video1", "/dev/video2"}
                      : std::vector<std::string>{"/dev/video0", "/dev/video1"};
  }
  int open(const std::string& file) override {
    const bool is_there =
        file == "/dev/video0" || file == "/dev/video1" || (file == "/dev/video2" && is_plugged);
    if (!is_there) return errno = ENOENT, -1;
    ++num_open;
    return file.back() - '0' + 10;
  }
  void close(int) override { --num_open; }
  void* map(int, std::size_t num_bytes, std::size_t offset) override {
    const std::lock_guard lock(mutex_);
    auto& buffer = buffers_.at(offset / kPage);
    if (buffer.size() != num_bytes) return nullptr;
    ++num_mapped;
    return buffer.data();
  }
  void unmap(void*, std::size_t) override { --num_mapped; }

  int wait(int device, int milliseconds) override {
    const double end = monotonic_now() + 1e-3 * milliseconds;
    do {
      if (!is_plugged) return 1;  // as poll(2) with POLLERR
      if (device == kDepthId && is_due()) return 1;
      sleep_seconds(0.0002);
    } while (monotonic_now() < end);
    return 0;
  }

  int control(int device, unsigned long request, void* data) override {
    const std::lock_guard lock(mutex_);
    if (device == kDepthId && !is_plugged) return errno = ENODEV, -1;
    switch (request) {
      case VIDIOC_QUERYCAP: return report_capability(device, *static_cast<v4l2_capability*>(data));
      case VIDIOC_ENUM_FMT: return report_format(device, *static_cast<v4l2_fmtdesc*>(data));
      default: break;
    }
    if (device != kDepthId) return errno = ENOTTY, -1;
    switch (request) {
      case VIDIOC_ENUM_FRAMESIZES: return report_size(*static_cast<v4l2_frmsizeenum*>(data));
      case VIDIOC_ENUM_FRAMEINTERVALS: return report_rate(*static_cast<v4l2_frmivalenum*>(data));
      case VIDIOC_S_FMT: return set_format(*static_cast<v4l2_format*>(data));
      case VIDIOC_S_PARM: return 0;
      case VIDIOC_REQBUFS: return request_buffers(*static_cast<v4l2_requestbuffers*>(data));
      case VIDIOC_QUERYBUF: return report_buffer(*static_cast<v4l2_buffer*>(data));
      case VIDIOC_QBUF: return queue(*static_cast<v4l2_buffer*>(data));
      case VIDIOC_DQBUF: return give(*static_cast<v4l2_buffer*>(data));
      case VIDIOC_STREAMON: return is_streaming_ = true, next_ = monotonic_now(), 0;
      case VIDIOC_STREAMOFF: return is_streaming_ = false, queued_.clear(), 0;
      default: return errno = ENOTTY, -1;
    }
  }

 private:
  static constexpr int kDepthId = 12;
  static constexpr std::size_t kPage = 1 << 24;

  static int report_capability(int device, v4l2_capability& to) {
    std::strcpy(reinterpret_cast<char*>(to.card),
                device == kDepthId ? "RealSense Depth 435" : "Color");
    to.capabilities = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING | V4L2_CAP_DEVICE_CAPS;
    to.device_caps =
        device == 11 ? V4L2_CAP_META_CAPTURE : V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
    return 0;
  }
  static int report_format(int device, v4l2_fmtdesc& to) {
    if (to.index > (device == kDepthId ? 1U : 0U)) return errno = EINVAL, -1;
    to.pixelformat = device == kDepthId && to.index == 1 ? V4L2_PIX_FMT_Z16 : V4L2_PIX_FMT_YUYV;
    return 0;
  }
  int report_size(v4l2_frmsizeenum& to) const {
    if (to.pixel_format != V4L2_PIX_FMT_Z16 || to.index >= sizes.size()) return errno = EINVAL, -1;
    to.type = V4L2_FRMSIZE_TYPE_DISCRETE;
    to.discrete.width = static_cast<std::uint32_t>(sizes[to.index].first);
    to.discrete.height = static_cast<std::uint32_t>(sizes[to.index].second);
    return 0;
  }
  static int report_rate(v4l2_frmivalenum& to) {
    if (to.index > 1) return errno = EINVAL, -1;
    to.type = V4L2_FRMIVAL_TYPE_DISCRETE;
    to.discrete = {1, to.index == 0 ? 90U : 30U};
    return 0;
  }
  int set_format(v4l2_format& to) {
    to.fmt.pix.bytesperline = 2 * to.fmt.pix.width + static_cast<std::uint32_t>(padding);
    format_ = to.fmt.pix;
    return 0;
  }
  int request_buffers(v4l2_requestbuffers& to) {
    if (num_mapped > 0) return errno = EBUSY, -1;
    queued_.clear();
    buffers_.assign(to.count,
                    std::vector<char>(std::size_t{format_.bytesperline} * format_.height));
    return 0;
  }
  int report_buffer(v4l2_buffer& to) const {
    to.length = static_cast<std::uint32_t>(buffers_.at(to.index).size());
    to.m.offset = static_cast<std::uint32_t>(to.index * kPage);
    return 0;
  }
  int queue(v4l2_buffer& to) {
    queued_.push_back(to.index);
    return 0;
  }
  bool is_due() {
    const std::lock_guard lock(mutex_);
    return is_streaming_ && !is_stalled && !queued_.empty() && monotonic_now() >= next_;
  }
  int give(v4l2_buffer& to) {
    if (!is_streaming_ || is_stalled || queued_.empty() || monotonic_now() < next_) {
      return errno = EAGAIN, -1;
    }
    next_ += 1e-6 * microseconds;
    to.index = queued_.front();
    queued_.pop_front();
    const bool is_damaged = num_damaged > 0;
    if (is_damaged) --num_damaged;
    const auto pixels = pattern(static_cast<int>(format_.width), static_cast<int>(format_.height),
                                is_damaged ? 0 : number_);
    for (std::uint32_t v = 0; v < format_.height; ++v) {
      std::memcpy(buffers_[to.index].data() + std::size_t{v} * format_.bytesperline,
                  pixels.data() + std::size_t{v} * format_.width, std::size_t{2} * format_.width);
    }
    to.bytesused = static_cast<std::uint32_t>(buffers_[to.index].size());
    // Every second damaged one is said to be, the others are too short.
    if (is_damaged && num_damaged % 2 == 0) to.flags |= V4L2_BUF_FLAG_ERROR;
    if (is_damaged && num_damaged % 2 == 1) to.bytesused /= 2;
    if (is_monotonic) to.flags |= V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    // Exposed and transferred until now; by another clock it is earlier.
    const double stamp = monotonic_now() - (is_monotonic ? 0.02 : 0.5);
    to.timestamp.tv_sec = static_cast<time_t>(stamp);
    to.timestamp.tv_usec =
        static_cast<suseconds_t>(1e6 * (stamp - static_cast<double>(to.timestamp.tv_sec)));
    ++number_;
    return 0;
  }

  std::mutex mutex_;
  std::vector<std::vector<char>> buffers_;
  std::deque<std::uint32_t> queued_;
  v4l2_pix_format format_{};
  double next_ = 0;
  int number_ = 0;
  bool is_streaming_ = false;
};

}  // namespace palpate::test
