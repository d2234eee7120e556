// Progress of the blend from the last surface to the newest one, when surfaces are not on time.
#pragma once

#include <algorithm>

#include "src/cloud/internal/cloud_blend.h"

namespace palpate { inline namespace v0 {

/// A new surface is taken up when the blend to the one before is complete, so that no surface that
/// comes early makes a step in the force. A shorter blend, down to half a period, makes up for the
/// wait: after a late surface the lag goes back to what it was. The blend begins at the query
/// before, which was the last one of the surface before: so the first query of a new surface
/// already feels it.
class BlendClock {
 public:
  /// At `now` the surface is taken up that was ready at `ready_time`; `last` is the query before.
  void begin(double now, double last, double ready_time, double period) {
    duration_ = std::clamp(period - (now - ready_time), period / 2, period);
    start_ = std::max(last, now - duration_ / 2);
  }
  double progress(double now) const { return frame_progress(now, start_, duration_); }
  bool is_complete(double now) const { return progress(now) >= 1; }

 private:
  double start_ = 0;
  double duration_ = 1e-9;  // nothing yet: complete
};

}}  // namespace palpate::v0
