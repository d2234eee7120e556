#include <algorithm>
#include <cstdint>
#include <memory>
#include <set>
#include <string>

#include <assimp/DefaultIOSystem.h>
#include <assimp/MemoryIOWrapper.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <assimp/IOStream.hpp>
#include <assimp/Importer.hpp>

#include "src/io/meshes/mesh_parsers.h"

namespace palpate { inline namespace v0 {
namespace {

Error bad(std::string message) { return {Errc::bad_input, std::move(message)}; }

/// A little-endian 32-bit number at `offset`.
std::uint32_t u32_at(std::string_view content, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value |= std::uint32_t(static_cast<unsigned char>(content[offset + i])) << (8 * i);
  }
  return value;
}

Vec3d transform(const aiMatrix4x4& m, const aiVector3D& p) {
  const double x = p.x, y = p.y, z = p.z;
  return {m.a1 * x + m.a2 * y + m.a3 * z + m.a4, m.b1 * x + m.b2 * y + m.b3 * z + m.b4,
          m.c1 * x + m.c2 * y + m.c3 * z + m.c4};
}

/// Files, one of which is in memory. Assimp forgets to close some of which it does not like the
/// content: here every stream leaves a list when it is closed, and those still on it are closed at
/// the end.
class Files : public Assimp::DefaultIOSystem {
 public:
  Files(std::string name, std::string_view content) : name_(std::move(name)), content_(content) {}
  ~Files() override {
    while (!open_.empty()) delete *open_.begin();
  }

  bool Exists(const char* name) const override {
    return name == name_ || DefaultIOSystem::Exists(name);
  }
  Assimp::IOStream* Open(const char* name, const char* mode) override {
    std::unique_ptr<Assimp::IOStream> file;
    if (name == name_) {
      file = std::make_unique<Assimp::MemoryIOStream>(
          reinterpret_cast<const std::uint8_t*>(content_.data()), content_.size());
    } else {
      file.reset(DefaultIOSystem::Open(name, mode));
    }
    return file ? new Stream(std::move(file), open_) : nullptr;
  }
  void Close(Assimp::IOStream* stream) override { delete stream; }

 private:
  class Stream : public Assimp::IOStream {
   public:
    Stream(std::unique_ptr<Assimp::IOStream> file, std::set<Stream*>& open)
        : file_(std::move(file)), open_(open) {
      open_.insert(this);
    }
    ~Stream() override { open_.erase(this); }

    size_t Read(void* buffer, size_t size, size_t count) override {
      return file_->Read(buffer, size, count);
    }
    size_t Write(const void*, size_t, size_t) override { return 0; }
    aiReturn Seek(size_t offset, aiOrigin origin) override { return file_->Seek(offset, origin); }
    size_t Tell() const override { return file_->Tell(); }
    size_t FileSize() const override { return file_->FileSize(); }
    void Flush() override {}

   private:
    std::unique_ptr<Assimp::IOStream> file_;
    std::set<Stream*>& open_;
  };

  std::string name_;
  std::string_view content_;
  std::set<Stream*> open_;
};

/// Adds the triangles of a node and of those below it. Points and lines are left out.
void add_node(const aiScene& scene, const aiNode& node, const aiMatrix4x4& parent,
              TriangleMesh& mesh) {
  const aiMatrix4x4 pose = parent * node.mTransformation;
  const bool is_mirrored = pose.Determinant() < 0;
  for (unsigned i = 0; i < node.mNumMeshes; ++i) {
    const aiMesh& part = *scene.mMeshes[node.mMeshes[i]];
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    for (unsigned v = 0; v < part.mNumVertices; ++v) {
      mesh.vertices.push_back(transform(pose, part.mVertices[v]));
    }
    for (unsigned f = 0; f < part.mNumFaces; ++f) {
      const aiFace& face = part.mFaces[f];
      if (face.mNumIndices != 3) continue;
      const std::uint32_t a = first + face.mIndices[0], b = first + face.mIndices[1],
                          c = first + face.mIndices[2];
      mesh.triangles.push_back(is_mirrored ? std::array{a, c, b} : std::array{a, b, c});
    }
  }
  for (unsigned i = 0; i < node.mNumChildren; ++i) {
    add_node(scene, *node.mChildren[i], pose, mesh);
  }
}

}  // namespace

std::optional<Error> check_stl_size(std::string_view content) {
  constexpr std::size_t kHeaderBytes = 84, kFacetBytes = 50;
  if (content.size() < kHeaderBytes) return bad("is neither a text nor a binary STL file");
  const std::uint32_t num_facets = u32_at(content, kHeaderBytes - 4);
  if (num_facets <= (content.size() - kHeaderBytes) / kFacetBytes) return std::nullopt;
  return bad("is truncated or no STL file: it announces " + std::to_string(num_facets) +
             " facets but has only " + std::to_string(content.size()) + " bytes");
}

Result<std::string_view> glb_json(std::string_view content) {
  constexpr std::size_t kHeaderBytes = 20;  // of the file and of its first chunk
  if (content.size() < kHeaderBytes || !content.starts_with("glTF") || u32_at(content, 4) != 2 ||
      content.substr(16, 4) != "JSON") {
    return bad("is not a GLB file of version 2");
  }
  const std::uint32_t size = u32_at(content, 8), json_size = u32_at(content, 12);
  if (size > content.size() || json_size > content.size() - kHeaderBytes) {
    return bad("is truncated: it announces " + std::to_string(std::max(size, json_size)) +
               " bytes but has only " + std::to_string(content.size()));
  }
  return content.substr(kHeaderBytes, json_size);
}

std::string glb_with_json(std::string_view content, const std::string& json) {
  constexpr std::size_t kFileHeader = 12, kChunkHeader = 8;
  const std::size_t begin = kFileHeader + kChunkHeader + u32_at(content, kFileHeader);
  const std::string_view rest = content.substr(begin);  // other chunks
  const std::string padding((4 - json.size() % 4) % 4, ' ');
  const auto u32 = [](std::size_t value) {
    std::string bytes;
    for (int i = 0; i < 4; ++i) bytes += static_cast<char>(value >> (8 * i) & 0xff);
    return bytes;
  };
  const std::size_t json_size = json.size() + padding.size();
  const std::size_t size = kFileHeader + kChunkHeader + json_size + rest.size();
  std::string glb = "glTF" + u32(2) + u32(size) + u32(json_size) + "JSON";
  return glb.append(json).append(padding).append(rest);
}

// Assimp must not repair: of its many steps only the triangulation of polygons and the check of
// indices are requested.
Result<TriangleMesh> load_with_assimp(const std::filesystem::path& path,
                                      std::string_view content) try {
  Assimp::Importer importer;
  importer.SetIOHandler(new Files(path.string(), content));  // The importer owns it.
  const aiScene* scene =
      importer.ReadFile(path.string(), aiProcess_Triangulate | aiProcess_ValidateDataStructure);
  if (scene == nullptr || scene->mRootNode == nullptr) {
    return bad("is damaged or empty (Assimp: " + std::string(importer.GetErrorString()) + ")");
  }
  TriangleMesh mesh;
  add_node(*scene, *scene->mRootNode, aiMatrix4x4(), mesh);
  return mesh;
} catch (const std::exception& error) {
  return bad("is damaged (Assimp: " + std::string(error.what()) + ")");
}

}}  // namespace palpate::v0
