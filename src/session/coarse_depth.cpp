#include "src/session/coarse_depth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "palpate/cloud/surface_estimator.h"

namespace palpate {
namespace {

constexpr int kCellsAcross = 24;   // of the whole image's width
constexpr double kMinValid = 0.3;  // of a cell's pixels
const SurfaceOptions kRange;       // what a surface is made of

/// The largest odd number of cells within the middle half of the image, so that one is central.
int odd_count(int num_pixels, int cell) { return std::max(1, (num_pixels / 2 / cell - 1) | 1); }

/// Linear over NaNs, constant at both ends.
void fill_gaps(std::vector<double>& values) {
  std::size_t known = values.size();  // index of the last known value
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (std::isnan(values[k])) continue;
    for (std::size_t gap = known == values.size() ? 0 : known + 1; gap < k; ++gap) {
      const double from = known == values.size() ? values[k] : values[known];
      const double share = known == values.size()
                               ? 1
                               : static_cast<double>(gap - known) / static_cast<double>(k - known);
      values[gap] = from + (values[k] - from) * share;
    }
    known = k;
  }
  for (std::size_t k = known + 1; k < values.size(); ++k) values[k] = values[known];
}

/// Replaces every value by a function of itself and its two neighbours on each side; the ends count
/// repeatedly.
template <class Function>
std::vector<double> over_five(const std::vector<double>& values, Function function) {
  std::vector<double> result;
  const auto last = static_cast<std::ptrdiff_t>(values.size()) - 1;
  for (std::ptrdiff_t k = 0; k <= last; ++k) {
    std::array<double, 5> five;
    for (std::ptrdiff_t i = 0; i < 5; ++i) {
      five[static_cast<std::size_t>(i)] =
          values[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(k + i - 2, 0, last))];
    }
    result.push_back(function(five));
  }
  return result;
}

double median(std::array<double, 5> five) {
  std::nth_element(five.begin(), five.begin() + 2, five.end());
  return five[2];
}

double smoothed(const std::array<double, 5>& five) {
  return (five[0] + 4 * five[1] + 6 * five[2] + 4 * five[3] + five[4]) / 16;
}

}  // namespace

double DepthProfile::at(double time) const {
  const auto after = std::upper_bound(times.begin(), times.end(), time);
  if (after == times.begin()) return depths.front();
  if (after == times.end()) return depths.back();
  const auto k = static_cast<std::size_t>(after - times.begin());
  const double share = (time - times[k - 1]) / (times[k] - times[k - 1]);
  return depths[k - 1] + (depths[k] - depths[k - 1]) * share;
}

DepthProfile smooth_profile(std::vector<double> times, std::vector<double> depths) {
  fill_gaps(depths);
  return {std::move(times), over_five(over_five(depths, median), smoothed)};
}

CoarseDepth::CoarseDepth(const DepthStreamInfo& info)
    : cell_(std::max(1, info.width / kCellsAcross)),
      columns_(odd_count(info.width, cell_)),
      rows_(odd_count(info.height, cell_)),
      width_(info.width),
      height_(info.height),
      intrinsics_(info.intrinsics) {}

Result<CoarseDepth> CoarseDepth::scan(DepthSource& stream, double until) {
  CoarseDepth coarse(stream.info());
  DepthFrame frame;
  double start = 0, time = 0;
  while (true) {
    const auto got = stream.next(frame);
    if (!got) return got.error();
    if (!*got) break;
    if (frame.width != coarse.width_ || frame.height != coarse.height_) {
      return Error{Errc::bad_input,
                   "a depth frame has another size than its stream; give frames of one size"};
    }
    if (coarse.times_.empty()) start = frame.timestamp;
    time = frame.timestamp - start;
    if (time > until) break;
    coarse.times_.push_back(time);
    coarse.add(frame);
  }
  if (coarse.times_.empty()) {
    return Error{Errc::bad_input, "the depth stream holds no frame; give at least one"};
  }
  coarse.duration_ = coarse.times_.back() + 1 / stream.info().rate;
  return coarse;
}

