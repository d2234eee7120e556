// palpate touch --device: a hand on a haptic device, live.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/io/trajectory_file.h"
#include "palpate/session/haptic_run.h"
#include "palpate/session/session.h"
#include "palpate/viewer/view_server.h"

namespace palpate::apps {

struct LiveOptions {
  std::string device;       ///< as open_device takes it
  HapticSettings settings;  ///< but what `run` holds
  RunSettings run;          ///< contact, surface, field, time, backend and rate of queries
  std::optional<double> duration;
  std::string output;
  bool json = false;
  std::optional<ViewServerOptions> page;  ///< shown meanwhile
  std::optional<ProbeChoice> probe;       ///< how the path was chosen, if nobody gave it
};

/// Feels `source` with the tool in the hand. `path` is where to touch: unless the settings say
/// where the device is, its middle is put where the path begins; a simulated hand follows it.
Status touch_live(const LiveOptions& options, const Tool& tool, DepthSource& source,
                  const std::vector<TimedPose>& path);

}  // namespace palpate::apps
