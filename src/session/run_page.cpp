// The page of a run: its summary, its course as plots want it, and the deepest moment.
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <utility>

#include "src/pages/report_page.h"
#include "src/run/internal/pipeline.h"
#include "src/session/compact_json.h"
#include "src/session/run_report.h"
#include "src/session/run_stages.h"
#include "src/session/settings_json.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMostSpheres = 200000;      // of the deepest moment
constexpr std::size_t kMostPixels = 1280 * 1024;  // of its depth image

/// Columns as in wrench.csv, and the two energies.
Json series_json(const RunLog& log) {
  const auto& ticks = log.series.ticks();
  Json json = Json::object();
  const auto add = [&](const std::string& name, auto value, int digits = 5) {
    Json& column = json[name] = Json::array();
    for (const TickRecord& tick : ticks) column.push_back(compact(value(tick), digits));
  };
  const auto add_vector = [&](const std::string& name, const char* unit, auto vector) {
    constexpr const char* kAxes[] = {"_x_", "_y_", "_z_"};
    for (int axis = 0; axis < 3; ++axis) {
      add(name + kAxes[axis] + unit, [&](const TickRecord& tick) { return vector(tick)[axis]; });
    }
  };
  const auto measured = [](const TickRecord& tick, double value) {
    return is_contact_lost(tick) ? NAN : value;
  };
  add(
      "time_s", [](const TickRecord& tick) { return tick.time; }, 9);
  add("volume_m3", [&](const TickRecord& t) { return measured(t, t.penetration.volume); });
  if (!log.setup.settings.objects.empty()) {
    add("objects_volume_m3", [](const TickRecord& tick) { return tick.objects.volume; });
  }
  add_vector("force", "N",
             [&](const TickRecord& tick) { return tick.step.contact_W.force * measured(tick, 1); });
  add_vector("torque", "Nm", [&](const TickRecord& tick) {
    return tick.step.contact_W.torque * measured(tick, 1);
  });
  if (!log.has_hand()) return json;
  add_vector("hand_force", "N", [](const TickRecord& tick) { return tick.F_H_B.force; });
  add_vector("hand_torque", "Nm", [](const TickRecord& tick) { return tick.F_H_B.torque; });
  add("stretch_m", [](const TickRecord& tick) { return tick.step.stretch; });
  add("energy_given_J", [](const TickRecord& tick) { return tick.safety.energy; });
  add("energy_coupling_J", [](const TickRecord& tick) { return tick.step.energy; });
  add("gain", [](const TickRecord& tick) { return tick.safety.gain; });
  add("fault", [](const TickRecord& tick) { return static_cast<int>(told_fault(tick)); });
  add("sensor_age_s", [](const TickRecord& tick) { return tick.sensor_age; });
  add("contact_age_s", [](const TickRecord& tick) { return tick.contact_age; });
  return json;
}

/// [lower end in microseconds, count] of every bucket that has any.
Json latencies_json(const LoopTimes& times) {
  Json json = Json::object();
  for (const RunStage& stage : run_stages(times)) {
    Json& buckets = json[stage.name] = Json::array();
    for (int b = 0; b < LatencyHistogram::kNumBuckets; ++b) {
      if (stage.times.count(b) == 0) continue;
      buckets.push_back({compact(1e-3 * LatencyHistogram::lower_end(b)), stage.times.count(b)});
    }
  }
  return json;
}

Json list(const Vec3d& v) { return {compact(v.x), compact(v.y), compact(v.z)}; }

/// Every n-th pixel in both directions, so that it is not too large for a page.
DepthFrame thinned(const DepthFrame& frame, int n) {
  if (n == 1) return frame;
  DepthFrame thin = frame;
  thin.width = (frame.width + n - 1) / n;
  thin.height = (frame.height + n - 1) / n;
  thin.pixels.clear();
  for (int v = 0; v < frame.height; v += n) {
    for (int u = 0; u < frame.width; u += n) {
      thin.pixels.push_back(frame.pixels[static_cast<std::size_t>(v * frame.width + u)]);
    }
  }
  return thin;
}

