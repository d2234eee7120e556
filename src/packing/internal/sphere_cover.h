// Few spheres that overlap, for those who ask how near a body is.
#pragma once

#include <span>

#include "palpate/packing/packing.h"

namespace palpate { inline namespace v0 {

/// Spheres inside of a mesh that passed check_solid, such that points spread over its surface are
/// within `standoff` (m) of one. They may overlap, which those of a packing do not: so far fewer
/// are needed. Strictly inside in double precision on the stored numbers. Errors: invalid numbers;
/// no sphere fits.
Result<SpherePacking> cover_solid(const TriangleMesh& solid, double standoff, int max_spheres);

/// m: the farthest that a corner, or one of kStandoffSamples points spread over a surface, lies
/// from the nearest of the spheres.
double farthest_standoff(const TriangleMesh& solid, std::span<const Sphere> spheres);

}}  // namespace palpate::v0
