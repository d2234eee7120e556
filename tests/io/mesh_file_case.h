// Files of a mesh, written and read back: for tests of mesh formats.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate::test {

namespace fs = std::filesystem;

class MeshFile : public ::testing::Test {
 protected:
  fs::path write(const std::string& name, const std::string& content) const {
    std::ofstream(folder_ / name, std::ios::binary) << content;
    return folder_ / name;
  }

  void expect_error(const std::string& name, const std::string& content,
                    const std::string& words) const {
    const auto mesh = load_mesh(write(name, content));
    ASSERT_FALSE(mesh) << name << " was read; expected: " << words;
    EXPECT_NE(mesh.error().message.find(words), std::string::npos) << mesh.error().message;
    EXPECT_NE(mesh.error().message.find(name), std::string::npos) << mesh.error().message;
  }

  /// Every truncation ends in an error or a mesh with sound indices, never in a crash.
  void truncate(const std::string& name, const std::string& content, bool must_fail) const {
    constexpr std::size_t kTruncations = 200;
    for (std::size_t i = 0; i < kTruncations; ++i) {
      const std::size_t length = i * content.size() / kTruncations;
      const auto mesh = load_mesh(write(name, content.substr(0, length)));
      if (!mesh) {
        EXPECT_FALSE(mesh.error().message.empty());
        continue;
      }
      EXPECT_FALSE(must_fail) << name << " cut to " << length << " bytes was read";
      for (const auto& triangle : mesh->triangles) {
        for (const std::uint32_t vertex : triangle) ASSERT_LT(vertex, mesh->vertices.size());
      }
      EXPECT_FALSE(check_solid(*mesh)) << name << " cut to " << length << " bytes is a solid";
    }
  }

  TemporaryFolder folder_;
};

inline TriangleMesh sample() { return make_torus(0.05, 0.02, 12, 8); }

inline void expect_same_solid(const Result<TriangleMesh>& read, const TriangleMesh& mesh,
                              double tolerance, double copies = 1) {
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->triangles.size(), copies * mesh.triangles.size());
  const auto solid = check_solid(*read);
  ASSERT_TRUE(solid) << solid.error().message;
  EXPECT_TRUE(solid->warnings.empty()) << solid->warnings.front();
  const double expected = copies * mass_properties(mesh).volume;
  EXPECT_NEAR(mass_properties(solid->mesh).volume, expected, tolerance * expected);
}

template <class T>
void append(std::string& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// The binary chunk of a glTF: float positions, then 32-bit indices.
inline std::string gltf_buffer(const TriangleMesh& mesh) {
  std::string out;
  for (const Vec3d& p : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) append(out, static_cast<float>(p[axis]));
  }
  for (const auto& t : mesh.triangles) {
    for (const std::uint32_t v : t) append(out, v);
  }
  return out;
}

/// One mesh placed twice: 0.2 m along x, and mirrored in x = 0 from there.
inline std::string gltf_json(const TriangleMesh& mesh, const std::string& buffer_uri) {
  const std::string num_vertices = std::to_string(mesh.vertices.size());
  const std::string num_indices = std::to_string(3 * mesh.triangles.size());
  const std::string position_bytes = std::to_string(12 * mesh.vertices.size());
  const std::string index_bytes = std::to_string(12 * mesh.triangles.size());
  const std::string bytes = std::to_string(12 * (mesh.vertices.size() + mesh.triangles.size()));
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],"nodes":[
{"mesh":0,"translation":[0.2,0,0]},
{"scale":[-1,1,1],"children":[2]},{"mesh":0,"translation":[0.2,0,0]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
"accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":)" +
         num_vertices + R"(,"min":[-1,-1,-1],"max":[1,1,1]},
{"bufferView":1,"componentType":5125,"type":"SCALAR","count":)" +
         num_indices + R"(}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":)" +
         position_bytes + R"(},{"buffer":0,"byteOffset":)" + position_bytes + R"(,"byteLength":)" +
         index_bytes + R"(}],"buffers":[{)" + buffer_uri + R"("byteLength":)" + bytes + "}]}";
}

inline std::string glb(const TriangleMesh& mesh) {
  std::string json = gltf_json(mesh, "");
  json.resize((json.size() + 3) / 4 * 4, ' ');
  const std::string buffer = gltf_buffer(mesh);
  std::string out = "glTF";
  append(out, std::uint32_t(2));
  append(out, static_cast<std::uint32_t>(12 + 8 + json.size() + 8 + buffer.size()));
  append(out, static_cast<std::uint32_t>(json.size()));
  out += "JSON" + json;
  append(out, static_cast<std::uint32_t>(buffer.size()));
  out += std::string("BIN\0", 4) + buffer;
  return out;
}

}  // namespace palpate::test
