#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "src/cloud/internal/cloud_blend_cuda.h"
#include "src/cloud/internal/depth_average_cuda.h"
#include "src/cloud/internal/stream_noise.h"
#include "src/cloud/internal/surface_cuda.h"
#include "src/core/internal/assert.h"
#include "src/core/internal/stamp.h"
#include "src/field/depth_field_cuda.h"
#include "src/field/memory/field_memory_cuda.h"
#include "src/field/timeline/frame_slots.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {
namespace {

struct Slot {
  SurfaceCuda estimator;
  std::optional<CloudBlendCuda> predicted;
  std::optional<DepthFieldCuda> field, seen_free, in_front, remembered;
  FrameNoise noise;                  // if the stream tells it
  gpu::Graph as_seen, as_predicted;  // all the work of a frame

  PointCloudView predicted_cloud() const {
    PointCloudView cloud = estimator.cloud();
    const PointCloudView moved = predicted->cloud();
    std::tie(cloud.x, cloud.y, cloud.z) = std::tie(moved.x, moved.y, moved.z);
    std::tie(cloud.nx, cloud.ny, cloud.nz) = std::tie(moved.nx, moved.ny, moved.nz);
    return cloud;
  }
};

class FrameSlotsCuda final : public FrameSlots {
 public:
  FrameSlotsCuda(const SlotSettings& settings, std::optional<DepthAveragerCuda> averager,
                 std::optional<FieldMemoryCuda> memory, std::vector<Slot> slots, int gpu)
      : max_jump_(settings.time.max_jump),
        role_(settings.role()),
        noise_(settings.stream.width, settings.stream.height),
        is_noise_known_(is_known(settings.surface.noise) || !settings.learns_noise),
        averager_(std::move(averager)),
        field_memory_(std::move(memory)),
        slots_(std::move(slots)),
        surfaces_(slots_.size()),
        memory_(gpu),
        meters_(memory_.take<float>(static_cast<std::size_t>(settings.stream.width) *
                                    static_cast<std::size_t>(settings.stream.height))),
        stream_(gpu, gpu::Priority::low) {
    const Slot* last = &slots_.back();
    for (Slot& slot : slots_) {
      slot.as_seen = record(slot, nullptr);
      if (slot.predicted) slot.as_predicted = record(slot, last);
      last = &slot;
    }
    stream_.wait();
  }

  // The whole image takes a fraction of a millisecond.
  SurfaceStats take(int number, const DepthImageView& frame, std::optional<double> motion,
                    const PixelWindow&, double interval, ThreadPool&) override {
    Slot& slot = slots_[static_cast<std::size_t>(number)];
    if (field_memory_) field_memory_->set_interval(interval);
    if (motion) slot.predicted->set_progress(*motion);
    if (frame.counts != nullptr && frame.gpu == kHostMemory) {
      const auto put = [&frame](auto& taker) {
        std::copy_n(frame.counts, frame.num_pixels(), taker.input().begin());
        taker.set_unit(frame.unit);
      };
      if (averager_) {
        put(*averager_);
      } else {
        put(slot.estimator);
      }
      stream_.launch(motion ? slot.as_predicted : slot.as_seen);
    } else {
      enqueue_image(slot, frame);
      enqueue_rest(slot, motion ? &before(number) : nullptr);
    }
    // A slot keeps its previous content if the GPU has failed.
    if (!stream_.wait()) return {};
    SurfaceView& surfaces = surfaces_[static_cast<std::size_t>(number)];
    surfaces.cloud = motion ? slot.predicted_cloud() : slot.estimator.cloud();
    surfaces.cloud.stamp = next_stamp();
    // A frame that is on the GPU stays there and tells its own noise.
    if (!is_noise_known_ && frame.gpu == kHostMemory) {
      const FrameNoise seen = *surfaces.cloud.noise;
      noise_.add(frame, seen);
      slot.noise = noise_.of_frame(seen, averager_.has_value());
      surfaces.cloud.noise = &slot.noise;
    }
    const auto show = [&](const std::optional<DepthFieldCuda>& field, DepthFieldView& view) {
      if (!field) return;
      view = field->view();
      view.noise = surfaces.cloud.noise;
      view.stamp = next_stamp();
    };
    show(slot.field, surfaces.field);
    show(slot.seen_free, surfaces.seen_free);
    show(slot.in_front, surfaces.in_front);
    show(slot.remembered, surfaces.remembered);
    surfaces.role = role_;
    return slot.estimator.stats();
  }

  const SurfaceView& surfaces(int slot) const override {
    return surfaces_[static_cast<std::size_t>(slot)];
  }

  PointCloud seen_cloud(int slot, ThreadPool&) override {
    const PointCloudView seen = slots_[static_cast<std::size_t>(slot)].estimator.cloud();
    PointCloud copy(seen.width, seen.height, seen.intrinsics);
    if (surfaces(slot).cloud.width == 0) return copy;  // no frame yet
    gpu::Stream stream(stream_.gpu(), gpu::Priority::low);
    int channel = 0;
    for (const float* values : {seen.x, seen.y, seen.z, seen.nx, seen.ny, seen.nz}) {
      stream.copy(copy.channel(channel++), values, seen.size() * sizeof(float));
    }
    stream.wait();
    return copy;
  }

