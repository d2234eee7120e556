// Depth frames, where they come from, and filters over them.
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

namespace palpate::inline v0 {

// The pinhole model of a depth camera. Camera frame C: x right, y down, z forward.

/// Pixels. x = (u - cx) z / fx, y = (v - cy) z / fy, pixel centres at whole numbers.
struct Intrinsics {
  double fx = 0, fy = 0, cx = 0, cy = 0;

  friend bool operator==(const Intrinsics&, const Intrinsics&) = default;
};

/// How a lens bends the image, in the order of OpenCV and ROS: Brown-Conrady ("plumb_bob": k1, k2,
/// p1, p2, k3) or rational (k4 to k6 as well). A point x = X / Z, y = Y / Z, r^2 = x^2 + y^2 is
/// seen at x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + 2 p1 x y + p2
/// (r^2 + 2 x^2), y' likewise, and pixel fx x' + cx, fy y' + cy. All 0: a pinhole.
struct Distortion {
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0;

  friend bool operator==(const Distortion&, const Distortion&) = default;
};

// What kind of depth camera frames come from, which decides how their noise and their edges look.

/// How a depth camera measures.
enum class SensorKind {
  none,              ///< nobody says, or without faults as a simulated one
  structured_light,  ///< one camera sees a known pattern: Kinect v1, Xtion, SR305
  active_stereo,     ///< two cameras see a random pattern: RealSense D400, Gemini
  tof,               ///< time of flight: Azure Kinect, Femto, L515
};
constexpr auto names_of(SensorKind) {
  return std::array{"none", "structured_light", "active_stereo", "tof"};
}

// A stream of raw depth frames: files, a simulated camera, live cameras.

/// Limits of every depth image.
inline constexpr int kMaxImageWidth = 4096;
inline constexpr int kMaxImageHeight = 4096;

/// One frame as a sensor delivers it. Depth in metres is pixel * unit; 0 and 65535 mean "no
/// measurement".
struct DepthFrame {
  int width = 0, height = 0;
  double unit = 0.001;                ///< metres per count
  std::vector<std::uint16_t> pixels;  ///< row-major, width * height
  /// Seconds on the source's own clock; of a live stream (`DepthStreamInfo::is_live`) when it was
  /// captured, on the monotonic clock of this computer.
  double timestamp = 0;
  Pose X_WC = {};  ///< of the camera in the world, when the frame was captured
  /// The same moment on the clock that a robot stamps all its messages by, s; 0: of none.
  double stamp = 0;
};

/// One depth image to look at, not owning: `counts` times `unit` metres (0 and 65535: no
/// measurement), or `metres` (0 and NaN: no measurement). Row-major, width * height values, in host
/// memory or in that of a GPU.
struct DepthImageView {
  int width = 0, height = 0;
  const std::uint16_t* counts = nullptr;
  const float* metres = nullptr;  ///< looked at if there are no counts
  double unit = 0.001;            ///< metres per count
  int gpu = kHostMemory;          ///< whose memory the values are in
  Pose X_WC;                      ///< as of DepthFrame

  DepthImageView() = default;
  /// Without any values unless the frame has as many as its size says.
  DepthImageView(const DepthFrame& frame)
      : width(frame.width), height(frame.height), unit(frame.unit), X_WC(frame.X_WC) {
    if (frame.pixels.size() == num_pixels()) counts = frame.pixels.data();
  }
  DepthImageView(int wide, int high, const std::uint16_t* values, double metres_per_count,
                 int on_gpu = kHostMemory)
      : width(wide), height(high), counts(values), unit(metres_per_count), gpu(on_gpu) {}
  DepthImageView(int wide, int high, const float* values, int on_gpu = kHostMemory)
      : width(wide), height(high), metres(values), gpu(on_gpu) {}

