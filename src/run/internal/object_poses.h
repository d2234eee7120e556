// Poses of the objects of a run.
#pragma once

#include <vector>

#include "palpate/contact/body_contact.h"

namespace palpate { inline namespace v0 {

/// Returns the poses of all objects, of which those that move are at `moving`, in their order.
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

}}  // namespace palpate::v0
