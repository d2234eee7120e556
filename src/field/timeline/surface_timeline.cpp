#include "palpate/field/sensor.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "src/cloud/internal/cloud_blend.h"
#include "src/field/internal/key_frames.h"
#include "src/field/timeline/frame_slots.h"

namespace palpate { inline namespace v0 {
namespace {

Status check(const SlotSettings& settings) {
  const TimeOptions& time = settings.time;
  if (Status status = check_settings(time); !status) return status;
  const double period = time.first_period != 0 ? time.first_period : 1 / settings.stream.rate;
  if (!(period > 0 && period <= std::numeric_limits<double>::max())) {
    return Error{Errc::invalid_argument,
                 "a depth stream needs a frame rate above 0, or a first period above 0 s"};
  }
  const bool looks_back = time.mode == TimeMode::predict || time.average.kind != DepthAverage::none;
  if (settings.stream.is_moving && looks_back) {
    return Error{Errc::invalid_argument,
                 "time.mode = predict and averages (time.average) need a static camera; turn them "
                 "off for a moving one"};
  }
  if (time.memory.kind == DepthMemory::off) return Done{};
  if (!settings.field) {
    return Error{Errc::invalid_argument,
                 "a memory (time.memory) is one of depth fields; use the method field, or leave it "
                 "out"};
  }
  if (time.mode == TimeMode::predict) {
    return Error{Errc::invalid_argument,
                 "a memory (time.memory) needs time.mode latest or interpolate; turn it off"};
  }
  return Done{};
}

}  // namespace

Result<std::unique_ptr<FrameSlots>> make_frame_slots(const SlotSettings& settings,
                                                     const Place& place) {
  if (place.backend == Backend::cpu) return make_frame_slots_cpu(settings);
#if defined(PALPATE_CUDA)
  return make_frame_slots_cuda(settings, place.gpu);
#else
  return find_gpus().error();
#endif
}

struct SurfaceTimeline::Impl {
  /// Optical flow of a frame in a slot.
  struct Flow {
    std::vector<float> pixels;  // of the whole image, also if the surface has a smaller one
    FlowView view;              // without pixels: none was given
  };
  std::unique_ptr<FrameSlots> slots;
  DepthStreamInfo stream;
  int binning;
  DepthFrame small;  // of the last frame, if binned
  TimeMode mode;
  int num_slots;
  double period;  // expected time to the next frame
  int newest = 0;
  int num_frames = 0;
  double time = 0;  // of the newest frame
  std::optional<KeyFrames> key_frames = {};
  std::vector<Pose> X_WC = std::vector<Pose>(static_cast<std::size_t>(num_slots));
  std::vector<Flow> flows = {};  // of each slot; empty: frames have none

  /// Returns the surface in a slot.
  SurfaceView surface(int slot) const {
    SurfaceView view = slots->surfaces(slot);
    view.X_WC = X_WC[static_cast<std::size_t>(slot)];
    return view;
  }

