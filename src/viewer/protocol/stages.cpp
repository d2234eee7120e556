#include "src/viewer/protocol/messages.h"

#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kMaxBars = 60;

/// Lists the buckets between the first and the last used one, neighbors merged until they are few
/// enough; empty ones are left out.
Json histogram_json(const LatencyHistogram& times) {
  int first = 0, end = LatencyHistogram::kNumBuckets;
  while (first < end && times.count(first) == 0) ++first;
  while (end > first && times.count(end - 1) == 0) --end;
  const int width = std::max(1, (end - first + kMaxBars - 1) / kMaxBars);
  Json bars = Json::array();
  for (int begin = first; begin < end; begin += width) {
    std::uint64_t num = 0;
    for (int i = begin; i < std::min(begin + width, end); ++i) num += times.count(i);
    if (num == 0) continue;
    const double low = LatencyHistogram::lower_end(begin) / 1000;
    bars.push_back({std::round(low * 1000) / 1000, num});  // to the nanosecond
  }
  return bars;
}

}  // namespace

Json stage_json(const char* name, const LatencyHistogram& times) {
  const LatencyHistogram::Summary summary = times.summary();
  return {{"name", name},
          {"num", summary.num},
          {"p50", summary.p50},
          {"p99", summary.p99},
          {"p999", summary.p999},
          {"max", summary.max},
          {"histogram", histogram_json(times)}};
}

Json stages_json(const LoopTimes& times) {
  return {stage_json("haptic", times.haptic_compute),
          stage_json("haptic, of the processor", times.haptic_cpu),
          stage_json("haptic period", times.haptic_period),
          stage_json("contact", times.contact_compute),
          stage_json("surface", times.surface_compute),
          stage_json("contact age", times.contact_age),
          stage_json("sensor to force", times.sensor_to_force)};
}

}}  // namespace palpate::v0
