// A run along a path that is recorded in parts.
#pragma once

#include <filesystem>

#include "palpate/session/run.h"
#include "tests/session/live_hand.h"
#include "tests/session/path_run.h"
#include "tests/session/synthetic_stream.h"

namespace palpate::test::parted_run {

inline constexpr double kRate = 200;  // of ticks, 1/s
inline constexpr int kFrameRate = 10;

/// The wall comes nearer by 2 cm a second.
inline Result<RunOutcome> record(const std::filesystem::path& run, const RunSettings& settings,
                                 const RecordingOptions& recording, double seconds = 6) {
  static const Tool tool = small_tool();
  SyntheticStream stream(static_cast<int>(seconds * kFrameRate), kFrameRate);
  auto device = test::path_device(pressing_pose, kRate);
  RunOptions options;
  options.recording = recording;
  return record_run(tool, stream, **device, settings, run, options);
}

inline RunSettings settings_with(TimeMode mode, CouplingKind kind) {
  RunSettings settings = path_settings(kRate);
  settings.time.mode = mode;
  settings.coupling.kind = kind;
  test::be_patient(settings.safety);
  return settings;
}

}  // namespace palpate::test::parted_run