/// What each pixel has more than the one to its left, modulo 2^16: first all low bytes, then all
/// high bytes; by zlib, in base64. Empty if there is no memory for it.
std::string packed_depth(const DepthFrame& frame) {
  const std::size_t num = frame.pixels.size();
  std::vector<Bytef> bytes(2 * num);
  for (std::size_t i = 0; i < num; ++i) {
    const int left = i % static_cast<std::size_t>(frame.width) == 0 ? 0 : frame.pixels[i - 1];
    const auto more = static_cast<std::uint16_t>(frame.pixels[i] - left);
    bytes[i] = static_cast<Bytef>(more & 0xff);
    bytes[num + i] = static_cast<Bytef>(more >> 8);
  }
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  std::string packed(size, '\0');
  if (compress2(reinterpret_cast<Bytef*>(packed.data()), &size, bytes.data(),
                static_cast<uLong>(bytes.size()), Z_BEST_COMPRESSION) != Z_OK) {
    return {};
  }
  packed.resize(size);
  return base64(packed);
}

/// Radius of the tool about the centre of mass of its spheres.
double tool_radius(const Tool& tool) {
  double radius = 0;
  for (const Sphere& s : tool.spheres()) {
    radius = std::max(radius, norm(to_double(s.centre) - tool.sphere_mass().centre_of_mass) +
                                  static_cast<double>(s.radius));
  }
  return radius;
}

/// States and planes of the spheres that a page shows, as the viewer's messages have them.
void add_states(Json& json, std::span<const SphereState> states,
                std::span<const Plane<float>> planes) {
  constexpr std::uint8_t kIsCut = 4;
  std::vector<std::uint8_t> bytes;
  std::vector<float> cuts;
  for (std::size_t i = 0; i < states.size(); ++i) {
    const auto& [normal, offset] = planes[i];
    const bool is_cut = states[i] != SphereState::outside && !(normal == Vec3f{});
    bytes.push_back(static_cast<std::uint8_t>(static_cast<int>(states[i]) | (is_cut ? kIsCut : 0)));
    if (is_cut) cuts.insert(cuts.end(), {normal.x, normal.y, normal.z, offset});
  }
  json["states"] = packed<std::uint8_t>(bytes);
  json["planes"] = packed<float>(cuts);
}