/// Cells lie around the image centre.
int CoarseDepth::first_pixel(int cell, int num_cells, int num_pixels) const {
  return (num_pixels - num_cells * cell_) / 2 + cell * cell_;
}

Vec3d CoarseDepth::ray(int column, int row) const {
  const double u = first_pixel(column, columns_, width_) + 0.5 * (cell_ - 1);
  const double v = first_pixel(row, rows_, height_) + 0.5 * (cell_ - 1);
  return {(u - intrinsics_.cx) / intrinsics_.fx, (v - intrinsics_.cy) / intrinsics_.fy, 1};
}

void CoarseDepth::add(const DepthFrame& frame) {
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      depths_.push_back(static_cast<float>(measure(frame, column, row)));
    }
  }
}

/// Median of the measurements in a cell.
double CoarseDepth::measure(const DepthFrame& frame, int column, int row) {
  const int u0 = first_pixel(column, columns_, width_), v0 = first_pixel(row, rows_, height_);
  cell_pixels_.clear();
  for (int v = std::max(0, v0); v < std::min(height_, v0 + cell_); ++v) {
    for (int u = std::max(0, u0); u < std::min(width_, u0 + cell_); ++u) {
      const std::uint16_t pixel =
          frame.pixels[static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) +
                       static_cast<std::size_t>(u)];
      const double z = pixel * frame.unit;
      const bool usable = pixel != 65535 && z >= kRange.min_depth && z <= kRange.max_depth;
      if (usable) cell_pixels_.push_back(pixel);
    }
  }
  if (cell_pixels_.empty() || static_cast<double>(cell_pixels_.size()) < kMinValid * cell_ * cell_)
    return NAN;
  const auto middle = cell_pixels_.begin() + static_cast<std::ptrdiff_t>(cell_pixels_.size() / 2);
  std::nth_element(cell_pixels_.begin(), middle, cell_pixels_.end());
  return *middle * frame.unit;
}

double CoarseDepth::depth(std::size_t frame, int column, int row) const {
  const auto cells = static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  return static_cast<double>(
      depths_[frame * cells + static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
              static_cast<std::size_t>(column)]);
}

double CoarseDepth::unevenness(int column, int row) const {
  constexpr double kMissingCost = 0.5, kCentreCost = 0.03;
  double flaws = 0, before = NAN;
  std::size_t num_missing = 0;
  for (std::size_t k = 0; k < times_.size(); ++k) {
    const double here = depth(k, column, row);
    if (std::isnan(here)) {
      ++num_missing;
      continue;
    }
    if (!std::isnan(before)) flaws += std::abs(here - before) / here;
    before = here;
    double difference = 0;
    int num_neighbours = 0;
    for (int r = std::max(0, row - 1); r <= std::min(rows_ - 1, row + 1); ++r) {
      for (int c = std::max(0, column - 1); c <= std::min(columns_ - 1, column + 1); ++c) {
        if (r == row && c == column) continue;
        const double there = depth(k, c, r);
        difference += std::isnan(there) ? kMissingCost : std::abs(there - here) / here;
        ++num_neighbours;
      }
    }
    if (num_neighbours > 0) flaws += difference / num_neighbours;
  }
  const auto num_frames = static_cast<double>(times_.size());
  const double missing = static_cast<double>(num_missing) / num_frames;
  if (missing > 0.5) return INFINITY;
  const double off_centre = std::hypot(column - columns_ / 2, row - rows_ / 2);
  return flaws / num_frames + kMissingCost * missing + kCentreCost * off_centre / kCellsAcross;
}

DepthProfile CoarseDepth::profile(int column, int row) const {
  std::vector<double> times, depths;
  for (std::size_t k = 0; k < times_.size(); ++k) {
    // A frame is felt until the next one comes: the middle of that time stands for it.
    const double end = k + 1 < times_.size() ? times_[k + 1] : duration_;
    times.push_back((times_[k] + end) / 2);
    depths.push_back(depth(k, column, row));
  }
  return smooth_profile(std::move(times), std::move(depths));
}

}  // namespace palpate
