#include "src/session/run_report.h"

#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "src/session/html_page.h"
#include "src/session/probe_report.h"
#include "src/session/report_pictures.h"
#include "src/session/settings_json.h"
#include "src/session/svg_plot.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kMicrosecond = 1e-6;

struct Stage {
  const char* key;
  const char* words;
  const LatencyHistogram& times;
};

std::vector<Stage> stages(const LoopTimes& times) {
  return {{"haptic_compute", "haptic tick: computing", times.haptic_compute},
          {"haptic_cpu", "haptic tick: computing, without what others ran on its core meanwhile",
           times.haptic_cpu},
          {"haptic_period", "haptic tick: from one to the next", times.haptic_period},
          {"contact_compute", "contact query: computing", times.contact_compute},
          {"surface_compute", "surface of a depth frame: computing", times.surface_compute},
          {"contact_age", "age of the contact at a tick", times.contact_age},
          {"sensor_to_force", "from the depth frame to the force", times.sensor_to_force}};
}

std::string microseconds(double value) { return with_unit(value * kMicrosecond, kTimeUnits); }

std::string newtons(double value) { return short_number(value, 3) + "\u00a0N"; }

std::string headline(const Tool& tool, const RunLog& log, const LoopTimes& times) {
  const auto compute = times.haptic_compute.summary(), contact = times.contact_compute.summary();
  const auto surface = times.surface_compute.summary(), lag = times.sensor_to_force.summary();
  const double share = log.peaks.volume / full_volume(tool, log.setup.settings.contact);
  std::string cards =
      card(with_unit(log.peaks.volume, kVolumeUnits),
           "deepest penetration, " + short_number(100 * share, 3) + "\u00a0% of the tool") +
      card(newtons(log.peaks.contact_force), "largest force on the tool");
  if (log.has_hand()) {
    cards += card(newtons(log.peaks.force),
                  "largest force on the hand; wanted " + newtons(log.peaks.wanted_force)) +
             card(microseconds(lag.p50),
                  "median from depth frame to force; 99 %: " + microseconds(lag.p99));
  }
  cards +=
      card(microseconds(compute.p50), "median of a tick; 99 %: " + microseconds(compute.p99)) +
      card(std::to_string(log.loop.num_missed),
           "of " + std::to_string(log.loop.num_ticks) + " ticks computed longer than " +
               with_unit(1 / log.setup.device.rate, kTimeUnits)) +
      card(microseconds(contact.p50), "median of a query; 99 %: " + microseconds(contact.p99)) +
      card(microseconds(surface.p50),
           "median of a surface, " + std::to_string(log.loop.num_frames) + " depth frames");
  return "<div class='cards'>" + cards + "</div>\n";
}

/// One value per tick that is shown.
template <class Value>
std::vector<double> series(const RunLog& log, Value value) {
  std::vector<double> values;
  values.reserve(log.series.ticks().size());
  for (const TickRecord& tick : log.series.ticks()) values.push_back(value(tick));
  return values;
}

/// Components and length of a vector over time.
template <class Vector>
std::string vector_figure(const RunLog& log, LinePlot plot, const std::string& y_label,
                          const std::string& symbol, Vector vector, const std::string& caption) {
  const char* const axes[] = {"x", "y", "z"};
  plot.y_label = y_label;
  for (int axis = 0; axis < 3; ++axis) {
    plot.lines.push_back({symbol + " " + axes[axis], "series" + std::to_string(axis + 1),
                          series(log, [&](const TickRecord& tick) { return vector(tick)[axis]; })});
  }
  plot.lines.push_back({"|" + symbol + "|", "series4",
                        series(log, [&](const TickRecord& tick) { return norm(vector(tick)); })});
  return figure(draw(plot), caption);
}

/// Which newtons a cubic metre gives, for people.
std::string stiffness_words(const RunLog& log) {
  return short_number(1e-6 * log.newtons_per_cubic_metre, 4) + " N/cm³, which is " +
         short_number(log.coupling.force_at_eighth) + " N at an eighth of the tool's volume";
}

