// Turns the frames of a kind of camera into the frames that surfaces are made of.
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "palpate/cameras/cameras.h"
#include "src/cameras/stream/capture_clock.h"
#include "src/cameras/stream/rectifier.h"

namespace palpate { inline namespace v0 {

/// A stream as its kind opens it, a *raw* one: `info()` may change with every frame, distortion is
/// in it, time stamps are the camera's own.
struct RawStream {
  std::unique_ptr<DepthSource> source;
  StampClock stamps = StampClock::cameras;
  bool can_come_back = true;  ///< once it is lost; live ones only
  /// Pose of the images' camera in the frame that has the stream's pose. None: it is a camera's.
  std::optional<Pose> X_FC = {};
};
using OpenRaw = std::function<Result<RawStream>()>;

/// Frames on request, one by one, undistorted. Errors: no intrinsics.
Result<std::unique_ptr<DepthSource>> make_rectified(RawStream raw, const CameraUri& uri);

/// Frames that come by themselves, read by a thread of its own. When `raw` fails, it is destroyed
/// and opened again until that works; `again` may be empty, then the error ends the stream. A call
/// into a vendor's library that never returns is left behind with its thread. Errors: no
/// intrinsics; the system starts no thread.
Result<std::unique_ptr<DepthSource>> make_live(RawStream raw, OpenRaw again, const CameraUri& uri);

/// Returns the URI's parameters of such a stream. Error: neither of them has the intrinsics.
Result<CameraTruth> truth_of(const CameraUri& uri, const DepthStreamInfo& stream);

}}  // namespace palpate::v0