  void expect_next(double new_time);
  void keep_flow(const DepthImageView& frame, double interval);
};

/// Updates a running mean over about eight frames; a dropped frame or a burst hardly moves it.
void SurfaceTimeline::Impl::expect_next(double new_time) {
  if (num_frames > 0) {
    constexpr double kShare = 0.125;
    period += kShare * (std::clamp(new_time - time, period / 2, period * 2) - period);
  }
  time = new_time;
}

/// Keeps the flow of a frame; that of the first one is ignored: it has no interval.
void SurfaceTimeline::Impl::keep_flow(const DepthImageView& frame, double interval) {
  if (flows.empty()) return;
  Flow& flow = flows[static_cast<std::size_t>(newest)];
  const bool is_given =
      frame.flow != nullptr && interval > 0 && 2 * frame.num_pixels() == flow.pixels.size();
  flow.view.pixels = is_given ? flow.pixels.data() : nullptr;
  flow.view.interval = interval;
  if (is_given) std::copy_n(frame.flow, flow.pixels.size(), flow.pixels.begin());
}

Result<SurfaceTimeline> FrameSlots::make_timeline(std::unique_ptr<FrameSlots> slots,
                                                  const SlotSettings& settings) {
  if (const Status status = check(settings); !status) return status.error();
  const TimeOptions& time = settings.time;
  const double period = time.first_period != 0 ? time.first_period : 1 / settings.stream.rate;
  // Pushes allocate nothing.
  DepthFrame small;
  if (settings.binning > 1) {
    small.pixels.resize(static_cast<std::size_t>(settings.stream.width) *
                        static_cast<std::size_t>(settings.stream.height));
  }
  return SurfaceTimeline(std::make_unique<SurfaceTimeline::Impl>(
      SurfaceTimeline::Impl{std::move(slots), settings.stream, settings.binning, std::move(small),
                            time.mode, settings.num_slots(), period}));
}

Result<SurfaceTimeline> SurfaceTimeline::create(const DepthStreamInfo& stream,
                                                const TimelineOptions& options,
                                                const Place& place) {
  if (options.binning < 1 || options.binning > kMaxBinning) {
    return Error{Errc::invalid_argument, "depth images are binned by 1 to " +
                                             std::to_string(kMaxBinning) + " pixels, not " +
                                             std::to_string(options.binning)};
  }
  const SlotSettings settings{options, binned(stream, options.binning)};
  if (const Status status = check(settings); !status) return status.error();
  auto slots = make_frame_slots(settings, place);
  if (!slots) return slots.error();
  auto timeline = FrameSlots::make_timeline(*std::move(slots), settings);
  if (timeline && stream.has_flow) {
    const std::size_t num =
        2 * static_cast<std::size_t>(stream.width) * static_cast<std::size_t>(stream.height);
    timeline->impl_->flows.assign(
        static_cast<std::size_t>(settings.num_slots()),
        {std::vector<float>(num), {nullptr, stream.width, stream.height, stream.intrinsics}});
  }
  if (timeline && settings.has_key_frames()) {
    auto key_frames = KeyFrames::create(
        settings, [&](const SlotSettings& kept) { return make_frame_slots(kept, place); });
    if (!key_frames) return key_frames.error();
    timeline->impl_->key_frames = *std::move(key_frames);
  }
  return timeline;
}

SurfaceTimeline::SurfaceTimeline(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SurfaceTimeline::SurfaceTimeline(SurfaceTimeline&&) noexcept = default;
SurfaceTimeline& SurfaceTimeline::operator=(SurfaceTimeline&&) noexcept = default;
SurfaceTimeline::~SurfaceTimeline() = default;

SurfaceStats SurfaceTimeline::push(const DepthImageView& frame, double time, ThreadPool& pool,
                                   const PixelWindow& requested) {
  Impl& d = *impl_;
  const double interval = d.num_frames > 0 ? time - d.time : 0;
  d.expect_next(time);
  std::optional<double> motion;
  if (d.mode == TimeMode::predict && d.num_frames > 0) {
    // At the next frame the motion of this interval has gone on for a period.
    motion = 1 + std::min(d.period / interval, 1.0);
  }
  d.newest = (d.newest + 1) % d.num_slots;
  d.X_WC[static_cast<std::size_t>(d.newest)] = frame.X_WC;
  ++d.num_frames;
  d.keep_flow(frame, interval);
  DepthImageView image = frame;
  if (d.binning > 1) {
    bin_depth(frame, d.binning, d.small);
    image = d.small;
    image.X_WC = frame.X_WC;
  }
  if (d.key_frames) d.key_frames->take(image, pool);
  return d.slots->take(d.newest, image, motion, requested, interval, pool);
}

Status SurfaceTimeline::resume_from(std::string_view state) {
  return impl_->slots->resume_from(state);
}

SurfaceBlend SurfaceTimeline::at(double time) const {
  const Impl& d = *impl_;
  const SurfaceView to = d.surface(d.newest);
  if (d.num_frames < 2 || d.mode == TimeMode::latest) return {to, to, 1};
  const int last = (d.newest + d.num_slots - 1) % d.num_slots;
  SurfaceBlend blend{d.surface(last), to, frame_progress(time, d.time, d.period)};
  if (!d.flows.empty()) blend.flow = d.flows[static_cast<std::size_t>(d.newest)].view;
  return blend;
}

std::span<const SurfaceBlend> SurfaceTimeline::key_frames() const {
  if (!impl_->key_frames) return {};
  return impl_->key_frames->views();
}

PointCloud SurfaceTimeline::newest_cloud(ThreadPool& pool) {
  return impl_->slots->seen_cloud(impl_->newest, pool);
}

const DepthStreamInfo& SurfaceTimeline::stream() const { return impl_->stream; }

double SurfaceTimeline::period() const { return impl_->period; }

const Status& SurfaceTimeline::status() const {
  const std::optional<KeyFrames>& kept = impl_->key_frames;
  return kept && !kept->status() ? kept->status() : impl_->slots->status();
}

}}  // namespace palpate::v0
