// Named columns of numbers, one row per point, as in PLY and PCD files. Errors are the rest of a
// sentence that starts with the name of the file.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// The requested columns, in that order, each width * height long. `origin` is subtracted from the
/// first three, in double.
struct CloudColumns {
  int width = 0, height = 1;
  std::vector<std::vector<float>> values;
  Vec3d eye;  // position of the sensor, VIEWPOINT of a PCD; else the origin
};

/// Columns of the element "vertex" of a PLY file (text or binary, float or double).
Result<CloudColumns> read_ply_columns(std::string_view content,
                                      std::span<const std::string_view> names,
                                      const Vec3d& origin = {});

/// Fields of a PCD file (ascii, binary or binary_compressed; float or double).
Result<CloudColumns> read_pcd_columns(std::string_view content,
                                      std::span<const std::string_view> names,
                                      const Vec3d& origin = {});

/// Narrows a number of column c.
inline float narrowed(double value, std::size_t c, const Vec3d& origin) {
  return static_cast<float>(c < 3 ? value - origin[static_cast<int>(c)] : value);
}

/// The error for a column that is not there.
inline Error missing_column(std::string_view name) {
  return {Errc::bad_input, "has no '" + std::string(name) + "' of type float or double"};
}

}}  // namespace palpate::v0
