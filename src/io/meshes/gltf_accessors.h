// The numbers of a glTF: buffers, their views, and the accessors that lie in them. All sizes and
// offsets are checked against the bytes that there are, before any number is read.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/math/geometry.h"
#include "src/io/meshes/gltf_json.h"

namespace palpate { inline namespace v0 { namespace gltf {

/// Numbers that lie in a buffer. Reading needs an accessor of the matching type.
struct Accessor {
  const char* data = nullptr;  ///< of the first element; null: all numbers are 0
  std::size_t stride = 0;      ///< bytes
  std::size_t count = 0;       ///< elements
  std::uint64_t component = 0;
  std::string type;
  std::size_t number = 0;  ///< in the file
  bool is_sparse = false;  ///< its numbers are not read

  /// Throws a Fault if it is sparse.
  void require_plain() const;
  bool is_positions() const;  ///< three floats each
  bool is_indices() const;    ///< unsigned whole numbers
  Vec3d position(std::size_t i) const;
  std::uint32_t index(std::size_t i) const;
};

class Accessors {
 public:
  /// `bin`: the binary chunk of a GLB. Buffers may be files in `folder`; each is read once, however
  /// often it is named. `num_file_bytes`: size of the whole file. Throws Fault.
  Accessors(const Json& root, std::string_view bin, const std::filesystem::path& folder,
            std::size_t num_file_bytes);
  Accessors(const Accessors&) = delete;  // accessors point into buffers

  std::size_t size() const { return all_.size(); }
  const Accessor& operator[](std::size_t i) const { return all_[i]; }

 private:
  std::vector<std::string> kept_;  // contents of data URIs
  std::map<std::filesystem::path, std::string> files_;
  std::vector<Accessor> all_;
};

}}}  // namespace palpate::v0::gltf
