// Contacts as pages get them.
#pragma once

#include "palpate/contact/body_contact.h"
#include "palpate/viewer/viewer.h"
#include "src/run/internal/object_poses.h"

namespace palpate { inline namespace v0 {

/// Measures the tool at X_WT with `query` and returns the state of each sphere, for display.
inline ViewContact view_contact(const ContactQuery& query, std::span<const SurfaceBlend> cameras,
                                const Pose& X_WT, double time, std::uint64_t frame_number) {
  ViewContact contact{time, frame_number, X_WT, {}};
  contact.spheres.resize(query.index()->tool().spheres().size());
  query.measure(cameras, X_WT, contact.spheres.wants());
  return contact;
}

inline std::vector<std::shared_ptr<const Tool>> shapes_of(const std::vector<SceneObject>& objects) {
  std::vector<std::shared_ptr<const Tool>> shapes;
  for (const SceneObject& object : objects) shapes.push_back(object.shape);
  return shapes;
}

}}  // namespace palpate::v0
