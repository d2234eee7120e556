#include "src/session/probing/coarse_depth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <utility>

#include "palpate/cloud/surface_estimator.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kCellsAcross = 24;       // of the whole image's width
constexpr int kFinerCellsAcross = 72;  // likewise, around a pixel that the user chose
constexpr int kCellsAround = 5;        // in each direction, around such a pixel
constexpr double kUsedShare = 0.75;    // of the image's side: a tool at its border leaves it
constexpr double kMinValid = 0.3;      // of a cell's pixels
constexpr double kMoment = 0.1;        // s
constexpr double kMissingCost = 0.5;   // as for a neighbor half as far away
const SurfaceOptions kRange;           // range of depths that surfaces use

/// The largest odd number of cells within the middle part of the image, so that one is central.
int odd_count(int num_pixels, int cell) {
  const int count = static_cast<int>(kUsedShare * num_pixels) / cell;
  return std::max(1, count % 2 == 1 ? count : count - 1);
}

/// Returns the relative difference of two depths, at most kMissingCost.
double difference(double here, double there) {
  if (std::isnan(there)) return kMissingCost;
  return std::min(kMissingCost, std::abs(there - here) / here);
}

/// Fills NaNs: linear between known values, constant at both ends.
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

/// Replaces every value by a function of itself and its two neighbors on each side; the ends count
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
  // Outliers go first: a gap beside one must not be filled from it.
  std::vector<double> known;
  std::copy_if(depths.begin(), depths.end(), std::back_inserter(known),
               [](double depth) { return !std::isnan(depth); });
  known = over_five(known, median);
  auto next = known.begin();
  for (double& depth : depths) {
    if (!std::isnan(depth)) depth = *next++;
  }
  fill_gaps(depths);
  return {std::move(times), over_five(depths, smoothed)};
}

CoarseDepth::CoarseDepth(const DepthStreamInfo& info,
                         const std::optional<std::array<double, 2>>& around)
    : cell_(std::max(1, info.width / kCellsAcross)),
      columns_(odd_count(info.width, cell_)),
      rows_(odd_count(info.height, cell_)),
      width_(info.width),
      height_(info.height),
      first_u_((width_ - columns_ * cell_) / 2),
      first_v_((height_ - rows_ * cell_) / 2),
      intrinsics_(info.intrinsics) {
  if (!around) return;
  cell_ = std::max(1, info.width / kFinerCellsAcross) | 1;
  columns_ = rows_ = kCellsAround;
  first_u_ = static_cast<int>(std::lround((*around)[0])) - columns_ * cell_ / 2;
  first_v_ = static_cast<int>(std::lround((*around)[1])) - rows_ * cell_ / 2;
}

Result<CoarseDepth> CoarseDepth::scan(DepthSource& stream, double until,
                                      const std::optional<std::array<double, 2>>& around,
                                      double shortest) {
  CoarseDepth coarse(stream.info(), around);
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
    return Error{Errc::bad_input, "the depth stream has no frames; give at least one"};
  }
  coarse.duration_ = std::max(shortest, coarse.times_.back() + 1 / stream.info().rate);
  return coarse;
}

std::array<double, 2> CoarseDepth::pixel(int column, int row) const {
  return {first_u_ + column * cell_ + 0.5 * (cell_ - 1),
          first_v_ + row * cell_ + 0.5 * (cell_ - 1)};
}

Vec3d CoarseDepth::ray(int column, int row) const {
  const auto [u, v] = pixel(column, row);
  return {(u - intrinsics_.cx) / intrinsics_.fx, (v - intrinsics_.cy) / intrinsics_.fy, 1};
}

double CoarseDepth::off_center(int column, int row) const {
  const auto [u, v] = pixel(column, row);
  return std::hypot(u - 0.5 * (width_ - 1), v - 0.5 * (height_ - 1)) / (0.5 * width_);
}

void CoarseDepth::add(const DepthFrame& frame) {
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      depths_.push_back(static_cast<float>(measure(frame, column, row)));
    }
  }
}

