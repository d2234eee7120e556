#include "apps/verbs/query_results.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "src/run/internal/reported_output.h"

namespace palpate::apps {
namespace {

nlohmann::ordered_json to_json(const Vec3d& v) { return {v.x, v.y, v.z}; }

/// Returns pose and wrench in the frame of --wrench-frame, --wrench-point and --tcp.
nlohmann::ordered_json reported_json(const OutputOptions& output, const Tool& tool,
                                     const Pose& X_WCamera, const QueryMeasurement& at) {
  const ReportedOutput reported(
      output, {at.X_WT, at.X_WT * tool.sphere_mass().center_of_mass, X_WCamera, Pose{}});
  const VolumeWrench measure = reported.wrench(at.penetration.measure_W);
  return {{"pose", seven_numbers(reported.pose())},
          {"force", to_json(measure.force)},
          {"torque", to_json(measure.torque)}};
}

void print_newtons(const char* begin, double stiffness, const Vec3d& force, const Vec3d& torque) {
  const Vec3d F = stiffness * force, M = stiffness * torque;
  std::printf("%5s at %g N/m³: force %.4g %.4g %.4g N, torque %.4g %.4g %.4g N m\n", begin,
              stiffness, F.x, F.y, F.z, M.x, M.y, M.z);
}

}  // namespace

std::string camera_name(std::size_t number) {
  return number == 0 ? "camera" : "camera_" + std::to_string(number + 1);
}

void print_results_json(const QueryOptions& options, const RunSettings& settings, const Tool& tool,
                        const Pose& X_WCamera, Backend backend, std::size_t num_usable,
                        double tool_volume, const std::vector<QueryMeasurement>& measurements) {
  nlohmann::ordered_json json{{"method", name_of(options.settings.contact.method)},
                              {"backend", name_of(backend)},
                              {"usable_points", num_usable}};
  if (settings.contact.method == MethodKind::field) {
    json["unseen_is"] = name_of(settings.field.unseen);
  }
  json["results"] = nlohmann::ordered_json::array();
  for (const QueryMeasurement& measurement : measurements) {
    const auto& [penetration, shares, unseen, decided, seconds, X_WT, noise, clearance, nearest,
                 clearance_gradient] = measurement;
    json["results"].push_back({{"volume", penetration.volume},
                               {"fraction", penetration.volume / tool_volume},
                               {"force", to_json(penetration.measure_W.force)},
                               {"torque", to_json(penetration.measure_W.torque)},
                               {"boundary_spheres", penetration.num_boundary_spheres},
                               {"inside_spheres", penetration.num_inside_spheres},
                               {"points", penetration.num_points},
                               {"compute_us", seconds * 1e6},
                               {"status", penetration.status.bits}});
    if (noise) {
      json["results"].back()["volume_std"] = noise->volume_std();
      json["results"].back()["force_std"] = to_json(noise->force_std());
      json["results"].back()["torque_std"] = to_json(noise->torque_std());
    }
    if (options.settings.contact.method == MethodKind::field) {
      if (unseen) json["results"].back()["unseen"] = std::min(1.0, *unseen / tool_volume);
      auto& by = json["results"].back()["decided"];
      for (std::size_t k = 0; k + 1 < decided.size(); ++k) by[camera_name(k)] = decided[k];
      by["none"] = decided.back();
    }
    if (options.stiffness > 0) {
      const VolumeWrench& measure = penetration.measure_W;
      json["results"].back()["force_N"] = to_json(options.stiffness * measure.force);
      json["results"].back()["torque_Nm"] = to_json(options.stiffness * measure.torque);
      if (noise) {
        json["results"].back()["force_std_N"] = to_json(options.stiffness * noise->force_std());
        json["results"].back()["torque_std_Nm"] = to_json(options.stiffness * noise->torque_std());
      }
    }
    if (clearance) {
      json["results"].back().update({{"clearance", *clearance},
                                     {"nearest", nearest},
                                     {"clearance_gradient", clearance_gradient}});
    }
    if (!(settings.output == OutputOptions{})) {
      json["results"].back()["reported"] =
          reported_json(settings.output, tool, X_WCamera, measurement);
    }
    if (options.objects.empty()) continue;
    const Penetration& objects = shares.bodies;
    json["results"].back()["objects"] = {{"volume", objects.volume},
                                         {"force", to_json(objects.measure_W.force)},
                                         {"torque", to_json(objects.measure_W.torque)},
                                         {"pairs", shares.num_pairs}};
  }
  if (!options.caps.file.empty()) json["caps"] = options.caps.file;
  print_json(json);
}

void print_results_table(const QueryOptions& options, double tool_volume,
                         const std::vector<QueryMeasurement>& measurements) {
  const bool has_objects = !options.objects.empty();
  // Superscripts and µ have two bytes, so that their columns are a byte wider.
  std::printf("%5s %13s %8s %37s %37s %8s %8s %8s %10s%s%s\n", "pose", "volume m³", "% tool",
              "force measure m³", "torque measure m⁴", "boundary", "inside", "points", "µs",
              has_objects ? "   objects m³" : "", options.wants_clearance ? "  clearance m" : "");
  if (options.std) {
    std::printf("%5s %12s %8s %36s %36s\n", "", "and its std", "", "and its std", "and its std");
  }
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    const Penetration& p = measurements[i].penetration;
    const Vec3d &f = p.measure_W.force, &m = p.measure_W.torque;
    std::printf("%5zu %12.5g %8.3f %12.4g%12.4g%12.4g %12.4g%12.4g%12.4g %8d %8d %8d %9.1f", i,
                p.volume, 100 * p.volume / tool_volume, f.x, f.y, f.z, m.x, m.y, m.z,
                p.num_boundary_spheres, p.num_inside_spheres, p.num_points,
                measurements[i].seconds * 1e6);
    if (has_objects) std::printf(" %12.5g", measurements[i].shares.bodies.volume);
    if (const auto& clearance = measurements[i].clearance) std::printf(" %12.5g", *clearance);
    std::puts(p.status.has(StepStatus::ambiguous_normals) ? "  (normals disagree)" : "");
    if (measurements[i].noise) {
      const MeasureNoise& noise = *measurements[i].noise;
      const Vec3d df = noise.force_std(), dm = noise.torque_std();
      std::printf("%5s %12.5g %8.3f %12.4g%12.4g%12.4g %12.4g%12.4g%12.4g\n", "+-",
                  noise.volume_std(), 100 * noise.volume_std() / tool_volume, df.x, df.y, df.z,
                  dm.x, dm.y, dm.z);
    }
    if (options.stiffness > 0) {
      print_newtons("", options.stiffness, f, m);
      if (const auto& noise = measurements[i].noise) {
        print_newtons("+-", options.stiffness, noise->force_std(), noise->torque_std());
      }
    }
    const double unseen = measurements[i].unseen.value_or(0) / tool_volume;
    if (unseen > 0.01) {
      std::printf("%5s %.3g %% of the tool is where no camera sees (--unseen %s)\n", "",
                  100 * std::min(1.0, unseen), name_of(options.settings.field.unseen).data());
    }
  }
}

void print_nearest(const NearestPose& nearest, std::size_t num_poses) {
  std::printf("the tool never touches; nearest %.2g m", std::max(0.0, nearest.distance));
  if (num_poses > 1) std::printf(" at pose %zu", nearest.pose);
  std::puts("");
}

}  // namespace palpate::apps
