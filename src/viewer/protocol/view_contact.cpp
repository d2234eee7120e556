#include "src/viewer/protocol/view_contact.h"

namespace palpate { inline namespace v0 {

ViewContact view_contact(const ContactQuery& query, std::span<const SurfaceBlend> cameras,
                         const Pose& X_WT, double time, std::uint64_t frame_number) {
  ViewContact contact{time, frame_number, X_WT, {}};
  contact.spheres.resize(query.index()->tool().spheres().size());
  query.measure(cameras, X_WT, contact.spheres.wants());
  return contact;
}

}}  // namespace palpate::v0
