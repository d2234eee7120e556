// The distance of a tool to a CAD body, by the body's distance field.
#pragma once

#include "palpate/contact/contact.h"
#include "palpate/packing/packing.h"
#include "src/contact/clearance/clearance.h"
#include "src/contact/clearance/surface_plane.h"

namespace palpate { inline namespace v0 {

/// Returns the signed distance of a point in the frame of the body, and its derivative. Exact at
/// flat faces, and to a few tenths of the spacing of the grid there else; beyond all grids to a few
/// percent.
PointDistance body_distance(const SolidField& field, const Vec3d& p_B);

/// Lowers `least` to the clearance of a tool to a body, if that is less. `decider`: number of the
/// body. O(spheres).
void add_body_clearance(const ToolIndex& tool, const SolidField& field, const Pose& X_WB,
                        const Pose& X_WT, int decider, Clearance& least);

}}  // namespace palpate::v0
