#include "src/cameras/capture_clock.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate::inline v0 {

double CaptureClock::add(double stamp, double arrival) {
  const double delay = arrival - stamp;
  if (has_begun_ && std::abs(delay - (offset_ + slope_ * (stamp - first_stamp_))) > kLongestJump) {
    const int num = num_restarts_ + 1;
    reset();
    num_restarts_ = num;
  }
  if (!has_begun_) {
    has_begun_ = true;
    first_stamp_ = stamp;
    bin_end_ = 0;
  }
  keep({stamp - first_stamp_, delay});
  fit();
  return std::min(stamp + offset_ + slope_ * (stamp - first_stamp_), arrival);
}

void CaptureClock::keep(const Point& point) {
  if (num_bins_ > 0 && point.x < bin_end_) {
    if (point.y < bins_[num_bins_ - 1].y) bins_[num_bins_ - 1] = point;
    return;
  }
  if (num_bins_ == kNumBins) {
    std::move(bins_.begin() + 1, bins_.end(), bins_.begin());
    --num_bins_;
  }
  bins_[num_bins_++] = point;
  bin_end_ = kBinSeconds * (std::floor(point.x / kBinSeconds) + 1);
}

void CaptureClock::fit() {
  slope_ = 0;
  if (bins_[num_bins_ - 1].x - bins_[0].x >= kShortestBase) {
    // The lower hull, and its edge below the middle of all points.
    std::array<Point, kNumBins> hull;
    std::size_t num = 0;
    double middle = 0;
    for (std::size_t i = 0; i < num_bins_; ++i) {
      const Point& p = bins_[i];
      middle += p.x / static_cast<double>(num_bins_);
      const auto is_above = [&] {
        const Point &a = hull[num - 2], &b = hull[num - 1];
        return (b.y - a.y) * (p.x - a.x) >= (p.y - a.y) * (b.x - a.x);
      };
      while (num >= 2 && is_above()) --num;
      hull[num++] = p;
    }
    std::size_t edge = 1;
    while (edge + 1 < num && hull[edge].x < middle) ++edge;
    const Point &a = hull[edge - 1], &b = hull[edge];
    slope_ = std::clamp((b.y - a.y) / (b.x - a.x), -kLargestDrift, kLargestDrift);
  }
  offset_ = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < num_bins_; ++i) {
    offset_ = std::min(offset_, bins_[i].y - slope_ * bins_[i].x);
  }
}

}  // namespace palpate::inline v0
