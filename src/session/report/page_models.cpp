#include "src/session/internal/page_models.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "palpate/mesh/mesh.h"
#include "palpate/settings/setting_table.h"
#include "src/math/internal/farthest.h"
#include "src/session/internal/compact_json.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxPixels = 1280 * 1024;  // of all depth images together

Json list(const Vec3d& v) { return {compact(v.x, 6), compact(v.y, 6), compact(v.z, 6)}; }

Json list(const Pose& pose) {
  Json numbers = Json::array();
  for (const double value : seven_numbers(pose)) numbers.push_back(compact(value, 9));
  return numbers;
}

Json mesh_json(const TriangleMesh& mesh) {
  if (mesh.triangles.size() > kMaxPageTriangles) return nullptr;
  std::vector<float> positions;
  for (const Vec3d& p : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) positions.push_back(static_cast<float>(p[axis]));
  }
  std::vector<std::uint32_t> corners;
  for (const auto& triangle : mesh.triangles) {
    corners.insert(corners.end(), triangle.begin(), triangle.end());
  }
  return {{"positions", packed<float>(positions)}, {"triangles", packed<std::uint32_t>(corners)}};
}

/// Keeps every n-th pixel in both directions, so that the frame is not too large for a page.
DepthFrame thinned(const DepthFrame& frame, int n) {
  if (n == 1) return frame;
  DepthFrame thin = frame;
  thin.width = (frame.width + n - 1) / n;
  thin.height = (frame.height + n - 1) / n;
  thin.pixels.clear();
  for (int v = 0; v < frame.height; v += n) {
    for (int u = 0; u < frame.width; u += n) {
      thin.pixels.push_back(frame.pixels[static_cast<std::size_t>(v * frame.width + u)]);
    }
  }
  return thin;
}

/// Packs the difference of each pixel and the one to its left, modulo 2^16: first all low bytes,
/// then all high bytes; by zlib, in base64. Empty if there is no memory for it.
std::string packed_depth(const DepthFrame& frame) {
  const std::size_t num = frame.pixels.size();
  std::vector<Bytef> bytes(2 * num);
  for (std::size_t i = 0; i < num; ++i) {
    const int left = i % static_cast<std::size_t>(frame.width) == 0 ? 0 : frame.pixels[i - 1];
    const auto more = static_cast<std::uint16_t>(frame.pixels[i] - left);
    bytes[i] = static_cast<Bytef>(more & 0xff);
    bytes[num + i] = static_cast<Bytef>(more >> 8);
  }
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  std::string packed(size, '\0');
  if (compress2(reinterpret_cast<Bytef*>(packed.data()), &size, bytes.data(),
                static_cast<uLong>(bytes.size()), Z_BEST_COMPRESSION) != Z_OK) {
    return {};
  }
  packed.resize(size);
  return base64(packed);
}

Json camera_json(const DepthStreamInfo& stream, const DepthFrame& image, int n) {
  const auto& [fx, fy, cx, cy] = stream.intrinsics;
  const DepthFrame frame = thinned(image, n);
  return {{"name", stream.name},  {"X_WC", list(frame.X_WC)},
          {"width", frame.width}, {"height", frame.height},
          {"fx", fx / n},         {"fy", fy / n},
          {"cx", cx / n},         {"cy", cy / n},
          {"unit", frame.unit},   {"depth", packed_depth(frame)}};
}

/// Adds states and planes of the spheres that a page shows, as the viewer's messages have them.
void add_states(Json& json, std::span<const SphereState> states,
                std::span<const Plane<float>> planes) {
  constexpr std::uint8_t kIsCut = 4;
  std::vector<std::uint8_t> bytes;
  std::vector<float> cuts;
  for (std::size_t i = 0; i < states.size(); ++i) {
    const auto [normal, offset] = planes.empty() ? Plane<float>{} : planes[i];
    const bool is_cut = states[i] != SphereState::outside && !(normal == Vec3f{});
    bytes.push_back(static_cast<std::uint8_t>(static_cast<int>(states[i]) | (is_cut ? kIsCut : 0)));
    if (is_cut) cuts.insert(cuts.end(), {normal.x, normal.y, normal.z, offset});
  }
  json["states"] = packed<std::uint8_t>(bytes);
  json["planes"] = packed<float>(cuts);
}

}  // namespace

Json solid_json(const Tool& tool, std::span<const Sphere> spheres) {
  const Bounds box = bounds(tool.mesh());
  return {{"low_m", list(box.low)},
          {"high_m", list(box.high)},
          {"center_of_mass_m", list(tool.sphere_mass().center_of_mass)},
          {"radius_m", compact(farthest(spheres, tool.sphere_mass().center_of_mass))},
          {"spheres", packed<Sphere>(spheres.first(std::min(spheres.size(), kMaxPageSpheres)))},
          {"mesh", mesh_json(tool.mesh())}};
}

Json seen_tool_json(const Tool& tool, const Pose& X_WT, std::span<const DepthStreamInfo> streams,
                    std::span<const DepthFrame> images, std::span<const SphereState> states,
                    std::span<const Plane<float>> planes) {
  // Spheres are stored about by size.
  const std::size_t num_shown = std::min(states.size(), kMaxPageSpheres);
  std::size_t num_pixels = 0;
  for (const DepthFrame& image : images) num_pixels += image.pixels.size();
  const int n =
      static_cast<int>(std::ceil(std::sqrt(static_cast<double>(num_pixels) / kMaxPixels)));
  Json cameras = Json::array();
  for (std::size_t k = 0; k < images.size(); ++k) {
    if (!images[k].pixels.empty()) cameras.push_back(camera_json(streams[k], images[k], n));
  }
  Json json{{"X_WT", list(X_WT)},
            {"center_of_mass_m", list(tool.sphere_mass().center_of_mass)},
            {"radius_m", compact(farthest(tool.spheres(), tool.sphere_mass().center_of_mass))},
            {"spheres", packed<Sphere>(tool.spheres().first(num_shown))},
            {"spheres_left_out", states.size() - num_shown},
            {"mesh", mesh_json(tool.mesh())},
            {"cameras", std::move(cameras)}};
  add_states(json, states.first(num_shown), planes.empty() ? planes : planes.first(num_shown));
  return json;
}

Json seen_objects_json(std::span<const SceneObject> objects, std::span<const Pose> X_WB) {
  Json made = Json::array();
  std::size_t num_triangles = 0;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const TriangleMesh& mesh = objects[i].shape->mesh();
    num_triangles += mesh.triangles.size();
    made.push_back({{"X_WB", list(X_WB[i])},
                    {"mesh", num_triangles > kMaxPageTriangles ? Json() : mesh_json(mesh)}});
  }
  return made;
}

}}  // namespace palpate::v0
