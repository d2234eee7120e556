#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "src/cloud/internal/cloud_blend.h"
#include "src/core/internal/stamp.h"
#include "src/field/frame_slots.h"

namespace palpate {
namespace {

struct Slot {
  SurfaceEstimator estimator;
  std::optional<PointCloud> predicted;
  std::optional<DepthField> field, seen_free;
  SurfaceView surfaces;
};

class FrameSlotsCpu final : public FrameSlots {
 public:
  FrameSlotsCpu(const SlotSettings& settings, std::optional<DepthAverager> averager,
                std::vector<Slot> slots)
      : max_jump_(settings.time.max_jump),
        wants_depth_change_(settings.wants_depth_change),
        averager_(std::move(averager)),
        slots_(std::move(slots)) {}

  SurfaceStats take(int number, const DepthImageView& frame, std::optional<double> motion,
                    const PixelWindow& asked, ThreadPool& pool) override {
    Slot& slot = slots_[static_cast<std::size_t>(number)];
    const bool has_all = !slot.field || asked.has_all(frame.width, frame.height);
    SurfaceParts parts{{}, wants_depth_change_};
    // What is predicted takes the points of both frames, which have windows of their own.
    if (!has_all && !slot.predicted) parts = {slot.field->points_for(asked), false};
    const SurfaceStats stats =
        averager_ ? slot.estimator.update(averager_->update(frame, pool), pool, parts)
                  : slot.estimator.update(frame, pool, parts);
    slot.surfaces.cloud = slot.estimator.cloud();
    if (motion) {
      const std::size_t num = slots_.size();
      predict(slots_[(static_cast<std::size_t>(number) + num - 1) % num], slot, *motion, pool);
    }
    if (slot.field) {
      slot.field->update(slot.surfaces.cloud, pool, asked);
      slot.surfaces.field = slot.field->view();
    }
    if (slot.seen_free) {
      slot.seen_free->update(slot.surfaces.cloud, pool, asked);
      slot.surfaces.seen_free = slot.seen_free->view();
    }
    if (!has_all) slot.surfaces.cloud = {};
    return stats;
  }

  const SurfaceView& surfaces(int slot) const override {
    return slots_[static_cast<std::size_t>(slot)].surfaces;
  }

  PointCloud seen_cloud(int slot, ThreadPool& pool) override {
    SurfaceEstimator& estimator = slots_[static_cast<std::size_t>(slot)].estimator;
    estimator.complete(pool);
    const PointCloudView seen = estimator.cloud();
    PointCloud copy(seen.width, seen.height, seen.intrinsics, true);
    int channel = 0;
    for (const float* values : {seen.x, seen.y, seen.z, seen.nx, seen.ny, seen.nz, seen.edge_x,
                                seen.edge_y, seen.edge_z}) {
      std::copy_n(values, seen.size(), copy.channel(channel++));
    }
    return copy;
  }

  const Status& status() const override { return status_; }

 private:
  void predict(const Slot& last, Slot& now, double motion, ThreadPool& pool) const {
    PointCloudView& cloud = now.surfaces.cloud;
    blend_clouds(last.estimator.cloud(), cloud, motion, max_jump_, pool, *now.predicted);
    const PointCloudView moved = now.predicted->view();
    std::tie(cloud.x, cloud.y, cloud.z) = std::tie(moved.x, moved.y, moved.z);
    std::tie(cloud.nx, cloud.ny, cloud.nz) = std::tie(moved.nx, moved.ny, moved.nz);
    cloud.stamp = next_stamp();
  }

  double max_jump_;
  bool wants_depth_change_;
  std::optional<DepthAverager> averager_;
  std::vector<Slot> slots_;
  Status status_ = Done{};
};

}  // namespace

Result<std::unique_ptr<FrameSlots>> make_frame_slots_cpu(const SlotSettings& settings) {
  const DepthStreamInfo& stream = settings.stream;
  std::optional<DepthAverager> averager;
  if (settings.time.average.kind != DepthAverage::none) {
    auto made = DepthAverager::create(stream.width, stream.height, settings.time.average);
    if (!made) return made.error();
    averager = *std::move(made);
  }
  std::vector<Slot> slots;
  for (int i = 0; i < settings.num_slots(); ++i) {
    auto estimator = SurfaceEstimator::create(stream.width, stream.height, stream.intrinsics,
                                              settings.surface, best_isa(), stream.distortion);
    if (!estimator) return estimator.error();
    Slot slot{*std::move(estimator), {}, {}, {}, {}};
    if (settings.time.mode == TimeMode::predict) {
      slot.predicted.emplace(stream.width, stream.height, stream.intrinsics);
    }
    if (settings.field) {
      auto made = DepthField::create(stream.width, stream.height, *settings.field);
      if (!made) return made.error();
      slot.field = *std::move(made);
    }
    if (settings.field && settings.field->one_of_several) {
      auto made =
          DepthField::create(stream.width, stream.height, options_of_seen_free(*settings.field));
      if (!made) return made.error();
      slot.seen_free = *std::move(made);
    }
    slots.push_back(std::move(slot));
  }
  return std::unique_ptr<FrameSlots>(
      std::make_unique<FrameSlotsCpu>(settings, std::move(averager), std::move(slots)));
}

}  // namespace palpate
