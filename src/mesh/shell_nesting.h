// The closed parts of a mesh and their nesting.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

/// One closed part of a surface that does not cross itself.
struct Shell {
  std::vector<std::uint32_t> faces;
  double signed_volume = 0;  ///< m3; negative if the faces look inwards
  double area = 0;           ///< m2
  Vec3d sample;              ///< a point on the shell, in the middle of a face
};

/// The shells of a closed mesh in the order of their first faces.
std::vector<Shell> find_shells(const TriangleMesh& mesh);

/// Position of a shell among the others.
struct Nesting {
  std::size_t outermost = 0;   ///< of the shells around it; itself if there are none
  std::size_t num_around = 0;  ///< shells around it
};

/// Returns the nesting of each shell. The shells must not meet. O(n log n) for surfaces. Errors:
/// far more faces lie side by side than on any part, so that the search takes too long.
Result<std::vector<Nesting>> find_nesting(const TriangleMesh& mesh,
                                          const std::vector<Shell>& shells);

}}  // namespace palpate::v0
