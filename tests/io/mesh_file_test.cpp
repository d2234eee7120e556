// Mesh files: every format, every real mesh by name, and files that are damaged.
#include "palpate/io/formats.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "src/io/internal/atomic_file.h"
#include "tests/io/mesh_file_case.h"
#include "tests/test_util/data.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using namespace test;  // NOLINT: of mesh_file_case.h, all of it

std::string text(const fs::path& path) { return *read_file(path); }

std::string off_text(const TriangleMesh& mesh) {
  std::string out = "OFF # a comment\n" + std::to_string(mesh.vertices.size()) + " " +
                    std::to_string(mesh.triangles.size()) + " 0\n\n";
  for (const Vec3d& p : mesh.vertices) {
    out += std::to_string(p.x) + " " + std::to_string(p.y) + " " + std::to_string(p.z) + "\n";
  }
  for (const auto& t : mesh.triangles) {
    out += "3 " + std::to_string(t[0]) + " " + std::to_string(t[1]) + " " + std::to_string(t[2]) +
           " 255 0 0\n";
  }
  return out;
}

std::string ply_text(const TriangleMesh& mesh) {
  std::string out =
      "ply\r\nformat ascii 1.0\r\ncomment c\r\nelement vertex " +
      std::to_string(mesh.vertices.size()) +
      "\r\nproperty float x\r\nproperty float y\r\nproperty float z\r\nproperty uchar red\r\n"
      "element face " +
      std::to_string(mesh.triangles.size()) +
      "\r\nproperty list uchar uint vertex_index\r\nproperty int flags\r\nend_header\r\n";
  for (const Vec3d& p : mesh.vertices) {
    out += std::to_string(p.x) + " " + std::to_string(p.y) + " " + std::to_string(p.z) + " 7\r\n";
  }
  for (const auto& t : mesh.triangles) {
    out += "3 " + std::to_string(t[0]) + " " + std::to_string(t[1]) + " " + std::to_string(t[2]) +
           " 0\r\n";
  }
  return out;
}

std::string stl_text(const TriangleMesh& mesh) {
  std::string out = "solid part\n";
  for (const auto& t : mesh.triangles) {
    out += "facet normal 0 0 0\nouter loop\n";
    for (const std::uint32_t v : t) {
      const Vec3d& p = mesh.vertices[v];
      out += "vertex " + std::to_string(p.x) + " " + std::to_string(p.y) + " " +
             std::to_string(p.z) + "\n";
    }
    out += "endloop\nendfacet\n";
  }
  return out + "endsolid part\n";
}

TEST_F(MeshFile, PlyRoundTripIsExact) {
  const TriangleMesh mesh = make_spiral(0.02, 0.004, 0.014, 2, 20, 8);
  ASSERT_TRUE(save_mesh(mesh, folder_ / "m.ply"));
  const auto read = load_mesh(folder_ / "m.ply");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->vertices, mesh.vertices);
  EXPECT_EQ(read->triangles, mesh.triangles);
  const auto scaled = load_mesh(folder_ / "m.ply", 0.001);
  ASSERT_TRUE(scaled);
  EXPECT_EQ(scaled->vertices[5], mesh.vertices[5] * 0.001);
}

TEST_F(MeshFile, ObjRoundTripIsExact) {
  const TriangleMesh mesh = make_spiral(0.02, 0.004, 0.014, 2, 20, 8);
  ASSERT_TRUE(save_mesh(mesh, folder_ / "m.obj"));
  const auto read = load_mesh(folder_ / "m.obj");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->vertices, mesh.vertices);
  EXPECT_EQ(read->triangles, mesh.triangles);
}

