#include "src/cameras/stream/posed_source.h"

#include <cstdint>
#include <cstdio>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace palpate { inline namespace v0 {
namespace {

class PosedSource final : public DepthSource {
 public:
  PosedSource(std::unique_ptr<DepthSource> source, CameraPoses poses,
              const std::optional<Pose>& X_FC)
      : source_(std::move(source)), poses_(std::move(poses)), X_FC_(X_FC), info_(source_->info()) {
    info_.is_moving = info_.is_moving || poses_.is_moving();
  }

  const std::optional<Pose>& projection() const { return X_FC_; }
  const DepthStreamInfo& info() const override { return info_; }
  void cancel() noexcept override {
    source_->cancel();
    const std::lock_guard lock(mutex_);
    has_ended_ = true;
  }
  Result<bool> next(DepthFrame& frame) override {
    for (;;) {
      const auto got = source_->next(frame);
      if (!got || !*got) {
        const std::lock_guard lock(mutex_);
        has_ended_ = true;
        return got;
      }
      const auto X_WC = poses_.at(frame);
      if (X_WC) {
        frame.X_WC = *X_WC;
        return true;
      }
      const std::lock_guard lock(mutex_);
      why_ = X_WC.error().message;
      if (num_unposed_++ == 0 && info_.is_live) {
        notes_.push_back(info_.name + ": frames are dropped: " + why_);
      }
    }
  }
  /// Returns the source's notes; a live stream notes its first dropped frame, and all at its end.
  std::vector<std::string> take_notes() override {
    std::vector<std::string> notes = source_->take_notes();
    const std::lock_guard lock(mutex_);
    for (std::string& note : std::exchange(notes_, {})) notes.push_back(std::move(note));
    if (has_ended_ && num_unposed_ > 0) {
      notes.push_back(std::to_string(num_unposed_) + " frames were dropped: " + why_);
      num_unposed_ = 0;
    }
    return notes;
  }

 private:
  std::unique_ptr<DepthSource> source_;
  CameraPoses poses_;
  const std::optional<Pose> X_FC_;
  DepthStreamInfo info_;
  std::mutex mutex_;
  std::uint64_t num_unposed_ = 0;
  bool has_ended_ = false;
  std::string why_;
  std::vector<std::string> notes_;
};

}  // namespace

Result<CameraPoses> CameraPoses::of(const CameraUri& uri) {
  RobotTrees trees;
  return of(uri, true, trees);
}

Result<CameraPoses> CameraPoses::of(const CameraUri& uri, bool is_received, RobotTrees& trees) {
  CameraPoses poses;
  poses.X_HC_ = uri.X_WC;
  poses.frames_have_poses_ = uri.extras.contains("world");
  if (int(!uri.poses.empty()) + int(!uri.urdf.empty()) + int(poses.frames_have_poses_) > 1) {
    return Error{Errc::invalid_argument,
                 "camera " + uri.text + ": give one of 'poses', 'urdf' and 'world'"};
  }
  if (!uri.joints.empty() && uri.urdf.empty()) {
    return Error{Errc::invalid_argument, "camera " + uri.text + ": 'joints' goes with 'urdf'"};
  }
  if (!uri.poses.empty()) {
    auto path = load_trajectory(uri.poses);
    if (!path) return path.error();
    poses.path_ = *std::move(path);
  }
  if (!uri.urdf.empty()) {
    auto link = LinkInTree::open(uri.urdf, uri.joints, is_received, trees);
    if (!link) {
      return Error{link.error().code, "camera " + uri.text + ": " + link.error().message};
    }
    poses.link_ = std::make_shared<const LinkInTree>(*std::move(link));
  }
  return poses;
}

std::optional<bool> CameraPoses::is_live() const {
  if (link_) return link_->is_live();
  return path_.size() > 1 ? std::optional(false) : std::nullopt;
}

Result<Pose> CameraPoses::at(double time, double stamp) const {
  if (link_) {
    const auto X_WH = link_->at(time, stamp);
    if (!X_WH) return X_WH.error();
    return *X_WH * X_HC_;
  }
  if (path_.size() > 1 && (time < path_.front().time || time > path_.back().time)) {
    char text[120];
    std::snprintf(text, sizeof text, "the camera's poses are known from %.3f to %.3f s only",
                  path_.front().time, path_.back().time);
    return Error{Errc::unavailable, text};
  }
  return pose_at(path_, time) * X_HC_;
}

Result<Pose> CameraPoses::at(const DepthFrame& frame) const {
  if (frames_have_poses_) return frame.X_WC * X_HC_;
  return at(frame.timestamp, frame.stamp);
}

Result<std::optional<Pose>> standing_pose(const CameraUri& uri, RobotTrees& trees) {
  const auto poses = CameraPoses::of(uri, false, trees);
  if (!poses) return poses.error();
  if (poses->is_moving() || uri.extras.contains("world")) return std::optional<Pose>();
  const auto X_WC = poses->at(0);
  if (!X_WC) return X_WC.error();
  return std::optional(*X_WC);
}

Result<std::unique_ptr<DepthSource>> make_posed(std::unique_ptr<DepthSource> source,
                                                CameraPoses poses,
                                                const std::optional<Pose>& X_FC) {
  if (!X_FC && poses.is_left_alone()) return source;
  if (X_FC) poses.see_from(*X_FC);
  const auto is_live = poses.is_live();
  if (is_live && *is_live != source->info().is_live) {
    return Error{Errc::invalid_argument,
                 source->info().name +
                     (*is_live ? " is a recording, but its joint states are live"
                               : " is live, and a file of poses has another clock; read its frames "
                                 "from a file, or pass 'pose' if it is static")};
  }
  return std::unique_ptr<DepthSource>(
      std::make_unique<PosedSource>(std::move(source), std::move(poses), X_FC));
}

std::optional<Pose> projection_of(const DepthSource& camera) {
  const auto* const posed = dynamic_cast<const PosedSource*>(&camera);
  return posed != nullptr ? posed->projection() : std::nullopt;
}

}}  // namespace palpate::v0
