// Force on a moving tool while depth frames arrive, tick by tick at 1 kHz. Shared by 3.15 and the
// study of frames.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "eval/context.h"
#include "palpate/cloud/depth_source.h"
#include "palpate/field/sensor.h"

namespace palpate::eval {

inline constexpr double kTick = 1e-3;  // s

/// A tool that moves in the scene of a stream of frames.
struct Touch {
  DepthStreamInfo stream;
  std::vector<DepthFrame> frames;
  std::shared_ptr<const Tool> tool;
  std::function<Pose(double time)> X_WT;  ///< `time` s after the first frame; any thread
};

/// Quantity that is interpolated between two frames.
enum class Mixing {
  measures,  ///< measurements on both surfaces (ContactQuery::measure)
  points,    ///< points, by eq. 3.18 of the thesis: one surface to measure on
};

/// Force at each tick from the first frame to the last.
struct ForceSeries {
  std::vector<Vec3d> force;      ///< shares of the whole tool's
  std::vector<bool> is_arrival;  ///< a frame other than the first has just arrived
};

/// A way of going from frame to frame, to be measured.
struct Trial {
  const Touch* touch = nullptr;
  TimeOptions time;
  Mixing mixing = Mixing::measures;
};

/// Measures all trials: [trial][method], in their orders. On several threads.
Result<std::vector<std::vector<ForceSeries>>> measure_trials(Context& context,
                                                             const std::vector<Trial>& trials,
                                                             const std::vector<Method>& methods);

}  // namespace palpate::eval
