// Contacts as pages get them.
#pragma once

#include "palpate/contact/body_contact.h"
#include "palpate/viewer/viewer.h"

namespace palpate::inline v0 {

/// How the spheres were at the last query.
ViewContact view_contact(const ContactQuery& query, std::span<const SurfaceBlend> cameras,
                         const Pose& X_WT, double time, std::uint64_t frame_number);

/// Where all objects are, of which those that move are at `moving`, in their order.
template <class Poses>
std::vector<Pose> objects_at(const std::vector<SceneObject>& objects, const Poses& moving) {
  std::vector<Pose> poses;
  auto next = std::begin(moving);
  for (const SceneObject& object : objects) {
    const bool is_known = object.moves && next != std::end(moving);
    poses.push_back(is_known ? *next++ : object.X_WB);
  }
  return poses;
}
inline std::vector<std::shared_ptr<const Tool>> shapes_of(const std::vector<SceneObject>& objects) {
  std::vector<std::shared_ptr<const Tool>> shapes;
  for (const SceneObject& object : objects) shapes.push_back(object.shape);
  return shapes;
}

}  // namespace palpate::inline v0
