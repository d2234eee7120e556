#include "palpate/field/sensor.h"

#include <string>
#include <utility>

#include "src/field/frame_slots.h"

namespace palpate {

struct Sensor::Impl {
  Camera camera;
  Place place;
  std::unique_ptr<FrameSlots> slots;
  int num_slots;
  std::unique_ptr<ThreadPool> pool;
  int newest = 0;
  Status status = Done{};

  Status check(const DepthImageView& image) const;
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
  if (image.counts == nullptr && image.metres == nullptr) {
    return refuse("an image without values was given to a sensor; set counts or metres");
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

Result<Sensor> Sensor::create(const Camera& camera, const Place& place,
                              const SensorOptions& options) {
  constexpr int kMostSurfaces = 64;
  if (options.num_surfaces < 1 || options.num_surfaces > kMostSurfaces) {
    return Error{Errc::invalid_argument,
                 "a sensor keeps 1 to 64 surfaces, not " + std::to_string(options.num_surfaces)};
  }
  SlotSettings settings;
  settings.stream.width = camera.width;
  settings.stream.height = camera.height;
  settings.stream.intrinsics = camera.intrinsics;
  settings.surface = options.surface;
  settings.field = options.field;
  settings.time.mode = TimeMode::latest;
  settings.num_spare = options.num_surfaces - 1;
  settings.wants_depth_change = options.surface.depth_change.enabled;
  auto slots = make_frame_slots(settings, place);
  if (!slots) return slots.error();
  return Sensor(std::make_unique<Impl>(Impl{camera, place, *std::move(slots), settings.num_slots(),
                                            std::make_unique<ThreadPool>(options.num_threads)}));
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
  d.slots->take(next, image, std::nullopt, {}, *d.pool);
  d.status = d.slots->status();
  if (!d.status) return {};
  d.newest = next;
  return d.slots->surfaces(next);
}

const Status& Sensor::status() const { return impl_->status; }
const Place& Sensor::place() const { return impl_->place; }

}  // namespace palpate
