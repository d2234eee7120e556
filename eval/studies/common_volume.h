// Exact common volume of two convex bodies.
#pragma once

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate::eval {

/// Returns the common volume of two convex bodies, m3.
double common_volume(const TriangleMesh& a, const Pose& X_WA, const TriangleMesh& b,
                     const Pose& X_WB);

}  // namespace palpate::eval
