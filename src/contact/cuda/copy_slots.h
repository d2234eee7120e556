// Choice among two copies, kept for the surfaces of a blend between two frames: the one that shows
// a view, or the one to replace.
#pragma once

#include <cstdint>

#include "palpate/gpu/devices.h"

namespace palpate { inline namespace v0 {

/// Source of values. Equal stamps mean equal values, unless they are 0.
struct CopySource {
  std::uint64_t stamp = 0;
  const void* data = nullptr;
  int gpu = kHostMemory;
};

class CopySlots {
 public:
  static constexpr int kNum = 2;

  struct Choice {
    int slot;
    bool is_known;  ///< the slot shows the source; else it is the one used longest ago
  };
  Choice choose(const CopySource& source) {
    for (int slot = 0; slot < kNum; ++slot) {
      const CopySource& copied = uses_[slot].source;
      if (source.stamp != 0 && copied.stamp == source.stamp && copied.data == source.data &&
          copied.gpu == source.gpu) {
        uses_[slot].number = ++num_uses_;
        return {slot, true};
      }
    }
    const int oldest = uses_[0].number <= uses_[1].number ? 0 : 1;
    uses_[oldest] = {{}, ++num_uses_};
    return {oldest, false};
  }
  /// Call after the copy has been made.
  void note(int slot, const CopySource& source) { uses_[slot].source = source; }

 private:
  struct Use {
    CopySource source;
    std::uint64_t number = 0;
  };
  Use uses_[kNum];
  std::uint64_t num_uses_ = 0;
};

}}  // namespace palpate::v0
