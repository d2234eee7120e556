// A depth stream at a glance: one depth per frame for each of a few cells around the image centre.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/math/vec3.h"

namespace palpate {

/// Depths over time: linear in between, constant before the first and after the last.
struct DepthProfile {
  std::vector<double> times, depths;  ///< seconds, metres along z

  double at(double time) const;
};

/// For something that cannot jump: NaNs filled, outliers removed, smoothed over five values.
DepthProfile smooth_profile(std::vector<double> times, std::vector<double> depths);

class CoarseDepth {
 public:
  /// Reads the stream up to `until` seconds after its first frame. Errors: no frame; what the
  /// stream reports.
  static Result<CoarseDepth> scan(DepthSource& stream,
                                  double until = std::numeric_limits<double>::infinity());

  int columns() const { return columns_; }
  int rows() const { return rows_; }
  /// Seconds from the first frame to one frame period after the last.
  double duration() const { return duration_; }
  /// Through the middle of a cell, with z = 1.
  Vec3d ray(int column, int row) const;

  /// How unfit a cell is to be touched: relative depth differences to its neighbours and from frame
  /// to frame, frames without depth, and a little for the distance to the image centre. Infinite if
  /// more than half of the frames have no depth here.
  double unevenness(int column, int row) const;
  /// The depth of a cell as smooth_profile. The cell must have a finite unevenness.
  DepthProfile profile(int column, int row) const;

 private:
  explicit CoarseDepth(const DepthStreamInfo& info);
  void add(const DepthFrame& frame);
  double measure(const DepthFrame& frame, int column, int row);
  int first_pixel(int cell, int num_cells, int num_pixels) const;
  double depth(std::size_t frame, int column, int row) const;

  int cell_ = 0;  ///< pixels per side
  int columns_ = 0, rows_ = 0, width_ = 0, height_ = 0;
  Intrinsics intrinsics_;
  double duration_ = 0;
  std::vector<double> times_;  ///< since the first frame
  std::vector<float> depths_;  ///< frame by frame, row by row; NaN: too few measurements
  std::vector<std::uint16_t> cell_pixels_;  ///< pixels of one cell
};

}  // namespace palpate
