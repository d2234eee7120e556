// Large mesh and tool files.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "palpate/io/files.h"
#include "palpate/io/formats.h"
#include "tests/fuzz/large_inputs.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate::fuzz {
namespace {

namespace fs = std::filesystem;

/// An icosphere whose triangles take about so many bytes.
TriangleMesh round_mesh(std::size_t num_bytes, double bytes_per_triangle) {
  const double num = static_cast<double>(num_bytes) / bytes_per_triangle / 20;
  return make_icosphere(0.05, std::max(0, static_cast<int>(std::lround(std::log2(num) / 2))));
}

/// Corners whose polygon crosses itself: cutting it into triangles takes longest.
std::string random_point(std::size_t i) {
  test::Random random(i + 1);
  char text[64];
  std::snprintf(text, sizeof text, "%.4f %.4f 0\n", random.uniform(), random.uniform());
  return text;
}
constexpr std::size_t kCorners = 1000;

std::string points() {
  std::string all;
  for (std::size_t i = 0; i < kCorners; ++i) all += random_point(i);
  return all;
}

/// Rows of a strip: two new corners and two triangles of each.
std::string strip_points(std::size_t i) {
  const std::string x = std::to_string(1e-3 * static_cast<double>(i));
  return x + " 0 0\n" + x + " 1 0.125\n";
}

void polygons_obj(const fs::path& path, std::size_t num_bytes) {
  std::string head, face = "f";
  for (std::size_t i = 0; i < kCorners; ++i) {
    head += "v " + random_point(i);
    face += " " + std::to_string(i + 1);
  }
  write_pieces(path, num_bytes, head, [&](std::size_t) { return face + "\n"; });
}

void triangles_obj(const fs::path& path, std::size_t num_bytes) {
  write_pieces(path, num_bytes, "", [](std::size_t i) {
    const std::string x = std::to_string(1e-3 * static_cast<double>(i));
    return "v " + x + " 0 0\nv " + x + " 1 0.125\nv " + x + " 0 1\nf -1 -2 -3\n";
  });
}

void broken_lines_obj(const fs::path& path, std::size_t num_bytes) {
  write_pieces(
      path, num_bytes, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 \\\n",
      [](std::size_t) { return "\\\n"; }, "\n");
}

std::string stl_head(std::size_t num_facets) {
  std::string head(80, ' ');
  for (int shift = 0; shift < 32; shift += 8) head += static_cast<char>(num_facets >> shift);
  return head;
}

void facets_stl(const fs::path& path, std::size_t num_bytes) {
  const std::size_t num = num_bytes / 50;
  const std::string head = stl_head(num);
  std::string facet(50, '\0');
  const float corners[] = {0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0};
  facet.replace(0, 48, reinterpret_cast<const char*>(corners), 48);
  write_pieces(path, head.size() + 50 * num, head, [&](std::size_t) { return facet; });
}

constexpr const char* kFacet =
    "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";

void text_stl(const fs::path& path, std::size_t num_bytes) {
  write_pieces(
      path, num_bytes, "solid a\n", [](std::size_t) { return kFacet; }, "endsolid a\n");
}
void solids_stl(const fs::path& path, std::size_t num_bytes) {
  write_pieces(path, num_bytes, std::string("solid a\n") + kFacet + "endsolid a\n",
               [](std::size_t) { return "solid a\nendsolid a\n"; });
}

void strip_ply(const fs::path& path, std::size_t num_bytes) {
  const std::size_t num = num_bytes / 34;  // rows of two corners
  std::string faces;
  const std::string head = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(2 * num) +
                           "\nproperty float x\nproperty float y\nproperty float z\nelement face "
                           "1\nproperty list uchar int vertex_indices\nend_header\n";
  std::string rows;
  for (std::size_t i = 0; i < num; ++i) rows += strip_points(i);
  write_pieces(path, 0, head + rows + "3 0 1 2\n", nullptr);
}

void polygons_ply(const fs::path& path, std::size_t num_bytes) {
  std::string face{"\xe8\x03", 2};
  for (std::size_t i = 0; i < kCorners; ++i) {
    face += static_cast<char>(i & 255);
    face += static_cast<char>(i >> 8);
  }
  const std::size_t num = num_bytes / face.size();
  std::string head =
      "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(kCorners) +
      "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
      std::to_string(num) + "\nproperty list ushort ushort vertex_indices\nend_header\n";
  for (std::size_t i = 0; i < kCorners; ++i) {
    test::Random random(i + 1);
    const float p[] = {static_cast<float>(random.uniform()), static_cast<float>(random.uniform()),
                       0};
    head.append(reinterpret_cast<const char*>(p), sizeof p);
  }
  write_pieces(path, head.size() + num * face.size(), head, [&](std::size_t) { return face; });
}

void elements_ply(const fs::path& path, std::size_t num_bytes) {
  write_pieces(
      path, num_bytes, "ply\nformat ascii 1.0\n",
      [](std::size_t) { return "element a 0\nproperty int x\n"; }, "end_header\n");
}

void strip_off(const fs::path& path, std::size_t num_bytes) {
  const std::size_t num = num_bytes / 34;
  std::string rows;
  for (std::size_t i = 0; i < num; ++i) rows += strip_points(i);
  write_pieces(path, 0, "OFF\n" + std::to_string(2 * num) + " 1 0\n" + rows + "3 0 1 2\n", nullptr);
}

void polygons_off(const fs::path& path, std::size_t num_bytes) {
  std::string face = std::to_string(kCorners);
  for (std::size_t i = 0; i < kCorners; ++i) face += " " + std::to_string(i);
  const std::string corners = points();
  const std::size_t num = num_bytes / face.size();
  write_pieces(
      path, num * (face.size() + 1),
      "OFF\n" + std::to_string(kCorners) + " " + std::to_string(num) + " 0\n" + corners,
      [&](std::size_t) { return face + "\n"; }, face + "\n");
}

std::size_t json_size(std::size_t num_bytes) {
  return std::min(num_bytes, std::size_t(60) << 20);  // more JSON than 64 MiB is refused
}

/// As many scenes as nodes.
void scenes_gltf(const fs::path& path, std::size_t num_bytes) {
  const std::size_t num = json_size(num_bytes) / 6;
  std::string text = R"({"asset":{"version":"2.0"},"nodes":[{})";
  for (std::size_t i = 0; i < num; ++i) text += ",{}";
  text += R"(],"scenes":[{})";
  for (std::size_t i = 0; i < num; ++i) text += ",{}";
  write_pieces(path, 0, text + "]}", nullptr);
}

/// Many buffers, all of one other file, which is as large.
void buffers_gltf(const fs::path& path, std::size_t num_bytes) {
  constexpr std::size_t kBytesPerBuffer = 160;
  write_pieces(path.parent_path() / "all.bin", num_bytes, "",
               [](std::size_t) { return std::string(1000, '\0'); });
  std::string primitives, accessors, views, buffers;
  for (std::size_t i = 0; i < json_size(num_bytes) / kBytesPerBuffer; ++i) {
    const std::string n = std::to_string(i), comma = i == 0 ? "" : ",";
    primitives += comma + R"({"attributes":{"POSITION":)" + n + "}}";
    accessors +=
        comma + R"({"bufferView":)" + n + R"(,"componentType":5126,"type":"VEC3","count":3})";
    views += comma + R"({"buffer":)" + n + R"(,"byteLength":36})";
    buffers += comma + R"({"uri":"all.bin","byteLength":)" + std::to_string(num_bytes) + "}";
  }
  write_pieces(
      path, 0,
      R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)"
      R"("meshes":[{"primitives":[)" +
          primitives + R"(]}],"accessors":[)" + accessors + R"(],"bufferViews":[)" + views +
          R"(],"buffers":[)" + buffers + "]}",
      nullptr);
}

