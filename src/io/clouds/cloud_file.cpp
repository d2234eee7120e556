#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include "palpate/io/formats.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/io/clouds/cloud_columns.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/cloud_folder.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::array<std::string_view, 6> kPlyNames{"x", "y", "z", "nx", "ny", "nz"};
constexpr std::array<std::string_view, 6> kPcdNames{"x",        "y",        "z",
                                                    "normal_x", "normal_y", "normal_z"};

Error in_file(const std::filesystem::path& path, const std::string& what) {
  return {Errc::bad_input, path.string() + " " + what};
}

bool is_ply(std::string_view content) {
  return content.starts_with("ply\n") || content.starts_with("ply\r");
}

bool is_pcd(std::string_view content) {
  return content.starts_with("# .PCD") || content.starts_with("VERSION");
}

/// Returns the note about normals that were turned to where the eye stood.
std::string words_of_eye(const std::filesystem::path& path, const Vec3d& eye,
                         std::size_t num_turned, std::size_t num_usable) {
  char text[240] = "";
  const double share = 100.0 * static_cast<double>(num_turned) / static_cast<double>(num_usable);
  if (norm(eye) > 0) {
    std::snprintf(text, sizeof text,
                  ": its VIEWPOINT is (%g, %g, %g): normals are turned to there (%.3g %% of them), "
                  "points stay where they are",
                  eye.x, eye.y, eye.z, num_turned == 0 ? 0 : share);
  } else if (num_turned > 0) {
    std::snprintf(text, sizeof text,
                  ": %.3g %% of its normals pointed away from the camera, which is at the origin: "
                  "they are turned to it",
                  share);
  }
  return *text == '\0' ? "" : path.string() + text;
}

/// Reads a file without the byte order mark that a text may begin with.
Result<std::string> read_unmarked(const std::filesystem::path& path) {
  auto content = read_file(path);
  if (content) content->erase(0, content->size() - without_mark(*content).size());
  return content;
}

Result<std::string> read_cloud_file(const std::filesystem::path& path) {
  auto content = read_unmarked(path);
  if (content && !is_ply(*content) && !is_pcd(*content))
    return in_file(path, "is neither a PLY nor a PCD file; give a cloud in one of these formats");
  return content;
}

/// The first `num` of x, y, z and the three of the normal.
Result<CloudColumns> read_columns(std::string_view content, std::size_t num,
                                  const Vec3d& origin = {}) {
  return is_ply(content) ? read_ply_columns(content, std::span(kPlyNames).first(num), origin)
                         : read_pcd_columns(content, std::span(kPcdNames).first(num), origin);
}

}  // namespace

Result<CloudFile> load_cloud(const std::filesystem::path& path) {
  const auto content = read_cloud_file(path);
  if (!content) return content.error();
  const auto columns = read_columns(*content, kPlyNames.size());
  if (!columns) {
    return in_file(path, columns.error().message +
                             "; a cloud needs x y z and normals (PLY: nx ny nz, PCD: normal_x "
                             "normal_y normal_z), without normals give a depth image instead");
  }
  if (columns->width == 0) return in_file(path, "has no points; give a cloud that has some");
  PointCloud cloud(columns->width, columns->height);
  const auto& v = columns->values;
  const Vec3f eye = to_float(columns->eye);
  std::size_t num_turned = 0, num_usable = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3f p{v[0][i], v[1][i], v[2][i]}, n{v[3][i], v[4][i], v[5][i]};
    const bool is_turned = dot(n, eye - p) < 0;
    cloud.set(i, p, is_turned ? -n : n);
    if (std::isnan(cloud.channel(0)[i])) continue;
    ++num_usable;
    num_turned += is_turned;
  }
  return CloudFile{std::move(cloud), words_of_eye(path, columns->eye, num_turned, num_usable)};
}

Result<PointsFile> load_points(const std::filesystem::path& path, double scale, const Vec3d& eye) {
  const auto content = read_cloud_file(path);
  if (!content) return content.error();
  const Vec3d origin = eye / scale;
  auto columns = read_columns(*content, 6, origin);
  if (!columns) columns = read_columns(*content, 3, origin);
  if (!columns) return in_file(path, columns.error().message + "; a cloud needs x, y and z");
  const auto& v = columns->values;
  if (v[0].size() > kMaxCloudPoints) {
    return in_file(path, "has more than " + std::to_string(kMaxCloudPoints) + " points; thin it");
  }
  PointsFile file{{columns->width, columns->height, {}, {}}, scale * columns->eye};
  const float factor = static_cast<float>(scale);
  const Vec3f nothing = to_float(-origin);  // 0 0 0 is no measurement
  for (std::size_t i = 0; i < v[0].size(); ++i) {
    const Vec3f p{v[0][i], v[1][i], v[2][i]};
    file.cloud.points.push_back(p == nothing ? Vec3f{} : factor * p);
    if (v.size() == 6) file.cloud.normals.push_back({v[3][i], v[4][i], v[5][i]});
  }
  return file;
}

Result<DepthFrame> load_depth_pcd(const std::filesystem::path& path, double unit) {
  if (!(unit > 0) || !std::isfinite(unit))
    return Error{Errc::invalid_argument, "the depth unit must be positive meters per count"};
  const auto content = read_unmarked(path);
  if (!content) return content.error();
  if (!is_pcd(*content)) return in_file(path, "is not a PCD file; give one");
  const auto columns = read_pcd_columns(*content, std::span(kPcdNames).subspan(2, 1));
  if (!columns) return in_file(path, columns.error().message + "; give an organized PCD file");
  if (columns->height < 2)
    return in_file(path, "is not organized like an image (HEIGHT 1); give an organized PCD file");
  if (columns->width > kMaxImageWidth || columns->height > kMaxImageHeight)
    return in_file(path, "is larger than 4096 x 4096 points; give a smaller image");
  DepthFrame frame{columns->width, columns->height, unit, {}, 0};
  frame.pixels.reserve(columns->values[0].size());
  for (const float z : columns->values[0]) frame.pixels.push_back(count_of(double(z), unit));
  return frame;
}

Status save_cloud_ply(const PointCloudView& cloud, const std::filesystem::path& path) {
  static_assert(std::endian::native == std::endian::little, "written as little endian");
  std::size_t num_valid = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) num_valid += !std::isnan(cloud.x[i]);
  std::string text =
      "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(num_valid) + "\n";
  for (const std::string_view name : kPlyNames)
    text.append("property float ").append(name).append("\n");
  text += "end_header\n";
  text.reserve(text.size() + num_valid * kPlyNames.size() * sizeof(float));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (std::isnan(cloud.x[i])) continue;
    const std::array<float, 6> row{cloud.x[i],  cloud.y[i],  cloud.z[i],
                                   cloud.nx[i], cloud.ny[i], cloud.nz[i]};
    text.append(reinterpret_cast<const char*>(row.data()), sizeof(row));
  }
  return write_file_atomically(path, text);
}

}}  // namespace palpate::v0
