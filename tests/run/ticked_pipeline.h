// A pipeline, the frames of a camera that looks at a wall, and a hand that a test moves: a tick
// each millisecond.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <utility>

#include "src/run/internal/pipeline.h"
#include "tests/run/live_loop_fixtures.h"

namespace palpate::test {

inline constexpr double kFramePeriod = 1.0 / 30, kTickSeconds = 1e-3;

/// 320 x 240 pixels, counts of 0.01 mm.
inline DepthStreamInfo wall_stream() {
  DepthStreamInfo info;
  info.width = 320;
  info.height = 240;
  info.intrinsics = {300, 300, 159.5, 119.5};
  info.unit = 1e-5;
  info.rate = 30;
  return info;
}

/// A handle that is where the tool is.
inline RunSettings coupled_by(CouplingKind kind, double friction = 0) {
  RunSettings settings = patient_settings();
  settings.coupling.X_WB = {};
  settings.coupling.kind = kind;
  settings.coupling.friction.coefficient = friction;
  return settings;
}

class TickedPipeline {
 public:
  /// `draw`: the frame of that number, which is seen at that time.
  using Draw = std::function<DepthFrame(int number, double time)>;
  TickedPipeline(const Tool& tool, const DepthStreamInfo& stream, const RunSettings& settings,
                 Draw draw)
      : draw_(std::move(draw)) {
    pipeline_.emplace(Pipeline::create(tool, stream, device_info(), settings).value());
  }

  const TickRecord& to(const Pose& X_BH, std::uint32_t buttons = 0) {
    const double time = kTickSeconds * num_ticks_;
    for (; num_frames_ * kFramePeriod <= time; ++num_frames_) {
      const double shown = num_frames_ * kFramePeriod;
      pipeline_->push(draw_(num_frames_, shown), shown);
    }
    DeviceState state;
    state.time = time;
    state.X_BH = X_BH;
    state.buttons = buttons;
    if (num_ticks_ > 0) state.V_BH.linear = (X_BH.translation - last_.translation) / kTickSeconds;
    last_ = X_BH;
    state.is_valid = true;
    ++num_ticks_;
    return pipeline_->tick(state);
  }
  Pipeline& pipeline() { return *pipeline_; }

 private:
  Draw draw_;
  std::optional<Pipeline> pipeline_;
  int num_frames_ = 0, num_ticks_ = 0;
  Pose last_;
};

}  // namespace palpate::test
