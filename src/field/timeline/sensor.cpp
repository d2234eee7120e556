#include "palpate/field/sensor.h"

#include <string>
#include <utility>

#include "src/field/timeline/batch_frames.h"
#include "src/field/timeline/frame_slots.h"

namespace palpate { inline namespace v0 {

struct Sensor::Impl {
  Camera camera;
  Place place;
  SlotSettings settings;
  std::unique_ptr<FrameSlots> slots;
  int num_slots = 0;
  std::unique_ptr<ThreadPool> pool;
  int newest = 0;
  Status status = Done{};
  std::unique_ptr<BatchFrames> batches;  // when the first one comes

  Status check(const DepthImageView& image) const;
  Status make_batches();
};

Status Sensor::Impl::check(const DepthImageView& image) const {
  const auto refuse = [](std::string message) {
    return Error{Errc::invalid_argument, std::move(message)};
  };
  if (image.width != camera.width || image.height != camera.height) {
    return refuse("an image of " + std::to_string(image.width) + " x " +
                  std::to_string(image.height) + " pixels was given to a sensor of " +
                  std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                  "; create one for this size");
  }
  if (image.counts == nullptr && image.meters == nullptr) {
    return refuse("an image without values was given to a sensor; set counts or meters");
  }
  const bool is_here =
      image.gpu == kHostMemory || (place.backend == Backend::cuda && image.gpu == place.gpu);
  if (!is_here) {
    return refuse("an image in the memory of GPU " + std::to_string(image.gpu) +
                  " was given to a sensor elsewhere; create it with Place::cuda(" +
                  std::to_string(image.gpu) + ") or copy the image to host memory");
  }
  return slots->status();
}

Status Sensor::Impl::make_batches() {
  if (batches != nullptr) return Done{};
#if defined(PALPATE_CUDA)
  auto made = place.backend == Backend::cuda ? make_batch_frames_cuda(settings, place.gpu)
                                             : make_batch_frames_cpu(settings);
#else
  auto made = make_batch_frames_cpu(settings);
#endif
  if (!made) return made.error();
  batches = *std::move(made);
  return Done{};
}

Result<Sensor> Sensor::create(const Camera& camera, const Place& place,
                              const SensorOptions& options) {
  constexpr int kMaxSurfaces = 64;
  if (options.num_surfaces < 1 || options.num_surfaces > kMaxSurfaces) {
    return Error{Errc::invalid_argument,
                 "a sensor keeps 1 to 64 surfaces, not " + std::to_string(options.num_surfaces)};
  }
  SlotSettings settings;
  settings.stream.width = camera.width;
  settings.stream.height = camera.height;
  settings.stream.intrinsics = camera.intrinsics;
  settings.stream.distortion = camera.distortion;
  settings.surface = options.surface;
  settings.field = options.field;
  settings.time.mode = TimeMode::latest;
  settings.num_spare = options.num_surfaces - 1;
  settings.wants_depth_change = options.wants_depth_change;
  auto slots = make_frame_slots(settings, place);
  if (!slots) return slots.error();
  auto impl = std::make_unique<Impl>();
  impl->camera = camera;
  impl->place = place;
  impl->settings = settings;
  impl->slots = *std::move(slots);
  impl->num_slots = settings.num_slots();
  impl->pool = std::make_unique<ThreadPool>(options.num_threads);
  return Sensor(std::move(impl));
}

Sensor::Sensor(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Sensor::Sensor(Sensor&&) noexcept = default;
Sensor& Sensor::operator=(Sensor&&) noexcept = default;
Sensor::~Sensor() = default;

SurfaceView Sensor::update(const DepthImageView& image) {
  Impl& d = *impl_;
  d.status = d.check(image);
  if (!d.status) return {};
  const int next = (d.newest + 1) % d.num_slots;
  d.slots->take(next, image, std::nullopt, {}, 0, *d.pool);
  d.status = d.slots->status();
  if (!d.status) return {};
  d.newest = next;
  SurfaceView surface = d.slots->surfaces(next);
  surface.X_WC = image.X_WC;
  return surface;
}

SurfaceBatch Sensor::update_batch(const DepthImageView& first, int num,
                                  std::optional<CallerStream> stream) {
  Impl& d = *impl_;
  d.status = num > 0 ? d.check(first) : Status(Done{});
  if (d.status) d.status = d.make_batches();
  if (!d.status || num <= 0) return {};
  auto made = d.batches->update(first, num, stream, *d.pool);
  if (made) return *made;
  d.status = made.error();
  return {};
}

Status Sensor::reserve_batch(int num_images) {
  if (const Status status = impl_->make_batches(); !status) return status;
  return impl_->batches->reserve(num_images);
}

const Status& Sensor::status() const { return impl_->status; }
const Place& Sensor::place() const { return impl_->place; }

}}  // namespace palpate::v0