TEST_F(MeshFile, ConcavePolygonsStayWithinTheirOutline) {
  // An L-shaped prism with hexagons as its ends: every corner may be the first.
  for (int first = 0; first < 6; ++first) {
    const int outline[6][2] = {{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}};
    std::string obj, top = "f", bottom = "f", sides;
    for (int i = 0; i < 6; ++i) {
      const auto& [x, y] = outline[(first + i) % 6];
      const std::string place = "v 0." + std::to_string(x) + " ." + std::to_string(y);
      obj += place + " 0\n" + place + " 0.1\n";
      const int a = 2 * i + 1, b = 2 * ((i + 1) % 6) + 1;
      top += ' ' + std::to_string(a + 1);
      bottom += ' ' + std::to_string(2 * (5 - i) + 1);
      sides += "f " + std::to_string(a) + " " + std::to_string(b) + " \\\n" +
               std::to_string(b + 1) + " " + std::to_string(a + 1) + "\n";
    }
    const auto mesh = load_mesh(write("l.obj", obj + top + "\n" + bottom + "\n" + sides));
    ASSERT_TRUE(mesh) << mesh.error().message;
    const auto solid = check_solid(*mesh);
    ASSERT_TRUE(solid) << solid.error().message;
    EXPECT_NEAR(mass_properties(solid->mesh).volume, 0.003, 1e-12);
    EXPECT_EQ(solid->mesh.triangles.size(), 20u);
  }
}

TEST_F(MeshFile, ObjAndStlRoundTripToSinglePrecision) {
  for (const char* name : {"m.obj", "m.stl", "m.ply"}) {
    SCOPED_TRACE(name);
    ASSERT_TRUE(save_mesh(sample(), folder_ / name));
    expect_same_solid(load_mesh(folder_ / name), sample(), 1e-6);
  }
}

TEST_F(MeshFile, ReadsTextFormats) {
  expect_same_solid(load_mesh(write("m.off", off_text(sample()))), sample(), 1e-4);
  expect_same_solid(load_mesh(write("m.ply", ply_text(sample()))), sample(), 1e-4);
  expect_same_solid(load_mesh(write("m.STL", stl_text(sample()))), sample(), 1e-4);
}

TEST_F(MeshFile, TriangulatesPolygonsAndSkipsLines) {
  const std::string corners =
      "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv .1 .1 0\nv 0 0 .1\nv .1 0 .1\nv 0 .1 .1\nv .1 .1 .1\n";
  const auto mesh =
      load_mesh(write("cube.obj", corners + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\no a\nf 1 3 4 2\nf 5 6 "
                                            "8 7\nf 1 2 6 5\no b\nf 3/1 7/2 8/3 4/4\n"
                                            "f 1 5 7 3\nf -7 -5 -1 -3\nl 1 8\n"));
  expect_same_solid(mesh, make_box({0.1, 0.1, 0.1}), 1e-6);
  const auto off = load_mesh(write("cube.off",
                                   "OFF 8 6 0\n0 0 0\n.1 0 0\n0 .1 0\n.1 .1 0\n0 0 .1\n.1 0 .1\n"
                                   "0 .1 .1\n.1 .1 .1\n4 0 2 3 1\n4 4 5 7 6\n4 0 1 5 4\n4 2 6 7 3\n"
                                   "4 0 4 6 2\n4 1 3 7 5"));
  expect_same_solid(off, make_box({0.1, 0.1, 0.1}), 1e-6);
}

TEST_F(MeshFile, TextMayBeginWithAByteOrderMark) {
  ASSERT_TRUE(save_mesh(sample(), folder_ / "m.obj"));
  write("m.bin", gltf_buffer(sample()));
  for (const auto& [name, content] : {std::pair{"m.obj", text(folder_ / "m.obj")},
                                      {"m.off", off_text(sample())},
                                      {"m.ply", ply_text(sample())},
                                      {"m.stl", stl_text(sample())},
                                      {"m.gltf", gltf_json(sample(), R"("uri":"m.bin",)")}}) {
    const auto plain = load_mesh(write(name, content));
    ASSERT_TRUE(plain) << plain.error().message;
    const auto marked = load_mesh(write(name, "\xef\xbb\xbf" + content));
    ASSERT_TRUE(marked) << marked.error().message;
    EXPECT_EQ(marked->vertices, plain->vertices) << name;
    EXPECT_EQ(marked->triangles, plain->triangles) << name;
  }
}

