#include "src/cameras/stream/capture_clock.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {

StampOrder::Step StampOrder::add(double stamp, double arrival) {
  if (stamp > newest_) {
    newest_ = stamp;
    num_older_ = 0;
    return Step::newer;
  }
  if (num_older_ == 0 || stamp <= last_older_) {
    first_older_ = {stamp, arrival};
    num_older_ = 0;
  }
  last_older_ = stamp;
  const double between = arrival - first_older_.arrival;
  const double more = stamp - first_older_.stamp - between;
  const bool goes_on = ++num_older_ >= kNumOlder && std::abs(more) <= kPace * between;
  if (stamp >= newest_ - kLongestBack && !goes_on) return Step::older;
  newest_ = stamp;
  num_older_ = 0;
  return Step::set_back;
}

double CaptureClock::add(double stamp, double arrival) {
  const StampOrder::Step step = order_.add(stamp, arrival);
  const double delay = arrival - stamp, early = has_begun_ ? least_.y - delay : 0;
  const bool is_confirmed = early < kEarly || arrival - last_early_ < kConfirmed;
  if (early >= kEarly) last_early_ = arrival;
  const bool is_set = step == StampOrder::Step::set_back || (is_confirmed && early > kLongestJump);
  if (is_set) ++num_restarts_;
  if (is_set || !has_begun_) begin(stamp);
  if (is_set || (is_confirmed && step == StampOrder::Step::newer)) {
    keep({stamp - first_stamp_, delay});
    fit();
    follow(stamp - first_stamp_);
  }
  return std::min(stamp + least_.y, arrival);
}

void CaptureClock::begin(double stamp) {
  has_begun_ = true;
  first_stamp_ = stamp;
  bin_end_ = 0;
  num_bins_ = 0;
  least_ = {0, std::numeric_limits<double>::infinity()};
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

void CaptureClock::follow(double x) {
  least_ = {x, std::min(offset_ + slope_ * x, least_.y + kLargestDrift * (x - least_.x))};
}

}}  // namespace palpate::v0