/// One mesh of half the file, placed as often as the other half says.
void placed_glb(const fs::path& path, std::size_t num_bytes) {
  const std::size_t half = json_size(num_bytes) / 2, num_vertices = half / 12;
  const std::string n = std::to_string(num_vertices), size = std::to_string(12 * num_vertices);
  std::string json = R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0)";
  const std::size_t num_nodes = std::max<std::size_t>(half / 20, 1);
  for (std::size_t i = 1; i < num_nodes; ++i) json += "," + std::to_string(i);
  json += R"(]}],"nodes":[{"mesh":0})";
  for (std::size_t i = 1; i < num_nodes; ++i) json += R"(,{"mesh":0})";
  json +=
      R"(],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":[{"bufferView":0,)"
      R"("componentType":5126,"type":"VEC3","count":)" +
      n + R"(}],"bufferViews":[{"buffer":0,"byteLength":)" + size +
      R"(}],"buffers":[{"byteLength":)" + size + "}]}";
  json.append((4 - json.size() % 4) % 4, ' ');
  std::string data(12 * num_vertices, '\0');
  for (std::size_t i = 0; i < num_vertices; ++i) {
    const float x = static_cast<float>(i % 3 == 1), y = static_cast<float>(i % 3 == 2);
    data.replace(12 * i, 4, reinterpret_cast<const char*>(&x), 4);
    data.replace(12 * i + 4, 4, reinterpret_cast<const char*>(&y), 4);
  }
  const auto u32 = [](std::size_t value) {
    std::string bytes;
    for (int shift = 0; shift < 32; shift += 8) bytes += static_cast<char>(value >> shift);
    return bytes;
  };
  write_pieces(path, 0,
               "glTF" + u32(2) + u32(28 + json.size() + data.size()) + u32(json.size()) + "JSON" +
                   json + u32(data.size()) + std::string("BIN\0", 4) + data,
               nullptr);
}

