// Depth frames without the robot that the camera sees.
#include "palpate/cameras/cameras.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <utility>

#include "src/cameras/internal/link_image.h"
#include "src/cameras/robot/link_image_cuda.h"

namespace palpate { inline namespace v0 {

struct SelfFilter::Robot {
  std::vector<RobotLink> links;
  std::shared_ptr<const LinkPoses> poses;
  double padding = 0;
  std::vector<std::string> notes;
};

namespace {

/// Null on a CPU. Error: there is no such GPU.
Result<std::unique_ptr<LinksOnGpu>> links_at([[maybe_unused]] std::span<const RobotLink> links,
                                             [[maybe_unused]] const DepthStreamInfo& info,
                                             [[maybe_unused]] double padding, const Place& place) {
  if (place.backend == Backend::cpu) return std::unique_ptr<LinksOnGpu>();
#if defined(PALPATE_CUDA)
  return make_links_on_gpu(links, info.intrinsics, info.width, info.height, padding, place.gpu);
#else
  return find_gpus().error();
#endif
}

class SelfFilteredSource final : public DepthSource {
 public:
  SelfFilteredSource(std::unique_ptr<DepthSource> source, std::span<const RobotLink> links,
                     std::shared_ptr<const void> owner, const LinkPoses& poses, double padding,
                     const Place& place, const std::vector<std::string>& notes)
      : source_(std::move(source)),
        owner_(std::move(owner)),
        links_(links),
        poses_(poses),
        X_WL_(links.size()),
        X_CL_(links.size()),
        image_(source_->info().intrinsics, padding) {
    for (const std::string& each : notes) note(info().name + ": " + each);
    auto on_gpu = links_at(links, info(), padding, place);
    if (on_gpu) {
      on_gpu_ = *std::move(on_gpu);
    } else {
      note(info().name + ": the robot is removed on the CPU: " + on_gpu.error().message);
    }
  }

  const DepthStreamInfo& info() const override { return source_->info(); }
  void cancel() noexcept override { source_->cancel(); }

  Result<bool> next(DepthFrame& frame) override {
    for (;;) {
      const auto got = source_->next(frame);
      if (!got || !*got) {
        if (got && !has_kept_ && num_left_out_ > 0) return nothing_kept();
        report_end();
        return got;
      }
      const Status known = poses_.at_frame(frame, X_WL_);
      if (!known) {
        leave_out(known.error().message);
        continue;
      }
      if (!std::ranges::all_of(X_WL_, [](const Pose& X_WL) { return is_finite(X_WL); })) {
        leave_out("a link's pose is not finite");
        continue;
      }
      report_end();
      has_kept_ = true;
      const Pose X_CW = inverse(frame.X_WC);
      std::ranges::transform(X_WL_, X_CL_.begin(), [&](const Pose& X_WL) { return X_CW * X_WL; });
      if (!remove_on_gpu(frame)) remove_on_cpu(frame);
      return true;
    }
  }

  std::vector<std::string> take_notes() override {
    std::vector<std::string> notes = source_->take_notes();
    const std::lock_guard lock(mutex_);
    for (std::string& note : notes_) notes.push_back(std::move(note));
    notes_.clear();
    return notes;
  }

 private:
  bool remove_on_gpu(DepthFrame& frame) {
    if (on_gpu_ == nullptr) return false;
    const Result<bool> done = on_gpu_->remove_from(frame, X_CL_);
    if (!done) {
      note(info().name + ": the robot is removed on the CPU from now on: " + done.error().message);
      on_gpu_ = nullptr;
      return false;
    }
    if (!*done && !has_reported_cpu_) {
      has_reported_cpu_ = true;
      note(info().name +
           ": the robot is so near to the camera that its padding does not fit on the GPU: it is "
           "removed from such images on the CPU");
    }
    return *done;
  }
  void remove_on_cpu(DepthFrame& frame) {
    image_.begin(frame.width, frame.height);
    for (std::size_t i = 0; i < links_.size(); ++i) image_.add(links_[i].mesh, X_CL_[i]);
    image_.draw();
    image_.remove_from(frame);
  }