  std::size_t num_pixels() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
};

/// What stays the same over a stream.
struct DepthStreamInfo {
  int width = 0, height = 0;
  Intrinsics intrinsics;
  double unit = 0.001;            ///< metres per count
  double rate = 30;               ///< nominal frames per second
  std::optional<int> num_frames;  ///< nullopt for an endless stream
  std::string name;               ///< for humans
  bool is_live = false;           ///< frames come when they are captured, not when asked for
  Distortion distortion = {};  ///< none where surfaces are made: what cameras/ opens has it removed
  SensorKind sensor = SensorKind::none;  ///< see surface_options_for
  std::string frame = {};  ///< of coordinates, as a stream names its own C; empty: it does not
  bool is_moving = false;  ///< the camera moves: DepthFrame::X_WC is not that of the frame before
};

/// A source is read by one thread, oldest frame first. A live one gives the newest frame and leaves
/// out those that nobody took in time.
class DepthSource {
 public:
  virtual ~DepthSource() = default;
  virtual const DepthStreamInfo& info() const = 0;
  /// Fills `frame` (reusing its memory) and returns true, or false at the end of the stream. Time
  /// stamps are strictly increasing. Error: a frame that cannot be read, with its name.
  virtual Result<bool> next(DepthFrame& frame) = 0;
  /// From any thread: a `next` that waits for a frame, and every later one, returns false at once.
  /// A source whose `next` may wait for longer than a moment must implement this: whoever stops a
  /// run waits for `next`.
  virtual void cancel() noexcept {}
  /// From any thread: what people should know about the stream and have not been told yet, e.g.
  /// that the camera was unplugged or has changed its image size.
  virtual std::vector<std::string> take_notes() { return {}; }
};

/// The depth cameras that look at one scene, not owning: mostly one. They are numbered from 0.
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

// Smaller depth images: less to compute where a computer cannot keep up.

inline constexpr int kMaxBinning = 8;

/// The stream of images whose pixels are squares of `binning` times `binning` pixels. What is left
/// at the right and at the bottom is cut off.
DepthStreamInfo binned(const DepthStreamInfo& stream, int binning);

/// Each pixel is the rounded mean of those of its square that show the same surface: measurements
/// that are within 1/32 of their (lower) median. So no pixel floats between two surfaces. None
/// where nothing was measured. Of counts in host memory. Allocates only if `small` is too small.
/// O(pixels).
void bin_depth(const DepthImageView& image, int binning, DepthFrame& small);

// Averages of raw depth over time: the smoothing that thesis section 3.6 compares with
// interpolation. A mean calms noise, and what moves lags behind; an estimate that knows the noise
// calms what rests and follows what moves.

enum class DepthAverage {
  none,         ///< every frame as it is
  moving,       ///< mean of the last few measurements of a pixel
  exponential,  ///< mean += weight (measurement - mean)
  /// A Kalman filter of each pixel: the mean of all measurements since it last changed. Neighbours
  /// test together whether they move; what does is shown as it is measured, without lag.
  kalman,
};
constexpr auto names_of(DepthAverage) {
  return std::array{"none", "moving", "exponential", "kalman"};
}

/// Each pixel by itself. A measurement that is far from the mean so far is another surface: the
/// average starts anew with it.
struct DepthAverageOptions {
  DepthAverage kind = DepthAverage::none;
  int frames = 8;        ///< moving: measurements in the mean
  double weight = 0.25;  ///< exponential: of the newest measurement
  /// moving, exponential: share of the mean; farther off it is another surface.
  double max_jump = 0.03;
  /// A pixel without measurement keeps its mean over so many frames, then it has none; kalman:
  /// fewer while the mean is young.
  int keep_frames = 3;

  // kalman
  int rest_frames = 300;  ///< the mean of a pixel at rest goes over so many, at most
  /// Standard deviation of a measurement of z m: noise + noise_growth z^2, m. A Kinect v1's, within
  /// 20 % of Nguyen, Izadi & Lovell 2012 from 0.4 to 2 m.
  double noise = 0.0009;
  double noise_growth = 0.001;
  /// Noise of a camera that matches patterns is alike in so many neighbouring pixels.
  double noise_patch = 2;
};
inline void add_settings(SettingTable& t, DepthAverageOptions& o) {
  t.add("average", o.kind,
        "of each pixel's depth over time; palpate touch takes kalman where cameras stand still");
  t.add("average_frames", o.frames, {1, 64, "frames"}, "moving: measurements in the mean");
  t.add("average_weight", o.weight, {1e-9, 1}, "exponential: of the newest measurement");
  t.add("average_max_jump", o.max_jump, {0, 10},
        "moving, exponential: share of the mean; a measurement farther off is another surface");
  t.add("average_keep_frames", o.keep_frames, {0, 100, "frames"},
        "a pixel without measurement keeps its mean so long");
  t.add("average_rest_frames", o.rest_frames, {1, 10000, "frames"},
        "kalman: of a pixel at rest, at most, are in its mean");
  t.add("average_noise", o.noise, {1e-6, 1, "m"},
        "kalman: standard deviation of a measurement, close to the camera");
  t.add("average_noise_growth", o.noise_growth, {0, 1, "m"},
        "kalman: what it has grown by at 1 m; it grows with the square of the depth");
  t.add("average_noise_patch", o.noise_patch, {1, 10000, "pixels"},
        "kalman: of neighbouring pixels so many have their noise in common");
}

/// kalman: what the noise of such a camera asks for (docs/guide/cameras.md, "By kind of sensor").
/// Of none: the defaults.
DepthAverageOptions depth_average_options_for(SensorKind sensor);

/// Owns all buffers for one image size; `update` allocates nothing.
class DepthAverager {
 public:
  /// Errors: a size out of 8..4096, options out of range. All instruction sets give the same bits;
  /// one that the processor lacks is lowered.
  static Result<DepthAverager> create(int width, int height, const DepthAverageOptions& options,
                                      Isa isa = best_isa());
  DepthAverager(DepthAverager&&) noexcept;
  DepthAverager& operator=(DepthAverager&&) noexcept;
  ~DepthAverager();

  /// Takes one more frame, of the size given at construction and of one unit over the stream.
  /// Returns metres, NaN where there is no measurement; valid until the next update. The same bits
  /// for any number of threads.
  std::span<const float> update(const DepthImageView& counts, ThreadPool& pool);

  /// kalman: all that it knows of the frames so far, as bytes, the same ones at every place; about
  /// 8 for each pixel. O(pixels).
  std::string state() const;
  /// Goes on from there. Error: not the state of an estimate of such images.
  Status go_on_from(std::string_view state);

 private:
  struct Impl;
  explicit DepthAverager(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate::inline v0
