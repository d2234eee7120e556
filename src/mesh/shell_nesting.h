// The closed parts of a mesh and their nesting.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "palpate/mesh/mesh.h"

namespace palpate::inline v0 {

/// One closed part of a surface that does not cross itself.
struct Shell {
  std::vector<std::uint32_t> faces;
  Bounds box;
  double signed_volume = 0;  ///< m3; negative if the faces look inwards
  double area = 0;           ///< m2
  Vec3d sample;              ///< a point on the shell, in the middle of a face
};

/// The shells of a closed mesh in the order of their first faces.
std::vector<Shell> find_shells(const TriangleMesh& mesh);

/// For each shell, the indices of the shells around it. The shells must not meet.
std::vector<std::vector<std::size_t>> find_enclosing_shells(const TriangleMesh& mesh,
                                                            const std::vector<Shell>& shells);

}  // namespace palpate::inline v0
