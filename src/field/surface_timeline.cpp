#include "palpate/field/surface_timeline.h"

#include <algorithm>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include "palpate/cloud/cloud_blend.h"

namespace palpate {
namespace {

/// One frame with all that is made from it.
struct Moment {
  SurfaceEstimator estimator;
  std::optional<PointCloud> predicted;
  std::optional<DepthField> field;
  Surfaces surfaces;
};

}  // namespace

struct SurfaceTimeline::Impl {
  TimeOptions options;
  std::optional<DepthAverager> averager;
  std::vector<Moment> moments;  // two, or one by `latest`
  std::size_t newest = 0;
  int num_frames = 0;
  double time = 0;    // of the newest frame
  double period = 0;  // expected time to the next one

  void expect_next(double new_time);
  void predict(const Moment& last, Moment& now, double interval, ThreadPool& pool) const;
};

/// A running mean over about eight frames; a dropped frame or a burst hardly moves it.
void SurfaceTimeline::Impl::expect_next(double new_time) {
  if (num_frames > 0) {
    constexpr double kShare = 0.125;
    period += kShare * (std::clamp(new_time - time, period / 2, period * 2) - period);
  }
  time = new_time;
}

void SurfaceTimeline::Impl::predict(const Moment& last, Moment& now, double interval,
                                    ThreadPool& pool) const {
  // At the next frame the motion of this interval has gone on for a period.
  const double t = 1 + std::min(period / interval, 1.0);
  PointCloudView& cloud = now.surfaces.cloud;
  blend_clouds(last.estimator.cloud(), cloud, t, options.max_jump, pool, *now.predicted);
  const PointCloudView moved = now.predicted->view();
  std::tie(cloud.x, cloud.y, cloud.z) = std::tie(moved.x, moved.y, moved.z);
  std::tie(cloud.nx, cloud.ny, cloud.nz) = std::tie(moved.nx, moved.ny, moved.nz);
}

Result<SurfaceTimeline> SurfaceTimeline::create(const DepthStreamInfo& stream,
                                                const SurfaceOptions& surface,
                                                const std::optional<DepthFieldOptions>& field,
                                                const TimeOptions& options) {
  if (!(options.max_jump >= 0)) {
    return Error{Errc::invalid_argument,
                 "the largest jump of a predicted pixel must be a share of its depth, 0 or more"};
  }
  const double period = options.first_period != 0 ? options.first_period : 1 / stream.rate;
  if (!(period > 0 && period <= std::numeric_limits<double>::max())) {
    return Error{Errc::invalid_argument,
                 "a depth stream needs a frame rate above 0, or a first period above 0 s"};
  }
  auto impl = std::make_unique<Impl>();
  impl->options = options;
  impl->period = period;
  if (options.average.kind != DepthAverage::none) {
    auto averager = DepthAverager::create(stream.width, stream.height, options.average);
    if (!averager) return averager.error();
    impl->averager = *std::move(averager);
  }
  const int num_moments = options.mode == TimeMode::latest ? 1 : 2;
  for (int i = 0; i < num_moments; ++i) {
    auto estimator =
        SurfaceEstimator::create(stream.width, stream.height, stream.intrinsics, surface);
    if (!estimator) return estimator.error();
    Moment moment{*std::move(estimator), {}, {}, {}};
    if (options.mode == TimeMode::predict) {
      moment.predicted.emplace(stream.width, stream.height, stream.intrinsics);
    }
    if (field) {
      auto made = DepthField::create(stream.width, stream.height, *field);
      if (!made) return made.error();
      moment.field = *std::move(made);
    }
    impl->moments.push_back(std::move(moment));
  }
  return SurfaceTimeline(std::move(impl));
}

SurfaceTimeline::SurfaceTimeline(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SurfaceTimeline::SurfaceTimeline(SurfaceTimeline&&) noexcept = default;
SurfaceTimeline& SurfaceTimeline::operator=(SurfaceTimeline&&) noexcept = default;
SurfaceTimeline::~SurfaceTimeline() = default;

SurfaceStats SurfaceTimeline::push(const DepthFrame& frame, double time, ThreadPool& pool) {
  Impl& d = *impl_;
  const double interval = time - d.time;
  d.expect_next(time);
  const Moment& last = d.moments[d.newest];
  d.newest = (d.newest + 1) % d.moments.size();
  Moment& now = d.moments[d.newest];
  const SurfaceStats stats = d.averager
                                 ? now.estimator.update(d.averager->update(frame, pool), pool)
                                 : now.estimator.update(frame, pool);
  now.surfaces.cloud = now.estimator.cloud();
  if (d.options.mode == TimeMode::predict && d.num_frames > 0) {
    d.predict(last, now, interval, pool);
  }
  if (now.field) {
    now.field->update(now.surfaces.cloud, pool);
    now.surfaces.field = now.field->view();
  }
  ++d.num_frames;
  return stats;
}

SurfaceMoment SurfaceTimeline::at(double time) const {
  const Impl& d = *impl_;
  const Surfaces& to = d.moments[d.newest].surfaces;
  if (d.num_frames < 2 || d.options.mode == TimeMode::latest) return {to, to, 1};
  return {d.moments[1 - d.newest].surfaces, to, frame_progress(time, d.time, d.period)};
}

const SurfaceEstimator& SurfaceTimeline::newest() const {
  return impl_->moments[impl_->newest].estimator;
}

double SurfaceTimeline::period() const { return impl_->period; }

}  // namespace palpate
