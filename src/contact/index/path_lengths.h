// Path lengths between all spheres of a tool along the leaf graph: Priority::path.
#pragma once

#include <vector>

#include "palpate/tool/tool.h"
#include "src/contact/index/num_bytes.h"

namespace palpate { inline namespace v0 {

/// Paths go from center to center.
struct PathLengths {
  /// A row for each sphere, by sphere ids, m. The graph has bridges, so there is always a path.
  std::vector<float> lengths;

  /// Dijkstra from each sphere: O(spheres edges log spheres), a second for 2,000 spheres.
  explicit PathLengths(const Tool& tool);

  std::size_t num_bytes() const { return bytes_of(lengths); }
};

}}  // namespace palpate::v0
