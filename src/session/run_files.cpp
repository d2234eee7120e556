#include "src/session/run_files.h"

#include <sys/resource.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "src/session/settings_json.h"
#include "src/session/statistics.h"
#include "src/session/text.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

Json to_json(const Vec3d& v) { return {v.x, v.y, v.z}; }

/// Microseconds, as in timing.csv.
Json to_json(const Percentiles& p) {
  return {{"median", p.median * 1e6},
          {"p99", p.p99 * 1e6},
          {"p99.9", p.p999 * 1e6},
          {"max", p.max * 1e6}};
}

/// The tick where `size` is largest, the first one if there are several.
template <class Size>
const TickRecord& peak(const RunLog& log, Size size) {
  return *std::max_element(
      log.ticks.begin(), log.ticks.end(),
      [&](const TickRecord& a, const TickRecord& b) { return size(a) < size(b); });
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

}  // namespace

std::string wrench_csv(const Tool& tool, const RunLog& log) {
  const double tool_volume = full_volume(tool, log.settings.contact);
  std::string text =
      "t,tx,ty,tz,qx,qy,qz,qw,volume,fraction,fx,fy,fz,mx,my,mz,boundary_spheres,inside_spheres,"
      "points,frame,status\n";
  const bool has_objects = !log.settings.objects.empty();
  if (has_objects) {
    text.back() = ',';
    text +=
        "objects_volume,objects_fx,objects_fy,objects_fz,objects_mx,objects_my,objects_mz,"
        "object_pairs\n";
  }
  text.reserve(text.size() + log.ticks.size() * 256);
  for (const TickRecord& tick : log.ticks) {
    const Vec3d& p = tick.X_WT.translation;
    const Quaternion& q = tick.X_WT.rotation;
    const Penetration& r = tick.penetration;
    const Vec3d &f = r.measure_W.force, &m = r.measure_W.torque;
    append_row(text, ',', tick.time, p.x, p.y, p.z, q.x, q.y, q.z, q.w, r.volume,
               r.volume / tool_volume, f.x, f.y, f.z, m.x, m.y, m.z, r.num_boundary_spheres,
               r.num_inside_spheres, r.num_points, tick.frame, r.status.bits);
    if (!has_objects) continue;
    const Vec3d &of = tick.objects.measure_W.force, &om = tick.objects.measure_W.torque;
    text.back() = ',';
    append_row(text, ',', tick.objects.volume, of.x, of.y, of.z, om.x, om.y, om.z,
               tick.object_pairs);
  }
  return text;
}

std::string timing_csv(const RunLog& log) {
  std::string text = "t,query_us,surface_us\n";
  int last_frame = -1;
  for (const TickRecord& tick : log.ticks) {
    append_number(text, tick.time);
    text += ',';
    append_number(text, tick.query_seconds * 1e6);
    text += ',';
    // Only the tick at which a frame became current has a surface time.
    if (tick.frame != last_frame) {
      last_frame = tick.frame;
      append_number(text, log.frames[static_cast<std::size_t>(last_frame)].surface_seconds * 1e6);
    }
    text += '\n';
  }
  return text;
}

std::vector<double> query_seconds(const RunLog& log) {
  std::vector<double> values;
  for (const TickRecord& tick : log.ticks) values.push_back(tick.query_seconds);
  return values;
}

std::vector<double> surface_seconds(const RunLog& log) {
  std::vector<double> values;
  for (const FrameRecord& frame : log.frames) values.push_back(frame.surface_seconds);
  return values;
}

std::size_t num_deadline_misses(const RunLog& log) {
  const auto late = [&](const TickRecord& tick) {
    return tick.query_seconds * log.settings.rate > 1;
  };
  return static_cast<std::size_t>(std::count_if(log.ticks.begin(), log.ticks.end(), late));
}

std::string scarce_surface_warning(const RunLog& log) {
  const int num_pixels = log.stream.width * log.stream.height;
  const auto scarce = [&](const FrameRecord& frame) {
    return frame.surface.num_points < 0.001 * num_pixels;
  };
  const auto first = std::find_if(log.frames.begin(), log.frames.end(), scarce);
  if (first == log.frames.end()) return {};
  const auto num_scarce = std::count_if(first, log.frames.end(), scarce);
  std::string range;
  append_number(range, log.settings.surface.min_depth);
  range += " to ";
  append_number(range, log.settings.surface.max_depth);
  return std::to_string(first->surface.num_points) + " of " + std::to_string(num_pixels) +
         " pixels are usable (" + range + " m, with a surface around them) in frame " +
         std::to_string(first - log.frames.begin()) + ", and hardly any in " +
         std::to_string(num_scarce) + " of " + std::to_string(log.frames.size()) +
         " frames; check --depth-unit";
}

std::string summary_json(const Tool& tool, const RunLog& log) {
  const TickRecord& deepest = log.ticks[log.deepest_tick];
  const TickRecord& strongest =
      peak(log, [](const TickRecord& tick) { return norm(tick.penetration.measure_W.force); });
  const auto contact = [](const TickRecord& tick) {
    return tick.penetration.num_boundary_spheres > 0 || tick.object_pairs > 0;
  };
  Json json{{"version", PALPATE_VERSION},
            {"interrupted", log.interrupted},
            {"settings", palpate::to_json(log.settings)},
            {"stream", palpate::to_json(log.stream)},
            {"tool",
             {{"source", tool.source()},
              {"spheres", tool.spheres().size()},
              {"sphere_volume", tool.sphere_mass().volume},
              {"mesh_volume", tool.mesh_mass().volume}}},
            {"ticks", log.ticks.size()},
            {"ticks_in_contact", std::count_if(log.ticks.begin(), log.ticks.end(), contact)},
            {"frames", log.frames.size()},
            {"duration", static_cast<double>(log.ticks.size()) / log.settings.rate},
            {"peak",
             {{"volume", deepest.penetration.volume},
              {"fraction", deepest.penetration.volume / full_volume(tool, log.settings.contact)},
              {"volume_time", deepest.time},
              {"force", to_json(strongest.penetration.measure_W.force)},
              {"force_norm", norm(strongest.penetration.measure_W.force)},
              {"force_time", strongest.time}}},
            {"query_us", to_json(percentiles(query_seconds(log)))},
            {"surface_us", to_json(percentiles(surface_seconds(log)))},
            {"deadline_misses", num_deadline_misses(log)},
            {"peak_memory_bytes", peak_memory_bytes()}};
  if (!log.settings.objects.empty()) {
    const auto touches = [](const TickRecord& tick) { return tick.object_pairs > 0; };
    const TickRecord& most = peak(log, [](const TickRecord& tick) { return tick.objects.volume; });
    json["objects"] = {
        {"ticks_in_contact", std::count_if(log.ticks.begin(), log.ticks.end(), touches)},
        {"peak_volume", most.objects.volume},
        {"peak_volume_time", most.time}};
  }
  if (log.settings.probe) {
    json["probe"] = palpate::to_json(*log.settings.probe);
    json["settings"].erase("probe");
  }
  if (!log.failure.empty()) json["failure"] = log.failure;
  if (!log.why_not_cuda.empty()) json["why_not_cuda"] = log.why_not_cuda;
  const std::string warning = scarce_surface_warning(log);
  if (!warning.empty()) json["warning"] = warning;
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace palpate
