#include "src/session/report/run_report.h"

#include <sys/resource.h>

#include <nlohmann/json.hpp>

#include "palpate/version.h"
#include "src/session/internal/settings_json.h"
#include "src/session/report/run_stages.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

double peak_memory_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
#if defined(__APPLE__)
  return static_cast<double>(usage.ru_maxrss);
#else
  return static_cast<double>(usage.ru_maxrss) * 1024;
#endif
}

/// Returns the fault of a run; the fade at its end is none.
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
    json["desired_force_N"] = peaks.desired_force;
    json["stretch_m"] = peaks.stretch;
    json["energy_given_J"] = peaks.energy;
  }
  if (!log.setup.settings.objects.empty()) {
    json["volume_in_objects_m3"] = log.deepest.objects.volume;
    json["objects_volume_m3"] = peaks.objects_volume;
    json["objects_volume_time_s"] = peaks.objects_volume_time;
  }
  if (reports_unseen(log.setup)) {
    json["unseen_is"] = name_of(log.setup.settings.field.unseen);
    json["unseen"] = peaks.unseen_volume / full_volume(tool, log.setup.settings.contact);
    json["unseen_time_s"] = peaks.unseen_volume_time;
  }
  return json;
}

/// Times without force.
Json faults_json(const RunLog& log) {
  Json faults = Json::array();
  for (const auto& [time, fault, seconds] : log.faults) {
    faults.push_back({{"time_s", time},
                      {"fault", name_of(fault)},
                      {"meaning", std::string(describe(fault))},
                      {"seconds", seconds ? Json(*seconds) : Json()}});
  }
  return faults;
}

Json objects_json(const std::vector<SceneObject>& objects) {
  Json list = Json::array();
  for (const SceneObject& object : objects) {
    const Vec3d& p = object.X_WB.translation;
    list.push_back({{"source", object.shape->source()},
                    {"spheres", object.shape->spheres().size()},
                    {"position_m", {p.x, p.y, p.z}}});
    if (!object.name.empty()) list.back()["name"] = object.name;
    if (object.friction) list.back()["friction"] = *object.friction;
    if (object.static_ratio) list.back()["static_ratio"] = *object.static_ratio;
    if (object.viscous) list.back()["viscous"] = *object.viscous;
    if (object.moves) list.back()["mass_kg"] = mass_of(object);
  }
  return list;
}

}  // namespace

Json run_summary(const Tool& tool, const RunLog& log, const LoopTimes& times) {
  Json json{{"program", PALPATE_VERSION},
            {"tool",
             {{"source", tool.source()},
              {"spheres", tool.spheres().size()},
              {"sphere_volume_m3", tool.sphere_mass().volume},
              {"mesh_volume_m3", tool.mesh_mass().volume}}},
            {"full_volume_m3", full_volume(tool, log.setup.settings.contact)},
            {"device",
             {{"kind", log.setup.device.kind},
              {"name", log.setup.device.name},
              {"max_force_N", log.setup.device.limits.max_force},
              {"max_torque_Nm", log.setup.device.limits.max_torque}}},
            {"rate", log.setup.device.rate},
            {"stream", to_json(log.setup.streams.front())},
            {"cameras", to_json(log.setup.streams)},
            {"objects", objects_json(log.setup.settings.objects)},
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
            {"page_thinned_s", log.loop.page_thinned},
            {"image_thinned_s", log.loop.image_thinned},
            {"spheres_thinned_s", log.loop.spheres_thinned},
            {"interrupted", log.was_interrupted},
            {"ending", log.loop.ending},
            {"fault", name_of(fault_of(log))},
            {"fault_meaning", std::string(describe(fault_of(log)))},
            {"faults", faults_json(log)},
            {"failure", log.failure},
            {"not_kept", log.not_kept},
            {"newtons_per_m3", log.newtons_per_cubic_meter},
            {"peaks", peaks_json(tool, log)},
            {"engaged_ticks", log.peaks.num_engaged},
            {"limited_ticks", log.peaks.num_limited},
            {"peak_memory_bytes", peak_memory_bytes()}};
  for (const RunStage& stage : run_stages(times)) {
    const auto s = stage.times.summary();
    if (s.num == 0) continue;
    json["microseconds"][stage.name] = {{"p50", s.p50}, {"p99", s.p99},   {"p999", s.p999},
                                        {"max", s.max}, {"mean", s.mean}, {"num", s.num}};
  }
  for (const auto& [thread, how] : log.loop.scheduling) json["scheduling"][thread] = how;
  if (!log.why_not_cuda.empty()) json["why_not_cuda"] = log.why_not_cuda;
  json["warnings"] = log.warnings;
  RunSettings used = log.setup.settings;
  used.coupling = log.coupling;
  json["settings"] = to_json(settings_of(used));
  if (log.setup.probe) json["probe"] = to_json(*log.setup.probe);
  json["changes"] = log.changes.json();
  json["num_changes"] = log.changes.num();
  return json;
}

std::string file_text(const Json& json) {
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}}  // namespace palpate::v0
