// Points of the solid from which the first spheres grow.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "palpate/core/core.h"
#include "src/packing/ascent.h"

namespace palpate { inline namespace v0 {

struct StartingPoints {
  std::vector<Ball>
      balls;           ///< inside points; the radius is their distance to the mesh, or a bit less
  double spacing = 0;  ///< of the grid
};

/// Cell centers of a grid over `box` that `jitter` shifts (0: not at all), and the balls that touch
/// the middle of some facets from inside, which find what is thinner than a cell. Their order
/// depends on the arguments only. `keep_going` is called many times on the calling thread; nothing
/// if it says no.
std::optional<StartingPoints> starting_points(const FreeSpace& space, const Bounds& box,
                                              std::uint64_t jitter, ThreadPool& pool,
                                              const std::function<bool()>& keep_going);

}}  // namespace palpate::v0
