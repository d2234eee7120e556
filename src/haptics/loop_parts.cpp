#include "src/haptics/loop_parts.h"

#include <cmath>
#include <utility>

#include "src/haptics/surface_stage.h"

namespace palpate {
namespace {

Status check(const HapticSettings& settings, const DeviceInfo& device) {
  if (!(settings.contact_rate >= 1 && settings.contact_rate <= 100000)) {
    return Error{Errc::invalid_argument,
                 "the contact rate must be from 1 to 100000 queries per second; 1000 is usual"};
  }
  if (settings.num_threads < 0 || settings.num_threads > 256) {
    return Error{Errc::invalid_argument,
                 "the number of threads must be from 0 (one per core) to 256"};
  }
  if (!(device.rate > 0 && std::isfinite(device.rate))) {
    return Error{Errc::invalid_argument,
                 device.name + " tells no rate of ticks; it cannot be used"};
  }
  return Done{};
}

Status make_timeline(const DepthStreamInfo& stream, const HapticSettings& settings,
                     LoopParts& parts) {
  std::optional<DepthFieldOptions> field;
  if (settings.contact.method == InsideMethod::field) field = settings.field;
  auto timeline =
      SurfaceTimeline::create(stream, settings.surface, field, settings.time,
                              {settings.backend, settings.sensing_gpu}, SurfaceStage::kNumSpare);
  if (!timeline) return timeline.error();
  parts.timeline.emplace(*std::move(timeline));
  return Done{};
}

Status make_query(const Tool& tool, const HapticSettings& settings, LoopParts& parts) {
  ContactCapacities capacities;
  capacities.gpu = settings.contact_gpu;
  auto query = make_contact_query(settings.backend, tool, capacities);
  if (!query) return query.error();
  parts.query = std::make_unique<BlendedQuery>(*std::move(query));
  return Done{};
}

}  // namespace

Result<LoopParts> make_loop_parts(const Tool& tool, const DepthStreamInfo& stream,
                                  const DeviceInfo& device, const HapticSettings& settings,
                                  const HapticSettings* before) {
  if (const Status status = check(settings, device); !status) return status.error();
  auto coupling = check_coupling(settings.coupling, device.limits, 1 / device.rate);
  if (!coupling) return coupling.error();
  LoopParts parts;
  parts.scale =
      thesis_force_scale(coupling->options.force_at_eighth, full_volume(tool, settings.contact));
  if (before == nullptr || !keeps_coupling(*before, settings)) {
    parts.coupling = make_coupling(coupling->options, device.limits, tool.sphere_mass());
    parts.notes = std::move(coupling->warnings);
  }
  if (before == nullptr || !keeps_surfaces(*before, settings)) {
    if (const Status status = make_timeline(stream, settings, parts); !status) {
      return status.error();
    }
  }
  if (before == nullptr || before->backend != settings.backend) {
    if (const Status status = make_query(tool, settings, parts); !status) return status.error();
  }
  return parts;
}

}  // namespace palpate
