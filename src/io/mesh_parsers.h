// Readers of mesh files by format. Errors are the rest of a sentence that starts with the name of
// the file. PLY and OFF have readers of our own because Assimp repairs them silently: it clamps
// the indices of OFF files and invents faces for PLY files that end early.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string_view>

#include "palpate/core/result.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

/// PLY: ascii, binary little or big endian; any properties besides x, y, z and vertex_indices are
/// skipped. Polygons become fans of triangles.
Result<TriangleMesh> parse_ply_mesh(std::string_view content);

/// OFF, COFF, NOFF and CNOFF as text. Polygons become fans of triangles.
Result<TriangleMesh> parse_off_mesh(std::string_view content);

/// STL, OBJ, glTF and GLB. All parts are placed by their nodes and joined.
Result<TriangleMesh> load_with_assimp(const std::filesystem::path& path);

/// Does the file hold the facets that a binary STL announces, or the end of a text STL?
std::optional<Error> check_stl_size(std::string_view content);
/// Does the file hold the bytes that a GLB announces?
std::optional<Error> check_glb_size(std::string_view content);

/// Adds a polygon as a fan of triangles. Error: fewer than three corners, or an index that is not
/// one of the vertices. `face` is its number in the file.
std::optional<Error> add_polygon(TriangleMesh& mesh, std::span<const double> indices,
                                 std::uint64_t face);

}  // namespace palpate