std::string tool_plots(const Tool& tool, const RunLog& log, const LinePlot& base) {
  std::string html = "<h2>What the tool felt</h2>\n";
  const bool has_objects = !log.setup.settings.objects.empty();
  LinePlot volume = base;
  const Unit unit = unit_for(log.peaks.volume, kVolumeUnits);
  volume.y_label = std::string("volume in ") + unit.name;
  volume.right_factor = 100 / (full_volume(tool, log.setup.settings.contact) * unit.factor);
  volume.right_label = "% of the tool";
  volume.marked_x = log.peaks.volume_time;
  volume.lines.push_back({"penetration volume", "series1", series(log, [&](const auto& tick) {
                            return tick.penetration.volume * unit.factor;
                          })});
  if (has_objects) {
    volume.lines.push_back({"in objects", "series2", series(log, [&](const auto& tick) {
                              return tick.objects.volume * unit.factor;
                            })});
  }
  html += figure(draw(volume), std::string("How much of the tool lies behind the surface") +
                                   (has_objects ? " or in an object" : "") +
                                   ". At each stroke on the top edge a depth frame was captured.");
  html += vector_figure(
      log, base, "force in N", "F", [](const auto& tick) { return tick.step.contact_W.force; },
      "Force on the tool in camera axes (x right, y down, z away from the camera): volume times "
      "direction, times the volume stiffness of " +
          stiffness_words(log) + ".");
  html += vector_figure(
      log, base, "torque in N m", "M", [](const auto& tick) { return tick.step.contact_W.torque; },
      "Torque of the same forces about the tool's centre of mass.");
  return html;
}

std::string hand_plots(const RunLog& log, const LinePlot& base) {
  const DeviceLimits& limits = log.setup.device.limits;
  const double most = limits.max_force * log.setup.settings.safety.force_share;
  std::string html = "<h2>What the hand felt</h2>\n";
  LinePlot force = base;
  force.limit = log.peaks.force > 0.3 * most ? most : 0;
  force.limit_label = "most that the device gives";
  html += vector_figure(
      log, force, "force in N", "F", [](const auto& tick) { return tick.F_H_B.force; },
      "Force at the handle after the safety filter, in the axes of the device's base.");
  if (limits.max_torque > 0) {
    html += vector_figure(
        log, base, "torque in N m", "M", [](const auto& tick) { return tick.F_H_B.torque; },
        "Torque at the handle.");
  }

  html += "<h2>Between hand and tool</h2>\n";
  LinePlot stretch = base;
  const Unit length = unit_for(log.peaks.stretch, kLengthUnits);
  stretch.y_label = std::string("stretch in ") + length.name;
  stretch.lines.push_back({"stretch", "series1", series(log, [&](const auto& tick) {
                             return tick.step.stretch * length.factor;
                           })});
  html +=
      figure(draw(stretch),
             "How far the tool stays behind where the hand holds it: the surface keeps it out.");
  LinePlot energy = base;
  energy.y_label = "energy in mJ";
  energy.lines.push_back({"given to the hand", "series1",
                          series(log, [](const auto& tick) { return 1e3 * tick.safety.energy; })});
  energy.lines.push_back({"in the coupling", "series2",
                          series(log, [](const auto& tick) { return 1e3 * tick.step.energy; })});
  html += figure(draw(energy),
                 "What the passivity observer counts: above zero the device has given the hand "
                 "more than it took.");
  return html;
}

