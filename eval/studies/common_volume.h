// What two convex bodies share, exactly.
#pragma once

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate::eval {

/// Common volume of two convex bodies, m3.
double common_volume(const TriangleMesh& a, const Pose& X_WA, const TriangleMesh& b,
                     const Pose& X_WB);

}  // namespace palpate::eval
