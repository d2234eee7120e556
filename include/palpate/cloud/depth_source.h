// Depth frames, depth sources, binning, and averages over time.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/gpu/devices.h"
#include "palpate/math/geometry.h"
#include "palpate/settings/setting_table.h"

namespace palpate { inline namespace v0 {

// The pinhole model of a depth camera. Camera frame C: x right, y down, z forward.

/// In pixels. x = (u - cx) z / fx, y = (v - cy) z / fy; pixel centers are at integers.
struct Intrinsics {
  double fx = 0, fy = 0, cx = 0, cy = 0;

  friend bool operator==(const Intrinsics&, const Intrinsics&) = default;
};

/// Lens distortion, in the order of OpenCV and ROS: Brown-Conrady ("plumb_bob": k1, k2, p1, p2, k3)
/// or rational (also k4 to k6). A point x = X / Z, y = Y / Z, r^2 = x^2 + y^2 maps to x' = x (1 +
/// k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), y'
/// likewise, and to the pixel fx x' + cx, fy y' + cy. All 0: a pinhole.
struct Distortion {
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0;

  friend bool operator==(const Distortion&, const Distortion&) = default;
};

// The kind of depth camera determines its noise and its errors at edges.

/// Measuring principle of a depth camera.
enum class SensorKind {
  none,              ///< unknown, or ideal like a simulated camera
  structured_light,  ///< one camera sees a known pattern: Kinect v1, Xtion, SR305
  active_stereo,     ///< two cameras see a random pattern: RealSense D400, Gemini
  tof,               ///< time of flight: Azure Kinect, Femto, L515
};
constexpr auto names_of(SensorKind) {
  return std::array{"none", "structured_light", "active_stereo", "tof"};
}

// Streams of raw depth frames: files, simulated and live cameras.

/// Maximum size of a depth image.
inline constexpr int kMaxImageWidth = 4096;
inline constexpr int kMaxImageHeight = 4096;

/// Depth count of a surface farther than the largest count. For some sensors it is an error code
/// instead (`can_be_far`).
inline constexpr std::uint16_t kFarCount = 65535;

/// True if kFarCount means a far surface for this kind of sensor: for stereo and simulated cameras.
/// From structured light and time of flight, which end before 10 m, it is an error code.
constexpr bool can_be_far(SensorKind sensor) {
  return sensor == SensorKind::none || sensor == SensorKind::active_stereo;
}

// Frames and their sources.

/// One frame as the sensor delivers it. Depth in meters is pixel * unit; 0 means "no measurement",
/// and kFarCount "farther".
struct DepthFrame {
  int width = 0, height = 0;
  double unit = 0.001;                     ///< meters per count
  std::vector<std::uint16_t> pixels = {};  ///< row-major, width * height
  /// s, on the source's own clock. For a live stream (`DepthStreamInfo::is_live`): the capture time
  /// on the monotonic clock of this computer.
  double timestamp = 0;
  Pose X_WC = {};  ///< pose of the camera in the world at the capture of the frame
  /// Capture time on the clock that a robot uses for its messages, s; 0: unknown.
  double stamp = 0;
  /// Optical flow, optional (`DepthStreamInfo::has_flow`): velocity over the image of the point
  /// that each pixel shows, u and v in pixels per second, row-major, 2 * width * height; NaN:
  /// unknown. Empty: none for this frame.
  std::vector<float> flow = {};
};

/// A non-owning view of one depth image: `counts` times `unit` meters (0: no measurement,
/// kFarCount: farther), or `meters` (0, NaN and less: no measurement, infinite: farther).
/// Row-major, width * height values, in host or GPU memory.
struct DepthImageView {
  int width = 0, height = 0;
  const std::uint16_t* counts = nullptr;
  const float* meters = nullptr;  ///< used if there are no counts
  double unit = 0.001;            ///< meters per count
  const float* flow = nullptr;    ///< see DepthFrame; in host memory
  int gpu = kHostMemory;          ///< whose memory the values are in
  Pose X_WC;                      ///< see DepthFrame

