#include "palpate/mesh/mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <utility>

#include "palpate/math/geometry.h"
#include "src/core/internal/assert.h"
#include "src/mesh/rings.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr Vec3d kX{1, 0, 0}, kY{0, 1, 0};

/// The default of each name in make_shape, of any size.
struct NamedShape {
  std::string_view name;
  TriangleMesh (*make)();
};

constexpr NamedShape kShapes[] = {
    {"box",
     [] {
       return make_box({1, 1, 1});
     }},
    {"octahedron", [] { return make_octahedron(1); }},
    {"tetrahedron", [] { return make_tetrahedron(1); }},
    {"sphere", [] { return make_icosphere(0.5, 4); }},
    {"cylinder", [] { return make_cylinder(0.2, 1, 64); }},
    {"stylus", [] { return make_stylus(0.04, 1, 0.2, 48); }},
    {"spiral", [] { return make_spiral(0.020, 0.004, 0.014, 4, 48, 16); }},
    {"torus", [] { return make_torus(0.35, 0.15, 96, 48); }},
    // Parts that are thin at one end. A gripper's finger: a mounting block, an arm, and a tip of
    // sheet metal.
    {"finger",
     [] {
       return make_bar({{0, 26, 18}, {36, 26, 18}, {54, 14, 16}, {182, 0.8, 10}, {196, 0.25, 8}});
     }},
    {"comb", [] { return make_comb(11, 9, 6, 0.2, 45, 14, 5); }},
    {"needle", [] { return make_stylus(0.008, 1, 0.6, 24); }},
    // Standing on its edge.
    {"blade",
     [] {
       return make_bar({{0, 170, 0.1}, {30, 190, 4}, {36, 190, 4}});
     }},
};

}  // namespace

TriangleMesh make_box(const Vec3d& size) {
  PALPATE_ASSERT(size.x > 0 && size.y > 0 && size.z > 0);
  TriangleMesh mesh;
  for (int corner = 0; corner < 8; ++corner) {
    mesh.vertices.push_back({((corner & 1) ? 0.5 : -0.5) * size.x,
                             ((corner & 2) ? 0.5 : -0.5) * size.y,
                             ((corner & 4) ? 0.5 : -0.5) * size.z});
  }
  mesh.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                    {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return mesh;
}

TriangleMesh make_octahedron(double diameter) {
  PALPATE_ASSERT(diameter > 0);
  const double r = diameter / 2;
  return {{{r, 0, 0}, {0, r, 0}, {-r, 0, 0}, {0, -r, 0}, {0, 0, r}, {0, 0, -r}},
          {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}, {1, 0, 5}, {2, 1, 5}, {3, 2, 5}, {0, 3, 5}}};
}

TriangleMesh make_tetrahedron(double edge) {
  PALPATE_ASSERT(edge > 0);
  const double height = edge * std::sqrt(2.0 / 3.0);
  const double base_radius = edge / std::sqrt(3.0);
  TriangleMesh mesh;
  const Ring base = add_ring(mesh, {0, 0, -height / 4}, kX, kY, base_radius, 3);
  close_above(mesh, base, {0, 0, 3 * height / 4});
  mesh.triangles.push_back({base[0], base[2], base[1]});
  return mesh;
}

