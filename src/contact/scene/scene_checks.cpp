#include "src/contact/scene/scene_checks.h"

#include <cmath>

#include "src/contact/hull/camera_seats.h"

namespace palpate { inline namespace v0 {
namespace {

Error refused(const std::string& message) { return {Errc::invalid_argument, message}; }

std::string place_name(int gpu) {
  return gpu == kHostMemory ? "host memory" : "the memory of GPU " + std::to_string(gpu);
}

}  // namespace

Status check_scene(const Scene& scene, const ContactMethod& method, const Place& place) {
  const std::size_t num = scene.surfaces.size();
  if (num == 0 && scene.bodies.empty()) {
    return refused("the scene is empty; give it a surface or a body");
  }
  if (num > kMaxCameras) {
    return refused("a scene of " + std::to_string(num) + " surfaces was given; at most " +
                   std::to_string(kMaxCameras) + " are joined");
  }
  for (std::size_t k = 0; k < num; ++k) {
    const SurfaceView& surface = scene.surfaces[k];
    const DepthFieldView &field = surface.field, &first = scene.surfaces[0].field;
    if (field.num_levels > 0 && first.num_levels > 0 && field.gpu != first.gpu) {
      return refused("surface " + std::to_string(k) + " of a scene lies in " +
                     place_name(field.gpu) + " and surface 0 in " + place_name(first.gpu) +
                     "; make all of them by sensors in one place");
    }
    if (place.backend == Backend::cpu && field.num_levels > 0 && field.gpu != kHostMemory) {
      return refused("surface " + std::to_string(k) + " of a scene lies in " +
                     place_name(field.gpu) + "; create the contact with Place::cuda(" +
                     std::to_string(field.gpu) + "), or the sensor with Place::cpu()");
    }
  }
  for (std::size_t k = 0; num > 1 && k < num; ++k) {
    const SurfaceView& surface = scene.surfaces[k];
    if (!std::holds_alternative<FieldMethod>(method)) {
      return refused(
          "surfaces of several cameras are joined by the method field alone; create the "
          "contact with it, or give one surface");
    }
    if (surface.field.num_levels > 0 && surface.role == SurfaceRole::frame) {
      return refused("surface " + std::to_string(k) +
                     " of a scene was made for one camera by itself; make those of several with "
                     "DepthFieldOptions::one_of_several (Sensor(camera, joined=True))");
    }
  }
  return Done{};
}

Status check_memory(int gpu, const Place& place) {
  if (gpu == kHostMemory) return Done{};
  const bool is_cpu = place.backend == Backend::cpu;
  if (!is_cpu && gpu == place.gpu) return Done{};
  return refused("poses or answers in " + place_name(gpu) + " were given to a contact on " +
                 (is_cpu ? "the CPU" : "GPU " + std::to_string(place.gpu)) +
                 "; create it with Place::cuda(" + std::to_string(gpu) +
                 "), or copy them to host memory");
}

Status check_poses(const ScenePoses& poses, std::size_t num_tools) {
  const std::size_t num = poses.X_WT.size();
  const auto check_size = [&](std::span<const std::int32_t> indices, const char* name) -> Status {
    if (indices.empty() || indices.size() == num) return Done{};
    return refused("a query of " + std::to_string(num) + " poses was given " + name + " of " +
                   std::to_string(indices.size()) + "; give one number for each pose");
  };
  if (const Status s = check_size(poses.tool_of_pose, "tool_of_pose"); !s) return s;
  if (const Status s = check_size(poses.group_of_pose, "group_of_pose"); !s) return s;
  if (poses.tool_of_pose.empty() && num_tools > 1 && num > 0) {
    return refused("a contact of " + std::to_string(num_tools) +
                   " tools was given poses without tool_of_pose; give the tool of each pose");
  }
  const auto check_range = [&](std::span<const std::int32_t> indices, std::size_t size,
                               const char* name, const char* of) -> Status {
    for (std::size_t i = 0; i < indices.size(); ++i) {
      if (indices[i] >= 0 && static_cast<std::size_t>(indices[i]) < size) continue;
      return refused(std::string(name) + " of pose " + std::to_string(i) + " is " +
                     std::to_string(indices[i]) + ", but there are " + std::to_string(size) + " " +
                     of + "; count from 0");
    }
    return Done{};
  };
  if (const Status s = check_range(poses.tool_of_pose, num_tools, "tool_of_pose", "tools"); !s) {
    return s;
  }
  return check_range(poses.group_of_pose, static_cast<std::size_t>(std::max(0, poses.num_groups)),
                     "group_of_pose", "groups");
}

Status check_noise(const BatchAnswers& answers, const ContactMethod& method) {
  if (!answers.want_noise() || std::holds_alternative<FieldMethod>(method)) return Done{};
  return refused(std::string("standard deviations are measured with the method field, not with ") +
                 name_of(contact_options(method).method) + "; create the contact with field");
}

Status check_clearance(const ContactMethod& method, double limit, double smoothing) {
  if (!std::holds_alternative<FieldMethod>(method)) {
    return refused(std::string("clearance is measured with the method field, not with ") +
                   name_of(contact_options(method).method) + "; create the contact with field");
  }
  if (!(limit > 0) || !std::isfinite(limit)) {
    return refused("clearance saturates at a distance above 0, not at " + std::to_string(limit) +
                   " m");
  }
  if (!(smoothing >= 0) || !std::isfinite(smoothing)) {
    return refused("clearance is smoothed over a length, 0 for none, not over " +
                   std::to_string(smoothing) + " m");
  }
  return Done{};
}

}}  // namespace palpate::v0
