#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "src/cloud/internal/cloud_blend.h"
#include "src/cloud/internal/stream_noise.h"
#include "src/core/internal/stamp.h"
#include "src/field/memory/field_memory.h"
#include "src/field/timeline/frame_slots.h"

namespace palpate { inline namespace v0 {
namespace {

struct Slot {
  SurfaceEstimator estimator;
  std::optional<PointCloud> predicted;
  std::optional<DepthField> field, seen_free, in_front, remembered;
  SurfaceView surfaces;
  FrameNoise noise;
};

class FrameSlotsCpu final : public FrameSlots {
 public:
  FrameSlotsCpu(const SlotSettings& settings, std::optional<DepthAverager> averager,
                std::optional<FieldMemory> memory, std::vector<Slot> slots)
      : max_jump_(settings.time.max_jump),
        wants_depth_change_(settings.wants_depth_change),
        role_(settings.role()),
        noise_(settings.stream.width, settings.stream.height),
        is_noise_known_(is_known(settings.surface.noise) || !settings.learns_noise),
        averager_(std::move(averager)),
        memory_(std::move(memory)),
        slots_(std::move(slots)) {}

  SurfaceStats take(int number, const DepthImageView& frame, std::optional<double> motion,
                    const PixelWindow& requested, double interval, ThreadPool& pool) override {
    Slot& slot = slots_[static_cast<std::size_t>(number)];
    const bool has_all = !slot.field || requested.has_all(frame.width, frame.height);
    SurfaceParts parts{{}, wants_depth_change_};
    // A prediction takes the points of both frames, which have windows of their own, and a memory
    // takes all points.
    if (!has_all && !slot.predicted && !memory_) parts = {slot.field->points_for(requested), false};
    const SurfaceStats stats =
        averager_ ? slot.estimator.update(averager_->update(frame, pool), pool, parts)
                  : slot.estimator.update(frame, pool, parts);
    slot.surfaces.cloud = slot.estimator.cloud();
    if (!is_noise_known_) {
      const FrameNoise seen = *slot.surfaces.cloud.noise;
      noise_.add(frame, seen);
      slot.noise = noise_.of_frame(seen, averager_.has_value());
      slot.surfaces.cloud.noise = &slot.noise;
    }
    if (motion) {
      const std::size_t num = slots_.size();
      predict(slots_[(static_cast<std::size_t>(number) + num - 1) % num], slot, *motion, pool);
    }
    make_fields(slot, requested, interval, pool);
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
  void make_fields(Slot& slot, const PixelWindow& requested, double interval, ThreadPool& pool) {
    SurfaceView& surfaces = slot.surfaces;
    const PointCloudView& cloud = surfaces.cloud;
    if (memory_) memory_->update(cloud, interval, pool);
    // Updates a field from planes, or from the cloud of the frame.
    const auto make = [&](std::optional<DepthField>& field, const TangentPlane* planes,
                          DepthFieldView& view) {
      if (!field) return;
      if (planes != nullptr) {
        field->update(planes, cloud.intrinsics, pool, requested);
      } else {
        field->update(cloud, pool, requested);
      }
      view = field->view();
      view.noise = cloud.noise;
    };
    const bool is_alone = memory_ && !slot.remembered;
    make(slot.field, is_alone ? memory_->behind() : nullptr, surfaces.field);
    make(slot.seen_free, nullptr, surfaces.seen_free);
    make(slot.in_front, is_alone ? memory_->in_front() : nullptr, surfaces.in_front);
    make(slot.remembered, memory_ ? memory_->behind() : nullptr, surfaces.remembered);
    surfaces.role = role_;
  }

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
  SurfaceRole role_;
  StreamNoise noise_;
  bool is_noise_known_;  // by the settings
  std::optional<DepthAverager> averager_;
  std::optional<FieldMemory> memory_;
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
  std::optional<FieldMemory> memory;
  if (settings.has_pixel_memory())
    memory.emplace(stream.width, stream.height, settings.time.memory);
  std::vector<Slot> slots;
  for (int i = 0; i < settings.num_slots(); ++i) {
    auto estimator = SurfaceEstimator::create(stream.width, stream.height, stream.intrinsics,
                                              settings.surface, best_isa(), stream.distortion);
    if (!estimator) return estimator.error();
    Slot slot{*std::move(estimator), {}, {}, {}, {}, {}, {}, {}};
    if (settings.time.mode == TimeMode::predict) {
      slot.predicted.emplace(stream.width, stream.height, stream.intrinsics);
    }
    for (const auto& [options, field] : {std::pair{settings.field, &slot.field},
                                         {settings.seen_free(), &slot.seen_free},
                                         {settings.in_front(), &slot.in_front},
                                         {settings.remembered(), &slot.remembered}}) {
      if (!options) continue;
      auto made = DepthField::create(stream.width, stream.height, *options);
      if (!made) return made.error();
      *field = *std::move(made);
    }
    slots.push_back(std::move(slot));
  }
  return std::unique_ptr<FrameSlots>(std::make_unique<FrameSlotsCpu>(
      settings, std::move(averager), std::move(memory), std::move(slots)));
}

}}  // namespace palpate::v0
