// A small depth stream with an optical flow.
#pragma once

#include "tests/session/synthetic_stream.h"

namespace palpate::test {

/// A SyntheticStream whose wall also moves along itself. Nobody tells the flow of its frame 4.
class FlowingStream : public DepthSource {
 public:
  explicit FlowingStream(int num_frames) : wall_(num_frames), info_(wall_.info()) {
    info_.has_flow = true;
  }
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    auto got = wall_.next(frame);
    frame.flow.clear();
    if (!got || !*got || num_++ == 4) return got;
    for (std::size_t i = 0; i < frame.pixels.size(); ++i) {
      frame.flow.push_back(static_cast<float>(20 + 0.01 * static_cast<double>(i)));
      frame.flow.push_back(static_cast<float>(-10 - num_));
    }
    return got;
  }

 private:
  SyntheticStream wall_;
  DepthStreamInfo info_;
  int num_ = 0;
};

}  // namespace palpate::test
