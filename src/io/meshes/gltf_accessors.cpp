#include "src/io/meshes/gltf_accessors.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "src/io/internal/atomic_file.h"
#include "src/io/internal/base64.h"
#include "src/io/internal/file_names.h"
#include "src/io/meshes/little_endian.h"

namespace palpate { inline namespace v0 { namespace gltf {
namespace {

constexpr std::size_t kMaxBufferBytes = std::size_t(2) << 30;
constexpr std::uint64_t kByte = 5121, kShort = 5123, kInt = 5125, kFloat = 5126;  // unsigned ones

std::string data_of(std::string_view uri) {
  const std::size_t comma = uri.find(',');
  if (comma == uri.npos || !uri.substr(0, comma).ends_with(";base64")) {
    throw Fault{"has a data URI that is not base64; save it as GLB"};
  }
  auto bytes = bytes_of_base64(uri.substr(comma + 1));
  if (!bytes) throw Fault{"has a data URI with damaged base64"};
  return *std::move(bytes);
}

/// The files that buffers name, each read once, however it is spelled.
class BufferFiles {
 public:
  explicit BufferFiles(const std::filesystem::path& folder) : folder_((folder / "").string()) {}

  const std::string& read(const std::string& uri) {
    const auto [named, is_new] = by_name_.try_emplace(uri);
    if (!is_new) return *named->second;
    std::error_code error;
    // Below the folder, even if the name looks like an absolute path.
    std::filesystem::path path = folder_ + uri;
    if (!std::filesystem::is_regular_file(path, error)) path = folder_ + unescaped(uri);
    const std::filesystem::path place = std::filesystem::canonical(path, error);
    if (error || !std::filesystem::is_regular_file(place, error)) {
      throw Fault{"needs " + folder_ + uri + ", which is not a readable file"};
    }
    const auto [file, is_unread] = by_place_.try_emplace(place);
    if (is_unread) {
      auto content = read_file(place, kMaxBufferBytes);
      if (!content) throw Fault{"needs a file that cannot be read: " + content.error().message};
      file->second = *std::move(content);
    }
    return *(named->second = &file->second);
  }

  /// Moves what was read out, in any order.
  std::map<std::filesystem::path, std::string> take() { return std::move(by_place_); }

