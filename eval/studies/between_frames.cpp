#include "eval/studies/between_frames.h"

#include <optional>
#include <utility>

#include "eval/studies/method_queries.h"
#include "eval/studies/parallel.h"
#include "src/cloud/internal/cloud_blend.h"
#include "src/run/internal/pipeline.h"

namespace palpate::eval {
namespace {

/// Turns a blend into one interpolated surface.
class PointMixer {
 public:
  static Result<PointMixer> create(const DepthStreamInfo& stream, double max_jump) {
    auto field = DepthField::create(stream.width, stream.height);
    if (!field) return field.error();
    return PointMixer(PointCloud(stream.width, stream.height, stream.intrinsics), *std::move(field),
                      max_jump);
  }
  /// The views are valid until the next call.
  SurfaceBlend mix(const SurfaceBlend& blend, ThreadPool& pool) {
    if (blend.progress >= 1) return blend;
    blend_clouds(blend.from.cloud, blend.to.cloud, blend.progress, max_jump_, pool, cloud_);
    field_.update(cloud_.view(), pool);
    return {{}, {cloud_.view(), field_.view()}, 1};
  }

 private:
  PointMixer(PointCloud cloud, DepthField field, double max_jump)
      : cloud_(std::move(cloud)), field_(std::move(field)), max_jump_(max_jump) {}
  PointCloud cloud_;
  DepthField field_;
  double max_jump_;
};

Result<std::vector<ForceSeries>> measure_trial(const Trial& trial,
                                               const std::vector<Method>& methods, Work& work) {
  const Touch& touch = *trial.touch;
  RunSettings settings;  // with a field and points, for all methods
  settings.time = trial.time;
  auto timeline = make_surfaces(touch.stream, settings);
  if (!timeline) return timeline.error();
  auto mixer = PointMixer::create(touch.stream, trial.time.max_jump);
  if (!mixer) return mixer.error();
  MethodQueries queries(Backend::cpu, *touch.tool);
  ThreadPool pool(1);
  std::vector<ForceSeries> series(methods.size());
  const double begin = touch.frames.front().timestamp, end = touch.frames.back().timestamp;
  std::size_t next = 0;
  for (int k = 0; begin + k * kTick < end; ++k) {
    const double now = begin + k * kTick;
    bool is_arrival = false;
    for (; next < touch.frames.size() && touch.frames[next].timestamp <= now; ++next) {
      timeline->push(touch.frames[next], touch.frames[next].timestamp, pool);
      work.step();
      is_arrival = next > 0;
    }
    SurfaceBlend blend = timeline->at(now);
    if (trial.mixing == Mixing::points) blend = mixer->mix(blend, pool);
    queries.set_blend(blend);
    for (std::size_t m = 0; m < methods.size(); ++m) {
      const ContactOptions& options = methods[m].options;
      const Penetration penetration = queries.query(touch.X_WT(k * kTick), options);
      series[m].force.push_back(penetration.measure_W.force / full_volume(*touch.tool, options));
      series[m].is_arrival.push_back(is_arrival);
    }
  }
  return series;
}

}  // namespace

Result<std::vector<std::vector<ForceSeries>>> measure_trials(Context& context,
                                                             const std::vector<Trial>& trials,
                                                             const std::vector<Method>& methods) {
  double num_frames = 0;
  for (const Trial& trial : trials) num_frames += static_cast<double>(trial.touch->frames.size());
  std::vector<std::vector<ForceSeries>> all(trials.size());
  std::vector<std::optional<Error>> errors(trials.size());
  run_tasks(context, static_cast<int>(trials.size()), num_frames, [&](int i, Work& work) {
    const auto at = static_cast<std::size_t>(i);
    auto series = measure_trial(trials[at], methods, work);
    if (!series) {
      errors[at] = series.error();
      return;
    }
    all[at] = *std::move(series);
  });
  for (const auto& error : errors) {
    if (error) return *error;
  }
  return all;
}

}  // namespace palpate::eval
