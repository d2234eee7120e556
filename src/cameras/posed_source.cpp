#include "src/cameras/posed_source.h"

#include <atomic>
#include <cstdio>
#include <utility>

namespace palpate {
namespace {

class PosedSource final : public DepthSource {
 public:
  PosedSource(std::unique_ptr<DepthSource> source, CameraPoses poses)
      : source_(std::move(source)), poses_(std::move(poses)), info_(source_->info()) {
    info_.is_moving = poses_.is_moving();
  }

  const DepthStreamInfo& info() const override { return info_; }
  void cancel() noexcept override { source_->cancel(); }
  Result<bool> next(DepthFrame& frame) override {
    for (;;) {
      const auto got = source_->next(frame);
      if (!got || !*got) return got;
      if (!poses_.is_moving() ||
          (frame.timestamp >= poses_.begin() && frame.timestamp <= poses_.end())) {
        frame.X_WC = poses_.at(frame.timestamp);
        return true;
      }
      num_unposed_.fetch_add(1);
    }
  }
  std::vector<std::string> take_notes() override {
    std::vector<std::string> notes = source_->take_notes();
    if (const int num = num_unposed_.exchange(0); num > 0) {
      char text[160];
      std::snprintf(
          text, sizeof text,
          "%d frames were left out: the camera's poses are known from %.3f to %.3f s only", num,
          poses_.begin(), poses_.end());
      notes.push_back(text);
    }
    return notes;
  }

 private:
  std::unique_ptr<DepthSource> source_;
  CameraPoses poses_;
  DepthStreamInfo info_;
  std::atomic<int> num_unposed_ = 0;
};

}  // namespace

Result<CameraPoses> CameraPoses::of(const CameraUri& uri) {
  CameraPoses poses;
  if (uri.poses.empty()) {
    poses.path_ = {{0, uri.X_WC}};
    return poses;
  }
  if (!(uri.X_WC == Pose{})) {
    return Error{Errc::invalid_argument,
                 "camera " + uri.text + ": give 'pose' or 'poses', not both"};
  }
  auto path = load_trajectory(uri.poses);
  if (!path) return path.error();
  poses.path_ = *std::move(path);
  return poses;
}

Result<std::unique_ptr<DepthSource>> make_posed(std::unique_ptr<DepthSource> source,
                                                CameraPoses poses) {
  if (poses.is_at_origin()) return source;
  if (poses.is_moving() && source->info().is_live) {
    return Error{Errc::invalid_argument,
                 source->info().name +
                     " is live: a file of poses does not know its clock; give its frames from a "
                     "file, or 'pose' if it stands still"};
  }
  return std::unique_ptr<DepthSource>(
      std::make_unique<PosedSource>(std::move(source), std::move(poses)));
}

}  // namespace palpate
