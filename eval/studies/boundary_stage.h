// The first stage of a point-based query: finds the points in each sphere, with their sums per
// sphere (thesis section 3.2.1). For measurements.
#pragma once

#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "palpate/tool/tool.h"
#include "src/contact/index/sphere_grid.h"
#include "src/contact/points/scan/image_window.h"
#include "src/contact/points/scan/point_scan.h"

namespace palpate::eval {

class BoundaryStage {
 public:
  /// `tool` and `cloud` must outlive it.
  BoundaryStage(const Tool& tool, const PointCloudView& cloud)
      : grid_(tool.spheres()),
        box_T_(bounds_of(tool.spheres())),
        sums_(tool.spheres().size()),
        touched_((tool.spheres().size() + 7) / 8 * 8) {
    scan_.cloud = cloud;
    scan_.grid = grid_.view();
    scan_.spheres = tool.spheres().data();
  }
  BoundaryStage(const BoundaryStage&) = delete;  // the scan points into the grid
  BoundaryStage& operator=(const BoundaryStage&) = delete;

  /// Calls visit(sphere_id, sums), ascending, for every sphere that holds a point.
  template <class Visit>
  void run(const Pose& X_WT, Visit&& visit) {
    const ImageWindow window = image_window(scan_.cloud, box_T_, X_WT);
    scan_.R_TW = rotation_matrix(conjugate(X_WT.rotation));
    scan_.translation_W = X_WT.translation;
    scan_points_(scan_, window.row_begin, window.row_end, window.column_begin, window.column_end,
                 sums_.data(), touched_.data());
    take_touched(touched_, [&](std::size_t id) {
      visit(id, sums_[id]);
      sums_[id] = PointSums{};  // ready for the next pose
    });
  }

 private:
  SphereGrid grid_;
  Bounds box_T_;
  PointScan scan_;
  std::vector<PointSums> sums_;
  std::vector<std::uint8_t> touched_;
  static constexpr ScanPoints kScanPoints[] = PALPATE_BY_ISA(scan_points);
  ScanPoints scan_points_ = select_isa(kScanPoints, best_isa());
};

}  // namespace palpate::eval
