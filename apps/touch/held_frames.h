// Depth sources that begin later than their stream, hold its last frame, repeat its first frames,
// or move its camera.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "palpate/cloud/depth_source.h"

namespace palpate::apps {

/// Drops the frames before the one that is current at a time stamp.
class FramesFrom : public DepthSource {
 public:
  FramesFrom(std::unique_ptr<DepthSource> stream, double start)
      : stream_(std::move(stream)), start_(start) {}

  const DepthStreamInfo& info() const override { return stream_->info(); }
  void cancel() noexcept override { stream_->cancel(); }
  std::vector<std::string> take_notes() override { return stream_->take_notes(); }
  Result<bool> next(DepthFrame& frame) override {
    if (!has_next_) {
      do {
        frame_ = std::move(next_);
        const auto got = stream_->next(next_);
        if (!got) return got.error();
        has_next_ = true;
        has_ended_ = !*got;
      } while (!has_ended_ && next_.timestamp <= start_);
      if (!frame_.pixels.empty()) {
        std::swap(frame, frame_);
        return true;
      }
    }
    if (has_ended_) return false;
    if (!next_.pixels.empty()) {
      frame = std::exchange(next_, {});
      return true;
    }
    return stream_->next(frame);
  }

 private:
  std::unique_ptr<DepthSource> stream_;
  double start_;
  DepthFrame frame_, next_;
  bool has_next_ = false, has_ended_ = false;
};

/// Repeats the last frame, for runs that last longer than their frames.
class HeldFrames : public DepthSource {
 public:
  /// Continues at the stream's rate until `duration` seconds after its first frame.
  HeldFrames(std::unique_ptr<DepthSource> stream, double duration)
      : stream_(std::move(stream)), info_(stream_->info()), duration_(duration) {
    const int num_needed = static_cast<int>(std::ceil(duration * info_.rate));
    if (info_.num_frames) info_.num_frames = std::max(*info_.num_frames, num_needed);
  }

  const DepthStreamInfo& info() const override { return info_; }
  void cancel() noexcept override { stream_->cancel(); }
  std::vector<std::string> take_notes() override { return stream_->take_notes(); }
  Result<bool> next(DepthFrame& frame) override {
    if (!has_ended_) {
      const auto got = stream_->next(frame);
      if (!got) return got.error();
      has_ended_ = !*got;
      if (*got) {
        if (last_.pixels.empty()) start_ = frame.timestamp;
        last_ = frame;
        return true;
      }
    }
    last_.timestamp += 1 / info_.rate;
    last_.flow.clear();  // a held frame stands still
    if (last_.pixels.empty() || last_.timestamp - start_ >= duration_) return false;
    frame = last_;
    return true;
  }

 private:
  std::unique_ptr<DepthSource> stream_;
  DepthStreamInfo info_;
  double duration_, start_ = 0;
  DepthFrame last_;
  bool has_ended_ = false;
};

/// Frames in memory as a stream of their own.
class PreparedFrames : public DepthSource {
 public:
  /// `frames` must outlive it.
  PreparedFrames(const std::vector<DepthFrame>& frames, const DepthStreamInfo& stream)
      : frames_(frames), info_(stream) {
    info_.is_live = false;
    info_.num_frames = static_cast<int>(frames.size());
  }

  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    if (next_ == frames_.size()) return false;
    frame = frames_[next_++];
    return true;
  }

 private:
  const std::vector<DepthFrame>& frames_;
  DepthStreamInfo info_;
  std::size_t next_ = 0;
};

/// Frames as their camera sees them, wherever it stands.
class FramesInCamera : public DepthSource {
 public:
  explicit FramesInCamera(std::unique_ptr<DepthSource> stream) : stream_(std::move(stream)) {}

  const DepthStreamInfo& info() const override { return stream_->info(); }
  void cancel() noexcept override { stream_->cancel(); }
  std::vector<std::string> take_notes() override { return stream_->take_notes(); }
  Result<bool> next(DepthFrame& frame) override {
    auto got = stream_->next(frame);
    frame.X_WC = {};
    return got;
  }

 private:
  std::unique_ptr<DepthSource> stream_;
};

/// A stream with the frames that have been taken from its beginning.
class FramesAgain : public DepthSource {
 public:
  FramesAgain(std::vector<DepthFrame> first, std::unique_ptr<DepthSource> rest)
      : first_(std::move(first)), rest_(std::move(rest)) {}

  const DepthStreamInfo& info() const override { return rest_->info(); }
  void cancel() noexcept override { rest_->cancel(); }
  std::vector<std::string> take_notes() override { return rest_->take_notes(); }
  Result<bool> next(DepthFrame& frame) override {
    if (next_ == first_.size()) return rest_->next(frame);
    frame = std::move(first_[next_++]);
    return true;
  }

 private:
  std::vector<DepthFrame> first_;
  std::unique_ptr<DepthSource> rest_;
  std::size_t next_ = 0;
};

}  // namespace palpate::apps
