#include "src/io/clouds/ply_format.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

std::optional<PlyType> type_named(std::string_view name) {
  if (name == "char" || name == "int8") return PlyType::i8;
  if (name == "uchar" || name == "uint8") return PlyType::u8;
  if (name == "short" || name == "int16") return PlyType::i16;
  if (name == "ushort" || name == "uint16") return PlyType::u16;
  if (name == "int" || name == "int32") return PlyType::i32;
  if (name == "uint" || name == "uint32") return PlyType::u32;
  if (name == "float" || name == "float32") return PlyType::f32;
  if (name == "double" || name == "float64") return PlyType::f64;
  return std::nullopt;
}

std::size_t size_of(PlyType type) {
  constexpr std::size_t kSizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<int>(type)];
}

}  // namespace

Result<PlyHeader> take_ply_header(std::string_view& content) {
  if (take_line(content) != "ply") return bad_input("does not start with the line 'ply'");
  PlyHeader header;
  bool has_format = false;
  while (!content.empty()) {
    std::string_view rest = take_line(content);
    const std::string line(rest);
    const std::string_view key = take_word(rest);
    if (key == "end_header") {
      if (!has_format) return bad_input("has no 'format' line");
      return header;
    }
    if (key == "format") {
      const std::string_view name = take_word(rest);
      if (name == "ascii") {
        header.encoding = PlyEncoding::text;
      } else if (name == "binary_little_endian") {
        header.encoding = PlyEncoding::little_endian;
      } else if (name == "binary_big_endian") {
        header.encoding = PlyEncoding::big_endian;
      } else {
        return bad_input("has an unknown format: '" + line + "'");
      }
      has_format = true;
    } else if (key == "element") {
      const std::string name(take_word(rest));
      const auto count = parse_number<std::uint64_t>(take_word(rest));
      if (!count) return bad_input("has a bad header line: '" + line + "'");
      header.elements.push_back({name, *count, {}});
    } else if (key == "property") {
      std::string_view word = take_word(rest);
      PlyProperty property;
      if (word == "list") {
        property.list_count = type_named(take_word(rest));
        if (!property.list_count) return bad_input("has a bad header line: '" + line + "'");
        word = take_word(rest);
      }
      const auto type = type_named(word);
      property.name = take_word(rest);
      if (!type || property.name.empty() || header.elements.empty()) {
        return bad_input("has a bad header line: '" + line + "'");
      }
      property.type = *type;
      header.elements.back().properties.push_back(property);
    } else if (key != "comment" && key != "obj_info" && !key.empty()) {
      return bad_input("has a bad header line: '" + line + "'");
    }
  }
  return bad_input("is truncated: its header has no end");
}

template <class T>
std::optional<double> PlyValues::binary() {
  if (rest_.size() < sizeof(T)) return std::nullopt;
  char bytes[sizeof(T)];
  const bool same_order =
      (encoding_ == PlyEncoding::little_endian) == (std::endian::native == std::endian::little);
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    bytes[i] = rest_[same_order ? i : sizeof(T) - 1 - i];
  }
  rest_.remove_prefix(sizeof(T));
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return static_cast<double>(value);
}

std::optional<double> PlyValues::next(PlyType type) {
  if (encoding_ == PlyEncoding::text) return parse_number<double>(take_word(rest_));
  switch (type) {
    case PlyType::i8: return binary<std::int8_t>();
    case PlyType::u8: return binary<std::uint8_t>();
    case PlyType::i16: return binary<std::int16_t>();
    case PlyType::u16: return binary<std::uint16_t>();
    case PlyType::i32: return binary<std::int32_t>();
    case PlyType::u32: return binary<std::uint32_t>();
    case PlyType::f32: return binary<float>();
    case PlyType::f64: return binary<double>();
  }
  return std::nullopt;
}

std::optional<std::size_t> PlyValues::list_size(const PlyProperty& property) {
  const auto count = next(*property.list_count);
  const bool is_held = count && *count >= 0 && *count <= static_cast<double>(bytes_left());
  if (!is_held) return std::nullopt;
  return static_cast<std::size_t>(std::ceil(*count));
}

bool PlyValues::skip_list(const PlyProperty& property) {
  const auto size = list_size(property);
  if (!size) return false;
  for (std::size_t i = 0; i < *size; ++i) {
    if (!next(property.type)) return false;
  }
  return true;
}

std::size_t PlyValues::min_bytes(PlyType type) const {
  return encoding_ == PlyEncoding::text ? 2 : size_of(type);
}

std::optional<Error> check_ply_count(const PlyElement& element, const PlyValues& values) {
  std::size_t row_bytes = 0;
  for (const PlyProperty& property : element.properties) {
    row_bytes += values.min_bytes(property.list_count.value_or(property.type));
  }
  // The last number of a text needs no blank after it.
  if (row_bytes == 0 || element.count <= (values.bytes_left() + 1) / row_bytes) return {};
  return bad_input("is truncated: it announces " + std::to_string(element.count) + " '" +
                   element.name + "' but only " + std::to_string(values.bytes_left()) +
                   " bytes follow");
}

}}  // namespace palpate::v0
