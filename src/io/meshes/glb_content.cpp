#include "src/io/meshes/mesh_parsers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <nlohmann/json.hpp>

#include "src/io/meshes/little_endian.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

// Numbers of the glTF 2.0 specification.
constexpr int kFloat = 5126, kUnsignedInt = 5125, kVertices = 34962, kIndices = 34963;

/// Returns a color value as glTF wants it: linear, 0 to 1.
double linear_of(std::uint8_t srgb) {
  const double value = srgb / 255.0;
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

Json material_of(const ColoredMesh& part) {
  Json color = Json::array();
  for (const std::uint8_t value : part.rgb) color.push_back(linear_of(value));
  color.push_back(1.0);
  return {{"name", part.name},
          {"pbrMetallicRoughness",
           {{"baseColorFactor", color}, {"metallicFactor", 0.0}, {"roughnessFactor", 0.8}}}};
}

/// The document and the bytes of its one buffer, part by part.
class GlbWriter {
 public:
  void add(const ColoredMesh& part) {
    const int number = static_cast<int>(meshes_.size());
    const int positions = add_positions(part.mesh), indices = add_indices(part.mesh);
    materials_.push_back(material_of(part));
    meshes_.push_back({{"name", part.name},
                       {"primitives",
                        {{{"attributes", {{"POSITION", positions}}},
                          {"indices", indices},
                          {"material", number}}}}});
    nodes_.push_back({{"name", part.name}, {"mesh", number}});
  }

  std::string finish() const {
    Json children = Json::array(), nodes = nodes_;
    for (std::size_t i = 0; i < nodes_.size(); ++i) children.push_back(i);
    nodes.push_back({{"name", "palpate"}, {"children", children}});
    const Json document{{"asset", {{"version", "2.0"}, {"generator", "Palpate"}}},
                        {"scene", 0},
                        {"scenes", {{{"nodes", {nodes_.size()}}}}},
                        {"nodes", nodes},
                        {"materials", materials_},
                        {"meshes", meshes_},
                        {"accessors", accessors_},
                        {"bufferViews", views_},
                        {"buffers", {{{"byteLength", bytes_.size()}}}}};
    std::string json = document.dump(-1, ' ', false, Json::error_handler_t::replace);
    json.append((4 - json.size() % 4) % 4, ' ');
    std::string glb = "glTF";
    const auto u32 = [&](std::size_t value) {
      append_little_endian(glb, static_cast<std::uint32_t>(value));
    };
    u32(2);
    u32(12 + 8 + json.size() + 8 + bytes_.size());
    u32(json.size());
    glb.append("JSON").append(json);
    u32(bytes_.size());
    return glb.append("BIN\0", 4).append(bytes_);
  }

 private:
  int add_accessor(std::size_t begin, int target, Json accessor) {
    accessor["bufferView"] = views_.size();
    views_.push_back({{"buffer", 0},
                      {"byteOffset", begin},
                      {"byteLength", bytes_.size() - begin},
                      {"target", target}});
    accessors_.push_back(std::move(accessor));
    return static_cast<int>(accessors_.size()) - 1;
  }

  int add_positions(const TriangleMesh& mesh) {
    const std::size_t begin = bytes_.size();
    std::array<float, 3> low, high;
    low.fill(std::numeric_limits<float>::max());
    high.fill(std::numeric_limits<float>::lowest());
    for (const Vec3d& vertex : mesh.vertices) {
      for (int axis = 0; axis < 3; ++axis) {
        const auto value = static_cast<float>(vertex[axis]);
        const auto k = static_cast<std::size_t>(axis);
        low[k] = std::min(low[k], value);
        high[k] = std::max(high[k], value);
        append_little_endian(bytes_, value);
      }
    }
    return add_accessor(begin, kVertices,
                        {{"componentType", kFloat},
                         {"count", mesh.vertices.size()},
                         {"type", "VEC3"},
                         {"min", low},
                         {"max", high}});
  }

  int add_indices(const TriangleMesh& mesh) {
    const std::size_t begin = bytes_.size();
    for (const auto& triangle : mesh.triangles) {
      for (const std::uint32_t index : triangle) append_little_endian(bytes_, index);
    }
    return add_accessor(begin, kIndices,
                        {{"componentType", kUnsignedInt},
                         {"count", 3 * mesh.triangles.size()},
                         {"type", "SCALAR"}});
  }

  Json materials_ = Json::array(), meshes_ = Json::array(), nodes_ = Json::array(),
       accessors_ = Json::array(), views_ = Json::array();
  std::string bytes_;
};

}  // namespace

Result<std::string> glb_content(std::span<const ColoredMesh* const> parts) {
  std::size_t num_bytes = 0;
  for (const ColoredMesh* part : parts) {
    num_bytes += 12 * (part->mesh.vertices.size() + part->mesh.triangles.size());
  }
  if (num_bytes > std::size_t(4'000'000'000)) {
    return Error{Errc::io_failure, "is larger than the 4 GB of a GLB file; write a .ply file"};
  }
  GlbWriter writer;
  for (const ColoredMesh* part : parts) writer.add(*part);
  return writer.finish();
}

}}  // namespace palpate::v0
