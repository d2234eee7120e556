#include <algorithm>
#include <string>
#include <utility>

#include "src/cloud/internal/frame_noise.h"
#include "src/cloud/internal/surface_cuda.h"
#include "src/field/depth_field_cuda.h"
#include "src/field/timeline/batch_frames.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {
namespace {

/// Fields on a GPU: five kernels for every few million pixels.
class BatchFramesCuda final : public BatchFrames {
 public:
  BatchFramesCuda(const SlotSettings& settings, const PyramidLayout& layout, int gpu,
                  int pixels_at_once)
      : settings_(settings),
        layout_(layout),
        pixels_at_once_(pixels_at_once),
        gpu_(gpu),
        memory_(gpu),
        own_stream_(gpu, gpu::Priority::low),
        caller_stream_(gpu) {
    settings_.surface.depth_change.enabled = false;
  }

  Status reserve(int num_images) override {
    if (num_images <= num_) return Done{};
    own_stream_.wait();
    field_.reset();
    surface_.reset();
    memory_ = gpu::Memory(gpu_);
    num_ = 0;
    const DepthStreamInfo& stream = settings_.stream;
    const int num_pixels = stream.width * stream.height;
    const int at_once = std::min(num_images, std::max(1, pixels_at_once_ / num_pixels));
    if (const Status status = check_memory(num_images, at_once); !status) return status;
    auto surface = SurfaceCuda::create(stream.width, stream.height, stream.intrinsics,
                                       settings_.surface, gpu_, at_once, stream.distortion);
    if (!surface) return surface.error();
    auto field = DepthFieldCuda::create(stream.width, stream.height, *settings_.field, gpu_,
                                        num_images, at_once);
    if (!field) return field.error();
    const auto num_values =
        static_cast<std::size_t>(at_once) * static_cast<std::size_t>(num_pixels);
    staged_ = memory_.take<float>(num_values);
    noises_ = surface->learns_noise()
                  ? memory_.take<FrameNoise>(static_cast<std::size_t>(num_images))
                  : nullptr;
    if (!memory_.status()) return memory_.status();
    surface_ = *std::move(surface);
    field_ = *std::move(field);
    num_ = num_images;
    num_at_once_ = at_once;
    return Done{};
  }

  Result<SurfaceBatch> update(const DepthImageView& first, int num,
                              std::optional<CallerStream> requested_stream, ThreadPool&) override {
    if (requested_stream) caller_stream_.continue_in(requested_stream->handle);
    gpu::Stream& stream = requested_stream ? caller_stream_ : own_stream_;
    const bool is_staged = first.gpu != gpu_;
    if (stream.is_recording() && (is_staged || num > num_)) {
      return Error{Errc::invalid_argument,
                   is_staged ? "images in host memory cannot be captured in a graph; give them in "
                               "the memory of GPU " +
                                   std::to_string(gpu_)
                             : "a batch of images was captured in a graph before its memory was "
                               "there; call reserve_batch, or make it once before"};
    }
    if (const Status status = reserve(num); !status) return status.error();
    if (first.counts != nullptr) surface_->set_unit(first.unit);
    const std::size_t size = first.num_pixels();
    for (int begin = 0; begin < num; begin += num_at_once_) {
      const int some = std::min(num_at_once_, num - begin);
      const std::size_t at = static_cast<std::size_t>(begin) * size;
      const std::size_t num_values = static_cast<std::size_t>(some) * size;
      const std::uint16_t* counts = first.counts == nullptr ? nullptr : first.counts + at;
      const float* meters = counts != nullptr ? nullptr : first.meters + at;
      if (is_staged && counts != nullptr) {
        stream.copy(staged_, counts, num_values * sizeof *counts);
        counts = reinterpret_cast<const std::uint16_t*>(staged_);
      } else if (is_staged) {
        stream.copy(staged_, meters, num_values * sizeof *meters);
        meters = staged_;
      }
      surface_->enqueue_images(stream, counts, meters, some,
                               noises_ != nullptr ? noises_ + begin : nullptr);
      field_->enqueue(surface_->planes(), surface_->points_apart(), surface_->cloud(), begin, some,
                      stream);
    }
    if (!requested_stream || is_staged) stream.wait(kPatience + static_cast<double>(num) * 1e-3);
    if (!stream.status()) return stream.status().error();
    return SurfaceBatch(field_->view(), num, field_->pixels_apart(), field_->tiles_apart(),
                        noises_);
  }

 private:
  static constexpr double kPatience = 2;  // s

  Status check_memory(int num_images, int at_once) const {
    constexpr std::size_t kChannels = 3;  // of a point: its plane, and its filtered depth
    const std::size_t each = DepthFieldCuda::num_bytes(layout_);
    const std::size_t num_points = static_cast<std::size_t>(settings_.stream.width) *
                                   static_cast<std::size_t>(settings_.stream.height);
    const std::size_t beside =
        static_cast<std::size_t>(at_once) * (layout_.num_pixels() * sizeof(TangentPlane) +
                                             num_points * (kChannels + 1) * sizeof(float));
    const std::size_t free = gpu::free_memory(gpu_);
    const std::size_t desired = static_cast<std::size_t>(num_images) * each + beside;
    if (desired <= free) return Done{};
    const std::size_t fitting = free > beside ? (free - beside) / each : 0;
    return Error{Errc::unavailable, "the fields of " + std::to_string(num_images) + " images of " +
                                        std::to_string(settings_.stream.width) + " x " +
                                        std::to_string(settings_.stream.height) + " pixels take " +
                                        std::to_string(desired >> 20) + " MiB on GPU " +
                                        std::to_string(gpu_) + " and " +
                                        std::to_string(free >> 20) + " MiB are free: give " +
                                        std::to_string(fitting) + " at a time, at most"};
  }

  SlotSettings settings_;
  PyramidLayout layout_;
  int pixels_at_once_;
  int gpu_;
  int num_ = 0, num_at_once_ = 0;  // there is room for
  gpu::Memory memory_;
  float* staged_ = nullptr;       // images from host memory
  FrameNoise* noises_ = nullptr;  // if each image tells its own
  std::optional<SurfaceCuda> surface_;
  std::optional<DepthFieldCuda> field_;
  gpu::Stream own_stream_, caller_stream_;
};

}  // namespace

Result<std::unique_ptr<BatchFrames>> make_batch_frames_cuda(const SlotSettings& settings, int gpu,
                                                            int pixels_at_once) {
  if (const Status status = gpu::check_gpu(gpu); !status) return status.error();
  const auto layout =
      pyramid_layout(settings.stream.width, settings.stream.height, *settings.field);
  if (!layout) return layout.error();
  return std::unique_ptr<BatchFrames>(
      std::make_unique<BatchFramesCuda>(settings, *layout, gpu, pixels_at_once));
}

}}  // namespace palpate::v0
