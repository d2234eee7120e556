// A stream of raw depth frames: files, a simulated camera, live cameras.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/cloud/intrinsics.h"
#include "palpate/cloud/sensor_kind.h"
#include "palpate/core/result.h"
#include "palpate/gpu/devices.h"
#include "palpate/math/pose.h"

namespace palpate {

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

}  // namespace palpate
