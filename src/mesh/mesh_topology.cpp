#include "src/mesh/mesh_topology.h"

#include <algorithm>
#include <numeric>
#include <tuple>

namespace palpate { inline namespace v0 {

bool same_edge(const HalfEdge& a, const HalfEdge& b) {
  return std::minmax(a.from, a.to) == std::minmax(b.from, b.to);
}

std::vector<HalfEdge> sorted_half_edges(const std::vector<Triangle>& triangles) {
  std::vector<HalfEdge> edges;
  edges.reserve(3 * triangles.size());
  for (std::size_t face = 0; face < triangles.size(); ++face) {
    for (int k = 0; k < 3; ++k) {
      edges.push_back(
          {triangles[face][k], triangles[face][(k + 1) % 3], static_cast<std::uint32_t>(face)});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const HalfEdge& a, const HalfEdge& b) {
    const auto key = [](const HalfEdge& e) {
      return std::tuple(std::min(e.from, e.to), std::max(e.from, e.to), e.face, e.from);
    };
    return key(a) < key(b);
  });
  return edges;
}

EdgeFaults find_edge_faults(const std::vector<Triangle>& triangles) {
  const std::vector<HalfEdge> edges = sorted_half_edges(triangles);
  EdgeFaults faults;
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    while (end < edges.size() && same_edge(edges[begin], edges[end])) ++end;
    const bool had_none = faults.none();
    if (end - begin == 1) {
      ++faults.open;
    } else if (end - begin > 2) {
      ++faults.non_manifold;
    } else if (edges[begin].from == edges[begin + 1].from) {
      ++faults.inconsistent;
    }
    if (had_none) faults.first = edges[begin];
  }
  return faults;
}

std::vector<std::uint32_t> shell_of_faces(const std::vector<Triangle>& triangles) {
  // Union-find over faces; the root of a set is its lowest face.
  std::vector<std::uint32_t> parent(triangles.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](std::uint32_t face) {
    while (parent[face] != face) face = parent[face] = parent[parent[face]];
    return face;
  };
  const std::vector<HalfEdge> edges = sorted_half_edges(triangles);
  for (std::size_t i = 1; i < edges.size(); ++i) {
    if (!same_edge(edges[i - 1], edges[i])) continue;
    const auto [low, high] = std::minmax({root(edges[i - 1].face), root(edges[i].face)});
    parent[high] = low;
  }
  std::vector<std::uint32_t> shell(triangles.size());
  std::uint32_t num_shells = 0;
  for (std::uint32_t face = 0; face < shell.size(); ++face) {
    shell[face] = parent[face] == face ? num_shells++ : shell[root(face)];
  }
  return shell;
}

}}  // namespace palpate::v0
