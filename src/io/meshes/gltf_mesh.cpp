// Meshes of glTF 2.0 files: the triangles of all meshes that the nodes of a scene place, joined.
//
// Materials, skins, animations, points and lines are left out, as they have no shape. Morph targets
// move vertices by the weights of the node or the mesh. Nodes are trees of bounded depth, counts
// are bounded by the size of the file, and what may change shapes and is not supported is refused
// by name.
#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "src/io/internal/json_shape.h"
#include "src/io/meshes/gltf_accessors.h"
#include "src/io/meshes/little_endian.h"
#include "src/io/meshes/mesh_parsers.h"

namespace palpate { inline namespace v0 {
namespace gltf { namespace {

constexpr std::size_t kMaxJsonDepth = 64;
constexpr int kMaxNodeDepth = 256;
constexpr std::size_t kMaxJsonBytes = std::size_t(64) << 20;
constexpr std::size_t kMaxNodes = 1'000'000;  // and scenes
/// Vertices and indices of all placed meshes together; of small files fewer, for so many bytes.
constexpr double kMaxElements = 5e7, kElementsOfAny = 2.5e6, kElementsPerByte = 20;
/// Modes of primitives; those below are points and lines.
constexpr std::uint64_t kTriangles = 4, kTriangleStrip = 5, kTriangleFan = 6;

Json parse_json(std::string_view text) {
  if (text.size() > kMaxJsonBytes) throw Fault{"has more than 64 MiB of JSON; save it as GLB"};
  if (auto fault = JsonShape::fault_of(text, kMaxJsonDepth); !fault.empty()) {
    throw Fault{std::move(fault)};
  }
  Json document = Json::parse(text.begin(), text.end());
  if (!document.is_object()) throw Fault{"is not a glTF file or is truncated"};
  const auto asset = document.find("asset");
  if (asset == document.end() || !asset->is_object() ||
      !asset->value("version", "").starts_with("2.")) {
    throw Fault{"is not of glTF version 2"};
  }
  return document;
}

/// Extensions of looks alone: all others that a file requires may change its geometry.
void check_extensions(const Json& root) {
  constexpr std::string_view kLooks[] = {"KHR_materials_", "KHR_texture_", "EXT_texture_",
                                         "MSFT_texture_", "KHR_lights_"};
  for (const Json& required : list(root, "extensionsRequired")) {
    if (!required.is_string()) throw Fault{"requires an extension without a name"};
    const std::string name = required.get<std::string>();
    const auto begins = [&](std::string_view start) { return name.starts_with(start); };
    if (std::ranges::any_of(kLooks, begins)) continue;
    throw Fault{"needs the extension " + name.substr(0, 80) +
                ", which is not supported; save it without compression, quantization and the like"};
  }
}

// Meshes.

struct MorphTarget {
  std::size_t number = 0;  ///< that of its weight
  const Accessor* offsets = nullptr;
};

struct Primitive {
  std::uint64_t mode = kTriangles;
  const Accessor* positions = nullptr;
  std::vector<MorphTarget> targets;   ///< those that move positions
  const Accessor* indices = nullptr;  ///< null: positions in their order

