// Meshes of glTF files: what of them counts, and files that are damaged or hostile.
#include <gtest/gtest.h>

#include <cstring>
#include <string>

#include "src/io/internal/base64.h"
#include "tests/io/mesh_file_case.h"
#include "tests/test_util/data.h"

namespace palpate {
namespace {

using namespace test;  // NOLINT: of mesh_file_case.h, all of it

/// A glTF with these nodes; no buffers.
std::string gltf_of_nodes(const std::string& nodes, const std::string& more = "") {
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[)" + nodes +
         "]" + more + "}";
}

/// A glTF with what is of no use for a solid: a skin without inverse
/// bind matrices, an image whose kind is not of the form a/b, a texture whose offset is not two
/// numbers.
std::string decorated(std::string gltf) {
  const auto replace = [&](const std::string& from, const std::string& to) {
    const std::size_t at = gltf.find(from);
    ASSERT_NE(at, std::string::npos);
    gltf.replace(at, from.size(), to);
  };
  replace(R"({"mesh":0,"translation":[0.2,0,0]})",
          R"({"mesh":0,"translation":[0.2,0,0],"skin":0,"camera":7,"name":"x"})");
  replace(R"("indices":1})", R"("indices":1,"material":0,"targets":[{"POSITION":0}]})");
  replace(R"("scene":0,)",
          R"("scene":0,"skins":[{"joints":[0,1]}],
"images":[{"bufferView":0,"mimeType":"png"}],"textures":[{"source":0}],
"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0,
"extensions":{"KHR_texture_transform":{"offset":["a"],"scale":[1]}}}}}],
"animations":[{"channels":[{"sampler":3}]}],"extensionsUsed":["KHR_texture_transform"],)");
  return gltf;
}

TEST_F(MeshFile, OfAGltfOnlyTheGeometryCounts) {
  write("m.bin", gltf_buffer(sample()));
  const std::string plain = gltf_json(sample(), R"("uri":"m.bin",)");
  const auto mesh = load_mesh(write("m.gltf", decorated(plain)));
  expect_same_solid(mesh, sample(), 1e-6, 2);
  std::string binary = glb(sample());
  const std::string json = gltf_json(sample(), "");
  std::string replaced = "glTF";
  std::string rich = decorated(json);
  rich.resize((rich.size() + 3) / 4 * 4, ' ');
  const std::string chunks = binary.substr(20 + (json.size() + 3) / 4 * 4);
  append(replaced, std::uint32_t(2));
  append(replaced, static_cast<std::uint32_t>(20 + rich.size() + chunks.size()));
  append(replaced, static_cast<std::uint32_t>(rich.size()));
  replaced += "JSON" + rich + chunks;
  expect_same_solid(load_mesh(write("m.glb", replaced)), sample(), 1e-6, 2);
}

TEST_F(MeshFile, GltfThatIsCompressedIsAnError) {
  expect_error("draco.gltf",
               R"({"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]})",
               "without compression");
}

TEST_F(MeshFile, GltfNumbersAreNumbers) {
  expect_error("matrix.gltf", gltf_of_nodes(R"({"matrix":[1,2,3]})"), "16 numbers");
  expect_error("scale.gltf", gltf_of_nodes(R"({"scale":[1,"a",3]})"), "3 numbers");
  expect_error("mode.gltf", gltf_of_nodes("{}", R"(,"meshes":[{"primitives":[{"mode":"x"}]}])"),
               "not a whole number");
}

TEST_F(MeshFile, OfAGltfOnlyTrianglesCountWhateverTheRestIsMadeOf) {
  const auto gltf_of_mode = [](int mode) {
    return gltf_of_nodes(R"({"mesh":0})", R"(,"meshes":[{"primitives":[{"mode":)" +
                                              std::to_string(mode) +
                                              R"(,"attributes":{"POSITION":0},"indices":1}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":1,"type":"VEC3"},
{"bufferView":0,"byteOffset":12,"componentType":5125,"count":3,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteLength":24}],"buffers":[{"byteLength":24,
"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAACQAAAAkAAAAJAAAA"}])");
  };
  for (int mode = 0; mode < 7; ++mode) expect_error("m.gltf", gltf_of_mode(mode), "export");
  expect_error("m.gltf", gltf_of_mode(7), "unknown mode 7");
  // Neither are strips and fans without corners.
  for (const char* primitive : {R"({"mode":5})", R"({"mode":5,"attributes":{}})",
                                R"({"mode":6,"attributes":{"POSITION":0}})"}) {
    expect_error(
        "m.gltf",
        gltf_of_nodes(R"({"mesh":0})", R"(,"meshes":[{"primitives":[)" + std::string(primitive) +
                                           R"(]}],"accessors":[{"componentType":5126,
"count":1,"type":"VEC3"}])"),
        "no faces");
  }
}

