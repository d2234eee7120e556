// save_mesh: each format is put together in memory and written in one go.
#include <array>
#include <bit>
#include <charconv>
#include <string>

#include "palpate/io/atomic_file.h"
#include "palpate/io/mesh_file.h"

namespace palpate {
namespace {

template <class T>
void append_little_endian(std::string& out, T value) {
  auto bytes = std::bit_cast<std::array<char, sizeof(T)>>(value);
  if constexpr (std::endian::native == std::endian::big) {
    for (std::size_t i = 0; i < sizeof(T) / 2; ++i) std::swap(bytes[i], bytes[sizeof(T) - 1 - i]);
  }
  out.append(bytes.data(), bytes.size());
}

void append_float(std::string& out, const Vec3d& p) {
  for (int axis = 0; axis < 3; ++axis) append_little_endian(out, static_cast<float>(p[axis]));
}

std::string ply(const TriangleMesh& mesh) {
  std::string out = "ply\nformat binary_little_endian 1.0\ncomment metres\nelement vertex " +
                    std::to_string(mesh.vertices.size()) +
                    "\nproperty double x\nproperty double y\nproperty double z\nelement face " +
                    std::to_string(mesh.triangles.size()) +
                    "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const Vec3d& p : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) append_little_endian(out, p[axis]);
  }
  for (const auto& triangle : mesh.triangles) {
    out.push_back(3);
    for (const std::uint32_t index : triangle) append_little_endian(out, index);
  }
  return out;
}

std::string stl(const TriangleMesh& mesh) {
  std::string out = "binary STL by Palpate, metres";
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
  std::string out = "# metres\n";
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

}  // namespace

Status save_mesh(const TriangleMesh& mesh, const std::filesystem::path& path) {
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t index : triangle) {
      if (index < mesh.vertices.size()) continue;
      return Error{Errc::invalid_argument, "cannot write " + path.string() +
                                               ": a face uses vertex " + std::to_string(index) +
                                               " of " + std::to_string(mesh.vertices.size()) +
                                               "; check the mesh first"};
    }
  }
  const auto extension = path.extension();
  if (extension == ".ply") return write_file_atomically(path, ply(mesh));
  if (extension == ".stl") return write_file_atomically(path, stl(mesh));
  if (extension == ".obj") return write_file_atomically(path, obj(mesh));
  return Error{Errc::invalid_argument,
               "cannot write " + path.string() + ": give a name that ends in .ply, .stl or .obj"};
}

}  // namespace palpate
