// Readers of mesh files by format, and the writer of GLB. Errors are the rest of a sentence that
// starts with the name of the file. None repairs: what a file says of its shape is taken as it is,
// or refused.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "palpate/core/core.h"
#include "palpate/io/formats.h"
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

Result<TriangleMesh> parse_binary_stl(std::string_view content);

/// glTF 2.0 from its JSON: all parts are placed by their nodes and joined. `bin`: the binary chunk
/// of a GLB; other buffers may be files in `folder`. `num_file_bytes`: size of the whole file,
/// which bounds what it may announce.
Result<TriangleMesh> parse_gltf(std::string_view json, std::string_view bin,
                                const std::filesystem::path& folder, std::size_t num_file_bytes);
Result<TriangleMesh> parse_glb(std::string_view content, const std::filesystem::path& folder);

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

/// Writes the bytes of a GLB file: a node and a material for each part; `parts` are not empty, nor
/// is any of them, and faces use vertices that exist. The error is the rest of a sentence.
Result<std::string> glb_content(std::span<const ColoredMesh* const> parts);

}}  // namespace palpate::v0
