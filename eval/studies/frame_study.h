// The study of frames: forces in several scenes for several ways of going from frame to frame, and
// the quantities derived from them.
#pragma once

#include <optional>
#include <vector>

#include "eval/studies/frame_scenes.h"

namespace palpate::eval {

/// A way of going from frame to frame.
struct Way {
  const char *key, *name;
  TimeMode mode;
  DepthAverage average = DepthAverage::none;
  Mixing mixing = Mixing::measures;
};
inline constexpr Way kLatest{"latest", "latest", TimeMode::latest};
inline constexpr Way kInterpolate{"interpolate", "interpolate", TimeMode::interpolate};
inline constexpr Way kPredict{"predict", "predict", TimeMode::predict};
inline constexpr Way kMean{"latest_mean", "latest, mean of 8", TimeMode::latest,
                           DepthAverage::moving};
inline constexpr Way kExponential{"latest_exponential", "latest, exponential", TimeMode::latest,
                                  DepthAverage::exponential};
inline constexpr Way kPredictExponential{"predict_exponential", "predict, exponential",
                                         TimeMode::predict, DepthAverage::exponential};
inline constexpr Way kPoints{"points", "interpolate points", TimeMode::interpolate,
                             DepthAverage::none, Mixing::points};

inline constexpr const Way* kModes[] = {&kLatest, &kInterpolate, &kPredict};
inline constexpr const Way* kAverages[] = {&kLatest,      &kMean,    &kExponential,
                                           &kInterpolate, &kPredict, &kPredictExponential};

/// Delay and error of a force against that of the moving wall.
struct Lateness {
  /// Delay (s) behind the force of the same method on a wall that is visible at every instant, at
  /// the best correlation.
  double lag = 0;
  double error = 0;  ///< rms distance from the exact instantaneous force, share of the largest
};

/// A touch and the forces of every way that is tried.
struct StudyCase {
  const char *key = nullptr, *name = nullptr;
  Touch touch;
  std::vector<const Way*> ways;
  std::vector<std::vector<ForceSeries>> series = {};  ///< [way][method]
  std::vector<std::vector<Lateness>> lateness = {};   ///< [way][method]; of the moving wall only

  const ForceSeries& by(const Way& way, std::size_t method) const;
  const Lateness& late_by(const Way& way, std::size_t method) const;
};

struct Study {
  std::vector<Method> methods;  ///< the field, then those of the thesis
  /// The wall with 1.5 mm noise (and kPoints), with Kinect noise (all averages), at rest with
  /// Kinect noise (all averages); the moving box; the recording, if the data are there.
  StudyCase gaussian, kinect, resting, box;
  std::optional<StudyCase> recorded;
  WallForces wall;

  std::vector<const StudyCase*> moving() const;  ///< all but the wall at rest

  // The following quantities exclude the beginning, until averages have settled.

  /// Median step at the ticks when a frame arrives, over that at all ticks; both in contact only.
  double step_ratio(const StudyCase& studied, const Way& way, std::size_t method) const;
  /// Error of the predicted force when a frame arrives, relative to the change by the frame: 1
  /// without prediction, 0 for a perfect one.
  double surprise(const StudyCase& studied, std::size_t method) const;
  /// Standard deviation of the force of the wall at rest over its mean.
  double noise(const Way& way, std::size_t method) const;
};

Result<Study> make_study(Context& context);

}  // namespace palpate::eval
