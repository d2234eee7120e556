// What was measured, as pages get it.
#pragma once

#include "palpate/viewer/view_source.h"

namespace palpate {

/// How the spheres were at the last query.
ViewContact contact_shown(const ContactQuery& query, std::span<const SurfaceBlend> cameras,
                          const Pose& X_WT, double time, std::uint64_t frame_number);

}  // namespace palpate
