// Meshes on disk.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "palpate/core/result.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

/// Reads OBJ, STL, PLY, OFF, glTF or GLB; all parts become one mesh; polygons are triangulated;
/// coordinates are multiplied by `scale` (e.g. 0.001 for a file in millimetres). The mesh is not
/// checked: see check_solid. Errors: no such file, not a mesh, truncated, indices out of range.
Result<TriangleMesh> load_mesh(const std::filesystem::path& path, double scale = 1.0);

/// Writes by extension: .ply (binary) or .stl (binary) or .obj. Never leaves half a file.
Status save_mesh(const TriangleMesh& mesh, const std::filesystem::path& path);

/// A mesh in one colour, for pictures.
struct ColouredMesh {
  std::string name;
  std::array<std::uint8_t, 3> rgb{};  ///< sRGB
  TriangleMesh mesh;
};

/// Writes by extension: .ply (binary; all parts in one mesh, each vertex with its colour) or .glb
/// (each part a node and a material of its name; single precision). Coordinates as they are, in
/// metres: programs that take y for up, as glTF does, show them so. Parts without faces are left
/// out. Error: no part has any. Never leaves half a file.
Status save_coloured_meshes(std::span<const ColouredMesh> parts, const std::filesystem::path& path);

}  // namespace palpate
