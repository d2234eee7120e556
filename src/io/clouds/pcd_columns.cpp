#include <lzf.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>

#include "src/io/clouds/cloud_columns.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

static_assert(std::endian::native == std::endian::little, "PCD files are read as they lie");

struct Field {
  std::string_view name;
  char type = 'F';
  std::size_t size = 4, count = 1;
  std::size_t first_word = 0;  ///< of a row as text
  std::size_t offset = 0;      ///< in a binary row
};

struct Header {
  std::vector<Field> fields;
  std::uint64_t width = 0, height = 0;
  std::string_view encoding;
  std::size_t words_per_row = 0, bytes_per_row = 0;
  Vec3d eye;
};

/// One word per field; false if there are more or fewer, or one is not acceptable.
template <class Accept>
bool for_each_field(std::vector<Field>& fields, std::string_view rest, Accept&& accept) {
  for (Field& field : fields) {
    const std::string_view word = take_word(rest);
    if (word.empty() || !accept(field, word)) return false;
  }
  return !fields.empty() && take_word(rest).empty();
}

/// Reads one line of the header; false if it is not acceptable.
bool parse_header_line(std::string_view key, std::string_view rest, Header& header,
                       std::optional<std::uint64_t>& num_points) {
  constexpr std::uint64_t kMaxCount = 1 << 16;
  const auto number = [&](std::string_view word) { return parse_number<std::uint64_t>(word); };
  if (key == "VERSION") return true;
  if (key == "VIEWPOINT") {
    // Then its rotation, which changes no point.
    for (int axis = 0; axis < 3; ++axis) {
      header.eye[axis] = parse_number<double>(take_word(rest)).value_or(0);
    }
    return std::isfinite(norm(header.eye));
  }
  if (key == "FIELDS" || key == "COLUMNS") {
    for (auto word = take_word(rest); !word.empty(); word = take_word(rest))
      header.fields.push_back({word});
    return !header.fields.empty() && header.fields.size() <= kMaxCount;
  }
  if (key == "SIZE") {
    return for_each_field(header.fields, rest, [&](Field& field, std::string_view word) {
      field.size = number(word).value_or(0);
      return field.size == 1 || field.size == 2 || field.size == 4 || field.size == 8;
    });
  }
  if (key == "TYPE") {
    return for_each_field(header.fields, rest, [](Field& field, std::string_view word) {
      field.type = word[0];
      return word == "F" || word == "I" || word == "U";
    });
  }
  if (key == "COUNT") {
    return for_each_field(header.fields, rest, [&](Field& field, std::string_view word) {
      field.count = number(word).value_or(0);
      return field.count >= 1 && field.count <= kMaxCount;
    });
  }
  const std::string_view word = take_word(rest);
  if (key == "DATA") {
    header.encoding = word;
    return word == "ascii" || word == "binary" || word == "binary_compressed";
  }
  const auto value = number(word);
  if (key == "WIDTH") header.width = value.value_or(0);
  if (key == "HEIGHT") header.height = value.value_or(0);
  if (key == "POINTS") num_points = value;
  return value.has_value() && (key == "WIDTH" || key == "HEIGHT" || key == "POINTS");
}

Result<Header> take_header(std::string_view& content) {
  Header header;
  std::optional<std::uint64_t> num_points;
  while (!content.empty() && header.encoding.empty()) {
    const std::string_view line = take_line(content);
    std::string_view rest = line;
    const std::string_view key = take_word(rest);
    if (key.empty() || key.starts_with('#')) continue;
    if (!parse_header_line(key, rest, header, num_points))
      return bad_input("has a bad header line '" + std::string(line.substr(0, 80)) + "'");
  }
  if (header.encoding.empty()) return bad_input("is truncated: its header has no line 'DATA'");
  constexpr std::uint64_t kMaxSide = std::numeric_limits<int>::max();
  if (header.fields.empty() || header.width == 0 || header.height == 0)
    return bad_input("has no points: its header has no fields, or WIDTH or HEIGHT 0");
  if (header.width > kMaxSide || header.height > kMaxSide ||
      header.width * header.height > kMaxSide)
    return bad_input("claims more than 2^31 points");
  if (num_points && *num_points != header.width * header.height)
    return bad_input("claims " + std::to_string(*num_points) +
                     " points, which is not WIDTH x HEIGHT");
  for (Field& field : header.fields) {
    field.first_word = header.words_per_row;
    field.offset = header.bytes_per_row;
    header.words_per_row += field.count;
    header.bytes_per_row += field.count * field.size;
  }
  return header;
}