void round_glb(const fs::path& path, std::size_t num_bytes) {
  const ColoredMesh part{"part", {10, 20, 30}, round_mesh(num_bytes, 18)};
  (void)save_colored_meshes({&part, 1}, path);
}

void mesh_tool(const fs::path& path, std::size_t num_bytes) {
  SpherePacking packing;
  packing.spheres = {{{0, 0, 0}, 0.01f}};
  (void)save_tool(*Tool::build(round_mesh(num_bytes, 24), std::move(packing)), path);
}
void spheres_tool(const fs::path& path, std::size_t num_bytes) {
  constexpr double kBytesPerSphere = 100;
  const double num = static_cast<double>(num_bytes) / kBytesPerSphere;
  (void)save_tool(test::block_of_spheres(static_cast<int>(std::cbrt(num))), path);
}

using Tetrahedron = std::array<Vec3d, 4>;

/// each(i) is the i-th of so many.
void tetrahedra_stl(const fs::path& path, std::size_t num,
                    const std::function<Tetrahedron(std::size_t)>& each) {
  constexpr std::size_t kBytes = 4 * 50;
  const std::string head = stl_head(4 * num);
  write_pieces(path, head.size() + kBytes * num, head, [&](std::size_t i) {
    std::string facets;
    const Tetrahedron corners = each(i);
    for (const auto& face : {std::array{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}}) {
      facets.append(12, '\0');
      for (const int corner : face) {
        const Vec3f p = to_float(corners[corner]);
        facets.append(reinterpret_cast<const char*>(&p), sizeof p);
      }
      facets.append(2, '\0');
    }
    return facets;
  });
}
/// Their check takes a large part of the time that an input may take at most: it is not of any
/// size.
std::size_t num_tetrahedra(std::size_t num_bytes) {
  return std::min<std::size_t>(num_bytes, 20'000'000) / 200;
}

/// Side by side, along a diagonal.
void needles_stl(const fs::path& path, std::size_t num_bytes) {
  const Quaternion turn = axis_angle({1, -2, 3}, 0.9);
  tetrahedra_stl(path, num_tetrahedra(num_bytes), [&](std::size_t i) {
    const Vec3d column{1e-4 * static_cast<double>(i % 128), 1e-4 * static_cast<double>(i / 128), 0};
    Tetrahedron needle{{{4e-5, 0, 0}, {-2e-5, 3e-5, 0}, {-2e-5, -3e-5, 0}, {0, 0, 0.5}}};
    for (Vec3d& p : needle) p = rotate(turn, column + p);
    return needle;
  });
}