std::string safety_plots(const RunLog& log, const LinePlot& base) {
  std::string html = "<h2>Safety</h2>\n";
  LinePlot gain = base;
  gain.y_label = "share";
  gain.lines.push_back({"force let through", "series1",
                        series(log, [](const auto& tick) { return tick.safety.gain; })});
  gain.lines.push_back(
      {"fault", "series2", series(log, [](const auto& tick) {
         return tick.safety.fault == Fault::none || tick.safety.fault == Fault::stopped ? 0.0 : 1.0;
       })});
  html += figure(draw(gain), "The ramp after engaging, and the fade after a fault or at the end.");
  LinePlot ages = base;
  ages.log_y = true;
  ages.y_label = "age in ms";
  ages.lines.push_back({"depth frame", "series1",
                        series(log, [](const auto& tick) { return 1e3 * tick.sensor_age; })});
  ages.lines.push_back(
      {"contact", "series2", series(log, [](const auto& tick) { return 1e3 * tick.contact_age; })});
  return html + figure(draw(ages), "How old what a force rests on was, at each tick.");
}

/// How often each stage took longer than a time.
std::string tail_plot(const LoopTimes& times) {
  LinePlot plot;
  plot.log_x = plot.log_y = true;
  plot.x_label = "time in µs";
  plot.y_label = "% that took longer";
  constexpr int kStep = LatencyHistogram::kBucketsPerOctave / 8;
  const Stage shown[] = {{"", "tick", times.haptic_compute},
                         {"", "tick to tick", times.haptic_period},
                         {"", "query", times.contact_compute},
                         {"", "surface", times.surface_compute}};
  const auto shorter_than = [](const LatencyHistogram& stage, int bucket) {
    std::uint64_t num = 0;
    for (int b = 0; b < bucket; ++b) num += stage.count(b);
    return num;
  };
  // From the shortest time to the longest one of all stages.
  int first = LatencyHistogram::kNumBuckets, last = 0;
  for (const Stage& stage : shown) {
    for (int bucket = 0; bucket < LatencyHistogram::kNumBuckets; ++bucket) {
      if (stage.times.count(bucket) == 0) continue;
      first = std::min(first, bucket);
      last = std::max(last, bucket);
    }
  }
  first = std::max(0, first - kStep);
  for (int b = first; b <= last + 1 && b < LatencyHistogram::kNumBuckets; b += kStep) {
    plot.x.push_back(1e-3 * LatencyHistogram::lower_end(b));
  }
  int number = 0;
  for (const Stage& stage : shown) {
    PlotLine line{stage.words, "series" + std::to_string(++number), {}};
    const auto num = static_cast<double>(stage.times.summary().num);
    for (std::size_t i = 0; i < plot.x.size(); ++i) {
      const auto below =
          static_cast<double>(shorter_than(stage.times, first + kStep * static_cast<int>(i)));
      line.y.push_back(num > below ? 100 * (num - below) / num : NAN);
    }
    plot.lines.push_back(std::move(line));
  }
  return figure(draw(plot),
                "How often each stage took longer than the time below: 1 % is the 99th "
                "percentile. Both axes are logarithmic.");
}

std::string stage_table(const LoopTimes& times) {
  std::string html =
      "<div class='tables'><table>" + row("stage", "median / 99 % / 99.9 % / largest");
  for (const Stage& stage : stages(times)) {
    const auto s = stage.times.summary();
    if (s.num == 0) continue;
    html += row(stage.words, microseconds(s.p50) + " / " + microseconds(s.p99) + " / " +
                                 microseconds(s.p999) + " / " + microseconds(s.max));
  }
  return html + "</table></div>\n";
}

std::string on_off(bool on) { return on ? "on" : "off"; }

std::string object_rows(const std::vector<SceneObject>& objects) {
  std::string html;
  for (const auto& [shape, X_WB] : objects) {
    const Vec3d& p = X_WB.translation;
    html += row("object", shape->source() + ", " + std::to_string(shape->spheres().size()) +
                              " spheres, at " + short_number(p.x) + ", " + short_number(p.y) +
                              ", " + short_number(p.z) + " m");
  }
  return html;
}

