// First stage of a query over all threads: the sums of the points inside each sphere.
#pragma once

#include <span>
#include <vector>

#include "palpate/core/core.h"
#include "src/contact/points/scan/image_window.h"
#include "src/contact/points/scan/point_scan.h"

namespace palpate { inline namespace v0 {

/// All memory is allocated at construction.
class BoundaryPoints {
 public:
  /// `pool` must outlive it. Without `has_edges` edges cannot be requested.
  BoundaryPoints(std::size_t num_spheres, ThreadPool& pool, ScanPoints scan_points, bool has_edges);

  /// Adds up the points of the window. Rows (or runs of an unorganized cloud) are shared out; the
  /// sums are integers, so merging them in any order gives the same bits. `scan` needs no edge
  /// sums: they are filled in if `with_edges`.
  void collect(PointScan scan, const ImageWindow& window, bool with_edges);

  /// Calls visit(sphere_id, sums, edge_sums) for every sphere that contains points, ascending, and
  /// forgets its sums. The edge sums are zero without edges.
  template <class Visit>
  void take(Visit&& visit) {
    take_touched(tasks_[0].touched, [&](std::size_t id) {
      visit(id, tasks_[0].sums[id], with_edges_ ? edge_sums_[id] : EdgeSums{});
      tasks_[0].sums[id] = PointSums{};
      if (with_edges_) edge_sums_[id] = EdgeSums{};
    });
  }

 private:
  // Points of one task, merged into the first task's sums afterwards.
  struct Task {
    std::vector<PointSums> sums;        // one per sphere
    std::vector<std::uint8_t> touched;  // one per sphere, and up to a multiple of eight
  };

  ThreadPool* pool_;
  ScanPoints scan_points_;
  std::vector<Task> tasks_;
  std::vector<EdgeSums> edge_sums_;  // of all tasks; empty without edges
  bool with_edges_ = false;
};

}}  // namespace palpate::v0