  const Status& status() const override {
    return memory_.status() ? stream_.status() : memory_.status();
  }

 private:
  /// Records the work of a frame that goes into `slot`, predicted from the frame in `last` if any.
  gpu::Graph record(Slot& slot, const Slot* last) {
    stream_.begin_recording();
    if (averager_) {
      averager_->enqueue(stream_);
      slot.estimator.enqueue_depth(stream_, averager_->depth());
    } else {
      slot.estimator.enqueue(stream_);
    }
    enqueue_rest(slot, last);
    return stream_.end_recording();
  }
  /// Submits prediction and fields.
  void enqueue_rest(Slot& slot, const Slot* last) {
    PointCloudView cloud = slot.estimator.cloud();
    if (last != nullptr) {
      slot.predicted->enqueue(stream_, last->estimator.cloud(), cloud, max_jump_);
      cloud = slot.predicted_cloud();
    }
    if (field_memory_) field_memory_->enqueue(cloud, stream_);
    // Submits a field from planes, or from the cloud of the frame.
    const auto make = [&](std::optional<DepthFieldCuda>& field, const TangentPlane* planes) {
      if (!field) return;
      if (planes != nullptr) {
        field->enqueue(planes, cloud, stream_);
      } else {
        field->enqueue(cloud, stream_);
      }
    };
    const bool is_alone = field_memory_ && !slot.remembered;
    make(slot.field, is_alone ? field_memory_->behind() : nullptr);
    make(slot.seen_free, nullptr);
    make(slot.in_front, is_alone ? field_memory_->in_front() : nullptr);
    make(slot.remembered, field_memory_ ? field_memory_->behind() : nullptr);
  }
  /// Submits a frame in meters, or in the memory of this GPU: the graphs have no place for it.
  void enqueue_image(Slot& slot, const DepthImageView& frame) {
    PALPATE_ASSERT(!averager_ && (frame.gpu == kHostMemory || frame.gpu == stream_.gpu()));
    if (frame.counts != nullptr) {
      slot.estimator.set_unit(frame.unit);
      slot.estimator.enqueue_counts(stream_, frame.counts);
      return;
    }
    const float* meters = frame.meters;
    if (frame.gpu == kHostMemory) {
      stream_.copy(meters_, meters, frame.num_pixels() * sizeof(float));
      meters = meters_;
    }
    slot.estimator.enqueue_depth(stream_, meters);
  }
  const Slot& before(int number) const {
    const std::size_t num = slots_.size();
    return slots_[(static_cast<std::size_t>(number) + num - 1) % num];
  }

  double max_jump_;
  SurfaceRole role_;
  StreamNoise noise_;
  bool is_noise_known_;  // by the settings
  std::optional<DepthAveragerCuda> averager_;
  std::optional<FieldMemoryCuda> field_memory_;
  std::vector<Slot> slots_;
  std::vector<SurfaceView> surfaces_;
  gpu::Memory memory_;
  float* meters_;  // of a frame in meters from host memory
  gpu::Stream stream_;
};

}  // namespace

Result<std::unique_ptr<FrameSlots>> make_frame_slots_cuda(const SlotSettings& settings, int gpu) {
  if (const Status status = gpu::check_gpu(gpu); !status) return status.error();
  const DepthStreamInfo& stream = settings.stream;
  std::optional<DepthAveragerCuda> averager;
  if (settings.time.average.kind != DepthAverage::none) {
    auto made = DepthAveragerCuda::create(stream.width, stream.height, settings.time.average, gpu);
    if (!made) return made.error();
    averager = *std::move(made);
  }
  SurfaceOptions surface = settings.surface;
  surface.depth_change.enabled &= settings.wants_depth_change;
  std::optional<FieldMemoryCuda> memory;
  if (settings.has_pixel_memory()) {
    auto made = FieldMemoryCuda::create(stream.width, stream.height, settings.time.memory, gpu);
    if (!made) return made.error();
    memory = *std::move(made);
  }
  std::vector<Slot> slots;
  for (int i = 0; i < settings.num_slots(); ++i) {
    auto estimator = SurfaceCuda::create(stream.width, stream.height, stream.intrinsics, surface,
                                         gpu, 0, stream.distortion);
    if (!estimator) return estimator.error();
    Slot slot{*std::move(estimator), {}, {}, {}, {}, {}, {}, {}, {}};
    if (settings.time.mode == TimeMode::predict) {
      auto made = CloudBlendCuda::create(stream.width, stream.height, stream.intrinsics, gpu);
      if (!made) return made.error();
      slot.predicted = *std::move(made);
    }
    for (const auto& [options, field] : {std::pair{settings.field, &slot.field},
                                         {settings.seen_free(), &slot.seen_free},
                                         {settings.in_front(), &slot.in_front},
                                         {settings.remembered(), &slot.remembered}}) {
      if (!options) continue;
      auto made = DepthFieldCuda::create(stream.width, stream.height, *options, gpu);
      if (!made) return made.error();
      *field = *std::move(made);
    }
    slots.push_back(std::move(slot));
  }
  auto made = std::make_unique<FrameSlotsCuda>(settings, std::move(averager), std::move(memory),
                                               std::move(slots), gpu);
  if (!made->status()) return made->status().error();
  return std::unique_ptr<FrameSlots>(std::move(made));
}

}}  // namespace palpate::v0