std::string backend_words(const RunSettings& settings) {
  std::string words = name_of(settings.backend);
  if (settings.backend == Backend::cuda) {
    words += ": surfaces on GPU " + std::to_string(settings.sensing_gpu) + ", queries on GPU " +
             std::to_string(settings.contact_gpu);
  }
  return words;
}

/// The end of a path that still tells what it is: the last two parts.
std::string short_name(const std::string& name) {
  const std::size_t last = name.find_last_of('/', name.empty() ? 0 : name.size() - 2);
  if (last == std::string::npos || last == 0) return name;
  const std::size_t before = name.find_last_of('/', last - 1);
  return before == std::string::npos ? name : name.substr(before + 1);
}

std::string hand_rows(const RunLog& log) {
  if (!log.has_hand()) return {};
  const CouplingOptions& c = log.coupling;
  const SafetyOptions& safety = log.setup.settings.safety;
  const DeviceLimits& limits = log.setup.device.limits;
  return row("most force, torque",
             short_number(limits.max_force) + " N, " + short_number(limits.max_torque) + " N m") +
         row("between queries", name_of(c.hold)) +
         row("coupling stiffness", short_number(c.stiffness) + " N/m, " +
                                       short_number(c.angular_stiffness) + " N m/rad") +
         row("damping ratio", short_number(c.damping_ratio)) +
         row("motion scale", short_number(c.motion_scale)) +
         row("dead-man button", on_off(safety.dead_man)) +
         row("passivity control", on_off(safety.passivity_control)) +
         row("ticks bent by a limit", std::to_string(log.peaks.num_limited));
}

std::string settings_tables(const Tool& tool, const RunLog& log) {
  const RunSettings& s = log.setup.settings;
  const NormalOptions& n = s.surface.normals;
  const DepthStreamInfo& stream = log.setup.stream;
  const Intrinsics& k = stream.intrinsics;
  return "<h2>Settings</h2><div class='tables'><table>" + row("tool", tool.source()) +
         row("spheres", std::to_string(tool.spheres().size())) +
         row("sphere volume / mesh volume", with_unit(tool.sphere_mass().volume, kVolumeUnits) +
                                                " / " +
                                                with_unit(tool.mesh_mass().volume, kVolumeUnits)) +
         row("device", log.setup.device.name) +
         row("rate", short_number(log.setup.device.rate) + " Hz") +
         row("coupling", name_of(log.coupling.kind)) +
         row("volume stiffness", stiffness_words(log)) + hand_rows(log) +
         row("method", name_of(s.contact.method)) +
         row("volume of a sphere", name_of(std::optional(s.contact.counted()))) +
         row("between frames", name_of(s.time.mode)) +
         row("average over frames", name_of(s.time.average.kind)) + object_rows(s.objects) +
         "</table><table>" + row("depth frames from", short_name(stream.name)) +
         row("image", std::to_string(stream.width) + " × " + std::to_string(stream.height)) +
         row("fx, fy, cx, cy", short_number(k.fx, 6) + ", " + short_number(k.fy, 6) + ", " +
                                   short_number(k.cx, 6) + ", " + short_number(k.cy, 6)) +
         row("depth unit", short_number(stream.unit, 6) + " m") +
         row("bilateral filter", on_off(s.surface.filter.enabled)) +
         row("normals: fit, radius", name_of(n.fit) + ", " + std::to_string(n.radius) + " pixels") +
         row("backend", backend_words(s)) +
         row("threads",
             s.num_threads == 0 ? "one per core for surfaces" : std::to_string(s.num_threads)) +
         row("ticks", std::to_string(log.loop.num_ticks)) +
         row("queries", std::to_string(log.loop.num_contacts)) +
         row("depth frames", std::to_string(log.loop.num_frames)) +
         row("records lost", std::to_string(log.loop.num_lost_records)) +
         row("duration", short_number(log.loop.seconds) + " s") +
         (log.loop.ending.empty() ? "" : row("ended because", log.loop.ending)) +
         "</table></div>\n";
}