TEST_F(MeshFile, FacesOfAPlyMayComeBeforeItsVertices) {
  ASSERT_TRUE(save_mesh(sample(), folder_ / "m.ply"));
  const std::string content = text(folder_ / "m.ply"), end = "end_header\n";
  const std::string body = content.substr(content.find(end) + end.size());
  const std::size_t vertex_bytes = 24 * sample().vertices.size();
  const auto turned = load_mesh(
      write("turned.ply", "ply\nformat binary_little_endian 1.0\nelement face " +
                              std::to_string(sample().triangles.size()) +
                              "\nproperty list uchar int vertex_indices\nelement vertex " +
                              std::to_string(sample().vertices.size()) +
                              "\nproperty double x\nproperty double y\nproperty double z\n" + end +
                              body.substr(vertex_bytes) + body.substr(0, vertex_bytes)));
  ASSERT_TRUE(turned) << turned.error().message;
  EXPECT_EQ(turned->vertices, sample().vertices);
  EXPECT_EQ(turned->triangles, sample().triangles);
  expect_error("wrong.ply",
               "ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_indices\n"
               "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
               "end_header\n3 0 1 2\n3 0 1 9\n0 0 0\n1 0 0\n0 1 0\n",
               "in face 1: vertex 9 of 3");
}

TEST_F(MeshFile, BadArgumentsAreErrors) {
  EXPECT_EQ(load_mesh(folder_ / "absent.obj").error().code, Errc::not_found);
  const auto unknown = load_mesh(write("m.xyz", "hello"));
  EXPECT_NE(unknown.error().message.find(".glb"), std::string::npos) << unknown.error().message;
  fs::create_directories(folder_ / "folder.stl");
  EXPECT_EQ(load_mesh(folder_ / "folder.stl").error().code, Errc::bad_input);
  const fs::path good = write("m.off", off_text(sample()));
  for (const double scale : {0.0, -1.0, std::nan(""), HUGE_VAL}) {
    EXPECT_EQ(load_mesh(good, scale).error().code, Errc::invalid_argument);
  }
  EXPECT_FALSE(save_mesh(sample(), folder_ / "m.xyz"));
  EXPECT_FALSE(save_mesh(sample(), folder_ / "nowhere" / "m.ply"));
  EXPECT_FALSE(save_mesh({{}, {{0, 1, 2}}}, folder_ / "m.stl"));
  EXPECT_FALSE(fs::exists(folder_ / "m.stl"));
}

