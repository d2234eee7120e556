#include "src/contact/points/scan/boundary_points.h"

namespace palpate { inline namespace v0 {

BoundaryPoints::BoundaryPoints(std::size_t num_spheres, ThreadPool& pool, ScanPoints scan_points,
                               bool has_edges)
    : pool_(&pool),
      scan_points_(scan_points),
      tasks_(static_cast<std::size_t>(pool.num_threads())),
      edge_sums_(has_edges ? num_spheres : 0) {
  for (Task& task : tasks_) {
    task.sums.resize(num_spheres);
    task.touched.assign((num_spheres + 7) / 8 * 8, 0);
  }
}

void BoundaryPoints::collect(PointScan scan, const ImageWindow& window, bool with_edges) {
  with_edges_ = with_edges;
  if (with_edges) scan.edges = edge_sums_.data();
  const int num_tasks = static_cast<int>(tasks_.size());
  const bool by_rows = scan.cloud.height > 1;
  const int begin = by_rows ? window.row_begin : window.column_begin;
  const int end = by_rows ? window.row_end : window.column_end;
  pool_->parallel_for(num_tasks, [&](int t) {
    const int from =
        begin + static_cast<int>(static_cast<std::int64_t>(end - begin) * t / num_tasks);
    const int to =
        begin + static_cast<int>(static_cast<std::int64_t>(end - begin) * (t + 1) / num_tasks);
    Task& task = tasks_[static_cast<std::size_t>(t)];
    if (by_rows) {
      scan_points_(scan, from, to, window.column_begin, window.column_end, task.sums.data(),
                   task.touched.data());
    } else {
      scan_points_(scan, window.row_begin, window.row_end, from, to, task.sums.data(),
                   task.touched.data());
    }
  });

  Task& all = tasks_[0];
  for (std::size_t t = 1; t < tasks_.size(); ++t) {
    take_touched(tasks_[t].touched, [&](std::size_t id) {
      all.sums[id].add(tasks_[t].sums[id]);
      tasks_[t].sums[id] = PointSums{};
      all.touched[id] = 1;
    });
  }
}

}}  // namespace palpate::v0
