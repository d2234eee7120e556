// How far it is from each sphere of a tool to each other along the leaf graph: Priority::path.
#pragma once

#include <vector>

#include "palpate/tool/tool.h"
#include "src/contact/index/num_bytes.h"

namespace palpate::inline v0 {

/// The way goes from centre to centre.
struct PathLengths {
  /// A row for each sphere, by sphere ids, m. The graph has bridges, so that there is always a way.
  std::vector<float> lengths;

  /// Dijkstra from each sphere: O(spheres edges log spheres), a second for 2,000 spheres.
  explicit PathLengths(const Tool& tool);

  std::size_t num_bytes() const { return bytes_of(lengths); }
};

}  // namespace palpate::inline v0
