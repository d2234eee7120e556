// save_mesh and save_colored_meshes: each format is put together in memory and written in one go.
#include <array>
#include <charconv>
#include <limits>
#include <string>
#include <vector>

#include "palpate/io/formats.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/meshes/little_endian.h"
#include "src/io/meshes/mesh_parsers.h"

namespace palpate { inline namespace v0 {
namespace {

void append_float(std::string& out, const Vec3d& p) {
  for (int axis = 0; axis < 3; ++axis) append_little_endian(out, static_cast<float>(p[axis]));
}

/// Parts in one mesh, one after the other. Colors are those of all parts or of none.
struct PlyPart {
  const TriangleMesh* mesh;
  const std::array<std::uint8_t, 3>* rgb = nullptr;
};

std::string ply(std::span<const PlyPart> parts) {
  std::size_t num_vertices = 0, num_triangles = 0;
  for (const PlyPart& part : parts) {
    num_vertices += part.mesh->vertices.size();
    num_triangles += part.mesh->triangles.size();
  }
  const bool has_colors = !parts.empty() && parts.front().rgb != nullptr;
  std::string out = "ply\nformat binary_little_endian 1.0\ncomment meters\nelement vertex " +
                    std::to_string(num_vertices) +
                    "\nproperty double x\nproperty double y\nproperty double z\n";
  if (has_colors) out += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  out += "element face " + std::to_string(num_triangles) +
         "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const PlyPart& part : parts) {
    for (const Vec3d& p : part.mesh->vertices) {
      for (int axis = 0; axis < 3; ++axis) append_little_endian(out, p[axis]);
      if (!has_colors) continue;
      for (const std::uint8_t value : *part.rgb) append_little_endian(out, value);
    }
  }
  std::uint32_t first = 0;
  for (const PlyPart& part : parts) {
    for (const auto& triangle : part.mesh->triangles) {
      out.push_back(3);
      for (const std::uint32_t index : triangle) append_little_endian(out, first + index);
    }
    first += static_cast<std::uint32_t>(part.mesh->vertices.size());
  }
  return out;
}

std::string stl(const TriangleMesh& mesh) {
  std::string out = "binary STL by Palpate, meters";
  out.resize(80, ' ');
  append_little_endian(out, static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const auto& triangle : mesh.triangles) {
    const Vec3d &a = mesh.vertices[triangle[0]], &b = mesh.vertices[triangle[1]],
                &c = mesh.vertices[triangle[2]];
    append_float(out, normalized(cross(b - a, c - a)));
    for (const Vec3d& p : {a, b, c}) append_float(out, p);
    append_little_endian(out, std::uint16_t(0));
  }
  return out;
}

std::string obj(const TriangleMesh& mesh) {
  std::string out = "# meters\n";
  for (const Vec3d& p : mesh.vertices) {
    out += 'v';
    for (int axis = 0; axis < 3; ++axis) {
      char text[32];  // The shortest text that reads back as the same number.
      const auto [end, error] = std::to_chars(text, text + sizeof text, p[axis]);
      out.append(1, ' ').append(text, end);
    }
    out += '\n';
  }
  for (const auto& triangle : mesh.triangles) {
    out += 'f';
    for (const std::uint32_t index : triangle) out += ' ' + std::to_string(index + 1);
    out += '\n';
  }
  return out;
}

/// Do faces use vertices that exist?
Status check_indices(const TriangleMesh& mesh, const std::filesystem::path& path) {
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t index : triangle) {
      if (index < mesh.vertices.size()) continue;
      return Error{Errc::invalid_argument, "cannot write " + path.string() +
                                               ": a face uses vertex " + std::to_string(index) +
                                               " of " + std::to_string(mesh.vertices.size()) +
                                               "; check the mesh first"};
    }
  }
  return Done{};
}

}  // namespace

Status save_mesh(const TriangleMesh& mesh, const std::filesystem::path& path) {
  if (const Status status = check_indices(mesh, path); !status) return status;
  const auto extension = path.extension();
  if (extension == ".ply") {
    const PlyPart part{&mesh};
    return write_file_atomically(path, ply({&part, 1}));
  }
  if (extension == ".stl") return write_file_atomically(path, stl(mesh));
  if (extension == ".obj") return write_file_atomically(path, obj(mesh));
  return Error{Errc::invalid_argument,
               "cannot write " + path.string() + ": give a name that ends in .ply, .stl or .obj"};
}

Status save_colored_meshes(std::span<const ColoredMesh> parts, const std::filesystem::path& path) {
  std::vector<PlyPart> ply_parts;
  std::vector<const ColoredMesh*> glb_parts;
  std::size_t num_vertices = 0;
  for (const ColoredMesh& part : parts) {
    if (const Status status = check_indices(part.mesh, path); !status) return status;
    if (part.mesh.triangles.empty()) continue;
    ply_parts.push_back({&part.mesh, &part.rgb});
    glb_parts.push_back(&part);
    num_vertices += part.mesh.vertices.size();
  }
  const auto refuse = [&path](const std::string& why) {
    return Error{Errc::invalid_argument, "cannot write " + path.string() + ": " + why};
  };
  if (glb_parts.empty()) return refuse("there are no faces; give a mesh that has some");
  if (num_vertices > std::size_t(std::numeric_limits<std::int32_t>::max())) {
    return refuse("there are more than two thousand million vertices; give a coarser mesh");
  }
  const auto extension = path.extension();
  if (extension == ".ply") return write_file_atomically(path, ply(ply_parts));
  if (extension != ".glb") return refuse("give a name that ends in .ply or .glb");
  const auto content = glb_content(glb_parts);
  if (!content) return refuse(content.error().message);
  return write_file_atomically(path, *content);
}

}}  // namespace palpate::v0
