#include "src/contact/index/path_lengths.h"

#include <cstdint>
#include <functional>
#include <queue>
#include <span>
#include <utility>

namespace palpate { inline namespace v0 {

PathLengths::PathLengths(const Tool& tool) {
  const std::span<const Sphere> spheres = tool.spheres();
  const auto starts = tool.graph().row_starts(), neighbors = tool.graph().neighbors();
  const std::size_t n = spheres.size();
  std::vector<double> edge_lengths;
  for (std::size_t i = 0; i < n; ++i) {
    for (auto e = starts[i]; e < starts[i + 1]; ++e) {
      const auto j = static_cast<std::size_t>(neighbors[static_cast<std::size_t>(e)]);
      edge_lengths.push_back(norm(to_double(spheres[j].center) - to_double(spheres[i].center)));
    }
  }
  using Entry = std::pair<double, std::size_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  std::vector<double> way(n);
  lengths.reserve(n * n);
  for (std::size_t from = 0; from < n; ++from) {
    way.assign(n, 1e300);
    way[from] = 0;
    open.push({0, from});
    while (!open.empty()) {
      const auto [length, i] = open.top();
      open.pop();
      if (length > way[i]) continue;
      for (auto e = static_cast<std::size_t>(starts[i]);
           e < static_cast<std::size_t>(starts[i + 1]); ++e) {
        const auto j = static_cast<std::size_t>(neighbors[e]);
        if (length + edge_lengths[e] >= way[j]) continue;
        way[j] = length + edge_lengths[e];
        open.push({way[j], j});
      }
    }
    for (const double length : way) lengths.push_back(static_cast<float>(length));
  }
}

}}  // namespace palpate::v0
