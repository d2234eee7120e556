#include "src/viewer/protocol/view_contact.h"

namespace palpate { inline namespace v0 {

ViewContact view_contact(const ContactQuery& query, std::span<const SurfaceBlend> cameras,
                         const Pose& X_WT, double time, std::uint64_t frame_number) {
  const std::size_t num_spheres = query.index()->tool().spheres().size();
  ViewContact contact{time, frame_number, X_WT, {}};
  query.measure(cameras, X_WT, contact.spheres.wants(num_spheres));
  return contact;
}

}}  // namespace palpate::v0
