#include <bit>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "src/io/mesh_parsers.h"
#include "src/io/text_scanner.h"

namespace palpate {
namespace {

Error bad(std::string message) { return {Errc::bad_input, std::move(message)}; }

enum class Type { i8, u8, i16, u16, i32, u32, f32, f64 };

std::optional<Type> type_named(std::string_view name) {
  if (name == "char" || name == "int8") return Type::i8;
  if (name == "uchar" || name == "uint8") return Type::u8;
  if (name == "short" || name == "int16") return Type::i16;
  if (name == "ushort" || name == "uint16") return Type::u16;
  if (name == "int" || name == "int32") return Type::i32;
  if (name == "uint" || name == "uint32") return Type::u32;
  if (name == "float" || name == "float32") return Type::f32;
  if (name == "double" || name == "float64") return Type::f64;
  return std::nullopt;
}

std::size_t size_of(Type type) {
  constexpr std::size_t kSizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<int>(type)];
}

struct Property {
  std::string name;
  std::optional<Type> list_count;  ///< set for lists
  Type type;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

enum class Encoding { text, little_endian, big_endian };

struct Header {
  Encoding encoding = Encoding::text;
  std::vector<Element> elements;
};

Result<Header> take_header(std::string_view& content) {
  if (take_line(content) != "ply") return bad("does not start with the line 'ply'");
  Header header;
  bool has_format = false;
  while (!content.empty()) {
    std::string_view rest = take_line(content);
    const std::string line(rest);
    const std::string_view key = take_word(rest);
    if (key == "end_header") {
      if (!has_format) return bad("has no 'format' line");
      return header;
    }
    if (key == "format") {
      const std::string_view name = take_word(rest);
      if (name == "ascii") {
        header.encoding = Encoding::text;
      } else if (name == "binary_little_endian") {
        header.encoding = Encoding::little_endian;
      } else if (name == "binary_big_endian") {
        header.encoding = Encoding::big_endian;
      } else {
        return bad("has an unknown format: '" + line + "'");
      }
      has_format = true;
    } else if (key == "element") {
      const std::string name(take_word(rest));
      const auto count = parse_number<std::uint64_t>(take_word(rest));
      if (!count) return bad("has a bad header line: '" + line + "'");
      header.elements.push_back({name, *count, {}});
    } else if (key == "property") {
      std::string_view word = take_word(rest);
      Property property;
      if (word == "list") {
        property.list_count = type_named(take_word(rest));
        if (!property.list_count) return bad("has a bad header line: '" + line + "'");
        word = take_word(rest);
      }
      const auto type = type_named(word);
      property.name = take_word(rest);
      if (!type || property.name.empty() || header.elements.empty()) {
        return bad("has a bad header line: '" + line + "'");
      }
      property.type = *type;
      header.elements.back().properties.push_back(property);
    } else if (key != "comment" && key != "obj_info" && !key.empty()) {
      return bad("has a bad header line: '" + line + "'");
    }
  }
  return bad("is truncated: its header has no end");
}

/// Reads one value after the other; every PLY number fits into a double.
class Values {
 public:
  Values(std::string_view rest, Encoding encoding) : rest_(rest), encoding_(encoding) {}

  std::size_t bytes_left() const { return rest_.size(); }

  std::optional<double> next(Type type) {
    if (encoding_ == Encoding::text) return parse_number<double>(take_word(rest_));
    switch (type) {
      case Type::i8: return binary<std::int8_t>();
      case Type::u8: return binary<std::uint8_t>();
      case Type::i16: return binary<std::int16_t>();
      case Type::u16: return binary<std::uint16_t>();
      case Type::i32: return binary<std::int32_t>();
      case Type::u32: return binary<std::uint32_t>();
      case Type::f32: return binary<float>();
      case Type::f64: return binary<double>();
    }
    return std::nullopt;
  }

  /// The least bytes that a value can take.
  std::size_t min_bytes(Type type) const { return encoding_ == Encoding::text ? 2 : size_of(type); }

 private:
  template <class T>
  std::optional<double> binary() {
    if (rest_.size() < sizeof(T)) return std::nullopt;
    char bytes[sizeof(T)];
    const bool same_order =
        (encoding_ == Encoding::little_endian) == (std::endian::native == std::endian::little);
    for (std::size_t i = 0; i < sizeof(T); ++i) {
      bytes[i] = rest_[same_order ? i : sizeof(T) - 1 - i];
    }
    rest_.remove_prefix(sizeof(T));
    T value;
    std::memcpy(&value, bytes, sizeof(T));
    return static_cast<double>(value);
  }

  std::string_view rest_;
  Encoding encoding_;
};

/// Refuses counts that the rest of the file cannot hold, before anything is allocated for them.
std::optional<Error> check_count(const Element& element, const Values& values) {
  std::size_t row_bytes = 0;
  for (const Property& property : element.properties) {
    row_bytes += values.min_bytes(property.list_count.value_or(property.type));
  }
  // The last number of a text needs no blank after it.
  if (row_bytes == 0 || element.count <= (values.bytes_left() + 1) / row_bytes) return {};
  return bad("is truncated: it announces " + std::to_string(element.count) + " '" + element.name +
             "' but only " + std::to_string(values.bytes_left()) + " bytes follow");
}

/// One row of an element: its scalars x, y, z and its list of vertex indices.
struct Row {
  Vec3d point;
  std::vector<double> indices;
};

/// False at the end of the file or where a number is expected and something else stands.
bool read_row(const Element& element, Values& values, Row& row) {
  row.indices.clear();
  for (const Property& property : element.properties) {
    if (!property.list_count) {
      const auto value = values.next(property.type);
      if (!value) return false;
      if (property.name == "x") row.point.x = *value;
      if (property.name == "y") row.point.y = *value;
      if (property.name == "z") row.point.z = *value;
      continue;
    }
    const auto count = values.next(*property.list_count);
    if (!count || !(*count >= 0) || *count > static_cast<double>(values.bytes_left())) return false;
    const bool is_face = property.name == "vertex_indices" || property.name == "vertex_index";
    for (double i = 0; i < *count; ++i) {
      const auto value = values.next(property.type);
      if (!value) return false;
      if (is_face) row.indices.push_back(*value);
    }
  }
  return true;
}

bool has_property(const Element& element, std::string_view name) {
  for (const Property& property : element.properties) {
    if (property.name == name) return true;
  }
  return false;
}

}  // namespace

Result<TriangleMesh> parse_ply_mesh(std::string_view content) {
  auto header = take_header(content);
  if (!header) return header.error();
  Values values(content, header->encoding);
  TriangleMesh mesh;
  Row row;
  for (const Element& element : header->elements) {
    if (element.properties.empty()) continue;
    if (auto error = check_count(element, values)) return *error;
    const bool is_vertex = element.name == "vertex", is_face = element.name == "face";
    if (is_vertex && !(has_property(element, "x") && has_property(element, "y") &&
                       has_property(element, "z"))) {
      return bad("has vertices without x, y and z");
    }
    if (is_vertex) mesh.vertices.reserve(element.count);
    if (is_face) mesh.triangles.reserve(element.count);
    for (std::uint64_t i = 0; i < element.count; ++i) {
      if (!read_row(element, values, row)) {
        return bad("is truncated or damaged at '" + element.name + "' " + std::to_string(i) +
                   " of " + std::to_string(element.count));
      }
      if (is_vertex) mesh.vertices.push_back(row.point);
      if (!is_face) continue;
      if (auto error = add_polygon(mesh, row.indices, i)) return *error;
    }
  }
  return mesh;
}

}  // namespace palpate