/// Returns the median depth of a cell, m; NaN if too few pixels are measured. Adds their share.
double CoarseDepth::measure(const DepthFrame& frame, int column, int row) {
  const int u0 = first_u_ + column * cell_, v0 = first_v_ + row * cell_;
  cell_pixels_.clear();
  int num_pixels = 0;
  for (int v = std::max(0, v0); v < std::min(height_, v0 + cell_); ++v) {
    for (int u = std::max(0, u0); u < std::min(width_, u0 + cell_); ++u) {
      ++num_pixels;
      const std::uint16_t pixel =
          frame.pixels[static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) +
                       static_cast<std::size_t>(u)];
      const double z = pixel * frame.unit;
      const bool usable = pixel != 65535 && z >= kRange.min_depth && z <= kRange.max_depth;
      if (usable) cell_pixels_.push_back(pixel);
    }
  }
  const double share = num_pixels > 0 ? static_cast<double>(cell_pixels_.size()) / num_pixels : 0;
  shares_.push_back(static_cast<float>(share));
  if (!(share >= kMinValid)) return NAN;
  const auto middle = cell_pixels_.begin() + static_cast<std::ptrdiff_t>(cell_pixels_.size() / 2);
  std::nth_element(cell_pixels_.begin(), middle, cell_pixels_.end());
  return *middle * frame.unit;
}

std::size_t CoarseDepth::index(std::size_t frame, int column, int row) const {
  const auto cells = static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  return frame * cells + static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
         static_cast<std::size_t>(column);
}

double CoarseDepth::depth(std::size_t frame, int column, int row) const {
  return static_cast<double>(depths_[index(frame, column, row)]);
}

double CoarseDepth::period(std::size_t frame) const {
  return (frame + 1 < times_.size() ? times_[frame + 1] : duration_) - times_[frame];
}

double CoarseDepth::missing(int column, int row) const {
  double missing = 0;
  for (std::size_t k = 0; k < times_.size(); ++k) {
    if (std::isnan(depth(k, column, row))) missing += period(k);
  }
  return missing / duration_;
}

double CoarseDepth::unevenness(int column, int row) const {
  double squares = 0, before = NAN;
  for (std::size_t k = 0; k < times_.size(); ++k) {
    const double flaw = flaw_at(k, column, row, before);
    squares += period(k) * flaw * flaw;
    if (const double here = depth(k, column, row); !std::isnan(here)) before = here;
  }
  return missing(column, row) > 0.5 ? INFINITY : std::sqrt(squares / duration_);
}

/// Returns a cell's flaw: 0 if it is even, like `before`, and fully measured; 1 and more: not seen.
double CoarseDepth::flaw_at(std::size_t frame, int column, int row, double before) const {
  const double here = depth(frame, column, row);
  if (std::isnan(here)) return 1;
  double flaw = kMissingCost * (1 - static_cast<double>(shares_[index(frame, column, row)]));
  if (!std::isnan(before)) flaw += difference(here, before);
  double differences = 0;
  int num_neighbors = 0;
  for (int r = std::max(0, row - 1); r <= std::min(rows_ - 1, row + 1); ++r) {
    for (int c = std::max(0, column - 1); c <= std::min(columns_ - 1, column + 1); ++c) {
      if (r == row && c == column) continue;
      differences += difference(here, depth(frame, c, r));
      ++num_neighbors;
    }
  }
  return num_neighbors > 0 ? flaw + differences / num_neighbors : flaw;
}

double CoarseDepth::mean_depth(int column, int row) const {
  double sum = 0, time = 0;
  for (std::size_t k = 0; k < times_.size(); ++k) {
    const double here = depth(k, column, row);
    if (!std::isnan(here)) sum += period(k) * here, time += period(k);
  }
  return sum / time;
}

DepthProfile CoarseDepth::profile(int column, int row) const {
  std::vector<double> times, depths;
  for (std::size_t k = 0; k < times_.size(); ++k) {
    // A frame is used until the next one comes: the middle of that time stands for it.
    const int num_moments = std::clamp(static_cast<int>(std::ceil(period(k) / kMoment)), 1, 100);
    for (int i = 0; i < num_moments; ++i) {
      times.push_back(times_[k] + period(k) * (i + 0.5) / num_moments);
      depths.push_back(depth(k, column, row));
    }
  }
  return smooth_profile(std::move(times), std::move(depths));
}

}}  // namespace palpate::v0
