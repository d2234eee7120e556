// Checks of a glTF file before Assimp reads it. Assimp follows nodes wherever they lead, by
// recursion, and believes counts. Files that would make it run out of stack or memory, or read
// behind a buffer, are refused. All functions throw a Fault.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string_view>
#include <vector>

#include "src/io/meshes/gltf_json.h"

namespace palpate { inline namespace v0 { namespace gltf {

/// Parses a file of bounded size and depth.
Json parse_json(std::string_view text);

/// Refuses extensions that may change the geometry: all that a file requires, but those of looks.
void check_extensions(const Json& root);

/// The buffers of a file, and those of them that Assimp gets.
struct Buffers {
  std::vector<std::uint64_t> lengths;
  std::vector<std::size_t> numbers;  // of each among those that are kept
  Json kept = Json::array();         // one of each file: Assimp would read it for every other, too
};

/// Checks that buffers have the bytes that they announce, and puts together those that are one
/// file.
Buffers check_buffers(const Json& root, const std::filesystem::path& folder,
                      std::size_t num_file_bytes);

/// A bufferView, bytes.
struct View {
  std::uint64_t length, stride;
};

/// Checks that all bufferViews lie within their buffers.
std::vector<View> check_views(const Json& root, const Buffers& buffers);

/// Returns the number of elements of each accessor, all of which lie within their bufferView.
std::vector<double> check_accessors(const Json& root, const std::vector<View>& views,
                                    std::size_t num_file_bytes);

/// Returns the number of vertices and indices of each mesh.
std::vector<double> check_meshes(const Json& root, const std::vector<double>& counts);

/// Checks that nodes form trees of bounded depth, that scenes list only their roots, and that all
/// placed meshes together are not too large.
void check_nodes(const Json& root, const std::vector<double>& mesh_sizes,
                 std::size_t num_file_bytes);

}}}  // namespace palpate::v0::gltf
