// A coarse depth stream: one depth per 0.1 s for each of a few cells of the image.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// Depths over time: linear in between, constant before the first and after the last.
struct DepthProfile {
  std::vector<double> times, depths;  ///< s, and m along z

  double at(double time) const;
};

/// Returns a profile without jumps: NaNs filled, outliers removed, smoothed over five values.
DepthProfile smooth_profile(std::vector<double> times, std::vector<double> depths);

/// Coarse depths of a stream over time. A frame counts for as long as it is current, in moments of
/// 0.1 s at most.
class CoarseDepth {
 public:
  /// Reads the stream up to `until` seconds after its first frame. Cells of a 24th of the image's
  /// width lie around the image center, but not at its border; with `around`, smaller ones lie
  /// around this pixel. If the stream ends before `shortest`, its last frame stays until then.
  /// Errors: no frame; what the stream reports.
  static Result<CoarseDepth> scan(DepthSource& stream,
                                  double until = std::numeric_limits<double>::infinity(),
                                  const std::optional<std::array<double, 2>>& around = {},
                                  double shortest = 0);

  int columns() const { return columns_; }
  int rows() const { return rows_; }
  /// Seconds from the first frame to one frame period after the last, or `shortest`.
  double duration() const { return duration_; }
  /// The middle of a cell.
  std::array<double, 2> pixel(int column, int row) const;
  /// The viewing ray through the middle of a cell, with z = 1.
  Vec3d ray(int column, int row) const;
  /// Distance from the image center to the middle of a cell, over half the image's width.
  double off_center(int column, int row) const;

  /// Share of the time without a depth here.
  double missing(int column, int row) const;
  /// Unevenness of a cell: the quadratic mean over time, so that a bad while counts, of the
  /// relative depth differences to its neighbors and to the frame before (each counted up to 0.5)
  /// and the missing measurements. Infinite if more than half of the time has no depth here.
  double unevenness(int column, int row) const;
  /// Mean depth over time, m.
  double mean_depth(int column, int row) const;
  /// The depth of a cell as smooth_profile. The cell must have a finite unevenness.
  DepthProfile profile(int column, int row) const;

 private:
  CoarseDepth(const DepthStreamInfo& info, const std::optional<std::array<double, 2>>& around);
  void add(const DepthFrame& frame);
  double measure(const DepthFrame& frame, int column, int row);
  std::size_t index(std::size_t frame, int column, int row) const;
  double depth(std::size_t frame, int column, int row) const;
  double flaw_at(std::size_t frame, int column, int row, double before) const;
  /// Time that a frame is current, s.
  double period(std::size_t frame) const;

  int cell_ = 0;  ///< pixels per side
  int columns_ = 0, rows_ = 0, width_ = 0, height_ = 0;
  int first_u_ = 0, first_v_ = 0;  ///< first pixel of the first cell; may lie outside
  Intrinsics intrinsics_;
  double duration_ = 0;
  std::vector<double> times_;  ///< since the first frame
  std::vector<float> depths_;  ///< frame by frame, row by row; NaN: too few measurements
  std::vector<float> shares_;  ///< of the pixels in each cell that are measurements, likewise
  std::vector<std::uint16_t> cell_pixels_;  ///< pixels of one cell
};

}}  // namespace palpate::v0
