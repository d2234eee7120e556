#include "eval/studies/frame_study.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

namespace palpate::eval {
namespace {

constexpr std::size_t kSettled = 300;  // ticks

double time_of(std::size_t tick) { return static_cast<double>(tick) * kTick; }

std::size_t index_of(const Way& way, const std::vector<const Way*>& ways) {
  return static_cast<std::size_t>(std::find(ways.begin(), ways.end(), &way) - ways.begin());
}

/// Returns the median, of an even number the lower one.
double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + (static_cast<std::ptrdiff_t>(values.size()) - 1) / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Status feel_all(Context& context, const std::vector<Method>& methods,
                const std::vector<StudyCase*>& cases) {
  std::vector<Trial> trials;
  for (const StudyCase* studied : cases) {
    for (const Way* way : studied->ways) {
      TimeOptions time;
      time.mode = way->mode;
      time.average.kind = way->average;
      trials.push_back({&studied->touch, time, way->mixing});
    }
  }
  auto series = measure_trials(context, trials, methods);
  if (!series) return series.error();
  auto next = series->begin();
  for (StudyCase* studied : cases) {
    for (std::size_t i = 0; i < studied->ways.size(); ++i) {
      studied->series.push_back(std::move(*next++));
    }
  }
  return Done{};
}

double lag_of(const ForceSeries& series, const WallForces& wall, std::size_t method) {
  double best = -1, best_lag = 0;
  for (int ms = -50; ms < 250; ++ms) {
    const double lag = 1e-3 * ms;
    double x = 0, y = 0, xx = 0, yy = 0, xy = 0, n = 0;
    for (std::size_t k = kSettled; k < series.force.size(); ++k) {
      const double a = -series.force[k].z, b = wall.measured(method, time_of(k), lag);
      x += a, y += b, xx += a * a, yy += b * b, xy += a * b, n += 1;
    }
    const double correlation = (n * xy - x * y) / std::sqrt((n * xx - x * x) * (n * yy - y * y));
    if (correlation > best) best = correlation, best_lag = lag;
  }
  return best_lag;
}

double error_of(const ForceSeries& series, const WallForces& wall, std::size_t method) {
  double sum = 0, largest = 0;
  for (std::size_t k = kSettled; k < series.force.size(); ++k) {
    const double exact = wall.exact(method, time_of(k));
    largest = std::max(largest, exact);
    sum += std::pow(-series.force[k].z - exact, 2);
  }
  return std::sqrt(sum / static_cast<double>(series.force.size() - kSettled)) / largest;
}

void measure_lateness(StudyCase& studied, const WallForces& wall) {
  for (const std::vector<ForceSeries>& methods : studied.series) {
    std::vector<Lateness>& lateness = studied.lateness.emplace_back();
    for (std::size_t m = 0; m < methods.size(); ++m) {
      lateness.push_back({lag_of(methods[m], wall, m), error_of(methods[m], wall, m)});
    }
  }
}

}  // namespace

const ForceSeries& StudyCase::by(const Way& way, std::size_t method) const {
  return series[index_of(way, ways)][method];
}

const Lateness& StudyCase::late_by(const Way& way, std::size_t method) const {
  return lateness[index_of(way, ways)][method];
}

std::vector<const StudyCase*> Study::moving() const {
  std::vector<const StudyCase*> all{&gaussian, &kinect, &box};
  if (recorded) all.push_back(&*recorded);
  return all;
}

double Study::step_ratio(const StudyCase& studied, const Way& way, std::size_t method) const {
  const ForceSeries& series = studied.by(way, method);
  double largest = 0;
  for (const Vec3d& force : series.force) largest = std::max(largest, norm(force));
  std::vector<double> arrival, all;
  for (std::size_t k = kSettled; k < series.force.size(); ++k) {
    const double least = std::min(norm(series.force[k]), norm(series.force[k - 1]));
    if (least < 0.1 * largest) continue;
    all.push_back(norm(series.force[k] - series.force[k - 1]));
    if (series.is_arrival[k]) arrival.push_back(all.back());
  }
  return median(arrival) / median(all);
}

double Study::surprise(const StudyCase& studied, std::size_t method) const {
  const ForceSeries &series = studied.by(kPredict, method), &latest = studied.by(kLatest, method);
  double off = 0, change = 0;
  for (std::size_t k = kSettled; k < series.force.size(); ++k) {
    if (!series.is_arrival[k]) continue;
    off += norm(series.force[k] - latest.force[k]);
    change += norm(latest.force[k] - latest.force[k - 1]);
  }
  return off / change;
}

double Study::noise(const Way& way, std::size_t method) const {
  const ForceSeries& series = resting.by(way, method);
  double x = 0, xx = 0, n = 0;
  for (std::size_t k = kSettled; k < series.force.size(); ++k) {
    const double f = norm(series.force[k]);
    x += f, xx += f * f, n += 1;
  }
  return std::sqrt(std::max(0.0, xx / n - x / n * x / n)) / (x / n);
}

Result<Study> make_study(Context& context) {
  Study study;
  const auto methods = all_methods_alike();
  study.methods = {methods.back(), methods[0], methods[1], methods[2]};
  const std::vector<const Way*> modes(std::begin(kModes), std::end(kModes));
  const std::vector<const Way*> averages(std::begin(kAverages), std::end(kAverages));
  auto gaussian = touch_wall(context, DepthNoise::gaussian, true);
  if (!gaussian) return gaussian.error();
  // The longest case comes first.
  study.gaussian = {"wall_gaussian",
                    "moving wall, 1.5 mm noise",
                    *std::move(gaussian),
                    {&kPoints, &kLatest, &kInterpolate, &kPredict}};
  auto kinect = touch_wall(context, DepthNoise::kinect, true);
  if (!kinect) return kinect.error();
  study.kinect = {"wall_kinect", "moving wall, Kinect noise", *std::move(kinect), averages};
  auto resting = touch_wall(context, DepthNoise::kinect, false);
  if (!resting) return resting.error();
  study.resting = {"rest_kinect", "wall at rest, Kinect noise", *std::move(resting), averages};
  auto box = touch_moving_box(context);
  if (!box) return box.error();
  study.box = {"box_kinect", "moving box, Kinect noise", *std::move(box), modes};
  auto recorded = touch_recording(context);
  if (!recorded) return recorded.error();
  std::vector<StudyCase*> all{&study.gaussian, &study.kinect, &study.resting, &study.box};
  if (*recorded) {
    study.recorded = {"recorded", "visp_rbt, a camera in the hand", **std::move(recorded), modes};
    all.push_back(&*study.recorded);
  }
  auto wall = WallForces::create(context, study.methods);
  if (!wall) return wall.error();
  study.wall = *std::move(wall);
  if (const auto done = feel_all(context, study.methods, all); !done) return done.error();
  measure_lateness(study.gaussian, study.wall);
  measure_lateness(study.kinect, study.wall);
  return study;
}

}  // namespace palpate::eval
