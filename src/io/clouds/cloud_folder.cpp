#include "src/io/internal/cloud_folder.h"

#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace palpate { inline namespace v0 {
namespace {

class CloudFolderSource final : public DepthSource {
 public:
  CloudFolderSource(FrameList list, CloudCamera camera, CloudPoints first, const Vec3d& eye,
                    double scale, DepthStreamInfo info)
      : list_(std::move(list)),
        camera_(std::move(camera)),
        first_(std::move(first)),
        eye_(eye),
        scale_(scale),
        info_(std::move(info)) {}

  const DepthStreamInfo& info() const override { return info_; }
  std::vector<std::string> take_notes() override {
    const std::lock_guard lock(mutex_);
    return std::exchange(notes_, {});
  }

  Result<bool> next(DepthFrame& frame) override {
    if (next_ == list_.entries.size()) return false;
    const FrameEntry& entry = list_.entries[next_++];
    CloudPoints cloud = std::move(first_);
    if (next_ > 1) {
      auto file = load_points(entry.path, scale_, camera_.X_FC().translation);
      if (!file) return file.error();
      cloud = std::move(file->cloud);
      if (norm(file->eye - eye_) > 1e-3 && !std::exchange(is_eye_noted_, true)) {
        note(
            "its files have other VIEWPOINTs than the first one; all are seen from that of the "
            "first");
      }
    }
    const CloudShares shares = camera_.take(cloud.view(), frame);
    if (!shares.is_image && !std::exchange(is_noted_, true)) note(shares.text());
    frame.timestamp = entry.time;
    return true;
  }

 private:
  void note(const std::string& text) {
    const std::lock_guard lock(mutex_);
    notes_.push_back(info_.name + ": " + text);
  }

  const FrameList list_;
  CloudCamera camera_;
  CloudPoints first_;
  const Vec3d eye_;  // of the first file
  const double scale_;
  const DepthStreamInfo info_;
  std::size_t next_ = 0;
  bool is_noted_ = false, is_eye_noted_ = false;
  std::mutex mutex_;
  std::vector<std::string> notes_;
};

}  // namespace

Result<CloudFolder> open_cloud_folder(const FrameList& list, const CloudCameraOptions& options,
                                      double scale, const std::string& name) {
  const std::string& path = list.entries.front().path;
  CloudCameraOptions from = options;
  auto first = load_points(path, scale, from.viewpoint.value_or(Vec3d{}));
  if (!first) return first.error();
  // An organized cloud may be an image all the same: its points tell.
  if (!from.viewpoint && norm(first->eye) > 0 && !pinhole_of(first->cloud.view())) {
    from.viewpoint = first->eye;
    first = load_points(path, scale, first->eye);
    if (!first) return first.error();
  }
  auto camera = CloudCamera::create(first->cloud.view(), from);
  if (!camera) return Error{camera.error().code, path + ": " + camera.error().message};
  DepthStreamInfo info;
  camera->describe(info);
  info.rate = list.rate;
  info.num_frames = static_cast<int>(list.entries.size());
  info.name = name;
  const std::optional<Pose> X_FC = camera->projection();
  return CloudFolder{
      std::make_unique<CloudFolderSource>(list, *std::move(camera), std::move(first->cloud),
                                          first->eye, scale, std::move(info)),
      X_FC};
}

}}  // namespace palpate::v0