  void leave_out(const std::string& why) {
    if (num_left_out_ == 0) why_left_out_ = why;
    if (num_left_out_++ == 0) {
      note(info().name + ": depth images are dropped: " + why);
    }
  }
  void report_end() {
    if (num_left_out_ == 0) return;
    note(info().name + ": " + std::to_string(num_left_out_) +
         " depth images were dropped because the robot's pose was unknown");
    num_left_out_ = 0;
  }
  Error nothing_kept() const {
    return {Errc::bad_input, info().name + ": all " + std::to_string(num_left_out_) +
                                 " depth images were dropped: " + why_left_out_ +
                                 "; give the robot's states for the times of the images"};
  }
  void note(std::string text) {
    const std::lock_guard lock(mutex_);
    notes_.push_back(std::move(text));
  }

  const std::unique_ptr<DepthSource> source_;
  const std::shared_ptr<const void> owner_;  // owns links_ and poses_
  const std::span<const RobotLink> links_;
  const LinkPoses& poses_;
  std::vector<Pose> X_WL_, X_CL_;
  LinkImage image_;
  std::unique_ptr<LinksOnGpu> on_gpu_;  // null: on the CPU
  bool has_reported_cpu_ = false;
  bool has_kept_ = false;
  int num_left_out_ = 0;
  std::string why_left_out_;
  std::mutex mutex_;
  std::vector<std::string> notes_;
};

void scale_about_middle(TriangleMesh& mesh, double scale) {
  const auto [low, high] = bounds(mesh);
  const Vec3d middle = (low + high) * 0.5;
  for (Vec3d& p : mesh.vertices) p = middle + (p - middle) * scale;
}

}  // namespace

Result<SelfFilter> SelfFilter::create(std::vector<RobotLink> links,
                                      std::shared_ptr<const LinkPoses> poses,
                                      const SelfFilterOptions& options,
                                      std::vector<std::string> notes) {
  if (const Status status = check_settings(options); !status) return status.error();
  if (poses == nullptr) {
    return Error{Errc::invalid_argument, "a self filter needs a source of link poses"};
  }
  for (const RobotLink& link : links) {
    for (const auto& ids : link.mesh.triangles) {
      if (std::ranges::max(ids) < link.mesh.vertices.size()) continue;
      return Error{Errc::bad_input,
                   "the mesh of link '" + link.name + "' has a triangle without its vertices"};
    }
    if (!std::ranges::all_of(link.mesh.vertices,
                             [](const Vec3d& p) { return std::isfinite(norm(p)); })) {
      return Error{Errc::bad_input,
                   "the mesh of link '" + link.name + "' has a vertex that is not finite"};
    }
  }
  if (options.scale != 1) {
    for (RobotLink& link : links) scale_about_middle(link.mesh, options.scale);
  }
  return SelfFilter(std::make_shared<Robot>(
      Robot{std::move(links), std::move(poses), options.padding, std::move(notes)}));
}

Result<std::unique_ptr<DepthSource>> SelfFilter::applied_to(std::unique_ptr<DepthSource> source,
                                                            const Place& place) const {
  const DepthStreamInfo& info = source->info();
  const auto is_live = robot_->poses->is_live();
  if (is_live && *is_live != info.is_live) {
    return Error{Errc::invalid_argument,
                 info.name +
                     (info.is_live ? " is live and the robot's poses are recorded"
                                   : " is recorded and the robot's poses are live") +
                     ": they cannot be matched; use one clock for both"};
  }
  return std::unique_ptr<DepthSource>(
      std::make_unique<SelfFilteredSource>(std::move(source), robot_->links, robot_, *robot_->poses,
                                           robot_->padding, place, robot_->notes));
}

}}  // namespace palpate::v0