  std::size_t num_corners() const { return (indices ? indices : positions)->count; }
  std::uint32_t corner(std::size_t i) const {
    return indices ? indices->index(i) : static_cast<std::uint32_t>(i);
  }
};

struct Mesh {
  std::vector<Primitive> primitives;  ///< with triangles
  std::vector<double> weights;        ///< of morph targets, unless a node has its own
  double num_elements = 1;            ///< vertices and indices, of everything in it
};

void check_positions(const Accessor& positions) {
  positions.require_plain();
  if (positions.is_positions()) return;
  throw Fault{"has " + item("accessor", positions.number) +
              " of positions that are not three floats each (as by KHR_mesh_quantization), which "
              "is not supported; save it without quantization"};
}

void check_indices(const Accessor& indices) {
  indices.require_plain();
  if (indices.is_indices()) return;
  throw Fault{"has " + item("accessor", indices.number) + " of indices that are not whole numbers"};
}

/// Returns the weights of a mesh or a node; none if it has none.
std::vector<double> weights_of(const Json& object) {
  std::vector<double> weights;
  for (const Json& weight : list(object, "weights")) {
    if (!weight.is_number()) throw Fault{"has 'weights' that are not numbers"};
    weights.push_back(weight.get<double>());
  }
  return weights;
}

Mesh mesh_of(const Json& described, const Accessors& accessors) {
  Mesh mesh;
  mesh.weights = weights_of(described);
  const auto find = [&](const Json& number) {
    return &accessors[index_into(accessors.size(), whole(number, "accessor"), "accessor")];
  };
  for (const Json& entry : list(described, "primitives")) {
    if (!entry.is_object()) throw Fault{"has a primitive that is not an object"};
    Primitive primitive;
    primitive.mode = whole_member(entry, "mode").value_or(kTriangles);
    if (primitive.mode > kTriangleFan) {
      throw Fault{"has a primitive of the unknown mode " + std::to_string(primitive.mode)};
    }
    if (const auto indices = entry.find("indices"); indices != entry.end()) {
      primitive.indices = find(*indices);
      mesh.num_elements += static_cast<double>(primitive.indices->count);
    }
    const auto count = [&](const Json& group) {
      for (const Json& number : group) {
        mesh.num_elements += static_cast<double>(find(number)->count);
      }
    };
    const Json& targets = list(entry, "targets");
    for (std::size_t i = 0; i < targets.size(); ++i) {
      require_object(targets[i], "targets");
      count(targets[i]);
      ++mesh.num_elements;
      if (const auto offsets = targets[i].find("POSITION"); offsets != targets[i].end()) {
        primitive.targets.push_back({i, find(*offsets)});
      }
    }
    const auto attributes = entry.find("attributes");
    if (attributes != entry.end()) count(*attributes);
    if (primitive.mode < kTriangles || attributes == entry.end()) continue;
    require_object(*attributes, "attributes");
    if (!attributes->contains("POSITION")) continue;
    primitive.positions = find((*attributes)["POSITION"]);
    if (primitive.num_corners() < 3) continue;
    mesh.primitives.push_back(std::move(primitive));
  }
  return mesh;
}

// Nodes.

/// x_parent = x a.x + y a.y + z a.z + a.t.
struct Placement {
  Vec3d x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1}, t;

