// How far the way from the last surface to the newest one has come, when surfaces are not on time.
#pragma once

#include <algorithm>

#include "src/cloud/internal/cloud_blend.h"

namespace palpate::inline v0 {

/// A new surface is taken up when the blend to the one before is complete, so that no surface that
/// comes early makes a step in the force. What was waited is made up for by a shorter blend, down
/// to half a period: after a late surface the lag goes back to what it was.
class BlendClock {
 public:
  /// At `now` the surface is taken up that was ready at `ready_time`.
  void begin(double now, double ready_time, double period) {
    start_ = now;
    duration_ = std::clamp(period - (now - ready_time), period / 2, period);
  }
  double progress(double now) const { return frame_progress(now, start_, duration_); }
  bool is_complete(double now) const { return progress(now) >= 1; }

 private:
  double start_ = 0;
  double duration_ = 1e-9;  // nothing yet: complete
};

}  // namespace palpate::inline v0
