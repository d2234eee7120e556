// Points spread over the surface of a mesh.
#pragma once

#include <vector>

#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

/// Points spread evenly over the area of a mesh's surface; they depend on mesh and number only.
std::vector<Vec3d> surface_points(const TriangleMesh& mesh, int num);

}}  // namespace palpate::v0