/// One in the other, every second a cavity.
void nested_stl(const fs::path& path, std::size_t num_bytes) {
  const std::size_t num = num_tetrahedra(num_bytes);
  tetrahedra_stl(path, num, [&](std::size_t i) {
    const double s = 0.1 * (1 - 0.5 * static_cast<double>(i) / static_cast<double>(num));
    Tetrahedron shell{{{s, s, s}, {-s, s, -s}, {-s, -s, s}, {s, -s, -s}}};
    if (i % 2 == 1) std::swap(shell[0], shell[1]);
    return shell;
  });
}

/// All but the first in a place much smaller than the distance to it.
void crowded_stl(const fs::path& path, std::size_t num_bytes) {
  const std::size_t num = num_tetrahedra(num_bytes);
  const auto side = static_cast<std::size_t>(std::cbrt(static_cast<double>(num))) + 1;
  const double step = 2e-4 / static_cast<double>(side), s = step / 3;
  tetrahedra_stl(path, num, [&](std::size_t i) {
    const Vec3d at =
        i == 0 ? Vec3d{1, 0, 0}
               : step * Vec3d{static_cast<double>(i % side), static_cast<double>(i / side % side),
                              static_cast<double>(i / side / side)};
    return Tetrahedron{at, at + Vec3d{0, s, 0}, at + Vec3d{s, 0, 0}, at + Vec3d{0, 0, s}};
  });
}

// With the check of what is to be packed, for self-intersections and parts in each other.
constexpr double kCheckSeconds = 100;

Status read_mesh(const fs::path& path) { return status_of(load_mesh(path)); }
Status read_solid(const fs::path& path) {
  const auto mesh = load_mesh(path);
  if (!mesh) return mesh.error();
  return status_of(check_solid(*mesh));
}
Status read_tool(const fs::path& path) { return status_of(load_tool(path)); }

}  // namespace

std::vector<LargeInput> large_meshes() {
  return {{"OBJ", "triangles", true, triangles_obj, read_mesh, ".obj"},
          {"OBJ", "polygons of 1000 corners", {}, polygons_obj, read_mesh, ".obj"},
          {"OBJ", "one line in parts of a byte", true, broken_lines_obj, read_mesh, ".obj"},
          {"STL", "binary", true, facets_stl, read_mesh, ".stl"},
          {"STL", "text", true, text_stl, read_mesh, ".stl"},
          {"STL", "empty solids", {}, solids_stl, read_mesh, ".stl"},
          {"solid", "needles", true, needles_stl, read_solid, ".stl", kCheckSeconds},
          {"solid", "one in the other", {}, nested_stl, read_solid, ".stl", kCheckSeconds},
          {"solid", "crowded", {}, crowded_stl, read_solid, ".stl", kCheckSeconds},
          {"PLY", "text", true, strip_ply, read_mesh, ".ply"},
          {"PLY", "polygons of 1000 corners", {}, polygons_ply, read_mesh, ".ply"},
          {"PLY", "a header of elements", false, elements_ply, read_mesh, ".ply"},
          {"OFF", "corners", true, strip_off, read_mesh, ".off"},
          {"OFF", "polygons of 1000 corners", {}, polygons_off, read_mesh, ".off"},
          {"glTF", "nodes and scenes", {}, scenes_gltf, read_mesh, ".gltf"},
          {"glTF", "buffers of one file", {}, buffers_gltf, read_mesh, ".gltf"},
          {"GLB", "triangles", true, round_glb, read_mesh, ".glb"},
          {"GLB", "a mesh that is placed often", {}, placed_glb, read_mesh, ".glb"},
          {"tool", "mesh", true, mesh_tool, read_tool, ".palp"},
          {"tool", "spheres", true, spheres_tool, read_tool, ".palp"}};
}

}  // namespace palpate::fuzz
