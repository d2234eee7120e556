// Finds self-intersections of a surface.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>

#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

using FacePair = std::pair<std::uint32_t, std::uint32_t>;

/// Two faces that have a point in common besides the corners and edges they share, or nothing.
/// Exact for coordinates rounded to 2^-40 of the longest side of the box. O(n log n) for surfaces.
/// Errors: far more faces lie side by side than on any part, so that the search takes too long.
Result<std::optional<FacePair>> find_self_intersection(const TriangleMesh& mesh);

}}  // namespace palpate::v0
