#include <algorithm>
#include <cmath>
#include <set>
#include <string_view>
#include <utility>

#include "src/run/internal/pipeline.h"

namespace palpate { inline namespace v0 {
namespace {

Backend backend_of(const RunSettings& settings) { return settings.backend.value_or(Backend::cpu); }

/// Checks the name of an object, by which settings find it. `taken`: names of those before it.
Status check_name(const std::string& name, std::set<std::string_view>& taken) {
  constexpr std::size_t kLongest = 64;
  const auto is_plain = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  };
  if (name.size() > kLongest || !std::ranges::all_of(name, is_plain)) {
    return Error{Errc::invalid_argument,
                 "the name of an object must be up to 64 letters, digits and _, not '" +
                     name.substr(0, kLongest) + "'"};
  }
  if (!name.empty() && !taken.insert(name).second) {
    return Error{Errc::invalid_argument,
                 "two objects are called '" + name + "'; give each a name of its own"};
  }
  return Done{};
}

Status check(const RunSettings& settings, const DeviceInfo& device) {
  if (Status status = check_settings(settings); !status) return status;
  if (!(device.rate > 0 && std::isfinite(device.rate))) {
    return Error{Errc::invalid_argument, device.name + " reports no tick rate; it cannot be used"};
  }
  std::set<std::string_view> names;
  for (const SceneObject& object : settings.objects) {
    if (const Status status = check_name(object.name, names); !status) return status;
    if (object.shape == nullptr || !is_finite(object.X_WB)) {
      return Error{Errc::invalid_argument, "every object needs a shape and a finite pose"};
    }
    const double friction = object.friction.value_or(0), ratio = object.static_ratio.value_or(1);
    const double viscous = object.viscous.value_or(0);
    if (!(friction >= 0 && friction <= 10 && ratio >= 1 && ratio <= 10 && viscous >= 0 &&
          viscous <= 100)) {
      return Error{Errc::invalid_argument,
                   "the friction of an object must be a number from 0 to 10, its static_ratio one "
                   "from 1 to 10 and its viscous friction one from 0 to 100 s/m"};
    }
  }
  return Done{};
}

Status check_moving(const RunSettings& settings) {
  if (!has_moving_objects(settings)) return Done{};
  if (settings.contact.method == MethodKind::field &&
      settings.contact.bodies == BodyMethod::field) {
    return Done{};
  }
  return Error{Errc::invalid_argument,
               "moving objects need --method field and --bodies field, which give the stiffness of "
               "contacts"};
}

Status check_flow(std::span<const DepthStreamInfo> streams, const RunSettings& settings) {
  if (std::ranges::none_of(streams, &DepthStreamInfo::has_flow)) return Done{};
  const bool can_use = backend_of(settings) == Backend::cpu &&
                       settings.contact.method == MethodKind::field &&
                       settings.time.mode != TimeMode::latest;
  if (can_use) return Done{};
  return Error{Errc::invalid_argument,
               "an optical flow is used with --backend cpu, --method field and --time interpolate "
               "or predict; give these, or leave the flow out"};
}

Status check_std(const RunSettings& settings) {
  if (!settings.wants_std || settings.contact.method == MethodKind::field) return Done{};
  return Error{Errc::invalid_argument,
               "--std is for the method field: " + std::string(name_of(settings.contact.method)) +
                   " does not know its noise"};
}

Status check_cameras(std::size_t num, const RunSettings& settings) {
  if (num == 0 || num > kMaxCameras) {
    return Error{Errc::invalid_argument, "a run has 1 to " + std::to_string(kMaxCameras) +
                                             " cameras, not " + std::to_string(num)};
  }
  if (num > 1 && settings.contact.method != MethodKind::field) {
    return Error{
        Errc::invalid_argument,
        "several cameras are joined by the method field alone; give --method field, or one "
        "camera"};
  }
  return Done{};
}

/// Creates the index of the first spheres alone, with torques about the whole tool's point.
Result<std::shared_ptr<const ToolIndex>> thinned_index(const Tool& tool, int num_spheres) {
  struct Thinned {
    Tool tool;
    std::shared_ptr<const ToolIndex> index;
  };
  auto prefix = tool.thinned(num_spheres);
  if (!prefix) return prefix.error();
  const auto thinned = std::make_shared<Thinned>(Thinned{*std::move(prefix), nullptr});
  thinned->index = ToolIndex::create(thinned->tool);
  return std::shared_ptr<const ToolIndex>(thinned, thinned->index.get());
}

/// Returns the number of key frames that each moving camera may keep.
int num_key_frames(std::span<const DepthStreamInfo> streams) {
  const auto num_moving =
      static_cast<int>(std::ranges::count_if(streams, &DepthStreamInfo::is_moving));
  const int num = kMaxCameras - static_cast<int>(streams.size());
  return std::max(1, num_moving > 0 ? num / num_moving : num);
}

/// Returns the name of a camera as its frames have it.
std::string camera_name(const std::string& name, std::size_t camera) {
  return "camera" + (camera > 0 ? "_" + std::to_string(camera + 1) : "") + " (" + name + ")";
}

}  // namespace

std::string frames_have_ended(const std::string& name, std::size_t camera,
                              std::size_t num_cameras) {
  return "the depth frames " + (num_cameras > 1 ? "of " + camera_name(name, camera) + " " : "") +
         "have ended";
}

Error error_of_camera(const Error& error, const std::string& name, std::size_t camera,
                      std::size_t num_cameras) {
  if (num_cameras == 1) return error;
  return {error.code, camera_name(name, camera) + ": " + error.message};
}

Error lost_backend() {
  return {Errc::unavailable,
          "the GPU did not answer a contact query in time or is lost; check it with nvidia-smi, or "
          "use the CPU (--backend cpu)"};
}

Result<SurfaceTimeline> make_surfaces(std::span<const DepthStreamInfo> streams, std::size_t camera,
                                      const RunSettings& settings, int num_spare,
                                      double first_period) {
  std::optional<DepthFieldOptions> field;
  if (settings.contact.method == MethodKind::field) {
    field = settings.field;
    field->one_of_several = streams.size() > 1;
  }
  TimeOptions time = settings.time;
  if (first_period > 0) time.first_period = first_period;
  time.memory.frames = std::min(time.memory.frames, num_key_frames(streams));
  return SurfaceTimeline::create(streams[camera],
                                 {.surface = settings.surface,
                                  .field = field,
                                  .time = time,
                                  .wants_depth_change = needs_depth_change(settings),
                                  .num_spare = num_spare,
                                  .binning = settings.binning},
                                 {backend_of(settings), settings.sensing_gpu});
}

Result<std::unique_ptr<ContactPart>> make_contact_part(std::shared_ptr<const ToolIndex> index,
                                                       const RunSettings& settings,
                                                       const ContactScale& scale,
                                                       ThreadPool* threads) {
  ExecutionOptions execution;
  execution.pool = threads;
  execution.reserves_noise = settings.wants_std;
  const auto method = contact_method(settings.contact);
  if (!method) return method.error();
  if (const auto num = static_cast<std::size_t>(std::max(settings.num_spheres, 0));
      num > 0 && num < index->tool().spheres().size()) {
    auto thinned = thinned_index(index->tool(), settings.num_spheres);
    if (!thinned) return thinned.error();
    index = *std::move(thinned);
  }
  const Tool& tool = index->tool();
  const Place place{backend_of(settings), settings.contact_gpu};
  auto query = make_contact_query(place, std::move(index), *method, execution);
  if (!query) return query.error();
  std::unique_ptr<MovingBodies> moving;
  if (has_moving_objects(settings)) {
    auto made = MovingBodies::create(settings.objects, settings.bodies, place, threads);
    if (!made) return made.error();
    moving = *std::move(made);
  }
  auto part = std::make_unique<ContactPart>(tool, *std::move(query), scale, settings.objects,
                                            settings.contact.bodies, std::move(moving));
  const Status status = part->measure_at(place);
  if (!status) return status.error();
  return part;
}

Result<std::unique_ptr<ContactPart>> make_contact_part(std::shared_ptr<const ToolIndex> index,
                                                       std::span<const DepthStreamInfo> streams,
                                                       const RunSettings& settings,
                                                       const ContactScale& scale,
                                                       ThreadPool* threads) {
  auto part = make_contact_part(std::move(index), settings, scale, threads);
  if (!part) return part.error();
  auto regions = region_lookups(settings.regions, streams);
  if (!regions) return regions.error();
  (*part)->set_regions(*std::move(regions));
  return part;
}

Result<RunParts> make_run_parts(const std::shared_ptr<const ToolIndex>& index,
                                std::span<const DepthStreamInfo> streams, const DeviceInfo& device,
                                const RunSettings& settings, const RunPartsOptions& options) {
  const Tool& tool = index->tool();
  if (const Status status = check(settings, device); !status) return status.error();
  if (const Status status = check_cameras(streams.size(), settings); !status) {
    return status.error();
  }
  if (const Status status = check_moving(settings); !status) return status.error();
  if (const Status status = check_flow(streams, settings); !status) return status.error();
  if (const Status status = check_std(settings); !status) return status.error();
  auto coupling =
      check_coupling(settings.coupling, device.limits, 1 / device.rate, tool.sphere_mass());
  if (!coupling) return coupling.error();
  const RunSettings* const before = options.before;
  RunParts parts;
  parts.checked_coupling = coupling->options;
  parts.scale = {thesis_volume_stiffness(coupling->options.force_at_eighth,
                                         full_volume(tool, settings.contact)),
                 coupling->options.friction,
                 friction_stiffness(coupling->options, device.limits),
                 settings.bodies,
                 frictions_of(settings.objects),
                 settings.wants_std};
  if (before == nullptr || !keeps_coupling(*before, settings)) {
    parts.coupling = make_coupling(coupling->options, device.limits, tool.sphere_mass());
    parts.notes = std::move(coupling->warnings);
  }
  parts.needs_timelines = before == nullptr || !keeps_surfaces(*before, settings);
  parts.needs_contact = before == nullptr || before->backend != settings.backend ||
                        before->contact != settings.contact ||
                        before->num_spheres != settings.num_spheres;
  if (options.leaves_out_large) return parts;
  if (parts.needs_timelines) {
    for (std::size_t k = 0; k < streams.size(); ++k) {
      auto timeline = make_surfaces(streams, k, settings, options.num_spare_surfaces);
      if (!timeline) return timeline.error();
      parts.timelines.push_back(*std::move(timeline));
    }
  }
  if (parts.needs_contact) {
    auto contact = make_contact_part(index, streams, settings, parts.scale, options.query_threads);
    if (!contact) return contact.error();
    parts.contact = *std::move(contact);
  }
  return parts;
}

}}  // namespace palpate::v0