/// Measured once more, on the CPU: shows the same, also when a GPU has failed.
Result<Json> moment_json(const Tool& tool, const RunLog& log) {
  const TickRecord& tick = log.deepest;
  const Pose& X_WT = tick.step.X_WT;
  RunSettings settings = log.setup.settings;
  if (tick.revision > 0) settings = log.changes[tick.revision - 1];
  settings.backend = Backend::cpu;
  settings.time.mode = TimeMode::latest;
  settings.num_spheres = 0;  // one state for each
  auto part = make_contact_part(ToolIndex::create(tool), settings, {});
  if (!part) return part.error();
  ThreadPool pool(settings.num_threads);
  std::deque<SurfaceTimeline> timelines;
  std::vector<SurfaceBlend> cameras;
  for (std::size_t k = 0; k < log.deepest_frames.size(); ++k) {
    if (log.deepest_frames[k].pixels.empty()) continue;
    auto surfaces = make_surfaces(log.setup.streams[k], settings, 0, log.deepest_frames.size() > 1);
    if (!surfaces) return surfaces.error();
    timelines.push_back(*std::move(surfaces));
    timelines.back().push(log.deepest_frames[k], 0, pool);
    cameras.push_back(timelines.back().at(0));
  }
  std::vector<SphereState> states(tool.spheres().size());
  std::vector<Plane<float>> planes(states.size());
  (*part)->query().measure(cameras, X_WT, {.states = states, .planes = planes});

  // Spheres are stored by size, as good as.
  const std::size_t num_shown = std::min(states.size(), kMostSpheres);
  const DepthStreamInfo& stream = log.setup.streams.front();
  const DepthFrame& image = log.deepest_frames.front();
  const auto& [fx, fy, cx, cy] = stream.intrinsics;
  const int n = static_cast<int>(
      std::ceil(std::sqrt(static_cast<double>(image.pixels.size()) / kMostPixels)));
  const DepthFrame frame = thinned(image, n);
  // As the first camera sees it.
  const Pose X_CW = inverse(image.X_WC);
  const auto in_camera = [&](const Vec3d& v_W) { return list(rotate(X_CW.rotation, v_W)); };
  Json pose = Json::array();
  for (const double value : seven_numbers(X_CW * X_WT)) pose.push_back(compact(value, 9));
  Json json{{"time_s", tick.time},
            {"X_WT", pose},
            {"volume_m3", compact(tick.penetration.volume)},
            {"force_N", in_camera(tick.step.contact_W.force)},
            {"torque_Nm", in_camera(tick.step.contact_W.torque)},
            {"centre_of_mass_m", list(tool.sphere_mass().centre_of_mass)},
            {"radius_m", compact(tool_radius(tool))},
            {"spheres", packed<Sphere>(tool.spheres().subspan(0, num_shown))},
            {"spheres_left_out", states.size() - num_shown},
            {"image",
             {{"width", frame.width},
              {"height", frame.height},
              {"fx", fx / n},
              {"fy", fy / n},
              {"cx", cx / n},
              {"cy", cy / n},
              {"unit", stream.unit}}},
            {"depth", packed_depth(frame)}};
  add_states(json, std::span(states).first(num_shown), std::span(planes).first(num_shown));
  return json;
}

/// The end of a path that still tells what it is: the last two parts.
std::string short_name(const std::string& name) {
  const std::size_t last = name.find_last_of('/', name.empty() ? 0 : name.size() - 2);
  if (last == std::string::npos || last == 0) return name;
  const std::size_t before = name.find_last_of('/', last - 1);
  return before == std::string::npos ? name : name.substr(before + 1);
}

/// What the settings of such a run are if nobody changes any.
Json usual_settings(const Tool& tool, const RunLog& log) {
  RunSettings usual;
  usual.coupling.kind = log.coupling.kind;
  const DeviceInfo& device = log.setup.device;
  const auto coupling =
      check_coupling(usual.coupling, device.limits, 1 / device.rate, tool.sphere_mass());
  if (coupling) usual.coupling = coupling->options;
  return to_json(settings_of(usual));
}

}  // namespace

Result<std::string> run_page(const Json& summary, const Tool& tool, const RunLog& log,
                             const LoopTimes& times) {
  Json json{{"kind", "run"},
            {"summary", summary},
            {"defaults", usual_settings(tool, log)},
            {"series", series_json(log)},
            {"frame_times_s", Json::array()},
            {"latencies", latencies_json(times)},
            {"moment", nullptr},
            {"moment_trouble", ""}};
  // Pages are sent to others, who need not know whose folders these were.
  const std::string stream_name = short_name(log.setup.streams.front().name);
  json["summary"]["stream"]["name"] = stream_name;
  for (Json& camera : json["summary"]["cameras"]) {
    camera["name"] = short_name(camera["name"].get<std::string>());
  }
  for (const double time : log.frame_times) json["frame_times_s"].push_back(compact(time, 7));
  if (!log.deepest_frames.empty() && !log.deepest_frames.front().pixels.empty()) {
    auto moment = moment_json(tool, log);
    if (moment) {
      json["moment"] = *std::move(moment);
    } else {
      json["moment_trouble"] = moment.error().message;
    }
  }
  return report_page("Palpate: " + tool.source() + " in " + stream_name, page_text(json));
}

}  // namespace palpate
