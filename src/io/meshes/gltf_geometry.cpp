// The geometry of a glTF file and nothing else, as Assimp can read it. Assimp follows nodes
// wherever they lead, by recursion, believes counts, and crashes on valid skins, images and
// textures: files that would make it run out of stack or memory are refused (gltf_checks.h), and of
// the others it gets only scenes, nodes, the triangles of meshes, and the buffers that hold them.
#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "src/io/meshes/gltf_checks.h"
#include "src/io/meshes/gltf_json.h"
#include "src/io/meshes/mesh_parsers.h"

namespace palpate { inline namespace v0 {
namespace gltf { namespace {

/// Copies a member that is there and is a list of `num` numbers.
void copy_numbers(const Json& from, const char* key, std::size_t num, Json& to) {
  const Json& numbers = list(from, key);
  if (numbers.empty()) return;
  const auto is_number = [](const Json& number) { return number.is_number(); };
  if (numbers.size() != num || !std::all_of(numbers.begin(), numbers.end(), is_number)) {
    throw Fault{std::string("has a '") + key + "' that is not " + std::to_string(num) + " numbers"};
  }
  to[key] = numbers;
}

/// f(item) of each item of a list, as a list.
template <class F>
Json each(const Json& items, const F& f) {
  Json result = Json::array();
  for (const Json& entry : items) result.push_back(f(entry));
  return result;
}

Json node_geometry(const Json& node) {
  Json kept = Json::object();
  copy_whole(node, {"mesh"}, kept);
  copy_numbers(node, "matrix", 16, kept);
  copy_numbers(node, "translation", 3, kept);
  copy_numbers(node, "rotation", 4, kept);
  copy_numbers(node, "scale", 3, kept);
  if (const Json& children = list(node, "children"); !children.empty()) kept["children"] = children;
  return kept;
}

/// Checks types: Assimp takes the numbers of any other types for those of these.
void check_types(const Json& accessors, std::uint64_t corners,
                 std::optional<std::uint64_t> indices) {
  constexpr std::uint64_t kByte = 5121, kShort = 5123, kInt = 5125, kFloat = 5126;
  const auto type = [&](std::uint64_t number) { return accessors[number].value("type", ""); };
  const auto component = [&](std::uint64_t number) {
    return whole_member(accessors[number], "componentType").value_or(0);
  };
  if (type(corners) != "VEC3" || component(corners) != kFloat) {
    throw Fault{"has " + item("accessor", corners) +
                " of positions that are not three floats each (as by KHR_mesh_quantization), which "
                "is not supported; save it without quantization"};
  }
  if (!indices) return;
  const std::uint64_t kind = component(*indices);
  if (type(*indices) != "SCALAR" || (kind != kByte && kind != kShort && kind != kInt)) {
    throw Fault{"has " + item("accessor", *indices) + " of indices that are not whole numbers"};
  }
}

/// Leaves out primitives without triangles: points, lines, and those with no corners or too few.
/// Assimp crashes on a line loop whose indices are wrong, and counts two corners less than none in
/// a strip.
Json mesh_geometry(const Json& mesh, const Json& accessors, const std::vector<double>& counts) {
  constexpr std::uint64_t kTriangles = 4, kTriangleFan = 6;
  Json primitives = Json::array();
  for (const Json& primitive : list(mesh, "primitives")) {
    const std::uint64_t mode = whole_member(primitive, "mode").value_or(kTriangles);
    if (mode > kTriangleFan)
      throw Fault{"has a primitive of the unknown mode " + std::to_string(mode)};
    const auto attributes = primitive.find("attributes");
    if (mode < kTriangles || attributes == primitive.end()) continue;
    const auto corners = whole_member(*attributes, "POSITION");
    const auto indices = whole_member(primitive, "indices");
    if (!corners || counts[indices.value_or(*corners)] < 3) continue;
    check_types(accessors, *corners, indices);
    Json kept = {{"mode", mode}, {"attributes", {{"POSITION", *corners}}}};
    if (indices) kept["indices"] = *indices;
    primitives.push_back(std::move(kept));
  }
  return {{"primitives", std::move(primitives)}};
}

Json accessor_geometry(const Json& accessor) {
  Json kept = {{"type", accessor.value("type", "")}};
  copy_whole(accessor, {"bufferView", "byteOffset", "componentType", "count"}, kept);
  return kept;
}

Json view_geometry(const Json& view, const Buffers& buffers) {
  Json kept = {{"buffer", buffers.numbers[view["buffer"].get<std::size_t>()]}};
  copy_whole(view, {"byteOffset", "byteLength", "byteStride"}, kept);
  return kept;
}

/// Returns the geometry of a checked file, whose accessors have these numbers of elements.
Json geometry_of(const Json& root, const std::vector<double>& counts, Buffers buffers) {
  Json kept = {{"asset", {{"version", "2.0"}}}};
  copy_whole(root, {"scene"}, kept);
  kept["scenes"] = each(list(root, "scenes"), [](const Json& scene) {
    return Json{{"nodes", list(scene, "nodes")}};
  });
  kept["nodes"] = each(list(root, "nodes"), node_geometry);
  kept["meshes"] = each(list(root, "meshes"), [&](const Json& mesh) {
    return mesh_geometry(mesh, list(root, "accessors"), counts);
  });
  kept["accessors"] = each(list(root, "accessors"), accessor_geometry);
  kept["bufferViews"] = each(list(root, "bufferViews"),
                             [&](const Json& view) { return view_geometry(view, buffers); });
  kept["buffers"] = std::move(buffers.kept);
  return kept;
}

}}  // namespace gltf

Result<std::string> gltf_geometry(std::string_view json, const std::filesystem::path& folder,
                                  std::size_t num_file_bytes) try {
  const gltf::Json root = gltf::parse_json(json);
  const auto asset = root.find("asset");
  if (asset == root.end() || !asset->is_object() ||
      !asset->value("version", "").starts_with("2.")) {
    throw gltf::Fault{"is not of glTF version 2"};
  }
  gltf::check_extensions(root);
  gltf::Buffers buffers = gltf::check_buffers(root, folder, num_file_bytes);
  const std::vector<gltf::View> views = gltf::check_views(root, buffers);
  const std::vector<double> counts = gltf::check_accessors(root, views, num_file_bytes);
  gltf::check_nodes(root, gltf::check_meshes(root, counts), num_file_bytes);
  return gltf::geometry_of(root, counts, std::move(buffers))
      .dump(-1, ' ', false, gltf::Json::error_handler_t::replace);
} catch (const gltf::Fault& fault) {
  return Error{Errc::bad_input, fault.what};
} catch (const gltf::Json::exception& error) {
  return Error{Errc::bad_input, "is damaged (" + std::string(error.what()) + ")"};
}

}}  // namespace palpate::v0
