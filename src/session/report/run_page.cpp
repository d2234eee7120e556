// The page of a run: its summary, its course for plots, and the deepest moment.
#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <string>
#include <utility>

#include "src/pages/internal/pages.h"
#include "src/run/internal/object_poses.h"
#include "src/run/internal/pipeline.h"
#include "src/session/internal/compact_json.h"
#include "src/session/internal/page_models.h"
#include "src/session/internal/settings_json.h"
#include "src/session/report/run_report.h"
#include "src/session/report/run_stages.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

/// Adds numbers as text: destroying a Json of a long array takes more memory, and where there is
/// none left, that would end the program.
template <class Items, class Value>
void add_numbers(std::string& text, const Items& items, Value value, int digits) {
  char separator = '[';
  for (const auto& item : items) {
    text += std::exchange(separator, ',');
    text += compact(value(item), digits).dump();
  }
  text += separator == '[' ? "[]" : "]";
}

/// Returns the columns that the page plots, and the two energies of a hand: an object, as text.
std::string series_text(const Tool& tool, const RunLog& log) {
  const auto& ticks = log.series.ticks();
  std::string text = "{";
  const auto add = [&](const std::string& name, auto value, int digits = 5) {
    text += (text.size() > 1 ? ",\"" : "\"") + name + "\":";
    add_numbers(text, ticks, value, digits);
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
  const double full = full_volume(tool, log.setup.settings.contact);
  const auto unseen_share = [&](const TickRecord& t) {
    return measured(t, t.penetration.unseen_volume) / full;
  };
  // One camera is plotted only where it matters.
  constexpr double kWorthAPlot = 0.01;
  if (reports_unseen(log.setup) &&
      (log.setup.streams.size() > 1 || std::ranges::any_of(ticks, [&](const TickRecord& t) {
         return unseen_share(t) > kWorthAPlot;
       }))) {
    add("unseen", unseen_share);
  }
  add_vector("force", "N",
             [&](const TickRecord& tick) { return tick.step.contact_W.force * measured(tick, 1); });
  add_vector("torque", "Nm", [&](const TickRecord& tick) {
    return tick.step.contact_W.torque * measured(tick, 1);
  });
  if (log.setup.settings.wants_std) {
    add("volume_std_m3", [&](const TickRecord& t) {
      return t.noise ? measured(t, t.noise->volume_std()) : static_cast<double>(NAN);
    });
    const double newtons = log.newtons_per_cubic_meter;
    // Along the axes, and of the norm: along the vector.
    const auto add_std = [&](const std::string& name, const char* unit,
                             Mat3d MeasureNoise::*covariance, Vec3d Wrench::*vector) {
      const auto along = [=](const TickRecord& t, const Vec3d& direction) {
        if (!t.noise || !(norm(direction) > 0)) return static_cast<double>(NAN);
        const Vec3d turned = (*t.noise).*covariance * direction;
        return newtons * std::sqrt(std::max(0.0, dot(direction, turned))) / norm(direction);
      };
      add_vector(name, unit, [&](const TickRecord& t) {
        return measured(t, 1) *
               Vec3d{along(t, {1, 0, 0}), along(t, {0, 1, 0}), along(t, {0, 0, 1})};
      });
      add(name + "_" + unit,
          [&](const TickRecord& t) { return measured(t, along(t, t.step.contact_W.*vector)); });
    };
    add_std("force_std", "N", &MeasureNoise::force, &Wrench::force);
    add_std("torque_std", "Nm", &MeasureNoise::torque, &Wrench::torque);
  }
  // The picture's tool follows the cursor of the plots.
  constexpr const char* kPose[] = {"tool_x_m", "tool_y_m", "tool_z_m", "tool_qx",
                                   "tool_qy",  "tool_qz",  "tool_qw"};
  for (std::size_t i = 0; i < std::size(kPose); ++i) {
    add(kPose[i], [i](const TickRecord& tick) { return seven_numbers(tick.step.X_WT)[i]; });
  }
  if (!log.has_hand()) return text + "}";
  add_vector("hand_force", "N", [](const TickRecord& tick) { return tick.F_H_B.force; });
  add_vector("hand_torque", "Nm", [](const TickRecord& tick) { return tick.F_H_B.torque; });
  add("stretch_m", [](const TickRecord& tick) { return tick.step.stretch; });
  add("energy_given_J", [](const TickRecord& tick) { return tick.safety.energy; });
  add("energy_coupling_J", [](const TickRecord& tick) { return tick.step.energy; });
  add("gain", [](const TickRecord& tick) { return tick.safety.gain; });
  add("fault", [](const TickRecord& tick) { return static_cast<int>(reported_fault(tick)); });
  add("sensor_age_s", [](const TickRecord& tick) { return tick.sensor_age; });
  add("contact_age_s", [](const TickRecord& tick) { return tick.contact_age; });
  return text + "}";
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

/// Measures the deepest moment again, on the CPU: shows the same, also when a GPU has failed.
Result<Json> moment_json(const Tool& tool, const RunLog& log) {
  const TickRecord& tick = log.deepest;
  const Pose& X_WT = tick.step.X_WT;
  RunSettings settings = log.deepest_settings;
  settings.backend = Backend::cpu;
  settings.time.mode = TimeMode::latest;
  settings.num_spheres = 0;  // one state for each
  settings.objects.clear();  // of the cloud alone
  auto part = make_contact_part(ToolIndex::create(tool), settings, {});
  if (!part) return part.error();
  ThreadPool pool(settings.num_threads);
  std::deque<SurfaceTimeline> timelines;
  std::vector<SurfaceBlend> cameras;
  for (std::size_t k = 0; k < log.deepest_frames.size(); ++k) {
    if (log.deepest_frames[k].pixels.empty()) continue;
    auto surfaces = make_surfaces(log.setup.streams, k, settings);
    if (!surfaces) return surfaces.error();
    timelines.push_back(*std::move(surfaces));
    timelines.back().push(log.deepest_frames[k], 0, pool);
    cameras.push_back(timelines.back().at(0));
  }
  std::vector<SphereState> states(tool.spheres().size());
  std::vector<Plane<float>> planes(states.size());
  (*part)->query().measure(cameras, X_WT, {.states = states, .planes = planes});

  Json json = seen_tool_json(tool, X_WT, log.setup.streams, log.deepest_frames, states, planes);
  const std::vector<SceneObject>& objects = log.setup.settings.objects;
  const auto& [num_moving, moving] = log.deepest_bodies;
  json["objects"] = seen_objects_json(objects, objects_at(objects, std::span(moving, num_moving)));
  json["time_s"] = tick.time;
  json["volume_m3"] = compact(tick.penetration.volume);
  json["objects_volume_m3"] = compact(tick.objects.volume);
  json["force_N"] = list(tick.step.contact_W.force);
  json["torque_Nm"] = list(tick.step.contact_W.torque);
  if (tick.noise) {
    const auto& m = tick.noise->force.m;
    Json& covariance = json["force_covariance_N2"] = Json::array();
    for (const double each : {m[0][0], m[0][1], m[0][2], m[1][1], m[1][2], m[2][2]}) {
      covariance.push_back(compact(std::pow(log.newtons_per_cubic_meter, 2) * each));
    }
  }
  return json;
}

/// Returns the last two parts of a path.
std::string short_name(const std::string& name) {
  const std::size_t last = name.find_last_of('/', name.empty() ? 0 : name.size() - 2);
  if (last == std::string::npos || last == 0) return name;
  const std::size_t before = name.find_last_of('/', last - 1);
  return before == std::string::npos ? name : name.substr(before + 1);
}

/// Returns the default settings of such a run.
Json usual_settings(const Tool& tool, const RunLog& log) {
  RunSettings usual;
  usual.coupling.kind = log.coupling.kind;
  usual.time.average.kind = usual_average(log.setup.streams);
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
            {"latencies", latencies_json(times)},
            {"nearest", nullptr},
            {"moment", nullptr},
            {"moment_trouble", ""}};
  if (log.nearest) {
    json["nearest"] = {{"distance_m", compact(log.nearest->distance)},
                       {"time_s", compact(log.nearest->time)}};
  }
  // Pages are sent to others, who need not know the folders.
  const std::string stream_name = short_name(log.setup.streams.front().name);
  json["summary"]["stream"]["name"] = stream_name;
  const auto shorten_name = [](Json& camera) {
    camera["name"] = short_name(camera["name"].get<std::string>());
  };
  for (Json& camera : json["summary"]["cameras"]) shorten_name(camera);
  if (!log.deepest_frames.empty() && !log.deepest_frames.front().pixels.empty()) {
    auto moment = moment_json(tool, log);
    if (moment) {
      json["moment"] = *std::move(moment);
      for (Json& camera : json["moment"]["cameras"]) shorten_name(camera);
      if (log.setup.settings.time.memory.kind != DepthMemory::off) {
        json["moment_trouble"] =
            "The picture is made of the depth images of that moment alone: what cameras remembered "
            "behind them is missing, so spheres there are shown as inside.";
      }
    } else {
      json["moment_trouble"] = moment.error().message;
    }
  }
  std::string text = "{\"series\":" + series_text(tool, log) + ",\"frame_times_s\":";
  add_numbers(text, log.frame_times, std::identity(), 7);
  text += "," + page_text(json).substr(1);
  return report_page("Palpate: " + tool.source() + " in " + stream_name, text);
}

}}  // namespace palpate::v0
