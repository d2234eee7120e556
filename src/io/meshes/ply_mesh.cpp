#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/io/clouds/ply_format.h"
#include "src/io/internal/text_scanner.h"
#include "src/io/meshes/mesh_parsers.h"

namespace palpate { inline namespace v0 {
namespace {

/// One row of an element: its scalars x, y, z and its list of vertex indices.
struct Row {
  Vec3d point;
  std::vector<double> indices;
};

/// False at the end of the file or where a number is expected and something else stands.
bool read_row(const PlyElement& element, PlyValues& values, Row& row) {
  row.indices.clear();
  for (const PlyProperty& property : element.properties) {
    if (!property.list_count) {
      const auto value = values.next(property.type);
      if (!value) return false;
      if (property.name == "x") row.point.x = *value;
      if (property.name == "y") row.point.y = *value;
      if (property.name == "z") row.point.z = *value;
      continue;
    }
    const auto size = values.list_size(property);
    if (!size) return false;
    const bool is_face = property.name == "vertex_indices" || property.name == "vertex_index";
    for (std::size_t i = 0; i < *size; ++i) {
      const auto value = values.next(property.type);
      if (!value) return false;
      if (is_face) row.indices.push_back(*value);
    }
  }
  return true;
}

/// Reads the rows of an element: vertices into the mesh, faces by `polygons`; null: only passes
/// over them.
Status read_rows(const PlyElement& element, PlyValues& values, TriangleMesh& mesh,
                 PolygonCutter* polygons) {
  const bool is_vertex = element.name == "vertex";
  Row row;
  for (std::uint64_t i = 0; i < element.count; ++i) {
    if (!read_row(element, values, row)) {
      return bad_input("is truncated or damaged at '" + element.name + "' " + std::to_string(i) +
                       " of " + std::to_string(element.count));
    }
    if (is_vertex) mesh.vertices.push_back(row.point);
    if (polygons == nullptr) continue;
    if (auto error = polygons->add(row.indices, " in face " + std::to_string(i))) return *error;
  }
  return Done{};
}

bool has_property(const PlyElement& element, std::string_view name) {
  for (const PlyProperty& property : element.properties) {
    if (property.name == name) return true;
  }
  return false;
}

}  // namespace

Result<TriangleMesh> parse_ply_mesh(std::string_view content) {
  auto header = take_ply_header(content);
  if (!header) return header.error();
  PlyValues values(content, header->encoding);
  TriangleMesh mesh;
  PolygonCutter polygons(mesh);
  std::vector<std::pair<const PlyElement*, PlyValues>> early_faces;  // before the vertices
  for (const PlyElement& element : header->elements) {
    if (element.properties.empty()) continue;
    if (auto error = check_ply_count(element, values)) return *error;
    const bool is_vertex = element.name == "vertex", is_face = element.name == "face";
    if (is_vertex &&
        !(has_property(element, "x") && has_property(element, "y") && has_property(element, "z"))) {
      return bad_input("has vertices without x, y and z");
    }
    if (is_vertex) mesh.vertices.reserve(element.count);
    if (is_face) mesh.triangles.reserve(element.count);
    const bool is_early = is_face && mesh.vertices.empty();
    if (is_early) early_faces.emplace_back(&element, values);
    const Status status =
        read_rows(element, values, mesh, is_face && !is_early ? &polygons : nullptr);
    if (!status) return status.error();
  }
  for (auto& [element, rows] : early_faces) {
    if (const Status status = read_rows(*element, rows, mesh, &polygons); !status) {
      return status.error();
    }
  }
  return mesh;
}

}}  // namespace palpate::v0