TEST_F(MeshFile, HostileGltfIsReadOrRefused) {
  PALPATE_DATA_OR_SKIP(folder, "hostile");
  for (const char* name : {"skin", "skin2", "image_mime", "texture_transform"}) {
    const auto mesh = load_mesh(folder / (std::string(name) + ".gltf"));
    EXPECT_TRUE(mesh || !mesh.error().message.empty()) << name;
  }
}

TEST_F(MeshFile, ReadsAFileThatManyBuffersNameOnce) {
  // Other spellings, and the buffer that is needed whole is not the first.
  write("m.bin", gltf_buffer(sample()));
  std::string json = gltf_json(sample(), R"("uri":"./m.bin",)");
  const auto replace = [&](const std::string& from, const std::string& to) {
    ASSERT_NE(json.find(from), std::string::npos);
    json.replace(json.find(from), from.size(), to);
  };
  replace(R"("buffers":[)",
          R"("buffers":[{"uri":"m.bin","byteLength":4},)"
          R"({"uri":"data:application/octet-stream;base64,AAAA","byteLength":3},)");
  replace(R"({"buffer":0)", R"({"buffer":2)");
  replace(R"({"buffer":0)", R"({"buffer":2)");
  const auto read = load_mesh(write("m.gltf", json));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->vertices, load_mesh(write("g.glb", glb(sample())))->vertices);
}

TEST_F(MeshFile, ReadsGltfWithItsNodes) {
  write("m.bin", gltf_buffer(sample()));
  const auto gltf = load_mesh(write("m.gltf", gltf_json(sample(), R"("uri":"m.bin",)")));
  expect_same_solid(gltf, sample(), 1e-6, 2);
  const auto binary = load_mesh(write("m.glb", glb(sample())));
  expect_same_solid(binary, sample(), 1e-6, 2);
  EXPECT_NEAR(bounds(*binary).high.x, 0.27, 1e-7);
  EXPECT_NEAR(bounds(*binary).low.x, -0.27, 1e-7);
}

/// A tetrahedron of 1/6 m3 whose positions are 16 bytes apart, before three primitives' indices of
/// one byte each: a strip, a fan and the triangle that it lacks.
std::string tetrahedron_gltf(const std::string& primitives, const std::string& node = "") {
  std::string bytes;
  for (const float x :
       {0.f, 0.f, 0.f, 9.f, 0.f, 1.f, 0.f, 9.f, 1.f, 0.f, 0.f, 9.f, 0.f, 0.f, 1.f, 9.f}) {
    append(bytes, x);
  }
  bytes += std::string(
      "\0\1\2\3\0\1"
      "\3\0\2\1\0"
      "\0\1\2",
      14);
  const auto indices = [](int begin, int num) {
    return R"(,{"bufferView":1,"byteOffset":)" + std::to_string(begin) +
           R"(,"componentType":5121,"type":"SCALAR","count":)" + std::to_string(num) + "}";
  };
  return R"({"asset":{"version":"2.0"},"nodes":[{"mesh":0)" + node +
         R"(}],"meshes":[{"primitives":[)" + primitives +
         R"(]}],"accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":4})" +
         indices(0, 6) + indices(6, 5) + indices(11, 3) +
         R"(],"bufferViews":[{"buffer":0,"byteLength":64,"byteStride":16},)"
         R"({"buffer":0,"byteOffset":64,"byteLength":14}],"buffers":[{"byteLength":78,)"
         R"("uri":"data:application/octet-stream;base64,)" +
         base64(bytes) + R"("}]})";
}