/// What each later revision of the settings changed, as {"section": {"key": value}}.
Json changes_json(const RunLog& log) {
  Json changes = Json::array();
  Json before = to_json(settings_of(log.setup.settings));
  for (const RunSettings& settings : log.changes) {
    const Json after = to_json(settings_of(settings));
    Json changed = Json::object();
    for (const auto& [section, keys] : after.items()) {
      for (const auto& [key, value] : keys.items()) {
        if (value != before[section][key]) changed[section][key] = value;
      }
    }
    changes.push_back(std::move(changed));
    before = after;
  }
  return changes;
}

std::string changes_table(const RunLog& log) {
  if (log.changes.empty()) return {};
  std::string html = "<h2>Changed while it ran</h2><table>";
  int number = 0;
  for (const Json& change : changes_json(log)) {
    std::string what;
    for (const auto& [section, keys] : change.items()) {
      for (const auto& [key, value] : keys.items()) {
        what += (what.empty() ? "" : ", ") + section + "." + key + " = " + value.dump();
      }
    }
    html += row(std::to_string(++number), what);
  }
  return html + "</table>\n";
}

std::string warning(const std::string& text) {
  return "<p class='warn'>" + escape_html(text) + "</p>\n";
}

double peak_memory_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
#if defined(__APPLE__)
  return static_cast<double>(usage.ru_maxrss);
#else
  return static_cast<double>(usage.ru_maxrss) * 1024;
#endif
}

/// That the force was faded out at the end is none.
Fault fault_of(const RunLog& log) {
  return log.loop.fault == Fault::stopped ? Fault::none : log.loop.fault;
}

Json peaks_json(const Tool& tool, const RunLog& log) {
  const RunPeaks& peaks = log.peaks;
  Json json{{"volume_m3", peaks.volume},
            {"fraction", peaks.volume / full_volume(tool, log.setup.settings.contact)},
            {"volume_time_s", peaks.volume_time},
            {"force_N", peaks.contact_force},
            {"force_time_s", peaks.contact_force_time},
            {"torque_Nm", peaks.contact_torque}};
  if (log.has_hand()) {
    json["hand_force_N"] = peaks.force;
    json["hand_torque_Nm"] = peaks.torque;
    json["wanted_force_N"] = peaks.wanted_force;
    json["stretch_m"] = peaks.stretch;
    json["energy_given_J"] = peaks.energy;
  }
  if (!log.setup.settings.objects.empty()) {
    json["objects_volume_m3"] = peaks.objects_volume;
    json["objects_volume_time_s"] = peaks.objects_volume_time;
  }
  return json;
}

/// Times without force.
Json faults_json(const RunLog& log) {
  Json faults = Json::array();
  for (const auto& [time, fault, seconds] : log.faults) {
    faults.push_back({{"time_s", time},
                      {"fault", name_of(fault)},
                      {"seconds", seconds ? Json(*seconds) : Json()}});
  }
  return faults;
}

std::string faults_table(const RunLog& log) {
  if (log.faults.empty()) return {};
  std::string html = "<h2>Times without force</h2><table>";
  for (const auto& [time, fault, seconds] : log.faults) {
    html += row(
        short_number(time, 4) + " s",
        std::string(describe(fault)) + (seconds ? "; back after " + short_number(*seconds, 3) + " s"
                                                : "; it did not come back"));
  }
  return html + "</table>\n";
}

}  // namespace