const Field* find_field(const Header& header, std::string_view name) {
  for (const Field& field : header.fields) {
    const bool is_real = field.type == 'F' && (field.size == 4 || field.size == 8);
    if (field.name == name && field.count == 1 && is_real) return &field;
  }
  return nullptr;
}

double load_real(const char* bytes, std::size_t size) {
  if (size == sizeof(float)) {
    float value;
    std::memcpy(&value, bytes, sizeof(value));
    return static_cast<double>(value);
  }
  double value;
  std::memcpy(&value, bytes, sizeof(value));
  return value;
}

Error truncated(const Header& header) {
  return bad_input("is truncated: it claims " + std::to_string(header.width) + " x " +
                   std::to_string(header.height) +
                   " points, which the rest of the file cannot hold");
}

/// Unpacks the body of a binary_compressed file, where each field lies in one piece.
Result<std::string> decompress(std::string_view content, const Header& header) {
  // LZF could copy 264 bytes for 3; clouds shrink to a third, and those without points are small.
  constexpr std::uint64_t kSmall = std::uint64_t{64} << 20, kMaxRatio = 25;
  std::uint32_t sizes[2];  // packed, unpacked
  if (content.size() < sizeof(sizes)) return truncated(header);
  std::memcpy(sizes, content.data(), sizeof(sizes));
  content.remove_prefix(sizeof(sizes));
  const std::uint64_t num_bytes = header.width * header.height * header.bytes_per_row;
  if (sizes[0] > content.size() || num_bytes > kSmall + kMaxRatio * sizes[0]) {
    return truncated(header);
  }
  if (sizes[1] != num_bytes)
    return bad_input("is damaged: its unpacked size does not fit its header");
  std::string result(num_bytes, '\0');
  if (lzf_decompress(content.data(), sizes[0], result.data(), sizes[1]) != sizes[1])
    return bad_input("is damaged: it cannot be unpacked");
  return result;
}

std::optional<Error> read_text(std::string_view content, const Header& header,
                               std::span<const Field* const> fields, const Vec3d& origin,
                               CloudColumns& columns) {
  std::vector<std::string_view> words(header.words_per_row);
  const std::size_t num_points = columns.values[0].size();
  for (std::size_t i = 0; i < num_points; ++i) {
    for (std::string_view& word : words) {
      word = take_word(content);
      if (word.empty()) return truncated(header);
    }
    for (std::size_t c = 0; c < fields.size(); ++c) {
      const auto value = parse_number<double>(words[fields[c]->first_word]);
      if (!value) return bad_input("is damaged: point " + std::to_string(i) + " has a bad number");
      columns.values[c][i] = narrowed(*value, c, origin);
    }
  }
  return std::nullopt;
}

}  // namespace

Result<CloudColumns> read_pcd_columns(std::string_view content,
                                      std::span<const std::string_view> names,
                                      const Vec3d& origin) {
  const auto header = take_header(content);
  if (!header) return header.error();
  std::vector<const Field*> fields;
  for (const std::string_view name : names) {
    fields.push_back(find_field(*header, name));
    if (fields.back() == nullptr) return missing_column(name);
  }

  // A number as text takes at least one byte and a blank.
  const std::uint64_t num_points = header->width * header->height;
  const bool is_text = header->encoding == "ascii", is_packed = header->encoding != "binary";
  const std::uint64_t row_bytes = is_text ? 2 * header->words_per_row : header->bytes_per_row;
  std::string unpacked;
  if (!is_text && is_packed) {
    auto body = decompress(content, *header);
    if (!body) return body.error();
    unpacked = *std::move(body);
    content = unpacked;
  }
  if (num_points > (content.size() + 1) / row_bytes) return truncated(*header);

  CloudColumns columns{
      static_cast<int>(header->width), static_cast<int>(header->height), {}, header->eye};
  columns.values.assign(names.size(), std::vector<float>(num_points));
  if (is_text) {
    if (auto error = read_text(content, *header, fields, origin, columns)) return *std::move(error);
    return columns;
  }
  if (content.size() / row_bytes < num_points) return truncated(*header);
  for (std::size_t c = 0; c < fields.size(); ++c) {
    const Field& field = *fields[c];
    const char* first = content.data() + field.offset * (is_packed ? num_points : 1);
    const std::size_t step = is_packed ? field.size : row_bytes;
    for (std::size_t i = 0; i < num_points; ++i)
      columns.values[c][i] = narrowed(load_real(first + i * step, field.size), c, origin);
  }
  return columns;
}

}}  // namespace palpate::v0