  Vec3d turned(const Vec3d& v) const { return x * v.x + y * v.y + z * v.z; }
  Vec3d operator()(const Vec3d& p) const { return turned(p) + t; }
  Placement operator*(const Placement& b) const {
    return {turned(b.x), turned(b.y), turned(b.z), (*this)(b.t)};
  }
  bool is_mirrored() const { return dot(cross(x, y), z) < 0; }
};

/// Returns a member that is a list of numbers; none if it is absent or empty.
template <std::size_t kNum>
std::optional<std::array<double, kNum>> numbers(const Json& node, const char* key) {
  const Json& given = list(node, key);
  if (given.empty()) return std::nullopt;
  const auto is_number = [](const Json& number) { return number.is_number(); };
  if (given.size() != kNum || !std::ranges::all_of(given, is_number)) {
    throw Fault{std::string("has a '") + key + "' that is not " + std::to_string(kNum) +
                " numbers"};
  }
  std::array<double, kNum> all;
  for (std::size_t i = 0; i < kNum; ++i) all[i] = given[i].get<double>();
  return all;
}

Placement placement_of(const Json& node) {
  Placement to;
  if (const auto m = numbers<16>(node, "matrix")) {
    const auto column = [&](std::size_t k) {
      return Vec3d{(*m)[4 * k], (*m)[4 * k + 1], (*m)[4 * k + 2]};
    };
    to = {column(0), column(1), column(2), column(3)};
  }
  if (const auto q = numbers<4>(node, "rotation")) {
    const Quaternion rotation{(*q)[0], (*q)[1], (*q)[2], (*q)[3]};
    const double length = std::hypot(std::hypot((*q)[0], (*q)[1]), std::hypot((*q)[2], (*q)[3]));
    if (!(length > 0)) throw Fault{"has a 'rotation' of length zero"};
    const Quaternion unit = normalized(rotation);
    to = to *
         Placement{rotate(unit, {1, 0, 0}), rotate(unit, {0, 1, 0}), rotate(unit, {0, 0, 1}), {}};
  }
  if (const auto s = numbers<3>(node, "scale")) {
    to.x *= (*s)[0];
    to.y *= (*s)[1];
    to.z *= (*s)[2];
  }
  if (const auto t = numbers<3>(node, "translation"))
    to.t = to.t + Vec3d{(*t)[0], (*t)[1], (*t)[2]};
  return to;
}

/// Checks that nodes form trees of bounded depth and that scenes list only their roots. Returns
/// which nodes are roots.
std::vector<std::size_t> check_nodes(const Json& root, const std::vector<Mesh>& meshes,
                                     std::size_t num_file_bytes) {
  const Json& nodes = list(root, "nodes");
  if (nodes.size() + list(root, "scenes").size() > kMaxNodes) {
    throw Fault{"has more than a million nodes and scenes"};
  }
  std::vector<bool> has_parent(nodes.size());
  double num_elements = 0;
  for (const Mesh& mesh : meshes) num_elements += mesh.num_elements;
  for (const Json& node : nodes) {
    for (const Json& child : list(node, "children")) {
      const std::size_t i = index_into(nodes.size(), whole(child, "children"), "node");
      if (has_parent[i]) throw Fault{"has " + item("node", i) + " with two parents"};
      has_parent[i] = true;
    }
    if (const auto mesh = whole_member(node, "mesh")) {
      num_elements += meshes[index_into(meshes.size(), *mesh, "mesh")].num_elements;
    }
  }
  const double most = std::min(
      kMaxElements, kElementsOfAny + kElementsPerByte * static_cast<double>(num_file_bytes));
  if (num_elements > most) {
    throw Fault{"has more than " + std::to_string(static_cast<std::int64_t>(most)) +
                " vertices and indices, repeated meshes included"};
  }
  // Level by level from the roots; what is never reached is a cycle.
  std::vector<std::size_t> roots, level, next;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (!has_parent[i]) roots.push_back(i);
  }
  level = roots;
  std::size_t num_reached = 0;
  for (int depth = 1; !level.empty(); ++depth) {
    if (depth > kMaxNodeDepth) {
      throw Fault{"nests more than " + std::to_string(kMaxNodeDepth) + " levels of nodes"};
    }
    num_reached += level.size();
    next.clear();
    for (const std::size_t i : level) {
      for (const Json& child : list(nodes[i], "children")) next.push_back(child.get<std::size_t>());
    }
    level.swap(next);
  }
  if (num_reached != nodes.size()) throw Fault{"has nodes that are their own ancestors"};
  std::size_t scene_number = 0;
  std::vector<std::size_t> listed_by(nodes.size());  // the last scene that lists it, from 1
  for (const Json& scene : list(root, "scenes")) {
    ++scene_number;
    for (const Json& entry : list(scene, "nodes")) {
      const std::size_t i = index_into(nodes.size(), whole(entry, "nodes"), "node");
      if (listed_by[i] == scene_number || has_parent[i]) {
        throw Fault{"has a scene that places " + item("node", i) + " twice"};
      }
      listed_by[i] = scene_number;
    }
  }
  return roots;
}

/// Returns the targets that move vertices, each after its weight.
std::vector<std::pair<double, const Accessor*>> moving_targets(const Primitive& primitive,
                                                               std::span<const double> weights) {
  std::vector<std::pair<double, const Accessor*>> moving;
  for (const auto& [number, offsets] : primitive.targets) {
    if (number >= weights.size() || weights[number] == 0) continue;
    check_positions(*offsets);
    if (offsets->count != primitive.positions->count) {
      throw Fault{"has a morph target of " + std::to_string(offsets->count) + " vertices for " +
                  std::to_string(primitive.positions->count)};
    }
    moving.emplace_back(weights[number], offsets);
  }
  return moving;
}

/// Adds the placed triangles of a primitive, and those of its vertices that they use, in the order
/// of the file.
void add_primitive(const Primitive& primitive, std::span<const double> weights,
                   const Placement& placement, TriangleMesh& mesh) {
  constexpr std::uint32_t kUnused = UINT32_MAX;
  check_positions(*primitive.positions);
  if (primitive.indices) check_indices(*primitive.indices);
  const bool is_list = primitive.mode == kTriangles, is_mirrored = placement.is_mirrored();
  const std::size_t num_corners = primitive.num_corners();
  if (is_list && num_corners % 3 != 0) {
    throw Fault{"has a list of triangles with " + std::to_string(num_corners) + " corners"};
  }
  std::vector<std::uint32_t> added(primitive.positions->count, kUnused);
  for (std::size_t i = 0; i < num_corners; ++i) {
    added[index_into(added.size(), primitive.corner(i), "vertex")] = 0;
  }
  const auto targets = moving_targets(primitive, weights);
  for (std::size_t i = 0; i < added.size(); ++i) {
    if (added[i] == kUnused) continue;
    added[i] = static_cast<std::uint32_t>(mesh.vertices.size());
    Vec3d p = primitive.positions->position(i);
    for (const auto& [weight, offsets] : targets) p += offsets->position(i) * weight;
    mesh.vertices.push_back(placement(p));
  }
  const auto vertex = [&](std::size_t corner) { return added[primitive.corner(corner)]; };
  const std::size_t num_triangles = is_list ? num_corners / 3 : num_corners - 2;
  for (std::size_t i = 0; i < num_triangles; ++i) {
    const std::size_t first = is_list ? 3 * i : i;
    const std::uint32_t a = vertex(primitive.mode == kTriangleFan ? 0 : first);
    std::uint32_t b = vertex(first + 1), c = vertex(first + 2);
    const bool is_odd = primitive.mode == kTriangleStrip && i % 2 == 1;
    if (is_odd != is_mirrored) std::swap(b, c);
    mesh.triangles.push_back({a, b, c});
  }
}

/// Adds the meshes of a node and of those below it.
void add_node(const Json& nodes, std::size_t i, const Placement& parent,
              const std::vector<Mesh>& meshes, TriangleMesh& mesh) {
  const Placement placement = parent * placement_of(nodes[i]);
  if (const auto number = whole_member(nodes[i], "mesh")) {
    const Mesh& placed = meshes[*number];
    const std::vector<double> own = weights_of(nodes[i]);
    for (const Primitive& primitive : placed.primitives) {
      add_primitive(primitive, own.empty() ? placed.weights : own, placement, mesh);
    }
  }
  for (const Json& child : list(nodes[i], "children")) {
    add_node(nodes, child.get<std::size_t>(), placement, meshes, mesh);
  }
}

TriangleMesh read(std::string_view json, std::string_view bin, const std::filesystem::path& folder,
                  std::size_t num_file_bytes) {
  const Json root = parse_json(json);
  check_extensions(root);
  const Accessors accessors(root, bin, folder, num_file_bytes);
  std::vector<Mesh> meshes;
  for (const Json& mesh : list(root, "meshes")) meshes.push_back(mesh_of(mesh, accessors));
  std::vector<std::size_t> roots = check_nodes(root, meshes, num_file_bytes);

  const Json& scenes = list(root, "scenes");
  if (!scenes.empty()) {
    const std::size_t scene =
        index_into(scenes.size(), whole_member(root, "scene").value_or(0), "scene");
    roots.clear();
    for (const Json& entry : list(scenes[scene], "nodes"))
      roots.push_back(entry.get<std::size_t>());
  }
  TriangleMesh mesh;
  for (const std::size_t i : roots) add_node(list(root, "nodes"), i, {}, meshes, mesh);
  return mesh;
}

}}  // namespace gltf