  DepthImageView() = default;
  /// Has no values if the number of pixels of the frame does not match its size.
  DepthImageView(const DepthFrame& frame)
      : width(frame.width), height(frame.height), unit(frame.unit), X_WC(frame.X_WC) {
    if (frame.pixels.size() == num_pixels()) counts = frame.pixels.data();
    if (frame.flow.size() == 2 * num_pixels()) flow = frame.flow.data();
  }
  DepthImageView(int wide, int high, const std::uint16_t* values, double meters_per_count,
                 int on_gpu = kHostMemory)
      : width(wide), height(high), counts(values), unit(meters_per_count), gpu(on_gpu) {}
  DepthImageView(int wide, int high, const float* values, int on_gpu = kHostMemory)
      : width(wide), height(high), meters(values), gpu(on_gpu) {}

  std::size_t num_pixels() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
};

/// Properties that are constant over a stream.
struct DepthStreamInfo {
  int width = 0, height = 0;
  Intrinsics intrinsics = {};
  double unit = 0.001;                 ///< meters per count
  double rate = 30;                    ///< nominal frames per second
  std::optional<int> num_frames = {};  ///< nullopt for an endless stream
  std::string name = {};               ///< for display
  bool is_live = false;                ///< frames arrive when they are captured, not on request
  Distortion distortion = {};          ///< zero for the streams of cameras/, which are undistorted
  SensorKind sensor = SensorKind::none;  ///< see surface_options_for
  std::string frame = {};                ///< frame id of C as the stream names it; empty: unnamed
  bool is_moving = false;  ///< the camera moves: DepthFrame::X_WC changes between frames
  bool has_flow = false;   ///< frames have an optical flow: DepthFrame::flow
};

/// A depth source. One thread reads it, oldest frame first. A live source returns the newest frame
/// and drops those that were not taken in time.
class DepthSource {
 public:
  virtual ~DepthSource() = default;
  /// Description of the stream: size, intrinsics, unit and rate.
  virtual const DepthStreamInfo& info() const = 0;
  /// Fills `frame` (reusing its memory) and returns true; false at the end of the stream. May
  /// block. Timestamps increase strictly. Error: a frame that cannot be read, with its name.
  virtual Result<bool> next(DepthFrame& frame) = 0;
  /// From any thread: a blocked `next`, and every later one, returns false at once. A source whose
  /// `next` may block for more than a moment must implement this, because stopping a run waits for
  /// `next`.
  virtual void cancel() noexcept {}
  /// From any thread: new messages about the stream for the user, e.g. that the camera was
  /// unplugged or has changed its image size.
  virtual std::vector<std::string> take_notes() { return {}; }
};

/// Non-owning list of the depth cameras of one scene, usually one. Numbered from 0.
class DepthSources {
 public:
  DepthSources(DepthSource& one) : sources_{&one} {}
  explicit DepthSources(std::vector<DepthSource*> sources) : sources_(std::move(sources)) {}

  std::size_t size() const { return sources_.size(); }
  DepthSource& operator[](std::size_t camera) const { return *sources_[camera]; }
  auto begin() const { return sources_.begin(); }
  auto end() const { return sources_.end(); }
  std::vector<DepthStreamInfo> infos() const {
    std::vector<DepthStreamInfo> infos;
    for (const DepthSource* source : sources_) infos.push_back(source->info());
    return infos;
  }

