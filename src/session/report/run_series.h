// The course of a run, as far as pages show it.
#pragma once

#include <vector>

#include "palpate/run/records.h"

namespace palpate { inline namespace v0 {

/// Ticks of a run of any length in bounded memory: of each group of neighbors the one with the
/// largest force stays; groups double when there are too many.
class RunSeries {
 public:
  void add(const TickRecord& tick);
  const std::vector<TickRecord>& ticks() const { return ticks_; }

 private:
  static constexpr std::size_t kMaxTicks = 1 << 14;
  std::vector<TickRecord> ticks_;
  std::size_t group_size_ = 1, num_in_group_ = 0;  // the last of ticks_ stands for the open group
};

/// True if nothing was measured, which is not zero.
bool is_contact_lost(const TickRecord& tick);
/// Returns the fault of a tick; the fade at the end is none.
Fault reported_fault(const TickRecord& tick);

}}  // namespace palpate::v0
