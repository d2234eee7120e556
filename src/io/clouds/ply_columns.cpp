#include <limits>
#include <string>

#include "src/io/clouds/cloud_columns.h"
#include "src/io/clouds/ply_format.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

/// Reads one row, storing scalar k as row[k].
bool read_row(const PlyElement& element, PlyValues& values, std::vector<double>& row) {
  for (std::size_t k = 0; k < element.properties.size(); ++k) {
    const PlyProperty& property = element.properties[k];
    if (property.list_count) {
      if (!values.skip_list(property)) return false;
      continue;
    }
    const auto value = values.next(property.type);
    if (!value) return false;
    row[k] = *value;
  }
  return true;
}

}  // namespace

Result<CloudColumns> read_ply_columns(std::string_view content,
                                      std::span<const std::string_view> names,
                                      const Vec3d& origin) {
  const auto header = take_ply_header(content);
  if (!header) return header.error();
  PlyValues values(content, header->encoding);
  for (const PlyElement& element : header->elements) {
    const bool is_vertex = element.name == "vertex";
    std::vector<std::size_t> places;
    if (is_vertex) {
      for (const std::string_view name : names) {
        std::size_t place = 0;
        const auto fits = [&](const PlyProperty& property) {
          return property.name == name && !property.list_count &&
                 (property.type == PlyType::f32 || property.type == PlyType::f64);
        };
        while (place < element.properties.size() && !fits(element.properties[place])) ++place;
        if (place == element.properties.size()) return missing_column(name);
        places.push_back(place);
      }
    }
    if (element.properties.empty()) continue;
    if (auto error = check_ply_count(element, values)) return *std::move(error);

    CloudColumns columns;
    if (is_vertex) {
      if (element.count > static_cast<std::uint64_t>(std::numeric_limits<int>::max()))
        return bad_input("has more than 2^31 points; split it");
      columns.width = static_cast<int>(element.count);
      columns.values.assign(names.size(), std::vector<float>(element.count));
    }
    std::vector<double> row(element.properties.size());
    for (std::uint64_t i = 0; i < element.count; ++i) {
      if (!read_row(element, values, row))
        return bad_input("is truncated or damaged at '" + element.name + "' " + std::to_string(i) +
                         " of " + std::to_string(element.count));
      for (std::size_t c = 0; c < places.size(); ++c)
        columns.values[c][i] = narrowed(row[places[c]], c, origin);
    }
    if (is_vertex) return columns;  // Faces do not matter.
  }
  return bad_input("has no element 'vertex'");
}

}}  // namespace palpate::v0