TEST_F(MeshFile, ReadsStripsFansAndPlacedNodesOfGltf) {
  const auto part = [](int mode, int indices) {
    return R"({"mode":)" + std::to_string(mode) + R"(,"attributes":{"POSITION":0},"indices":)" +
           std::to_string(indices) + "}";
  };
  const std::string strip = part(5, 1), fan = part(6, 2) + "," + part(4, 3);
  // No scene: its roots are placed. A mirrored one is a solid, too, not one turned inside out.
  const struct {
    std::string node;
    double volume;
    Vec3d low, high;
  } kPlaced[] = {
      {"", 1.0 / 6, {0, 0, 0}, {1, 1, 1}},
      {R"(,"translation":[5,0,0],"rotation":[0,0,0.7071067811865476,0.7071067811865476],)"
       R"("scale":[2,3,-1])",
       1,
       {2, 0, -1},
       {5, 2, 0}},
      {R"(,"matrix":[0,2,0,0, -3,0,0,0, 0,0,-1,0, 5,0,0,1])", 1, {2, 0, -1}, {5, 2, 0}}};
  for (const auto& [node, volume, low, high] : kPlaced) {
    for (const std::string& parts : {strip, fan}) {
      const auto mesh = load_mesh(write("m.gltf", tetrahedron_gltf(parts, node)), 0.1);
      ASSERT_TRUE(mesh) << mesh.error().message;
      EXPECT_EQ(mesh->triangles.size(), 4u);
      const auto solid = check_solid(*mesh);
      ASSERT_TRUE(solid) << solid.error().message;
      EXPECT_TRUE(solid->warnings.empty()) << solid->warnings.front();
      EXPECT_NEAR(mass_properties(solid->mesh).volume, 1e-3 * volume, 1e-15);
      EXPECT_LT(norm(bounds(*mesh).low - low * 0.1), 1e-12) << node;
      EXPECT_LT(norm(bounds(*mesh).high - high * 0.1), 1e-12) << node;
    }
  }
  expect_error("m.gltf", tetrahedron_gltf(part(4, 2)), "triangles with 5 corners");
  expect_error("m.gltf", tetrahedron_gltf(strip, R"(,"rotation":[0,0,0,0])"), "length zero");
  std::string uri = tetrahedron_gltf(strip);
  uri.replace(uri.find(";base64"), 7, ";utf-8x");
  expect_error("m.gltf", uri, "data URI that is not base64");
  uri.replace(uri.find(";utf-8x,"), 9, ";base64,*");
  expect_error("m.gltf", uri, "damaged base64");
}

/// The tetrahedron with morph targets: accessor 0 as offsets adds the positions times the weight,
/// accessor 4 is sparse, 5 has three vertices.
std::string morphed_gltf(const std::string& targets, const std::string& mesh,
                         const std::string& node = "", const std::string& attributes = "") {
  std::string gltf = tetrahedron_gltf(R"({"mode":5,"attributes":{"POSITION":0)" + attributes +
                                          R"(},"indices":1,"targets":[)" + targets + "]}",
                                      node.empty() ? "" : R"(,"weights":)" + node);
  const auto put = [&](const std::string& before, const std::string& what) {
    gltf.insert(gltf.find(before), what);
  };
  if (!mesh.empty()) put(R"("primitives")", R"("weights":)" + mesh + ",");
  put(R"(],"bufferViews")",
      R"(,{"componentType":5126,"type":"VEC3","count":1000,"sparse":{"count":1}},)"
      R"({"bufferView":0,"componentType":5126,"type":"VEC3","count":3})");
  return gltf;
}

TEST_F(MeshFile, MorphTargetsOfGltfMoveVerticesByTheirWeights) {
  const std::string one = R"({"POSITION":0})", three = one + R"(,{"NORMAL":0},)" + one;
  const struct {
    std::string targets, mesh, node;
    double size;
  } kMorphed[] = {{one, "", "", 1},         {one, "[1]", "", 2},
                  {one, "[0.5]", "", 1.5},  {one, "", "[1]", 2},
                  {one, "[1]", "[0]", 1},   {three, "[0.5,7,-0.25]", "", 1.25},
                  {three, "[0.5]", "", 1.5}};
  for (const auto& [targets, mesh, node, size] : kMorphed) {
    const auto read = load_mesh(write("m.gltf", morphed_gltf(targets, mesh, node)));
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_NEAR(mass_properties(*read).volume, size * size * size / 6, 1e-12) << mesh << node;
  }
  expect_error("m.gltf", morphed_gltf(one, R"(["a"])"), "'weights' that are not numbers");
  expect_error("m.gltf", morphed_gltf("0", "[1]"), "no object where 'targets' belongs");
  expect_error("m.gltf", morphed_gltf(R"({"POSITION":1})", "[1]"), "accessor 1 of positions");
  expect_error("m.gltf", morphed_gltf(R"({"POSITION":5})", "[1]"), "morph target of 3 vertices");
}

