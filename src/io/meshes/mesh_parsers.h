// Readers of mesh files by format. Errors are the rest of a sentence that starts with the name of
// the file. OBJ, PLY, OFF and STL as text have readers of our own: Assimp repairs PLY and OFF
// silently (it clamps the indices of OFF files and invents faces for PLY files that end early),
// does not know numbers like ".5" in OBJ files, rounds all of them to single precision, and knows
// no STL with an empty solid, a comment or capitals.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "palpate/core/core.h"
#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

/// PLY: ascii, binary little or big endian; any properties besides x, y, z and vertex_indices are
/// skipped.
Result<TriangleMesh> parse_ply_mesh(std::string_view content);

/// OBJ: vertices and faces; everything else is skipped.
Result<TriangleMesh> parse_obj_mesh(std::string_view content);

/// OFF, COFF, NOFF and CNOFF as text.
Result<TriangleMesh> parse_off_mesh(std::string_view content);

/// STL as text: any number of solids, also empty ones; comments, and capitals or not.
Result<TriangleMesh> parse_text_stl(std::string_view content);
bool is_text_stl(std::string_view content);

/// Binary STL, glTF and GLB from memory. All parts are placed by their nodes and joined. `path`
/// gives the format, and where other files lie that the content names.
Result<TriangleMesh> load_with_assimp(const std::filesystem::path& path, std::string_view content);

/// Does the file hold the facets that a binary STL announces?
std::optional<Error> check_stl_size(std::string_view content);
/// The JSON of a GLB (version 2). Error: the file does not hold the bytes that it announces.
Result<std::string_view> glb_json(std::string_view content);
/// The same GLB with other JSON.
std::string glb_with_json(std::string_view content, const std::string& json);
/// The JSON of a glTF that holds its geometry alone, which Assimp can read without running out of
/// stack or memory. Buffers may be files in `folder`; `num_file_bytes` is the size of the whole
/// file.
Result<std::string> gltf_geometry(std::string_view json, const std::filesystem::path& folder,
                                  std::size_t num_file_bytes);

/// Adds polygons to a mesh as triangles; concave ones are cut ear by ear, which takes quadratic
/// time or more: the work for all polygons of a file is limited.
class PolygonCutter {
 public:
  explicit PolygonCutter(TriangleMesh& mesh) : mesh_(mesh) {}
  /// Error: fewer than three corners, an index that is not one of the vertices, or too much work.
  /// `where` is " in line 7" or the like.
  std::optional<Error> add(std::span<const double> indices, const std::string& where);

 private:
  TriangleMesh& mesh_;
  std::int64_t tests_left_ = 300'000'000;  // of corners: some seconds
};

}}  // namespace palpate::v0
