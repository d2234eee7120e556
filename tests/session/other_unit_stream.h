// A camera that changes the unit of its depth in mid-stream.
#pragma once

#include "tests/session/synthetic_stream.h"

namespace palpate::test {

/// The same wall, but from frame `first` on in a fifth of the unit.
class OtherUnitStream final : public SyntheticStream {
 public:
  OtherUnitStream(int num_frames, int first) : SyntheticStream(num_frames), num_left_(first) {}
  Result<bool> next(DepthFrame& frame) override {
    auto got = SyntheticStream::next(frame);
    if (--num_left_ >= 0) return got;
    frame.unit /= 5;
    for (std::uint16_t& count : frame.pixels) count = static_cast<std::uint16_t>(5 * count);
    return got;
  }

 private:
  int num_left_;
};

}  // namespace palpate::test
