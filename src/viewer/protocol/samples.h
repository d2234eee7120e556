// A bounded queue of samples, from a loop to pages.
#pragma once

#include <deque>
#include <vector>

#include "palpate/run/run_loop.h"
#include "palpate/viewer/viewer.h"

namespace palpate { inline namespace v0 {

/// Returns the sample of a tick. Without a hand, F_H_B is the force on the tool.
ViewSample sample_of(const TickRecord& tick, bool has_hand);

/// Samples of the last seconds; older ones that were not fetched are dropped.
class SampleQueue {
 public:
  static constexpr double kSeconds = 4;

  void add(const ViewSample& sample);
  void clear() { samples_.clear(); }
  /// Moves all to the end of `samples`.
  void take(std::vector<ViewSample>& samples);

 private:
  static constexpr std::size_t kMaxSamples = 40000;  // at any rate
  std::deque<ViewSample> samples_;
};

}}  // namespace palpate::v0
