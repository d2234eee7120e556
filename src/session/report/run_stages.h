// The stages of a loop whose times a run stores, by name.
#pragma once

#include <array>

#include "palpate/run/run_loop.h"

namespace palpate { inline namespace v0 {

struct RunStage {
  const char* name;  ///< in summary.json
  const LatencyHistogram& times;
};

inline std::array<RunStage, 7> run_stages(const LoopTimes& times) {
  return {{{"haptic_compute", times.haptic_compute},
           {"haptic_cpu", times.haptic_cpu},
           {"haptic_period", times.haptic_period},
           {"contact_compute", times.contact_compute},
           {"surface_compute", times.surface_compute},
           {"contact_age", times.contact_age},
           {"sensor_to_force", times.sensor_to_force}}};
}

}}  // namespace palpate::v0