TEST_F(MeshFile, SparseAccessorsOfGltfMatterWhereTheyAreUsed) {
  const std::string sparse = R"({"POSITION":4})";
  for (const std::string& gltf : {morphed_gltf(sparse, ""), morphed_gltf(sparse, "[0]"),
                                  morphed_gltf("", "", "", R"(,"NORMAL":4)")}) {
    const auto read = load_mesh(write("m.gltf", gltf));
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_NEAR(mass_properties(*read).volume, 1.0 / 6, 1e-12);
  }
  expect_error("m.gltf", morphed_gltf(sparse, "[1]"), "the sparse accessor 4, which is not");
  std::string positions = morphed_gltf("", "");
  positions.replace(positions.find(R"("POSITION":0)"), 12, R"("POSITION":4)");
  expect_error("m.gltf", positions, "the sparse accessor 4");
  std::string indices = morphed_gltf("", "");
  indices.replace(indices.find(R"("indices":1)"), 11, R"("indices":4)");
  expect_error("m.gltf", indices, "the sparse accessor 4");
}

TEST_F(MeshFile, GlbAndGltfMayHaveEachOthersNames) {
  write("m.bin", gltf_buffer(sample()));
  expect_same_solid(load_mesh(write("m.gltf", glb(sample()))), sample(), 1e-6, 2);
  expect_same_solid(load_mesh(write("m.glb", "\n " + gltf_json(sample(), R"("uri":"m.bin",)"))),
                    sample(), 1e-6, 2);
}

TEST_F(MeshFile, BuffersOfGltfMayHaveEscapedNames) {
  write("a b%.bin", gltf_buffer(sample()));
  const auto mesh = load_mesh(write("m.gltf", gltf_json(sample(), R"("uri":"a%20b%25.bin",)")));
  expect_same_solid(mesh, sample(), 1e-6, 2);
}

TEST_F(MeshFile, AGlbThatLacksItsLastBytesIsAnError) {
  const std::string whole = glb(sample());
  expect_error("m.glb", whole.substr(0, whole.size() - 4), "truncated");
  std::string cut = whole.substr(0, whole.size() - 4);  // which says so of itself
  const auto size = static_cast<std::uint32_t>(cut.size());
  std::memcpy(cut.data() + 8, &size, sizeof size);
  expect_error("m.glb", cut, "truncated");
}

TEST_F(MeshFile, GltfOfEndlessDepthIsAnError) {
  const std::string open(200000, '['), close(200000, ']');
  expect_error("deep.gltf", R"({"asset":{"version":"2.0"},"extras":)" + open + close + "}",
               "levels of JSON");
  expect_error("deeper.gltf", open, "levels of JSON");
  std::string chain;
  for (int i = 1; i < 20000; ++i) chain += R"({"children":[)" + std::to_string(i) + "]},";
  expect_error("chain.gltf", gltf_of_nodes(chain + "{}"), "levels of nodes");
}

TEST_F(MeshFile, GltfNodesAreTrees) {
  std::string bomb;
  for (int i = 1; i < 40; ++i) {
    const std::string next = std::to_string(i);
    bomb += R"({"children":[)" + next + "," + next + "]},";
  }
  expect_error("bomb.gltf", gltf_of_nodes(bomb + "{}"), "two parents");
  expect_error("loop.gltf", gltf_of_nodes(R"({},{"children":[2]},{"children":[1]})"), "ancestors");
  expect_error("self.gltf", gltf_of_nodes(R"({"children":[0]})"), "ancestors");
  expect_error("range.gltf", gltf_of_nodes(R"({"children":[1]})"), "names node 1 of only 1");
  expect_error("minus.gltf", gltf_of_nodes(R"({"children":[-1]})"), "not a whole number");
  expect_error("twin.gltf", gltf_of_nodes("{}", R"(,"nodes":[])"), "gives 'nodes' twice");
  expect_error("mesh.gltf", gltf_of_nodes(R"({"mesh":0})"), "names mesh 0 of only 0");
}

