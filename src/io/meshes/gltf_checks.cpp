#include "src/io/meshes/gltf_checks.h"

#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include "src/io/internal/json_shape.h"

namespace palpate { inline namespace v0 { namespace gltf {
namespace {

constexpr std::size_t kMaxJsonDepth = 64;
constexpr int kMaxNodeDepth = 256;
constexpr std::size_t kMaxJsonBytes = std::size_t(64) << 20;
constexpr std::size_t kMaxNodes = 1'000'000;  // and scenes
/// Largest number of vertices and indices of all placed meshes together; less for small files: a
/// number that any file may have, and more for each byte.
constexpr double kMaxElements = 5e7, kElementsOfAny = 2.5e6, kElementsPerByte = 20;

/// The files that buffers name, each once, however it is spelled.
class BufferFiles {
 public:
  struct File {
    std::uint64_t size;
    std::size_t number;  // of the buffer that keeps it
  };

  explicit BufferFiles(const std::filesystem::path& folder) : folder_((folder / "").string()) {}

  /// Finds a file; `number`: of the buffer, which keeps the file if it is the first.
  const File& find(const std::string& name, std::size_t number) {
    const auto [named, is_new] = by_name_.try_emplace(name);
    if (!is_new) return *named->second;
    std::error_code error;
    // Assimp appends the name to the folder, even if it looks like an absolute one.
    const std::filesystem::path path = folder_ + name;
    const bool is_file = std::filesystem::is_regular_file(path, error);
    const std::uintmax_t size = is_file ? std::filesystem::file_size(path, error) : 0;
    if (!is_file || error) {
      throw Fault{"needs " + path.string() + ", which is not a readable file"};
    }
    const std::filesystem::path place = std::filesystem::canonical(path, error);
    const auto file = by_place_.try_emplace(error ? path : place, File{size, number}).first;
    return *(named->second = &file->second);
  }