TEST_F(MeshFile, DamagedFilesAreErrors) {
  for (const std::string name : {"m.obj", "m.stl", "m.ply", "m.off", "m.gltf", "m.glb"}) {
    expect_error(name, "", "empty");
    expect_error(name, "this is not a mesh at all, only a line of text\n", "export");
    expect_error(name, std::string(500, '\0'), "export");
  }
  const std::string corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  expect_error("m.obj", corners + "f 1 2 9\n", "out of range");
  expect_error("m.obj", corners + "f 0 1 2\n", "damaged face in line 4");
  expect_error("m.obj", corners + "f 1 2\n", "only 2 corners in line 4");
  expect_error("m.obj", corners + "v 1 2\n", "damaged vertex in line 4");
  expect_error("m.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "vertex 3 of 3");
  expect_error("m.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "vertex -1 of 3");
  expect_error("m.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1    \n", "only 2 corners");
  expect_error("m.off", "OFF\n3 1 0\n0 0 0\n1 0 x\n0 1 0\n3 0 1 2\n", "vertex 1");
  expect_error("m.off", "OFF BINARY\n", "is a binary OFF file");
  expect_error("m.off", "OFF\n4000000000 4000000000 0\n0 0 0\n", "announces");
  std::string ply = ply_text(make_octahedron(0.1));
  expect_error("m.ply", ply.substr(0, ply.size() - 8), "truncated");
  expect_error("m.ply", ply.replace(ply.find("\r\n3 0 1"), 7, "\r\n3 0 9"), "vertex 9 of 6");
  expect_error("m.ply",
               "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\n"
               "property float y\nproperty float z\nend_header\n",
               "announces 4000000000");
  expect_error("m.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1 ",
               "without x, y and z");
  std::string stl(84, ' ');
  stl.replace(80, 4, "\xff\xff\xff\x7f");
  expect_error("m.stl", stl, "announces 2147483647 facets");
}

TEST_F(MeshFile, TruncationsNeverCrash) {
  for (const char* name : {"whole.ply", "whole.stl", "whole.obj"}) {
    ASSERT_TRUE(save_mesh(sample(), folder_ / name));
  }
  truncate("cut.ply", text(folder_ / "whole.ply"), true);
  truncate("cut.stl", text(folder_ / "whole.stl"), true);
  truncate("cut.obj", text(folder_ / "whole.obj"), false);
  truncate("text.ply", ply_text(sample()), true);
  truncate("text.stl", stl_text(sample()), true);
  truncate("cut.off", off_text(sample()), true);
  truncate("cut.glb", glb(sample()), true);
  write("m.bin", gltf_buffer(sample()));
  truncate("cut.gltf", gltf_json(sample(), R"("uri":"m.bin",)"), true);
}

TEST_F(MeshFile, TextStlIsReadWhateverItsCapitalsCommentsAndEmptySolids) {
  const std::string plain = stl_text(sample());
  std::string capitals = plain;
  std::ranges::transform(capitals, capitals.begin(),
                         [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  std::string one_line = plain.substr(plain.find('\n') + 1);
  one_line = "solid a\n" + one_line.substr(0, one_line.find("endsolid"));
  std::replace(one_line.begin() + 8, one_line.end(), '\n', ' ');
  const std::string empty = "solid facet\nendsolid facet\n";
  for (const std::string& text :
       {capitals, "\xef\xbb\xbf" + plain, "# a comment\n\n; more\n// and more\n  " + plain,
        empty + plain + empty, plain + "solid\r\nendsolid\r\n", one_line + "\nendsolid",
        "solid a\ncolor 1 0 0\n" + plain.substr(plain.find('\n') + 1)}) {
    SCOPED_TRACE(text.substr(0, 60));
    expect_same_solid(load_mesh(write("m.stl", text)), sample(), 1e-4);
  }
  const auto twice = load_mesh(write("m.stl", plain + capitals));
  ASSERT_TRUE(twice) << twice.error().message;
  EXPECT_EQ(twice->triangles.size(), 2 * sample().triangles.size());
  expect_error("m.stl", empty, "is empty");
  expect_error("m.stl", plain + "solid b\nfacet normal 0 0 1\n", "truncated");
  expect_error("m.stl", "solid\nfacet\nouter loop\nvertex 0 0 x\n", "damaged vertex in line 4");
  expect_error("m.stl", "solid\nfacet\nouter loop\nvertex 0 0 0\nendloop\n", "corner");
  expect_error("m.stl", "solid\nfacet\nouter loop\nvortex 0 0 0\n",
               "'vortex' in a facet in line 4");
}

TEST_F(MeshFile, PolygonsThatTakeTooLongToCutAreAnError) {
  // Corners anywhere: hardly one of them is an ear.
  test::Random random(1);
  std::string corners, face = "f";
  for (int i = 1; i <= 1000; ++i) {
    corners +=
        "v " + std::to_string(random.uniform()) + " " + std::to_string(random.uniform()) + " 0\n";
    face += " " + std::to_string(i);
  }
  std::string faces = face + "\n";
  EXPECT_TRUE(load_mesh(write("one.obj", corners + faces)));
  for (int i = 0; i < 6; ++i) faces += faces;
  expect_error("many.obj", corners + faces, "too many concave faces");
}

/// The mesh scaled such that its longest side is a hand's 0.15 m.
TriangleMesh hand_sized(TriangleMesh mesh) {
  const Bounds box = bounds(mesh);
  const Vec3d sides = box.high - box.low;
  const double scale = 0.15 / std::max({sides.x, sides.y, sides.z});
  for (Vec3d& p : mesh.vertices) p *= scale;
  return mesh;
}

/// Two parts and one without faces.
std::vector<ColoredMesh> colored() {
  std::vector<ColoredMesh> parts{
      {"ring", {150, 50, 200}, sample()}, {"none", {1, 2, 3}, {}}, {"ball", {40, 90, 230}, {}}};
  parts[2].mesh = make_icosphere(0.02, 2);
  for (Vec3d& p : parts[2].mesh.vertices) p += Vec3d{0.3, -0.2, 0.7};
  return parts;
}

TEST_F(MeshFile, ColoredMeshesAreReadBackAsOne) {
  const std::vector<ColoredMesh> parts = colored();
  TriangleMesh expected = parts[0].mesh;
  for (const Vec3d& p : parts[2].mesh.vertices) expected.vertices.push_back(p);
  const auto first = static_cast<std::uint32_t>(parts[0].mesh.vertices.size());
  for (const auto& [a, b, c] : parts[2].mesh.triangles) {
    expected.triangles.push_back({first + a, first + b, first + c});
  }
  for (const char* name : {"picture.ply", "picture.glb"}) {
    SCOPED_TRACE(name);
    const Status saved = save_colored_meshes(parts, folder_ / name);
    ASSERT_TRUE(saved) << saved.error().message;
    const auto mesh = load_mesh(folder_ / name);
    ASSERT_TRUE(mesh) << mesh.error().message;
    EXPECT_EQ(mesh->triangles, expected.triangles);
    ASSERT_EQ(mesh->vertices.size(), expected.vertices.size());
    const double rounding = name[8] == 'p' ? 0 : 1e-7;
    for (std::size_t v = 0; v < expected.vertices.size(); ++v) {
      EXPECT_LE(norm(mesh->vertices[v] - expected.vertices[v]), rounding);
    }
    const auto solid = check_solid(*mesh);
    ASSERT_TRUE(solid) << solid.error().message;
    EXPECT_TRUE(solid->warnings.empty());
  }
}

TEST_F(MeshFile, ColoredMeshesKeepTheirColors) {
  const std::vector<ColoredMesh> parts = colored();
  ASSERT_TRUE(save_colored_meshes(parts, folder_ / "picture.ply"));
  const std::string ply = text(folder_ / "picture.ply");
  const std::string end = "end_header\n";
  const std::size_t begin = ply.find(end) + end.size(), vertex_bytes = 3 * 8 + 3;
  const std::size_t num_first = parts[0].mesh.vertices.size();
  EXPECT_EQ(ply.substr(begin + 24, 3), "\x96\x32\xc8");
  EXPECT_EQ(ply.substr(begin + (num_first - 1) * vertex_bytes + 24, 3), "\x96\x32\xc8");
  EXPECT_EQ(ply.substr(begin + num_first * vertex_bytes + 24, 3), "\x28\x5a\xe6");

  ASSERT_TRUE(save_colored_meshes(parts, folder_ / "picture.glb"));
  const std::string glb = text(folder_ / "picture.glb");
  for (const char* words : {"\"ring\"", "\"ball\"", "\"baseColorFactor\":[0.30498"}) {
    EXPECT_NE(glb.find(words), std::string::npos) << words;
  }
  EXPECT_EQ(glb.find("\"none\""), std::string::npos);
}

TEST_F(MeshFile, ColoredMeshesThatCannotBeWrittenLeaveNothing) {
  std::vector<ColoredMesh> parts = colored();
  for (const char* name : {"picture.stl", "picture", "no/such/folder.ply", "no/such/folder.glb"}) {
    EXPECT_FALSE(save_colored_meshes(parts, folder_ / name)) << name;
  }
  EXPECT_FALSE(save_colored_meshes({}, folder_ / "picture.ply"));
  EXPECT_FALSE(save_colored_meshes({&parts[1], 1}, folder_ / "picture.glb"));
  parts[2].mesh.triangles[5][1] = 100000;
  for (const char* name : {"picture.ply", "picture.glb"}) {
    const Status saved = save_colored_meshes(parts, folder_ / name);
    ASSERT_FALSE(saved);
    EXPECT_NE(saved.error().message.find("uses vertex 100000"), std::string::npos);
  }
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

TEST(RealMeshes, GoodOnesAreSolids) {
  // Name, vertices, faces and volume in the units of the file, from the notes of the data set.
  const struct {
    const char* name;
    std::size_t num_vertices, num_faces;
    double volume;
  } kMeshes[] = {
      {"spiral_tool.obj", 2704, 5404, 2.44805e-05}, {"bunny_3k.off", 3485, 6966, 0.000753934},
      {"chai3d_drill.obj", 445, 886, 59858.4},      {"torus.stl", 4350, 8700, 4.91755},
      {"quadknot.obj", 1440, 2880, 1057310.0},      {"fuze_bottle.obj", 502, 1000, 0.000606689},
      {"cube_20mm_text.stl", 132, 260, 7938.68},    {"cylinder.stl", 210, 416, 25.0924},
      {"unit_sphere.stl", 642, 1280, 4.15274},      {"plate_holes.stl", 618, 1252, 767362.0},
      {"spot_cow.obj", 2930, 5856, 0.718259},       {"visp_cube.obj", 8, 12, 0.000614125}};
  PALPATE_DATA_OR_SKIP(folder, "meshes_good");
  for (const auto& expected : kMeshes) {
    SCOPED_TRACE(expected.name);
    const auto mesh = load_mesh(folder / expected.name);
    ASSERT_TRUE(mesh) << mesh.error().message;
    EXPECT_NEAR(mass_properties(*mesh).volume / expected.volume, 1, 2e-5);
    const auto solid = check_solid(hand_sized(*mesh));
    ASSERT_TRUE(solid) << solid.error().message;
    EXPECT_TRUE(solid->warnings.empty()) << solid->warnings.front();
    EXPECT_EQ(solid->mesh.vertices.size(), expected.num_vertices);
    EXPECT_EQ(solid->mesh.triangles.size(), expected.num_faces);
  }
}

TEST(RealMeshes, BadOnesEndInTheirOwnErrorOrWarning) {
  // `words` stand in the error, or in the only warning if the mesh can be accepted.
  const struct {
    const char* name;
    bool accepted;
    const char* words;
  } kMeshes[] = {{"soup.stl", false, "300 open edges"},
                 {"multibody.stl", false, "12 inconsistently oriented edges"},
                 {"joined_tetrahedra.obj", false, "3 non-manifold edges"},
                 {"chair_model.obj", false, "non-manifold edges"},
                 {"angle_block_open.stl", true, "joined"},
                 {"teapot_open.stl", false, "64 open edges"},
                 {"capsule_slivers.obj", true, "dropped 200 faces without area"},
                 {"empty.stl", false, "empty"},
                 {"not_enough_indices.obj", false, "only 2 corners in line 9"},
                 {"nan_color.obj", true, ""},
                 {"self_intersect_a.obj", false, "crosses or touches itself"},
                 {"visp_dragon.obj", false, "6 open edges (of one face only), 6 non-manifold"},
                 {"derived_drill_flipped.obj", true, "inside out"},
                 {"derived_spiral_oneflip.obj", false, "3 inconsistently oriented edges"},
                 {"derived_knot_onehole.obj", false, "3 open edges"},
                 {"derived_fuze_nan.obj", false, "not a finite number"},
                 {"derived_torus_outofrange.obj", false, "out of range"}};
  PALPATE_DATA_OR_SKIP(folder, "meshes_bad");
  for (const auto& expected : kMeshes) {
    SCOPED_TRACE(expected.name);
    std::string said;
    bool accepted = false;
    const auto mesh = load_mesh(folder / expected.name);
    if (mesh) {
      const auto solid = check_solid(hand_sized(*mesh));
      accepted = solid.has_value();
      if (!solid) said = solid.error().message;
      if (solid && !solid->warnings.empty()) said = solid->warnings.front();
    } else {
      said = mesh.error().message;
    }
    EXPECT_EQ(accepted, expected.accepted) << said;
    EXPECT_NE(said.find(expected.words), std::string::npos) << said;
  }
}

TEST(RealMeshes, WrongUnitIsNoticed) {
  PALPATE_DATA_OR_SKIP(folder, "meshes_bad");
  const auto meters = load_mesh(folder / "large_block.stl");
  ASSERT_TRUE(meters);
  const auto refused = check_solid(*meters);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("4572 m long"), std::string::npos);
  EXPECT_TRUE(check_solid(hand_sized(*meters)));
}

}  // namespace
}  // namespace palpate
