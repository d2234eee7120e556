#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "palpate/cloud/cloud_blend.h"
#include "palpate/core/stamp.h"
#include "src/field/frame_slots.h"

namespace palpate {
namespace {

struct Slot {
  SurfaceEstimator estimator;
  std::optional<PointCloud> predicted;
  std::optional<DepthField> field;
  Surfaces surfaces;
};

class FrameSlotsCpu final : public FrameSlots {
 public:
  FrameSlotsCpu(double max_jump, std::optional<DepthAverager> averager, std::vector<Slot> slots)
      : max_jump_(max_jump), averager_(std::move(averager)), slots_(std::move(slots)) {}

  SurfaceStats take(int number, const DepthFrame& frame, std::optional<double> motion,
                    ThreadPool& pool) override {
    Slot& slot = slots_[static_cast<std::size_t>(number)];
    const SurfaceStats stats = averager_
                                   ? slot.estimator.update(averager_->update(frame, pool), pool)
                                   : slot.estimator.update(frame, pool);
    slot.surfaces.cloud = slot.estimator.cloud();
    if (motion) {
      const std::size_t num = slots_.size();
      predict(slots_[(static_cast<std::size_t>(number) + num - 1) % num], slot, *motion, pool);
    }
    if (slot.field) {
      slot.field->update(slot.surfaces.cloud, pool);
      slot.surfaces.field = slot.field->view();
    }
    return stats;
  }

  const Surfaces& surfaces(int slot) const override {
    return slots_[static_cast<std::size_t>(slot)].surfaces;
  }

  PointCloud seen_cloud(int slot) const override {
    const PointCloudView seen = slots_[static_cast<std::size_t>(slot)].estimator.cloud();
    PointCloud copy(seen.width, seen.height, seen.intrinsics);
    int channel = 0;
    for (const float* values : {seen.x, seen.y, seen.z, seen.nx, seen.ny, seen.nz}) {
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
    auto estimator =
        SurfaceEstimator::create(stream.width, stream.height, stream.intrinsics, settings.surface);
    if (!estimator) return estimator.error();
    Slot slot{*std::move(estimator), {}, {}, {}};
    if (settings.time.mode == TimeMode::predict) {
      slot.predicted.emplace(stream.width, stream.height, stream.intrinsics);
    }
    if (settings.field) {
      auto made = DepthField::create(stream.width, stream.height, *settings.field);
      if (!made) return made.error();
      slot.field = *std::move(made);
    }
    slots.push_back(std::move(slot));
  }
  return std::unique_ptr<FrameSlots>(std::make_unique<FrameSlotsCpu>(
      settings.time.max_jump, std::move(averager), std::move(slots)));
}

}  // namespace palpate