Result<TriangleMesh> parse_gltf(std::string_view json, std::string_view bin,
                                const std::filesystem::path& folder,
                                std::size_t num_file_bytes) try {
  return gltf::read(json, bin, folder, num_file_bytes);
} catch (const gltf::Fault& fault) {
  return Error{Errc::bad_input, fault.what};
} catch (const gltf::Json::exception& error) {
  return Error{Errc::bad_input, "is damaged (" + std::string(error.what()) + ")"};
}

Result<TriangleMesh> parse_glb(std::string_view content, const std::filesystem::path& folder) {
  constexpr std::size_t kFileHeader = 12, kChunkHeader = 8, kHeader = kFileHeader + kChunkHeader;
  if (content.size() < kHeader || !content.starts_with("glTF") ||
      little_endian_at<std::uint32_t>(content.data() + 4) != 2 || content.substr(16, 4) != "JSON") {
    return Error{Errc::bad_input, "is not a GLB file of version 2"};
  }
  const std::size_t size = little_endian_at<std::uint32_t>(content.data() + 8),
                    json_size = little_endian_at<std::uint32_t>(content.data() + kFileHeader);
  const auto truncated = [&](std::size_t announced) {
    return Error{Errc::bad_input, "is truncated: it announces " + std::to_string(announced) +
                                      " bytes but has only " + std::to_string(content.size())};
  };
  if (size > content.size() || json_size > content.size() - kHeader) {
    return truncated(std::max(size, json_size));
  }
  std::string_view bin = content.substr(kHeader + json_size);
  if (bin.size() >= kChunkHeader && bin.substr(4, 4) == std::string_view("BIN\0", 4)) {
    const std::size_t bin_size = little_endian_at<std::uint32_t>(bin.data());
    if (bin_size > bin.size() - kChunkHeader) return truncated(bin_size);
    bin = bin.substr(kChunkHeader, bin_size);
  } else {
    bin = {};
  }
  return parse_gltf(content.substr(kHeader, json_size), bin, folder, content.size());
}

}}  // namespace palpate::v0