TriangleMesh make_icosphere(double radius, int subdivisions) {
  PALPATE_ASSERT(radius > 0 && subdivisions >= 0 && subdivisions <= 10);
  // The twelve corners of an icosahedron are those of three golden rectangles.
  const double g = (1 + std::sqrt(5.0)) / 2;
  TriangleMesh mesh{
      {{-1, g, 0},
       {1, g, 0},
       {-1, -g, 0},
       {1, -g, 0},
       {0, -1, g},
       {0, 1, g},
       {0, -1, -g},
       {0, 1, -g},
       {g, 0, -1},
       {g, 0, 1},
       {-g, 0, -1},
       {-g, 0, 1}},
      {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
       {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
       {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}}};
  for (Vec3d& p : mesh.vertices) p = normalized(p);

  using Index = std::uint32_t;
  for (int level = 0; level < subdivisions; ++level) {
    std::map<std::pair<Index, Index>, Index> middles;
    const auto middle = [&](Index a, Index b) {
      const auto [entry, is_new] = middles.try_emplace(std::minmax(a, b), Index(0));
      if (is_new) {
        entry->second = add_vertex(mesh, normalized(mesh.vertices[a] + mesh.vertices[b]));
      }
      return entry->second;
    };
    for (const auto& [a, b, c] : std::exchange(mesh.triangles, {})) {
      const Index ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      mesh.triangles.insert(mesh.triangles.end(),
                            {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
  }
  for (Vec3d& p : mesh.vertices) p *= radius;
  return mesh;
}

TriangleMesh make_cylinder(double radius, double height, int segments) {
  PALPATE_ASSERT(radius > 0 && height > 0 && segments >= 3);
  TriangleMesh mesh;
  const Vec3d top{0, 0, height / 2};
  const Ring lower = add_ring(mesh, -top, kX, kY, radius, segments);
  const Ring upper = add_ring(mesh, top, kX, kY, radius, segments);
  connect(mesh, lower, upper);
  close_below(mesh, lower, -top);
  close_above(mesh, upper, top);
  return mesh;
}

TriangleMesh make_stylus(double radius, double length, double tip_length, int segments) {
  PALPATE_ASSERT(radius > 0 && tip_length > 0 && length > tip_length && segments >= 3);
  TriangleMesh mesh;
  const Vec3d top{0, 0, length / 2};
  const Ring lower = add_ring(mesh, {0, 0, tip_length - length / 2}, kX, kY, radius, segments);
  const Ring upper = add_ring(mesh, top, kX, kY, radius, segments);
  connect(mesh, lower, upper);
  close_below(mesh, lower, -top);
  close_above(mesh, upper, top);
  return mesh;
}

TriangleMesh make_bar(std::initializer_list<BarSection> sections) {
  PALPATE_ASSERT(sections.size() >= 2);
  const double middle = (sections.begin()->z + std::prev(sections.end())->z) / 2;
  TriangleMesh mesh;
  Ring previous{};
  const BarSection* below = nullptr;
  for (const BarSection& section : sections) {
    PALPATE_ASSERT(section.x > 0 && section.y > 0 && (below == nullptr || section.z > below->z));
    const Ring ring{static_cast<std::uint32_t>(mesh.vertices.size()), 4};
    for (const auto& [x, y] : {std::pair{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}}) {
      add_vertex(mesh, {x * section.x, y * section.y, section.z - middle});
    }
    if (below != nullptr) connect(mesh, previous, ring);
    previous = ring;
    below = &section;
  }
  const Ring first{0, 4};
  for (const auto& [a, b, c] : {std::array{0u, 2u, 1u}, {0u, 3u, 2u}}) {
    mesh.triangles.push_back({first[a], first[b], first[c]});
    mesh.triangles.push_back({previous[a], previous[c], previous[b]});
  }
  return mesh;
}

// Its outline is one row of points below the back, one above it, and the tips of the teeth; front
// and rear are the same triangles turned round, and walls run along the outline.
TriangleMesh make_comb(int num_teeth, double pitch, double tooth_width, double tip_width,
                       double tooth_length, double back_height, double thickness) {
  PALPATE_ASSERT(num_teeth >= 1 && pitch > tooth_width && tooth_width > tip_width && tip_width > 0);
  PALPATE_ASSERT(tooth_length > 0 && back_height > 0 && thickness > 0);
  using Index = std::uint32_t;
  TriangleMesh mesh;
  const auto num = static_cast<Index>(num_teeth);
  const double middle = ((num_teeth - 1) * pitch + tooth_width) / 2;
  const double bottom = -(tooth_length + back_height) / 2;
  std::vector<Index> low, high, tips;  // two of each per tooth; the rear ones have the next index
  const auto add = [&](std::vector<Index>& row, double x, double z) {
    row.push_back(add_vertex(mesh, {x - middle, -thickness / 2, z}));
    add_vertex(mesh, {x - middle, thickness / 2, z});
  };
  for (Index tooth = 0; tooth < num; ++tooth) {
    const double left = tooth * pitch, inset = (tooth_width - tip_width) / 2;
    for (const double x : {0.0, tooth_width}) {
      add(low, left + x, bottom + tooth_length);
      add(high, left + x, bottom + tooth_length + back_height);
      add(tips, left + (x > 0 ? tooth_width - inset : inset), bottom);
    }
  }
  // Four corners, counterclockwise seen from the front (-y).
  const auto plate = [&](Index a, Index b, Index c, Index d) {
    mesh.triangles.insert(mesh.triangles.end(),
                          {{a, b, c}, {a, c, d}, {a + 1, c + 1, b + 1}, {a + 1, d + 1, c + 1}});
  };
  const auto wall = [&](Index a, Index b) {
    mesh.triangles.insert(mesh.triangles.end(), {{b, a, a + 1}, {b, a + 1, b + 1}});
  };
  for (Index i = 0; i + 1 < 2 * num; ++i) {
    plate(low[i], low[i + 1], high[i + 1], high[i]);
    wall(high[i + 1], high[i]);
    if (i % 2 == 1) {  // between two teeth
      wall(low[i], low[i + 1]);
      continue;
    }
    plate(tips[i], tips[i + 1], low[i + 1], low[i]);
    wall(low[i], tips[i]);
    wall(tips[i], tips[i + 1]);
    wall(tips[i + 1], low[i + 1]);
  }
  wall(low[2 * num - 1], high[2 * num - 1]);
  wall(high[0], low[0]);
  return mesh;
}

TriangleMesh make_spiral(double helix_radius, double wire_radius, double pitch, double turns,
                         int segments_per_turn, int wire_segments) {
  PALPATE_ASSERT(wire_radius > 0 && helix_radius > wire_radius && pitch > 2 * wire_radius);
  PALPATE_ASSERT(turns > 0 && segments_per_turn >= 3 && wire_segments >= 3);
  TriangleMesh mesh;
  const double rise = pitch / (2 * kPi);  // Height gained per radian.
  const int steps = std::max(1, static_cast<int>(std::lround(turns * segments_per_turn)));
  Ring previous{};
  for (int step = 0; step <= steps; ++step) {
    const double angle = 2 * kPi * turns * step / steps;
    const Vec3d outward{std::cos(angle), std::sin(angle), 0};
    const Vec3d tangent =
        normalized(Vec3d{-helix_radius * std::sin(angle), helix_radius * std::cos(angle), rise});
    const Vec3d center = outward * helix_radius + Vec3d{0, 0, rise * (angle - kPi * turns)};
    const Ring ring =
        add_ring(mesh, center, outward, cross(tangent, outward), wire_radius, wire_segments);
    if (step == 0) close_below(mesh, ring, center);
    if (step > 0) connect(mesh, previous, ring);
    if (step == steps) close_above(mesh, ring, center);
    previous = ring;
  }
  return mesh;
}

TriangleMesh make_torus(double ring_radius, double tube_radius, int ring_segments,
                        int tube_segments) {
  PALPATE_ASSERT(tube_radius > 0 && ring_radius > tube_radius);
  PALPATE_ASSERT(ring_segments >= 3 && tube_segments >= 3);
  TriangleMesh mesh;
  std::vector<Ring> rings;
  for (int i = 0; i < ring_segments; ++i) {
    const double angle = 2 * kPi * i / ring_segments;
    const Vec3d outward{std::cos(angle), std::sin(angle), 0};
    const Vec3d tangent{-outward.y, outward.x, 0};
    rings.push_back(add_ring(mesh, outward * ring_radius, outward, cross(tangent, outward),
                             tube_radius, tube_segments));
  }
  for (std::size_t i = 0; i < rings.size(); ++i) {
    connect(mesh, rings[i], rings[(i + 1) % rings.size()]);
  }
  return mesh;
}

std::vector<std::string> shape_names() {
  std::vector<std::string> names;
  for (const NamedShape& shape : kShapes) names.emplace_back(shape.name);
  return names;
}

Result<TriangleMesh> make_shape(std::string_view name, double size) {
  if (!(size > 0) || !std::isfinite(size)) {
    return Error{Errc::invalid_argument,
                 "the size of a shape is " + std::to_string(size) + "; give meters above zero"};
  }
  std::string known;
  for (const NamedShape& shape : kShapes) {
    if (shape.name == name) {
      TriangleMesh mesh = shape.make();
      const Bounds box = bounds(mesh);
      const Vec3d sides = box.high - box.low;
      const double scale = size / std::max({sides.x, sides.y, sides.z});
      for (Vec3d& p : mesh.vertices) p *= scale;
      return mesh;
    }
    known += (known.empty() ? "" : ", ") + std::string(shape.name);
  }
  return Error{Errc::not_found,
               "there is no shape named '" + std::string(name) + "'; known are: " + known};
}

}}  // namespace palpate::v0
