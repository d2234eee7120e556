// The leaf graph over slots: spheres in a spatial order, so that neighbors lie near each other in
// memory.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/tool/tool.h"
#include "src/contact/index/num_bytes.h"

namespace palpate { inline namespace v0 {

/// Rows one after the other; edges go both ways.
struct SortedGraph {
  std::vector<std::int32_t> sphere_ids;  ///< of each slot; -1 for padding
  std::vector<std::int32_t> slot_of;     ///< of each sphere
  std::vector<std::int32_t> row_starts;  ///< of each slot, and one past the last
  std::vector<std::int32_t> neighbors;   ///< slots

  /// `ids_of_slots`: of each slot, every sphere once; -1 (padding) has no neighbors.
  SortedGraph(const LeafGraph& graph, std::span<const std::int32_t> ids_of_slots)
      : sphere_ids(ids_of_slots.begin(), ids_of_slots.end()),
        slot_of(graph.row_starts().size() - 1) {
    for (std::size_t slot = 0; slot < sphere_ids.size(); ++slot) {
      if (sphere_ids[slot] < 0) continue;
      slot_of[static_cast<std::size_t>(sphere_ids[slot])] = static_cast<std::int32_t>(slot);
    }
    row_starts.reserve(sphere_ids.size() + 1);
    neighbors.reserve(graph.neighbors().size());
    for (const std::int32_t id : sphere_ids) {
      row_starts.push_back(static_cast<std::int32_t>(neighbors.size()));
      if (id < 0) continue;
      const auto row = static_cast<std::size_t>(id);
      for (std::int32_t e = graph.row_starts()[row]; e < graph.row_starts()[row + 1]; ++e) {
        const std::int32_t neighbor = graph.neighbors()[static_cast<std::size_t>(e)];
        neighbors.push_back(slot_of[static_cast<std::size_t>(neighbor)]);
      }
    }
    row_starts.push_back(static_cast<std::int32_t>(neighbors.size()));
  }

  std::size_t num_bytes() const { return bytes_of(sphere_ids, slot_of, row_starts, neighbors); }
};

}}  // namespace palpate::v0