TEST_F(MeshFile, GltfCountsAreCheckedAgainstTheFile) {
  const auto with = [&](const std::string& parts) { return gltf_of_nodes("{}", "," + parts); };
  const std::string buffer =
      R"("buffers":[{"byteLength":12,"uri":"data:;base64,AAAAAAAAAAAAAAAA"}])";
  expect_error("buffer.gltf", with(R"("buffers":[{"byteLength":4000000000}])"), "truncated");
  expect_error("file.gltf", with(R"("buffers":[{"byteLength":4,"uri":"none.bin"}])"), "none.bin");
  expect_error("device.gltf", with(R"("buffers":[{"byteLength":4,"uri":"../../../dev/zero"}])"),
               "not a readable file");
  expect_error("view.gltf",
               with(buffer + R"(,"bufferViews":[{"buffer":0,"byteOffset":8,"byteLength":8}])"),
               "does not fit");
  expect_error("accessor.gltf",
               with(buffer + R"(,"bufferViews":[{"buffer":0,"byteLength":12}],"accessors":[)"
                             R"({"bufferView":0,"componentType":5126,"type":"VEC3","count":2}])"),
               "announces 2 elements");
  expect_error("sparse.gltf",
               with(R"("accessors":[{"componentType":5126,"type":"VEC3","count":2000000000}])"),
               "announces 2000000000 elements");
}

TEST_F(MeshFile, GltfOfWhatIsNotKnownIsRefusedByName) {
  write("m.bin", gltf_buffer(sample()));
  const std::string json = gltf_json(sample(), R"("uri":"m.bin",)");
  const auto with = [&](const std::string& what, const std::string& instead) {
    std::string changed = json;
    return changed.replace(changed.find(what), what.size(), instead);
  };
  const auto needing = [&](const std::string& extension) {
    return with(R"("scene":0)", R"("extensionsRequired":[")" + extension + R"("],"scene":0)");
  };
  for (const char* name : {"KHR_mesh_quantization", "KHR_draco_mesh_compression",
                           "EXT_meshopt_compression", "EXT_mesh_gpu_instancing", "VENDOR_any"}) {
    expect_error("m.gltf", needing(name), std::string("needs the extension ") + name);
  }
  for (const char* name : {"KHR_materials_unlit", "KHR_texture_transform", "KHR_lights_punctual"}) {
    expect_same_solid(load_mesh(write("m.gltf", needing(name))), sample(), 1e-4, 2);
  }
  for (const char* type : {"5120", "5121", "5122", "5123", "5125"}) {
    expect_error("m.gltf", with("5126", type), "KHR_mesh_quantization");
  }
  expect_error("m.gltf", with(R"("VEC3")", R"("VEC2")"), "not three floats");
  expect_error("m.gltf", with("5125", "5126"), "not whole numbers");
}

TEST_F(MeshFile, GltfThatRepeatsItsMeshTooOftenIsAnError) {
  write("m.bin", gltf_buffer(sample()));
  const auto repeated = [](int num) {
    std::string json = gltf_json(sample(), R"("uri":"m.bin",)");
    std::string many = R"("nodes":[)";
    for (int i = 0; i < num; ++i) many += R"({"mesh":0},)";
    return json.replace(json.find("\"nodes\":[\n"), 9, many);
  };
  EXPECT_TRUE(load_mesh(write("some.gltf", repeated(2000))));
  // 13 million in 220 kB, and 67 million.
  expect_error("repeat.gltf", repeated(20000), "repeated meshes included");
  expect_error("often.gltf", repeated(100000), "repeated meshes included");
}

TEST_F(MeshFile, GltfWithATruncatedBufferIsAnError) {
  write("m.bin", gltf_buffer(sample()).substr(0, 1000));
  EXPECT_FALSE(load_mesh(write("m.gltf", gltf_json(sample(), R"("uri":"m.bin",)"))));
}

}  // namespace
}  // namespace palpate
