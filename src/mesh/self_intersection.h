// Self-intersections of a surface, by an exact test of two triangles, in integers.
//
// Coordinates are integers from 0 to 2^40. A plane test is then a determinant below 2^123, which a
// 128-bit integer holds: no case needs a tolerance, and coplanar faces of CAD parts are just one
// more case.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

using GridPoint = Vec3<std::int64_t>;
inline constexpr int kGridBits = 40;

struct GridTriangle {
  GridPoint p[3];
  std::uint32_t vertex[3];  ///< names of the corners; equal names mean a shared corner
};

/// True if the triangles have a point in common besides the corners and edges they share.
bool triangles_meet(const GridTriangle& a, const GridTriangle& b);

using FacePair = std::pair<std::uint32_t, std::uint32_t>;

/// Two faces that have a point in common besides the corners and edges they share, or nothing.
/// Exact for coordinates rounded to 2^-40 of the longest side of the box. O(n log n) for surfaces.
/// Errors: far more faces lie side by side than on any part, so that the search takes too long.
Result<std::optional<FacePair>> find_self_intersection(const TriangleMesh& mesh);

}}  // namespace palpate::v0
