#include "src/viewer/shown.h"

namespace palpate {

ViewContact contact_shown(const ContactQuery& query, const Pose& X_WT, double time,
                          std::uint64_t frame_number) {
  const auto states = query.states();
  const auto planes = query.planes();
  return {time, frame_number, X_WT, {states.begin(), states.end()}, {planes.begin(), planes.end()}};
}

}  // namespace palpate
