// What the stages of a loop work with, made from its settings.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/contact/blended_query.h"
#include "palpate/haptics/haptic_loop.h"

namespace palpate {

struct LoopParts {
  std::unique_ptr<Coupling> coupling;
  std::optional<SurfaceTimeline> timeline;
  std::unique_ptr<BlendedQuery> query;
  ForceScale scale;
  std::vector<std::string> notes;  ///< for people
};

/// With `before`, what a running loop keeps of it is left out. Errors: settings out of range, the
/// backend, a device that cannot be used.
Result<LoopParts> make_loop_parts(const Tool& tool, const DepthStreamInfo& stream,
                                  const DeviceInfo& device, const HapticSettings& settings,
                                  const HapticSettings* before = nullptr);

}  // namespace palpate
