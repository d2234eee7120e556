// The leaf graph over places: spheres in a spatial order, so that neighbours lie near each other in
// memory.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/tool/tool.h"
#include "src/contact/index/num_bytes.h"

namespace palpate::inline v0 {

/// Rows one after the other; edges go both ways.
struct SortedGraph {
  std::vector<std::int32_t> sphere_ids;  ///< of each place; -1 for padding
  std::vector<std::int32_t> place_of;    ///< of each sphere
  std::vector<std::int32_t> row_starts;  ///< of each place, and one past the last
  std::vector<std::int32_t> neighbours;  ///< places

  /// `ids_of_places`: of each place, every sphere once; -1 (padding) has no neighbours.
  SortedGraph(const LeafGraph& graph, std::span<const std::int32_t> ids_of_places)
      : sphere_ids(ids_of_places.begin(), ids_of_places.end()),
        place_of(graph.row_starts().size() - 1) {
    for (std::size_t place = 0; place < sphere_ids.size(); ++place) {
      if (sphere_ids[place] < 0) continue;
      place_of[static_cast<std::size_t>(sphere_ids[place])] = static_cast<std::int32_t>(place);
    }
    row_starts.reserve(sphere_ids.size() + 1);
    neighbours.reserve(graph.neighbours().size());
    for (const std::int32_t id : sphere_ids) {
      row_starts.push_back(static_cast<std::int32_t>(neighbours.size()));
      if (id < 0) continue;
      const auto row = static_cast<std::size_t>(id);
      for (std::int32_t e = graph.row_starts()[row]; e < graph.row_starts()[row + 1]; ++e) {
        const std::int32_t neighbour = graph.neighbours()[static_cast<std::size_t>(e)];
        neighbours.push_back(place_of[static_cast<std::size_t>(neighbour)]);
      }
    }
    row_starts.push_back(static_cast<std::int32_t>(neighbours.size()));
  }

  std::size_t num_bytes() const { return bytes_of(sphere_ids, place_of, row_starts, neighbours); }
};

}  // namespace palpate::inline v0
