// The surfaces of the last frames, for a timeline. The time keeping is one for all
// (surface_timeline.cpp); the surfaces are made on the CPU or on a GPU.
#pragma once

#include <memory>
#include <optional>

#include "palpate/field/sensor.h"
#include "src/field/memory/memory_pixel.h"

namespace palpate { inline namespace v0 {

/// Settings of the surfaces of frames.
struct SlotSettings : TimelineOptions {
  DepthStreamInfo stream;    ///< of the binned images
  bool learns_noise = true;  ///< frames follow each other in time, so their steps tell noise

  /// A static camera remembers by its pixels, a moving one by frames from earlier poses.
  bool has_pixel_memory() const { return in_front() && !stream.is_moving; }
  bool has_key_frames() const {
    return field && time.memory.kind != DepthMemory::off && stream.is_moving;
  }
  /// Options of the fields of each frame beside `field`: of space seen to be free, of surfaces in
  /// front, and of space remembered to be free.
  std::optional<DepthFieldOptions> seen_free() const {
    if (!field || !(field->one_of_several || has_key_frames())) return {};
    return options_of_seen_free(*field);
  }
  std::optional<DepthFieldOptions> in_front() const {
    if (!field || time.memory.kind == DepthMemory::off) return {};
    return options_of_in_front(*field, time.memory);
  }
  std::optional<DepthFieldOptions> remembered() const {
    return has_pixel_memory() ? seen_free() : std::nullopt;
  }
  /// Role of the surfaces of frames.
  SurfaceRole role() const {
    if (seen_free()) return SurfaceRole::one_of_several;
    return in_front() ? SurfaceRole::with_memory : SurfaceRole::frame;
  }
  /// With the newest frame alone there is nothing to blend.
  int num_slots() const { return (time.mode == TimeMode::latest ? 1 : 2) + num_spare; }
};

/// The last frames with all that is made from them. They are taken in turn.
class FrameSlots {
 public:
  virtual ~FrameSlots() = default;
  /// Makes a timeline over slots. Errors: max_jump or first_period.
  static Result<SurfaceTimeline> make_timeline(std::unique_ptr<FrameSlots> slots,
                                               const SlotSettings& settings);

  /// Fills a slot from the next frame, `interval` s after the one before. With `motion` the surface
  /// is predicted: each pixel goes from the frame in the slot before to this one and beyond, to
  /// `motion` times the way. A field is made for queries in a window at least.
  virtual SurfaceStats take(int slot, const DepthImageView& frame, std::optional<double> motion,
                            const PixelWindow& requested, double interval, ThreadPool& pool) = 0;
  virtual const SurfaceView& surfaces(int slot) const = 0;
  /// The points of a slot's frame as they were seen, in host memory.
  virtual PointCloud seen_cloud(int slot, ThreadPool& pool) = 0;
  /// An error once the GPU has failed.
  virtual const Status& status() const = 0;
};

/// Errors: see SurfaceEstimator, DepthField and DepthAverager; no such GPU, too little memory on
/// it.
Result<std::unique_ptr<FrameSlots>> make_frame_slots_cpu(const SlotSettings& settings);
Result<std::unique_ptr<FrameSlots>> make_frame_slots_cuda(const SlotSettings& settings, int gpu);

Result<std::unique_ptr<FrameSlots>> make_frame_slots(const SlotSettings& settings,
                                                     const Place& place);

}}  // namespace palpate::v0
