#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "src/io/internal/text_scanner.h"
#include "src/io/meshes/little_endian.h"
#include "src/io/meshes/mesh_parsers.h"

namespace palpate { inline namespace v0 {
namespace {

/// True if `word` is `lower`, which is in small letters, whatever its capitals.
bool is_word(std::string_view word, std::string_view lower) {
  return std::ranges::equal(word, lower, [](char a, char b) {
    return (a >= 'A' && a <= 'Z' ? static_cast<char>(a - 'A' + 'a') : a) == b;
  });
}

/// True if a line ends before this word: it is empty or begins a comment.
bool ends_line(std::string_view word) {
  return word.empty() || word.starts_with('#') || word.starts_with(';') || word.starts_with("//");
}

/// Three numbers, in single precision as in binary files.
std::optional<Vec3d> take_vertex(std::string_view& line) {
  Vec3d p;
  for (int axis = 0; axis < 3; ++axis) {
    const auto number = parse_number<double>(take_word(line));
    if (!number) return std::nullopt;
    p[axis] = static_cast<double>(static_cast<float>(*number));
    if (!std::isfinite(p[axis])) return std::nullopt;
  }
  return p;
}

}  // namespace

bool is_text_stl(std::string_view content) {
  constexpr std::size_t kHead = 1024;  // of a binary one, in which there are zeros
  if (content.substr(0, kHead).find('\0') != std::string_view::npos) return false;
  while (!content.empty()) {
    std::string_view line = take_line(content);
    const std::string_view word = take_word(line);
    if (!ends_line(word)) return is_word(word, "solid");
  }
  return false;
}

Result<TriangleMesh> parse_text_stl(std::string_view content) {
  TriangleMesh mesh;
  PolygonCutter polygons(mesh);
  std::vector<double> corners;
  bool is_in_solid = false, is_in_facet = false;
  for (int number = 1; !content.empty(); ++number) {
    const auto where = [&] { return " in line " + std::to_string(number); };
    std::string_view line = take_line(content);
    for (std::string_view word = take_word(line); !ends_line(word); word = take_word(line)) {
      if (is_word(word, "solid") || (is_word(word, "endsolid") && !is_in_facet)) {
        is_in_solid = is_word(word, "solid");
        break;  // its name follows, or anything
      }
      if (is_word(word, "facet")) {
        is_in_facet = true;
      } else if (!is_in_facet) {
        break;  // what others write between facets
      } else if (is_word(word, "normal")) {
        for (int axis = 0; axis < 3; ++axis) take_word(line);
      } else if (is_word(word, "loop")) {
        corners.clear();
      } else if (is_word(word, "vertex")) {
        const auto vertex = take_vertex(line);
        if (!vertex) return bad_input("has a damaged vertex" + where());
        corners.push_back(static_cast<double>(mesh.vertices.size()));
        mesh.vertices.push_back(*vertex);
      } else if (is_word(word, "endloop")) {
        if (auto error = polygons.add(corners, where())) return *error;
      } else if (is_word(word, "endfacet")) {
        is_in_facet = false;
      } else if (!is_word(word, "outer")) {
        return bad_input("has '" + std::string(word.substr(0, 40)) + "' in a facet" + where());
      }
    }
  }
  if (is_in_facet || is_in_solid) return bad_input("is truncated: it has no 'endsolid' at its end");
  if (mesh.triangles.empty()) return bad_input("is empty: none of its solids has a facet");
  return mesh;
}

Result<TriangleMesh> parse_binary_stl(std::string_view content) {
  // 80 bytes of anything, the number of facets, and of each a normal, three vertices and two bytes.
  constexpr std::size_t kHeaderBytes = 84, kFacetBytes = 50, kNormalBytes = 12;
  if (content.size() < kHeaderBytes) return bad_input("is neither a text nor a binary STL file");
  const auto num_facets = little_endian_at<std::uint32_t>(content.data() + kHeaderBytes - 4);
  if (num_facets > (content.size() - kHeaderBytes) / kFacetBytes) {
    return bad_input("is truncated or no STL file: it announces " + std::to_string(num_facets) +
                     " facets but has only " + std::to_string(content.size()) + " bytes");
  }
  TriangleMesh mesh;
  mesh.vertices.reserve(3 * std::size_t(num_facets));
  mesh.triangles.reserve(num_facets);
  const char* at = content.data() + kHeaderBytes;
  for (std::uint32_t i = 0; i < num_facets; ++i, at += kFacetBytes) {
    for (std::size_t corner = 0; corner < 3; ++corner) {
      Vec3d p;
      for (int axis = 0; axis < 3; ++axis) {
        p[axis] = little_endian_at<float>(at + kNormalBytes + 12 * corner + 4 * axis);
        if (!std::isfinite(p[axis])) {
          return bad_input("has a damaged vertex in facet " + std::to_string(i));
        }
      }
      mesh.vertices.push_back(p);
    }
    mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  return mesh;
}

}}  // namespace palpate::v0