 private:
  std::vector<DepthSource*> sources_;
};

// Binning: smaller depth images, for computers that are too slow.

inline constexpr int kMaxBinning = 8;

/// The stream of images with `binning` x `binning` pixels combined. The rest at the right and
/// bottom is cropped.
DepthStreamInfo binned(const DepthStreamInfo& stream, int binning);

/// Each pixel is the rounded mean of the pixels in its square on the same surface:
/// measurements within 1/32 of their (lower) median. So no pixel lies between two surfaces. 0
/// if nothing was measured; kFarCount if that is the median. `image`: counts in host memory.
/// Allocates only if `small` is too small. O(pixels).
void bin_depth(const DepthImageView& image, int binning, DepthFrame& small);

// Averages of raw depth over time: the smoothing that thesis section 3.6 compares with
// interpolation. A mean reduces noise and lags behind motion. A Kalman estimate reduces the noise
// of static pixels and follows moving ones without lag.

enum class DepthAverage {
  none,         ///< raw frames
  moving,       ///< mean of the last few measurements of a pixel
  exponential,  ///< mean += weight (measurement - mean)
  /// A Kalman filter per pixel: the mean of all measurements since its last change. Neighborhoods
  /// test together for motion; moving pixels keep their raw measurement, without lag.
  kalman,
};
constexpr auto names_of(DepthAverage) {
  return std::array{"none", "moving", "exponential", "kalman"};
}

/// Per pixel. A measurement far from the current mean belongs to another surface: it restarts the
/// average.
struct DepthAverageOptions {
  DepthAverage kind = DepthAverage::none;
  int frames = 8;        ///< moving: number of measurements in the mean
  double weight = 0.25;  ///< exponential: weight of the newest measurement
  /// moving, exponential: share of the mean; beyond it a measurement is another surface.
  double max_jump = 0.03;
  /// A pixel without measurement keeps its mean for this many frames; kalman: fewer while the mean
  /// is young.
  int keep_frames = 3;

  // kalman
  int rest_frames = 300;  ///< maximum number of frames in the mean of a static pixel
  /// Standard deviation of a measurement at depth z: noise + noise_growth z^2, m. Defaults: a
  /// Kinect v1, within 20 % of Nguyen, Izadi & Lovell 2012 from 0.4 to 2 m.
  double noise = 0.0009;
  double noise_growth = 0.001;
  /// Number of neighboring pixels with correlated noise, for cameras that match patterns.
  double noise_patch = 2;
};
inline void add_settings(SettingTable& t, DepthAverageOptions& o) {
  t.add("average", o.kind,
        "average of each pixel's depth over time; touch uses kalman for static cameras");
  t.add("average_frames", o.frames, {1, 64, "frames"},
        "moving: number of measurements in the mean");
  t.add("average_weight", o.weight, {1e-9, 1}, "exponential: weight of the newest measurement");
  t.add("average_max_jump", o.max_jump, {0, 10},
        "moving, exponential: share of the mean; a measurement farther off restarts it");
  t.add("average_keep_frames", o.keep_frames, {0, 100, "frames"},
        "a pixel without measurement keeps its mean for this long");
  t.add("average_rest_frames", o.rest_frames, {1, 10000, "frames"},
        "kalman: maximum frames in the mean of a static pixel");
  t.add("average_noise", o.noise, {1e-6, 1, "m"},
        "kalman: standard deviation of a measurement at depth 0");
  t.add("average_noise_growth", o.noise_growth, {0, 1, "m"},
        "kalman: its growth at 1 m; it grows with the square of the depth");
  t.add("average_noise_patch", o.noise_patch, {1, 10000, "pixels"},
        "kalman: number of neighboring pixels with correlated noise");
}

/// kalman: noise settings for a kind of sensor (docs/reference/cameras.md, "By kind of sensor").
/// For none: the defaults.
DepthAverageOptions depth_average_options_for(SensorKind sensor);

/// Averages depth over time. Owns all buffers for one image size; `update` allocates nothing.
class DepthAverager {
 public:
  /// Allocates all buffers. Errors: a size out of 8..4096, options out of range. All instruction
  /// sets give the same bits; an unsupported one falls back to a lower one.
  static Result<DepthAverager> create(int width, int height, const DepthAverageOptions& options,
                                      Isa isa = best_isa());
  DepthAverager(DepthAverager&&) noexcept;
  DepthAverager& operator=(DepthAverager&&) noexcept;
  ~DepthAverager();

  /// Adds a frame of the size given at construction; all frames have the same unit. Returns depth
  /// in meters, width * height values, NaN where there is no measurement, infinite where the frame
  /// has kFarCount, which no mean has a part of; valid until the next update. Same bits for any
  /// number of threads. O(pixels).
  std::span<const float> update(const DepthImageView& counts, ThreadPool& pool);

 private:
  struct Impl;
  explicit DepthAverager(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}}  // namespace palpate::v0