 private:
  std::string folder_;
  std::map<std::string, const File*> by_name_;
  std::map<std::filesystem::path, File> by_place_;
};

Json buffer_geometry(const Json& buffer) {
  Json kept = Json::object();
  copy_whole(buffer, {"byteLength"}, kept);
  if (const auto uri = buffer.find("uri"); uri != buffer.end()) kept["uri"] = *uri;
  return kept;
}

double element_bytes(const Json& accessor) {
  const std::uint64_t component = whole_member(accessor, "componentType").value_or(0);
  const std::string type = accessor.value("type", "");
  const double bytes = component == 5120 || component == 5121   ? 1
                       : component == 5122 || component == 5123 ? 2
                       : component == 5125 || component == 5126 ? 4
                                                                : 0;
  const double count = type == "SCALAR"                   ? 1
                       : type == "VEC2"                   ? 2
                       : type == "VEC3"                   ? 3
                       : type == "VEC4" || type == "MAT2" ? 4
                       : type == "MAT3"                   ? 9
                       : type == "MAT4"                   ? 16
                                                          : 0;
  return bytes * count;
}

}  // namespace

Json parse_json(std::string_view text) {
  if (text.size() > kMaxJsonBytes) throw Fault{"has more than 64 MiB of JSON; save it as GLB"};
  if (auto fault = JsonShape::fault_of(text, kMaxJsonDepth); !fault.empty()) {
    throw Fault{std::move(fault)};
  }
  Json document = Json::parse(text.begin(), text.end());
  if (!document.is_object()) throw Fault{"is not a glTF file or is truncated"};
  return document;
}

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

Buffers check_buffers(const Json& root, const std::filesystem::path& folder,
                      std::size_t num_file_bytes) {
  BufferFiles files(folder);
  Buffers buffers;
  for (const Json& buffer : list(root, "buffers")) {
    const std::uint64_t length = whole_member(buffer, "byteLength").value_or(0);
    // Those of the GLB, of the data URI, or of the file.
    std::uint64_t num_available = num_file_bytes;
    std::size_t number = buffers.kept.size();
    if (const auto uri = buffer.find("uri"); uri != buffer.end()) {
      if (!uri->is_string()) throw Fault{"has a 'uri' that is not a string"};
      const std::string& name = uri->get_ref<const std::string&>();
      if (name.starts_with("data:")) {
        num_available = name.size();
      } else {
        const BufferFiles::File& file = files.find(name, number);
        num_available = file.size;
        number = file.number;
      }
    }
    if (length > num_available) {
      throw Fault{"is truncated: " + item("buffer", buffers.lengths.size()) + " announces " +
                  std::to_string(length) + " bytes, more than there are"};
    }
    if (number == buffers.kept.size()) {
      buffers.kept.push_back(buffer_geometry(buffer));
    } else if (Json& kept = buffers.kept[number];
               length > kept.value("byteLength", std::uint64_t(0))) {
      kept["byteLength"] = length;
    }
    buffers.lengths.push_back(length);
    buffers.numbers.push_back(number);
  }
  return buffers;
}

std::vector<View> check_views(const Json& root, const Buffers& buffers) {
  std::vector<View> views;
  for (const Json& view : list(root, "bufferViews")) {
    const std::uint64_t length = whole_member(view, "byteLength").value_or(0);
    const std::uint64_t offset = whole_member(view, "byteOffset").value_or(0);
    const std::uint64_t buffer = buffers.lengths[index_into(
        buffers.lengths.size(), whole_member(view, "buffer").value_or(UINT64_MAX), "buffer")];
    if (offset > buffer || length > buffer - offset) {
      throw Fault{"has " + item("bufferView", views.size()) + " that does not fit into its buffer"};
    }
    views.push_back({length, whole_member(view, "byteStride").value_or(0)});
  }
  return views;
}

std::vector<double> check_accessors(const Json& root, const std::vector<View>& views,
                                    std::size_t num_file_bytes) {
  std::vector<double> counts;
  for (const Json& accessor : list(root, "accessors")) {
    const std::string name = item("accessor", counts.size());
    const auto count = static_cast<double>(whole_member(accessor, "count").value_or(0));
    const auto offset = static_cast<double>(whole_member(accessor, "byteOffset").value_or(0));
    if (accessor.contains("sparse")) {
      throw Fault{"has the sparse " + name + ", which is not supported; save plain accessors"};
    }
    const double bytes = element_bytes(accessor);
    if (bytes == 0) throw Fault{"has " + name + " of an unknown type"};
    double available = static_cast<double>(num_file_bytes), stride = bytes;
    if (const auto index = whole_member(accessor, "bufferView")) {
      const View& view = views[index_into(views.size(), *index, "bufferView")];
      available = static_cast<double>(view.length);
      if (view.stride != 0) stride = static_cast<double>(view.stride);
    }
    if (count > 0 && offset + (count - 1) * stride + bytes > available) {
      throw Fault{"is truncated: " + name + " announces " +
                  std::to_string(static_cast<std::uint64_t>(count)) +
                  " elements, more than there are"};
    }
    counts.push_back(count);
  }
  return counts;
}

std::vector<double> check_meshes(const Json& root, const std::vector<double>& counts) {
  std::vector<double> sizes;
  for (const Json& mesh : list(root, "meshes")) {
    double size = 1;
    const auto add = [&](const Json& accessor) {
      size += counts[index_into(counts.size(), whole(accessor, "accessor"), "accessor")];
    };
    for (const Json& primitive : list(mesh, "primitives")) {
      if (!primitive.is_object()) throw Fault{"has a primitive that is not an object"};
      if (primitive.contains("indices")) add(primitive["indices"]);
      Json groups = list(primitive, "targets");
      if (primitive.contains("attributes")) groups.push_back(primitive["attributes"]);
      for (const Json& group : groups) {
        for (const Json& accessor : group) add(accessor);
      }
    }
    sizes.push_back(size);
  }
  return sizes;
}

void check_nodes(const Json& root, const std::vector<double>& mesh_sizes,
                 std::size_t num_file_bytes) {
  const Json& nodes = list(root, "nodes");
  if (nodes.size() + list(root, "scenes").size() > kMaxNodes) {
    throw Fault{"has more than a million nodes and scenes"};
  }
  std::vector<bool> has_parent(nodes.size());
  double num_elements = 0;
  for (const double size : mesh_sizes) num_elements += size;
  for (const Json& node : nodes) {
    for (const Json& child : list(node, "children")) {
      const std::size_t i = index_into(nodes.size(), whole(child, "children"), "node");
      if (has_parent[i]) throw Fault{"has " + item("node", i) + " with two parents"};
      has_parent[i] = true;
    }
    if (const auto mesh = whole_member(node, "mesh")) {
      num_elements += mesh_sizes[index_into(mesh_sizes.size(), *mesh, "mesh")];
    }
  }
  const double most = std::min(
      kMaxElements, kElementsOfAny + kElementsPerByte * static_cast<double>(num_file_bytes));
  if (num_elements > most) {
    throw Fault{"has more than " + std::to_string(static_cast<std::int64_t>(most)) +
                " vertices and indices, repeated meshes included"};
  }
  // Level by level from the roots; what is never reached is a cycle.
  std::vector<std::size_t> level, next;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (!has_parent[i]) level.push_back(i);
  }
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
}

}}}  // namespace palpate::v0::gltf