std::string summary_json(const Tool& tool, const RunLog& log, const LoopTimes& times) {
  Json json{{"program", PALPATE_VERSION},
            {"tool",
             {{"source", tool.source()},
              {"spheres", tool.spheres().size()},
              {"sphere_volume_m3", tool.sphere_mass().volume},
              {"mesh_volume_m3", tool.mesh_mass().volume}}},
            {"device", {{"kind", log.setup.device.kind}, {"name", log.setup.device.name}}},
            {"rate", log.setup.device.rate},
            {"stream", to_json(log.setup.stream)},
            {"seconds", log.loop.seconds},
            {"time_origin", log.setup.time_origin},
            {"ticks", log.loop.num_ticks},
            {"ticks_in_contact", log.peaks.num_in_contact},
            {"ticks_in_objects", log.peaks.num_in_objects},
            {"contacts", log.loop.num_contacts},
            {"frames", log.loop.num_frames},
            {"missed", log.loop.num_missed},
            {"lost_records", log.loop.num_lost_records},
            {"frames_left_out", log.loop.num_left_out},
            {"stiffness_left_out", log.loop.num_spared_stiffnesses},
            {"interrupted", log.was_interrupted},
            {"ending", log.loop.ending},
            {"fault", name_of(fault_of(log))},
            {"fault_meaning", std::string(describe(fault_of(log)))},
            {"faults", faults_json(log)},
            {"failure", log.failure},
            {"not_kept", log.not_kept},
            {"newtons_per_m3", log.newtons_per_cubic_metre},
            {"peaks", peaks_json(tool, log)},
            {"engaged_ticks", log.peaks.num_engaged},
            {"limited_ticks", log.peaks.num_limited},
            {"peak_memory_bytes", peak_memory_bytes()}};
  for (const Stage& stage : stages(times)) {
    const auto s = stage.times.summary();
    if (s.num == 0) continue;
    json["microseconds"][stage.key] = {{"p50", s.p50}, {"p99", s.p99},   {"p999", s.p999},
                                       {"max", s.max}, {"mean", s.mean}, {"num", s.num}};
  }
  if (!log.why_not_cuda.empty()) json["why_not_cuda"] = log.why_not_cuda;
  json["warnings"] = log.warnings;
  RunSettings used = log.setup.settings;
  used.coupling = log.coupling;
  json["settings"] = to_json(settings_of(used));
  if (log.setup.probe) json["probe"] = to_json(*log.setup.probe);
  json["changes"] = changes_json(log);
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string run_page(const Tool& tool, const RunLog& log, const LoopTimes& times) {
  const std::string seconds = short_number(log.loop.seconds, 3) + " s";
  std::string html = open_page(tool.source() + " in " + short_name(log.setup.stream.name),
                               "A tool of " + std::to_string(tool.spheres().size()) +
                                   " spheres on " + log.setup.device.name +
                                   ", felt against a stream of depth images for " + seconds + ".");
  if (log.was_interrupted) {
    html += warning("This run was interrupted after " + seconds +
                    ". What is shown is complete up to there.");
  }
  if (!log.failure.empty()) html += warning("The run ended early: " + log.failure);
  if (!log.not_kept.empty()) html += warning("Not all of the run is kept: " + log.not_kept);
  html += headline(tool, log, times);
  if (!log.deepest_frame.pixels.empty()) {
    const auto pictures = deepest_moment_html(tool, log);
    html += pictures ? *pictures : warning(pictures.error().message);
  }
  if (log.setup.probe) html += probe_html(*log.setup.probe, log.deepest_frame);
  LinePlot base;
  base.x_label = "time in s";
  base.x = series(log, [](const TickRecord& tick) { return tick.time; });
  base.events = log.frame_times;
  if (!base.x.empty()) {
    html += tool_plots(tool, log, base);
    if (log.has_hand()) html += hand_plots(log, base) + safety_plots(log, base) + faults_table(log);
    html += "<h2>How long it took</h2>\n" + tail_plot(times) + stage_table(times);
  }
  if (!log.warnings.empty()) html += "<h2>Notes</h2>\n";
  for (const std::string& text : log.warnings) html += warning(text);
  html += settings_tables(tool, log) + changes_table(log);
  return html + close_page(
                    "All of it is in recording.mcap, which ROS 2 tools and Foxglove open; the "
                    "numbers are in wrench.csv and summary.json, too; palpate replay repeats it.");
}

}  // namespace palpate
