#include <string>
#include <vector>

#include "src/io/internal/text_scanner.h"
#include "src/io/meshes/mesh_parsers.h"

namespace palpate { inline namespace v0 {
namespace {

/// Hands out the statements of a file one by one, whatever they are.
class Statements {
 public:
  explicit Statements(std::string_view text) : text_(text) {}

  /// False at the end. A line that ends in a backslash goes on in the next one.
  bool next() {
    if (text_.empty()) return false;
    rest_ = next_line();
    if (rest_.ends_with('\\')) {
      joined_.clear();
      while (rest_.ends_with('\\')) {
        joined_.append(rest_.substr(0, rest_.size() - 1)).push_back(' ');
        rest_ = next_line();
      }
      rest_ = joined_.append(rest_);
    }
    rest_ = rest_.substr(0, rest_.find('#'));
    keyword_ = take_word(rest_);
    return true;
  }

  std::string_view keyword() const { return keyword_; }
  std::string_view take() { return take_word(rest_); }
  std::string where() const { return " in line " + std::to_string(line_); }

 private:
  std::string_view next_line() {
    ++line_;
    return take_line(text_);
  }

  std::string_view text_, rest_, keyword_;
  std::string joined_;
  std::size_t line_ = 0;
};

}  // namespace

Result<TriangleMesh> parse_obj_mesh(std::string_view content) {
  // A face may come before its vertices, hence two passes.
  TriangleMesh mesh;
  PolygonCutter polygons(mesh);
  for (Statements statement(content); statement.next();) {
    if (statement.keyword() != "v") continue;
    const auto x = parse_number<double>(statement.take());
    const auto y = parse_number<double>(statement.take());
    const auto z = parse_number<double>(statement.take());
    if (!x || !y || !z) return bad_input("has a damaged vertex" + statement.where());
    mesh.vertices.push_back({*x, *y, *z});
  }

  std::int64_t num_vertices_so_far = 0;
  std::vector<double> indices;
  for (Statements statement(content); statement.next();) {
    if (statement.keyword() == "v") ++num_vertices_so_far;
    if (statement.keyword() != "f") continue;
    indices.clear();
    for (auto corner = statement.take(); !corner.empty(); corner = statement.take()) {
      // A corner is vertex/texture/normal; -1 is the vertex before this line.
      const auto number = parse_number<std::int64_t>(corner.substr(0, corner.find('/')));
      if (!number || *number == 0) return bad_input("has a damaged face" + statement.where());
      indices.push_back(
          static_cast<double>(*number > 0 ? *number - 1 : num_vertices_so_far + *number));
    }
    if (auto error = polygons.add(indices, statement.where())) return *error;
  }
  return mesh;
}

}}  // namespace palpate::v0