 private:
  std::string folder_;
  std::map<std::string, const std::string*> by_name_;
  std::map<std::filesystem::path, std::string> by_place_;
};

struct View {
  std::string_view bytes;
  std::uint64_t stride = 0;
};

std::vector<View> views_of(const Json& root, const std::vector<std::string_view>& buffers) {
  std::vector<View> views;
  for (const Json& view : list(root, "bufferViews")) {
    const std::uint64_t length = whole_member(view, "byteLength").value_or(0);
    const std::uint64_t offset = whole_member(view, "byteOffset").value_or(0);
    const std::string_view buffer = buffers[index_into(
        buffers.size(), whole_member(view, "buffer").value_or(UINT64_MAX), "buffer")];
    if (offset > buffer.size() || length > buffer.size() - offset) {
      throw Fault{"has " + item("bufferView", views.size()) + " that does not fit into its buffer"};
    }
    views.push_back({buffer.substr(offset, length), whole_member(view, "byteStride").value_or(0)});
  }
  return views;
}

std::size_t component_bytes(std::uint64_t component) {
  switch (component) {
    case 5120:
    case kByte: return 1;
    case 5122:
    case kShort: return 2;
    case kInt:
    case kFloat: return 4;
    default: return 0;
  }
}

std::size_t num_components(std::string_view type) {
  constexpr std::pair<std::string_view, std::size_t> kTypes[] = {
      {"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4}, {"MAT2", 4}, {"MAT3", 9}, {"MAT4", 16}};
  for (const auto& [name, num] : kTypes) {
    if (name == type) return num;
  }
  return 0;
}

}  // namespace

void Accessor::require_plain() const {
  if (!is_sparse) return;
  throw Fault{"has the sparse " + item("accessor", number) +
              ", which is not supported; save plain accessors"};
}

bool Accessor::is_positions() const { return type == "VEC3" && component == kFloat; }

bool Accessor::is_indices() const {
  return type == "SCALAR" && (component == kByte || component == kShort || component == kInt);
}

Vec3d Accessor::position(std::size_t i) const {
  Vec3d p;
  for (int axis = 0; axis < 3 && data != nullptr; ++axis) {
    p[axis] = static_cast<double>(little_endian_at<float>(data + i * stride + 4 * axis));
    if (!std::isfinite(p[axis])) throw Fault{"has a position that is not finite"};
  }
  return p;
}

std::uint32_t Accessor::index(std::size_t i) const {
  if (data == nullptr) return 0;
  const char* const at = data + i * stride;
  return component == kByte    ? little_endian_at<std::uint8_t>(at)
         : component == kShort ? little_endian_at<std::uint16_t>(at)
                               : little_endian_at<std::uint32_t>(at);
}

Accessors::Accessors(const Json& root, std::string_view bin, const std::filesystem::path& folder,
                     std::size_t num_file_bytes) {
  const Json& described = list(root, "buffers");
  kept_.reserve(described.size());  // short strings move with their characters
  BufferFiles files(folder);
  std::vector<std::string_view> buffers;
  for (const Json& buffer : described) {
    const std::uint64_t length = whole_member(buffer, "byteLength").value_or(0);
    std::string_view bytes = buffers.empty() ? bin : std::string_view();
    if (const auto uri = buffer.find("uri"); uri != buffer.end()) {
      if (!uri->is_string()) throw Fault{"has a 'uri' that is not a string"};
      const std::string& name = uri->get_ref<const std::string&>();
      bytes = name.starts_with("data:") ? kept_.emplace_back(data_of(name)) : files.read(name);
    }
    if (length > bytes.size()) {
      throw Fault{"is truncated: " + item("buffer", buffers.size()) + " announces " +
                  std::to_string(length) + " bytes, more than there are"};
    }
    buffers.push_back(bytes.substr(0, length));
  }
  const std::vector<View> views = views_of(root, buffers);
  files_ = files.take();

  for (const Json& described_accessor : list(root, "accessors")) {
    const std::string name = item("accessor", all_.size());
    Accessor accessor;
    accessor.number = all_.size();
    accessor.count = whole_member(described_accessor, "count").value_or(0);
    accessor.component = whole_member(described_accessor, "componentType").value_or(0);
    accessor.type = described_accessor.value("type", "");
    const auto offset = whole_member(described_accessor, "byteOffset").value_or(0);
    accessor.is_sparse = described_accessor.contains("sparse");
    const std::size_t bytes = component_bytes(accessor.component) * num_components(accessor.type);
    if (bytes == 0) throw Fault{"has " + name + " of an unknown type"};
    std::size_t available = num_file_bytes;
    accessor.stride = bytes;
    if (const auto index = whole_member(described_accessor, "bufferView")) {
      const View& view = views[index_into(views.size(), *index, "bufferView")];
      available = view.bytes.size();
      if (view.stride != 0) accessor.stride = view.stride;
      accessor.data = view.bytes.data() + std::min<std::uint64_t>(offset, available);
    } else if (accessor.is_sparse) {  // its numbers lie elsewhere
      all_.push_back(std::move(accessor));
      continue;
    }
    const auto last = static_cast<double>(offset) + (static_cast<double>(accessor.count) - 1) *
                                                        static_cast<double>(accessor.stride);
    if (accessor.count > 0 && last + static_cast<double>(bytes) > static_cast<double>(available)) {
      throw Fault{"is truncated: " + name + " announces " + std::to_string(accessor.count) +
                  " elements, more than there are"};
    }
    all_.push_back(std::move(accessor));
  }
}

}}}  // namespace palpate::v0::gltf
