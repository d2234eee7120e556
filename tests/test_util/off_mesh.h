// OFF files for tests and benchmarks of rooms that know no files.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>

#include "palpate/mesh/mesh.h"

namespace palpate::test {

/// A triangle mesh in the plain OFF format; trusts the file.
inline TriangleMesh read_off(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::string magic;
  std::size_t num_vertices = 0, num_faces = 0, ignored = 0;
  file >> magic >> num_vertices >> num_faces >> ignored;
  TriangleMesh mesh;
  mesh.vertices.resize(num_vertices);
  mesh.triangles.resize(num_faces);
  for (Vec3d& v : mesh.vertices) file >> v.x >> v.y >> v.z;
  for (auto& t : mesh.triangles) file >> ignored >> t[0] >> t[1] >> t[2];
  return mesh;
}

}  // namespace palpate::test
