#include "src/contact/scene/scene_answers.h"

#include <algorithm>
#include <vector>

namespace palpate { inline namespace v0 {

void put_spheres(std::size_t pose, const SpherePicture& picture, std::span<const Sphere> spheres,
                 const Pose& X_WT, const SceneAnswers& answers) {
  const Mat3d R_WT = rotation_matrix(normalized(X_WT.rotation));
  for (std::size_t i = 0; i < answers.max_spheres; ++i) {
    const std::size_t to = pose * answers.max_spheres + i;
    double depth = 0, volume = 0;
    Vec3d direction;
    std::int8_t decided = kNoCamera;
    if (i < spheres.size() && picture.states[i] != SphereState::outside) {
      const Plane<float>& plane = picture.planes[i];
      const auto radius = static_cast<double>(spheres[i].radius);
      const double distance =
          static_cast<double>(dot(plane.normal, spheres[i].center) - plane.offset);
      depth = std::max(0.0, radius - distance);
      volume = cap_volume(radius, distance);
      direction = R_WT * to_double(plane.normal);
      decided = picture.deciders[i];
    }
    if (answers.sphere_depth != nullptr) answers.sphere_depth[to] = static_cast<float>(depth);
    if (answers.sphere_volume != nullptr) answers.sphere_volume[to] = static_cast<float>(volume);
    if (answers.sphere_decided != nullptr) answers.sphere_decided[to] = decided;
    for (int axis = 0; axis < 3 && answers.sphere_direction != nullptr; ++axis) {
      answers.sphere_direction[3 * to + static_cast<std::size_t>(axis)] =
          static_cast<float>(direction[axis]);
    }
  }
}

void put_groups(const ScenePoses& poses, const SceneAnswers& answers) {
  const auto num = static_cast<std::size_t>(poses.num_groups);
  std::vector<double> least(num, answers.clearance_limit);
  if (answers.group_pose != nullptr) std::fill_n(answers.group_pose, num, -1);
  if (answers.group_volume != nullptr) std::fill_n(answers.group_volume, num, 0.0);
  for (std::size_t i = 0; i < poses.X_WT.size(); ++i) {
    const auto g = static_cast<std::size_t>(poses.group_of_pose[i]);
    if (answers.group_volume != nullptr) answers.group_volume[g] += answers.contact.volume[i];
    if (!(answers.clearance[i] < least[g])) continue;
    least[g] = answers.clearance[i];
    if (answers.group_pose != nullptr) answers.group_pose[g] = static_cast<std::int32_t>(i);
  }
  if (answers.group_clearance != nullptr) std::ranges::copy(least, answers.group_clearance);
}

}}  // namespace palpate::v0
