// Depth frames from your own code.
#pragma once

#include <memory>

#include "palpate/cloud/depth_source.h"

namespace palpate {

/// Frames are pushed at one end and felt at the other. The newest one wins: what nobody took in
/// time is left out and counted.
///
///   auto camera = PushedSource::create(info).value();
///   auto loop = RunLoop::create(tool, *camera, device, settings).value();   // one thread
///   camera->push(frame);                                                    // any other one
class PushedSource : public DepthSource {
 public:
  struct Options {
    /// Time stamps are the camera's own, s on a clock of its own: capture times on this computer's
    /// clock are estimated from them. Else a frame is captured when it is pushed.
    bool has_time_stamps = false;
    double latency = 0;  ///< s, from the exposure to the time stamp
  };
  /// `info`: of the frames; `info.distortion` is removed from them. Where the camera is, each frame
  /// says (DepthFrame::X_WC), and `info.is_moving` whether that changes. Errors: a size or focal
  /// length that no image has.
  static Result<std::unique_ptr<PushedSource>> create(const DepthStreamInfo& info,
                                                      const Options& options);
  static Result<std::unique_ptr<PushedSource>> create(const DepthStreamInfo& info);

  /// From any threads. Never waits for whoever feels them; takes the pixels and gives others back,
  /// so that a caller who keeps `frame` allocates nothing. A frame of another size than `info` is
  /// mapped to that, as of a camera that has changed its mode. Pushed after `end`: ignored.
  virtual void push(DepthFrame& frame) = 0;
  /// No more frames come.
  virtual void end() = 0;
};

}  // namespace palpate
