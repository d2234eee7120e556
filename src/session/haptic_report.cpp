#include "src/session/haptic_report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "src/session/html_page.h"
#include "src/session/probe_report.h"
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

std::string headline(const Tool& tool, const HapticLog& log, const LoopTimes& times) {
  const auto compute = times.haptic_compute.summary(), contact = times.contact_compute.summary();
  const auto lag = times.sensor_to_force.summary();
  const double share = log.peaks.volume / full_volume(tool, log.setup.settings.contact);
  return "<div class='cards'>" +
         card(short_number(log.peaks.force, 3) + "\u00a0N",
              "largest force felt; wanted " + short_number(log.peaks.wanted_force, 3) + "\u00a0N") +
         card(with_unit(log.peaks.volume, kVolumeUnits),
              "deepest penetration, " + short_number(100 * share, 3) + "\u00a0% of the tool") +
         card(microseconds(compute.p99),
              "99 % of ticks computed within; largest " + microseconds(compute.max)) +
         card(std::to_string(log.loop.num_missed),
              "of " + std::to_string(log.loop.num_ticks) + " ticks longer than " +
                  with_unit(1 / log.setup.device.rate, kTimeUnits)) +
         card(microseconds(contact.p50), "median of a query; 99 %: " + microseconds(contact.p99)) +
         card(microseconds(lag.p50),
              "median from depth frame to force; 99 %: " + microseconds(lag.p99)) +
         "</div>\n";
}

/// One value per tick that is shown.
template <class Value>
std::vector<double> series(const HapticLog& log, Value value) {
  std::vector<double> values;
  values.reserve(log.series.ticks().size());
  for (const HapticRecord& tick : log.series.ticks()) values.push_back(value(tick));
  return values;
}

/// Components and length of a vector over time.
std::string vector_figure(const HapticLog& log, LinePlot plot, const std::string& y_label,
                          const std::string& symbol, Vec3d Wrench::*member, double limit,
                          const std::string& caption) {
  const char* const axes[] = {"x", "y", "z"};
  plot.y_label = y_label;
  for (int axis = 0; axis < 3; ++axis) {
    plot.lines.push_back(
        {symbol + " " + axes[axis], "series" + std::to_string(axis + 1),
         series(log, [&](const HapticRecord& tick) { return (tick.F_H_B.*member)[axis]; })});
  }
  plot.lines.push_back({"|" + symbol + "|", "series4", series(log, [&](const HapticRecord& tick) {
                          return norm(tick.F_H_B.*member);
                        })});
  plot.limit = limit;
  plot.limit_label = "most that the device gives";
  return figure(draw(plot), caption);
}

std::string felt_plots(const Tool& tool, const HapticLog& log, const LinePlot& base) {
  const DeviceLimits& limits = log.setup.device.limits;
  const double share = log.setup.settings.safety.force_share;
  std::string html = "<h2>What the hand felt</h2>\n";
  html +=
      vector_figure(log, base, "force in N", "F", &Wrench::force,
                    log.peaks.force > 0.3 * limits.max_force * share ? limits.max_force * share : 0,
                    "Force at the handle after the safety filter, in the axes of the device's "
                    "base. At each stroke on the top edge a depth frame was captured.");
  if (limits.max_torque > 0) {
    html +=
        vector_figure(log, base, "torque in N m", "M", &Wrench::torque, 0, "Torque at the handle.");
  }
  LinePlot volume = base;
  const Unit unit = unit_for(log.peaks.volume, kVolumeUnits);
  volume.y_label = std::string("volume in ") + unit.name;
  volume.right_factor = 100 / (full_volume(tool, log.setup.settings.contact) * unit.factor);
  volume.right_label = "% of the tool";
  volume.lines.push_back({"penetration volume", "series1", series(log, [&](const auto& tick) {
                            return tick.penetration.volume * unit.factor;
                          })});
  html += figure(draw(volume), "How much of the tool lies behind the surface.");

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

std::string safety_plots(const HapticLog& log, const LinePlot& base) {
  std::string html = "<h2>Safety</h2>\n";
  LinePlot gain = base;
  gain.y_label = "share";
  gain.lines.push_back({"force let through", "series1",
                        series(log, [](const auto& tick) { return tick.safety.gain; })});
  gain.lines.push_back({"fault", "series2", series(log, [](const auto& tick) {
                          return tick.safety.fault == Fault::none ? 0.0 : 1.0;
                        })});
  html += figure(draw(gain),
                 "The ramp after engaging, and the fade after a fault or at the end (which counts "
                 "as one: asked for).");
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
    html += row(stage.words, microseconds(s.p50) + " / " + microseconds(s.p99) + " / " +
                                 microseconds(s.p999) + " / " + microseconds(s.max));
  }
  return html + "</table></div>\n";
}

