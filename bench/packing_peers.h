// Two published methods to fill a solid with disjoint spheres, for comparison with `pack_spheres`.
// They are written here from the descriptions, not by their authors, and share our distance
// queries, so that only the search for the next sphere differs. Both run on the calling thread.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "bench/stopwatch.h"
#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate::bench {

struct PeerLimits {
  int max_spheres = 0;
  double max_seconds = std::numeric_limits<double>::infinity();  ///< CPU time
};

/// In insertion order: every prefix is the packing for that number.
struct PeerPacking {
  std::vector<Sphere> spheres;
  std::vector<Times> times;  ///< since the call, when each sphere was inserted
  bool out_of_time = false;
};

/// Prototype placement in the manner of Protosphere (Weller and Zachmann 2010; Teuber, Weller,
/// Zachmann 2013). Each round puts one prototype at a random place of every grid cell that is not
/// yet filled, moves all of them away from their closest obstacle in cooled steps, and inserts the
/// largest that do not overlap: those of at least `large` times the largest of the round. The grid
/// is split after 6 rounds, then after every 30.
PeerPacking pack_prototypes(const TriangleMesh& solid, double large, const PeerLimits& limits);

/// Greedy packing on a fixed grid: distance field of `cells` cells along the longest side of the
/// box, then always the largest sphere that fits around a cell center.
PeerPacking pack_fixed_grid(const TriangleMesh& solid, int cells, const PeerLimits& limits);

/// Verifies a packing in double on the stored numbers: returns the first sphere that leaves the
/// solid or overlaps another. Empty if the packing is valid.
std::string find_fault(const TriangleMesh& solid, const std::vector<Sphere>& spheres);

}  // namespace palpate::bench
