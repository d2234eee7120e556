// Memory of the graph stage of a query on a GPU (graph_stage.cuh).
#pragma once

#include <algorithm>
#include <vector>

#include "src/contact/index/sorted_graph.h"
#include "src/contact/points/point_query.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

inline SortedGraphView sorted_graph_on_gpu(gpu::Memory& memory, const SortedGraph& graph,
                                           const SphereClusters& clusters) {
  constexpr int kPart = SortedGraphView::kPart;
  std::vector<SlotSphere> spheres;
  std::vector<RowPart> more_parts;
  for (std::size_t i = 0; i < clusters.x.size(); ++i) {
    spheres.push_back({clusters.x[i], clusters.y[i], clusters.z[i], clusters.radius[i]});
    const std::int32_t row_begin = graph.row_starts[i], row_end = graph.row_starts[i + 1];
    for (std::int32_t begin = row_begin + kPart; begin < row_end; begin += kPart) {
      more_parts.push_back(
          {static_cast<std::int32_t>(i), row_begin, begin, std::min(begin + kPart, row_end)});
    }
  }
  return {memory.copy_of(spheres), memory.copy_of(graph.row_starts),
          memory.copy_of(graph.neighbors), memory.copy_of(more_parts),
          static_cast<std::int32_t>(more_parts.size())};
}

/// Allocates the search for a graph of sorted_graph_on_gpu.
inline GraphSearch graph_search_on_gpu(gpu::Memory& memory, const SortedGraphView& graph,
                                       std::size_t num_slots, std::size_t num_edges) {
  const std::size_t num_listed = num_edges + static_cast<std::size_t>(graph.num_more_parts);
  return {memory.take<SlotState>(num_slots),
          memory.take<double>(num_slots),
          memory.take<Offer>(num_edges + GraphSearch::kFirstOffers),
          {memory.take<RowPart>(num_listed), memory.take<RowPart>(num_listed)},
          memory.take<std::int32_t>(3),
          memory.take<std::int32_t>(1),
          1};
}

}}  // namespace palpate::v0
