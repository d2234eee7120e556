#include "palpate/session/report.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "src/session/html_page.h"
#include "src/session/probe_report.h"
#include "src/session/report_pictures.h"
#include "src/session/run_files.h"
#include "src/session/statistics.h"
#include "src/session/svg_plot.h"

namespace palpate {
namespace {

/// One value per tick.
template <class Value>
std::vector<double> series(const RunLog& log, Value value) {
  std::vector<double> values;
  values.reserve(log.ticks.size());
  for (const TickRecord& tick : log.ticks) values.push_back(value(tick));
  return values;
}

double largest(const std::vector<double>& values) {
  return values.empty() ? 0 : *std::max_element(values.begin(), values.end());
}

std::string headline(const Tool& tool, const RunLog& log) {
  const double volume = log.ticks[log.deepest_tick].penetration.volume;
  const auto query = percentiles(query_seconds(log)), surface = percentiles(surface_seconds(log));
  const double force = largest(
      series(log, [](const TickRecord& tick) { return norm(tick.penetration.measure_W.force); }));
  const std::size_t misses = num_deadline_misses(log);
  return "<div class='cards'>" +
         card(with_unit(volume, kVolumeUnits),
              "deepest penetration, " +
                  short_number(100 * volume / full_volume(tool, log.settings.contact), 3) +
                  "\u00a0% of the tool") +
         card(with_unit(force, kVolumeUnits), "largest force measure |F|") +
         card(with_unit(query.median, kTimeUnits),
              "median of a query; 99 %: " + with_unit(query.p99, kTimeUnits)) +
         card(std::to_string(misses), "of " + std::to_string(log.ticks.size()) +
                                          " ticks longer than " +
                                          with_unit(1 / log.settings.rate, kTimeUnits)) +
         card(with_unit(surface.median, kTimeUnits),
              "median of a surface, " + std::to_string(log.frames.size()) + " depth frames") +
         "</div>";
}

/// A plot of a vector over time: its components and its length.
std::string vector_figure(const RunLog& log, LinePlot plot, std::span<const Unit> units,
                          const std::string& name, const std::string& symbol, Vec3d Wrench::*member,
                          const std::string& caption) {
  const auto length =
      series(log, [&](const TickRecord& tick) { return norm(tick.penetration.measure_W.*member); });
  const Unit unit = unit_for(largest(length), units);
  plot.y_label = name + " in " + unit.name;
  const char* const axes[] = {"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis) {
    plot.lines.push_back({symbol + " " + axes[axis], "series" + std::to_string(axis + 1),
                          series(log, [&](const TickRecord& tick) {
                            return (tick.penetration.measure_W.*member)[axis] * unit.factor;
                          })});
  }
  plot.lines.push_back({"|" + symbol + "|", "series4", length});
  for (double& value : plot.lines.back().y) value *= unit.factor;
  return figure(draw(plot), caption);
}

std::string plots(const Tool& tool, const RunLog& log) {
  LinePlot base;
  base.x_label = "time in s";
  base.x = series(log, [](const TickRecord& tick) { return tick.time; });
  for (const FrameRecord& frame : log.frames) base.events.push_back(frame.time);
  base.marked_x = log.ticks[log.deepest_tick].time;

  LinePlot volume = base;
  const Unit unit = unit_for(log.ticks[log.deepest_tick].penetration.volume, kVolumeUnits);
  volume.y_label = std::string("volume in ") + unit.name;
  volume.right_factor = 100 / (full_volume(tool, log.settings.contact) * unit.factor);
  volume.right_label = "% of the tool";
  volume.lines.push_back({"penetration volume", "series1", series(log, [&](const TickRecord& tick) {
                            return tick.penetration.volume * unit.factor;
                          })});
  if (!log.settings.objects.empty()) {
    volume.lines.push_back({"in objects", "series2", series(log, [&](const TickRecord& tick) {
                              return tick.objects.volume * unit.factor;
                            })});
  }
  std::string html = "<h2>What the tool felt</h2>\n";
  html +=
      figure(draw(volume), "How much of the tool lies behind the surface" +
                               std::string(log.settings.objects.empty() ? "" : " or in an object") +
                               ". At each stroke on the top edge a new depth frame arrived.");
  html +=
      vector_figure(log, base, kVolumeUnits, "force measure", "F", &Wrench::force,
                    "Sum of volume times surface normal over all spheres, before any stiffness, "
                    "in camera axes (x right, y down, z away from the camera).");
  html += vector_figure(log, base, kTorqueUnits, "torque measure", "M", &Wrench::torque,
                        "Torque of the same forces about the tool's centre of mass.");

  html += "<h2>How long it took</h2>\n";
  LinePlot timing = base;
  timing.log_y = true;
  timing.y_label = "query in µs";
  timing.limit = 1e6 / log.settings.rate;
  timing.limit_label = "deadline: one tick at " + short_number(log.settings.rate) + " Hz";
  timing.lines.push_back({"query", "series1", series(log, [](const TickRecord& tick) {
                            return tick.query_seconds * 1e6;
                          })});
  html += figure(draw(timing), "Compute time of each query on this machine.");

  const auto p = percentiles(query_seconds(log));
  Histogram histogram;
  histogram.y_label = "ticks in bin";
  histogram.x_label = "query in µs";
  for (const double seconds : query_seconds(log)) histogram.values.push_back(seconds * 1e6);
  const auto marker = [&](const char* name, double us) {
    histogram.markers.push_back({us, std::string(name) + " " + short_number(us, 3) + " µs"});
  };
  marker("median", p.median * 1e6);
  marker("99 %", p.p99 * 1e6);
  marker("deadline", 1e6 / log.settings.rate);
  html += figure(draw(histogram),
                 "The same times, counted. Both axes are logarithmic: a single late tick shows.");
  return html;
}

/// The end of a path that still tells what it is: the last two parts.
std::string short_name(const std::string& name) {
  const std::size_t last = name.find_last_of('/', name.empty() ? 0 : name.size() - 2);
  if (last == std::string::npos || last == 0) return name;
  const std::size_t before = name.find_last_of('/', last - 1);
  return before == std::string::npos ? name : name.substr(before + 1);
}

std::string on_off(bool on) { return on ? "on" : "off"; }

std::string object_rows(const std::vector<SceneObject>& objects) {
  std::string html;
  for (const SceneObject& object : objects) {
    const Vec3d& p = object.X_WB.translation;
    html += row("object", object.shape->source() + ", " +
                              std::to_string(object.shape->spheres().size()) + " spheres, at " +
                              short_number(p.x) + ", " + short_number(p.y) + ", " +
                              short_number(p.z) + " m");
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

std::string tables(const Tool& tool, const RunLog& log) {
  const RunSettings& s = log.settings;
  const NormalOptions& n = s.surface.normals;
  const Intrinsics& k = log.stream.intrinsics;
  const auto query = percentiles(query_seconds(log)), surface = percentiles(surface_seconds(log));
  const auto times = [](const Percentiles& p) {
    return with_unit(p.median, kTimeUnits) + " / " + with_unit(p.p99, kTimeUnits) + " / " +
           with_unit(p.p999, kTimeUnits) + " / " + with_unit(p.max, kTimeUnits);
  };
  return "<h2>Settings</h2><div class='tables'><table>" + row("tool", tool.source()) +
         row("spheres", std::to_string(tool.spheres().size())) +
         row("sphere volume / mesh volume", with_unit(tool.sphere_mass().volume, kVolumeUnits) +
                                                " / " +
                                                with_unit(tool.mesh_mass().volume, kVolumeUnits)) +
         row("method", name_of(s.contact.method)) + row("priority", name_of(s.contact.priority)) +
         row("inside volume (graph)", name_of(s.contact.inside)) +
         row("volume of a sphere", name_of(std::optional(s.contact.counted()))) +
         row("edges", name_of(s.contact.edges)) + row("continuity", name_of(s.contact.continuity)) +
         row("between frames", name_of(s.time.mode)) +
         row("average over frames", name_of(s.time.average.kind)) +
         row("backend", backend_words(s)) +
         row("threads", s.num_threads == 0 ? "queries 1, surfaces one per core"
                                           : std::to_string(s.num_threads)) +
         row("rate", short_number(s.rate) + " Hz") +
         row("duration", short_number(static_cast<double>(log.ticks.size()) / s.rate) + " s") +
         object_rows(s.objects) + "</table><table>" +
         row("depth frames from", short_name(log.stream.name)) +
         row("image",
             std::to_string(log.stream.width) + " × " + std::to_string(log.stream.height)) +
         row("fx, fy, cx, cy", short_number(k.fx, 6) + ", " + short_number(k.fy, 6) + ", " +
                                   short_number(k.cx, 6) + ", " + short_number(k.cy, 6)) +
         row("depth unit", short_number(log.stream.unit, 6) + " m") +
         row("bilateral filter", on_off(s.surface.filter.enabled)) +
         row("normals: fit, radius", name_of(n.fit) + ", " + std::to_string(n.radius) + " pixels") +
         row("normals: weighting, anchoring, normalisation",
             on_off(n.weighting) + ", " + on_off(n.anchoring) + ", " + on_off(n.normalization)) +
         row("query: median / 99 % / 99.9 % / max", times(query)) +
         row("surface: median / 99 % / 99.9 % / max", times(surface)) + "</table></div>\n";
}

}  // namespace

Result<std::string> make_report(const Tool& tool, const RunLog& log) {
  auto pictures = deepest_moment_html(tool, log);
  if (!pictures) return pictures.error();
  const std::string title = tool.source() + " in " + short_name(log.stream.name);
  std::string html = open_page(title, "A tool of " + std::to_string(tool.spheres().size()) +
                                          " spheres, felt against a stream of depth images " +
                                          short_number(log.settings.rate) + " times a second.");
  if (log.interrupted) {
    html += "<p class='warn'>This run was interrupted after " +
            short_number(static_cast<double>(log.ticks.size()) / log.settings.rate) +
            " s. What is shown is complete up to there.</p>\n";
  }
  if (!log.failure.empty()) {
    html += "<p class='warn'>This run ended after " +
            short_number(static_cast<double>(log.ticks.size()) / log.settings.rate) +
            " s: " + escape_html(log.failure) + ". The force was faded out.</p>\n";
  }
  html += headline(tool, log) + *pictures;
  if (log.settings.probe) html += probe_html(*log.settings.probe, log.deepest_frame);
  html += plots(tool, log) + tables(tool, log);
  html += close_page(
      "The numbers of this page are in wrench.csv, timing.csv and summary.json beside it; the "
      "folder recording repeats them bit for bit.");
  return html;
}

}  // namespace palpate
