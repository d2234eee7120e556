// A stream of raw depth frames: files, a simulated camera, later live sensors.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/cloud/intrinsics.h"
#include "palpate/core/result.h"

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
  double timestamp = 0;               ///< seconds, on the source's own clock
};

/// What stays the same over a stream.
struct DepthStreamInfo {
  int width = 0, height = 0;
  Intrinsics intrinsics;
  double unit = 0.001;            ///< metres per count
  double rate = 30;               ///< nominal frames per second
  std::optional<int> num_frames;  ///< nullopt for an endless stream
  std::string name;               ///< for people
};

/// A source is read by one thread, oldest frame first.
class DepthSource {
 public:
  virtual ~DepthSource() = default;
  virtual const DepthStreamInfo& info() const = 0;
  /// Fills `frame` (reusing its memory) and returns true, or false at the end of the stream. Time
  /// stamps are strictly increasing. Error: a frame that cannot be read, with its name.
  virtual Result<bool> next(DepthFrame& frame) = 0;
};

}  // namespace palpate
