// Meshes on disk.
#pragma once

#include <filesystem>

#include "palpate/core/result.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

/// Reads OBJ, STL, PLY, OFF, glTF or GLB; all parts become one mesh; polygons are triangulated;
/// coordinates are multiplied by `scale` (e.g. 0.001 for a file in millimetres). The mesh is not
/// checked: see check_solid. Errors: no such file, not a mesh, truncated, indices out of range.
Result<TriangleMesh> load_mesh(const std::filesystem::path& path, double scale = 1.0);

/// Writes by extension: .ply (binary) or .stl (binary) or .obj. Never leaves half a file.
Status save_mesh(const TriangleMesh& mesh, const std::filesystem::path& path);

}  // namespace palpate
