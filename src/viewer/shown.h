// What was measured, as pages get it.
#pragma once

#include "palpate/field/surface_timeline.h"
#include "palpate/haptics/local_contact.h"
#include "palpate/viewer/view_source.h"

namespace palpate {

/// `seen` with the depth-change vectors of `felt`, if that is in host memory and has any.
ViewSurface surface_shown(const PointCloud& seen, const PointCloudView& felt,
                          std::uint64_t frame_number);

/// How the spheres were at the last query.
ViewContact contact_shown(const ContactQuery& query, const Pose& X_WT, double time,
                          std::uint64_t frame_number);

/// Newtons of a run without a device: as if one of 10 N showed it.
ForceScale force_shown(const Tool& tool, const ContactOptions& contact);
ViewSample sample_shown(double time, const Pose& X_WT, const Wrench& measure_W, double volume,
                        double query_seconds, const ForceScale& scale);

}  // namespace palpate
