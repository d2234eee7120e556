#include <string>
#include <vector>

#include "src/io/internal/text_scanner.h"
#include "src/io/meshes/mesh_parsers.h"

namespace palpate { inline namespace v0 {
namespace {

/// The next line that holds more than a comment; empty at the end of the file.
std::string_view take_content_line(std::string_view& text) {
  while (!text.empty()) {
    std::string_view line = take_line(text);
    line = line.substr(0, line.find('#'));
    if (line.find_first_not_of(" \t") != std::string_view::npos) return line;
  }
  return {};
}

}  // namespace

Result<TriangleMesh> parse_off_mesh(std::string_view content) {
  std::string_view line = take_content_line(content);
  const std::string_view magic = take_word(line);
  if (magic != "OFF" && magic != "COFF" && magic != "NOFF" && magic != "CNOFF") {
    return bad_input("does not start with the word OFF");
  }
  if (std::string_view beside = line; take_word(beside) == "BINARY") {
    return bad_input("is a binary OFF file, not a text OFF file; save it as text");
  }
  // The counts stand beside the magic word or on the next line.
  std::string_view counts =
      line.find_first_not_of(" \t") != std::string_view::npos ? line : take_content_line(content);
  const auto num_vertices = parse_number<std::uint64_t>(take_word(counts));
  const auto num_faces = parse_number<std::uint64_t>(take_word(counts));
  if (!num_vertices || !num_faces) {
    return bad_input("is not a text OFF file: the numbers of vertices and faces are missing");
  }
  // The shortest lines are "0 0 0" and "3 0 0 0"; the last needs no line end.
  constexpr std::size_t kMinVertexBytes = 6, kMinFaceBytes = 8;
  const std::size_t bytes = content.size() + 1;
  if (*num_vertices > bytes / kMinVertexBytes ||
      *num_faces > (bytes - *num_vertices * kMinVertexBytes) / kMinFaceBytes) {
    return bad_input("is truncated: it announces " + std::to_string(*num_vertices) +
                     " vertices and " + std::to_string(*num_faces) + " faces but only " +
                     std::to_string(content.size()) + " bytes follow");
  }

  TriangleMesh mesh;
  PolygonCutter polygons(mesh);
  mesh.vertices.reserve(*num_vertices);
  for (std::uint64_t i = 0; i < *num_vertices; ++i) {
    line = take_content_line(content);
    const auto x = parse_number<double>(take_word(line));
    const auto y = parse_number<double>(take_word(line));
    const auto z = parse_number<double>(take_word(line));
    if (!x || !y || !z) {
      return bad_input("is truncated or damaged at vertex " + std::to_string(i) + " of " +
                       std::to_string(*num_vertices));
    }
    mesh.vertices.push_back({*x, *y, *z});
  }
  std::vector<double> indices;
  for (std::uint64_t i = 0; i < *num_faces; ++i) {
    line = take_content_line(content);
    const auto num_corners = parse_number<std::uint64_t>(take_word(line));
    indices.clear();
    for (std::uint64_t k = 0; num_corners && k < *num_corners; ++k) {
      const auto index = parse_number<double>(take_word(line));
      if (!index) break;
      indices.push_back(*index);
    }
    if (!num_corners || indices.size() != *num_corners) {
      return bad_input("is truncated or damaged at face " + std::to_string(i) + " of " +
                       std::to_string(*num_faces));
    }
    if (auto error = polygons.add(indices, " in face " + std::to_string(i))) return *error;
  }
  return mesh;
}

}}  // namespace palpate::v0
