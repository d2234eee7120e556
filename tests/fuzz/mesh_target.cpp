// Mesh files, compiled once per format PALPATE_FUZZ_FORMAT (".obj", ...).
#include <cmath>

#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"
#include "tests/fuzz/target.h"

namespace palpate::fuzz {
namespace {

const std::string kFormat = PALPATE_FUZZ_FORMAT;

/// A tetrahedron in a buffer of its own, twice.
constexpr const char* kGltf = R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,2]}],
"nodes":[{"children":[1],"translation":[1,0,0]},{"mesh":0,"scale":[1,-1,1]},{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,5,1]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":4}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,1]},
{"bufferView":1,"componentType":5123,"count":12,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":24}],
"skins":[{"joints":[0]}],"images":[{"bufferView":0,"mimeType":"png"}],"materials":[{"extensions":{"KHR_texture_transform":{"offset":1}}}],
"buffers":[{"byteLength":72,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAAAAAAIA/AAACAAEAAAABAAMAAAADAAIAAQACAAMA"}]})";

std::string saved(const TriangleMesh& mesh) {
  ScratchFile file(kFormat);
  if (kFormat == ".glb") {
    const ColoredMesh part{"part", {10, 20, 30}, mesh};
    require(save_colored_meshes({&part, 1}, file.path()).has_value(), "a GLB can be written");
  } else {
    require(save_mesh(mesh, file.path()).has_value(), "a mesh can be written");
  }
  return file.read();
}

}  // namespace

std::vector<std::string> seeds() {
  if (kFormat == ".gltf") return {kGltf};
  if (kFormat == ".off") {
    return {"OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n",
            "COFF 5 2 0 # colors\n0 0 0 1 0 0 1\n1 0 0 1 0 0 1\n1 1 0 1 0 0 1\n.5 .2 0 1 0 0 1\n"
            "0 1 0 1 0 0 1\n5 0 1 2 3 4 9 9 9\n4 0 1 2 4\n"};
  }
  std::vector<std::string> all{saved(make_box({1, 2, 3}))};
  if (kFormat == ".obj") {
    all.push_back(
        "o a\nv 0 0 0\nv 1 .5 0\nv 0 1 0 1\nvn 0 0 1\ng b\nf 1//1 2//1 -1//1\nf 1 2 3 1\n");
  }
  if (kFormat == ".stl") {
    all.push_back(
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 "
        "0\nendloop\nendfacet\nendsolid a\n");
    all.push_back(
        "# c\nSOLID\nENDSOLID\nSOLID b\nCOLOR 1 0 0\nFACET NORMAL 0 0 1 OUTER LOOP\nVERTEX 0 0 "
        "0\nVERTEX 1 0 0 VERTEX 1 1 0\nVERTEX 0 1 0\nENDLOOP ENDFACET\nENDSOLID b\n");
  }
  if (kFormat == ".ply") {
    all.push_back(
        "ply\nformat ascii 1.0\ncomment c\nelement vertex 4\nproperty double x\nproperty float "
        "y\nproperty float z\nproperty uchar red\nelement face 2\nproperty list uchar int "
        "vertex_indices\nend_header\n0 0 0 1\n1 0 0 2\n0 1 0 3\n1 1 0 4\n3 0 1 2\n4 0 1 3 2\n");
  }
  return all;
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  static ScratchFile file(kFormat), again(".again.ply");
  const auto mesh = load_mesh(file.write(text_of(data, size)));
  if (!mesh) {
    require(mesh.error().message.size() > 10, "an error has a message");
    return 0;
  }
  for (const auto& triangle : mesh->triangles) {
    for (const std::uint32_t corner : triangle) {
      require(corner < mesh->vertices.size(), "triangles name vertices that are there");
    }
  }
  if (mesh->triangles.size() <= 300) (void)check_solid(*mesh);
  bool is_finite = true;
  for (const Vec3d& p : mesh->vertices) {
    is_finite = is_finite && std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
  }
  if (!is_finite || !save_mesh(*mesh, again.path())) return 0;
  const auto back = load_mesh(again.path());
  require(back.has_value(), "what was written can be read");
  require(back->triangles == mesh->triangles, "a mesh that was written and read has its triangles");
  return 0;
}