std::string settings_tables(const Tool& tool, const HapticLog& log) {
  const HapticSettings& s = log.setup.settings;
  const DeviceInfo& device = log.setup.device;
  const CouplingOptions& c = log.coupling;
  return "<h2>Settings</h2><div class='tables'><table>" + row("tool", tool.source()) +
         row("spheres", std::to_string(tool.spheres().size())) + row("device", device.name) +
         row("rate", short_number(device.rate) + " Hz") +
         row("most force, torque", short_number(device.limits.max_force) + " N, " +
                                       short_number(device.limits.max_torque) + " N m") +
         row("coupling", name_of(c.kind)) + row("between queries", name_of(c.hold)) +
         row("coupling stiffness", short_number(c.stiffness) + " N/m, " +
                                       short_number(c.angular_stiffness) + " N m/rad") +
         row("force at an eighth of the tool", short_number(c.force_at_eighth) + " N") +
         row("motion scale", short_number(c.motion_scale)) +
         row("dead-man button", s.safety.dead_man ? "on" : "off") +
         row("passivity control", s.safety.passivity_control ? "on" : "off") + "</table><table>" +
         row("depth frames from", log.setup.stream.name) +
         row("image", std::to_string(log.setup.stream.width) + " × " +
                          std::to_string(log.setup.stream.height)) +
         row("method", name_of(s.contact.method)) + row("between frames", name_of(s.time.mode)) +
         row("backend", name_of(s.backend)) + row("ticks", std::to_string(log.loop.num_ticks)) +
         row("queries", std::to_string(log.loop.num_contacts)) +
         row("depth frames", std::to_string(log.loop.num_frames)) +
         row("ticks bent by a limit", std::to_string(log.peaks.num_limited)) +
         row("records lost", std::to_string(log.loop.num_lost_records)) +
         row("duration", short_number(log.loop.seconds) + " s") + "</table></div>\n";
}

/// What each later revision of the settings changed, as {"section": {"key": value}}.
Json changes_json(const HapticLog& log) {
  Json changes = Json::array();
  Json before = to_json(settings_of(log.setup.settings));
  for (const HapticSettings& settings : log.changes) {
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

std::string changes_table(const HapticLog& log) {
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

}  // namespace

std::string haptic_summary_json(const Tool& tool, const HapticLog& log, const LoopTimes& times) {
  Json json{{"program", PALPATE_VERSION},
            {"tool", tool.source()},
            {"device", log.setup.device.name},
            {"seconds", log.loop.seconds},
            {"ticks", log.loop.num_ticks},
            {"contacts", log.loop.num_contacts},
            {"frames", log.loop.num_frames},
            {"missed", log.loop.num_missed},
            {"lost_records", log.loop.num_lost_records},
            {"fault", name_of(log.loop.fault)},
            {"fault_meaning", std::string(describe(log.loop.fault))},
            {"failure", log.failure},
            {"peaks",
             {{"force_N", log.peaks.force},
              {"wanted_force_N", log.peaks.wanted_force},
              {"torque_Nm", log.peaks.torque},
              {"volume_m3", log.peaks.volume},
              {"stretch_m", log.peaks.stretch},
              {"energy_given_J", log.peaks.energy}}},
            {"engaged_ticks", log.peaks.num_engaged},
            {"limited_ticks", log.peaks.num_limited}};
  for (const Stage& stage : stages(times)) {
    const auto s = stage.times.summary();
    json["microseconds"][stage.key] = {{"p50", s.p50}, {"p99", s.p99},   {"p999", s.p999},
                                       {"max", s.max}, {"mean", s.mean}, {"num", s.num}};
  }
  json["warnings"] = log.warnings;
  HapticSettings used = log.setup.settings;
  used.coupling = log.coupling;
  json["settings"] = to_json(settings_of(used));
  if (log.setup.probe) json["probe"] = to_json(*log.setup.probe);
  json["changes"] = changes_json(log);
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string haptic_page(const Tool& tool, const HapticLog& log, const LoopTimes& times) {
  std::string html =
      open_page(tool.source() + " in the hand", "Felt live on " + log.setup.device.name + " for " +
                                                    short_number(log.loop.seconds, 3) + " s.");
  if (!log.failure.empty()) html += warning("The run ended early: " + log.failure);
  html += headline(tool, log, times);
  if (log.setup.probe) html += probe_html(*log.setup.probe, {});
  LinePlot base;
  base.x_label = "time in s";
  base.x = series(log, [](const HapticRecord& tick) { return tick.time; });
  base.events = log.frame_times;
  if (!base.x.empty()) {
    html += felt_plots(tool, log, base) + safety_plots(log, base);
    html += "<h2>How long it took</h2>\n" + tail_plot(times) + stage_table(times);
  }
  if (!log.warnings.empty()) html += "<h2>Notes</h2>\n";
  for (const std::string& text : log.warnings) html += warning(text);
  html += settings_tables(tool, log) + changes_table(log);
  return html + close_page(
                    "All of it is in session.mcap, which Foxglove and other viewers open; "
                    "palpate replay repeats it.");
}

}  // namespace palpate
