// A run along a path, as the page's sources show it and as a pipeline that is made anew feels it.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <span>
#include <vector>

#include "palpate/session/run.h"
#include "palpate/viewer/viewer.h"
#include "src/run/internal/pipeline.h"
#include "tests/session/live_hand.h"
#include "tests/session/path_run.h"
#include "tests/session/synthetic_stream.h"

namespace palpate::test::path_view {

inline constexpr double kRate = 200;

inline RunSettings path_settings(TimeMode mode = TimeMode::interpolate) {
  RunSettings settings = test::path_settings(kRate);
  settings.time.mode = mode;
  return settings;
}

inline void record_path(const std::filesystem::path& folder, const RunSettings& settings,
                        int num_frames = 12) {
  SyntheticStream stream(num_frames);
  auto device = test::path_device(pressing_pose, kRate);
  const auto outcome = record_run(small_tool(), stream, **device, settings, folder);
  ASSERT_TRUE(outcome) << outcome.error().message;
}

/// The pipeline after the tick of that number, as the run itself had it.
template <class Look>
void play_to(std::size_t tick_number, const RunSettings& settings, int num_frames, Look look) {
  SyntheticStream stream(num_frames);
  const Tool tool = small_tool();
  auto pipeline = Pipeline::create(tool, stream.info(), DeviceInfo{}, settings);
  ASSERT_TRUE(pipeline);
  DepthFrame frame;
  ASSERT_TRUE(*stream.next(frame));
  const double first = frame.timestamp;
  bool has_next = true;
  for (std::size_t k = 0; k <= tick_number; ++k) {
    const double time = static_cast<double>(k) / kRate;
    while (has_next && frame.timestamp - first <= time) {
      pipeline->push(frame, frame.timestamp - first);
      has_next = *stream.next(frame);
    }
    const Pose X_WT = pressing_pose(time);
    pipeline->measure({X_WT.translation, normalized(X_WT.rotation)}, time);
  }
  look(*pipeline);
}

inline bool same_planes(const std::vector<Plane<float>>& a, std::span<const Plane<float>> b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& p, const auto& q) {
    return p.normal == q.normal && p.offset == q.offset;
  });
}

inline void expect_same(const ViewContact& shown, const Pipeline& pipeline) {
  SpherePicture spheres;
  spheres.resize(shown.spheres.states.size());
  pipeline.query().measure(pipeline.cameras(), shown.X_WT, spheres.wants());
  EXPECT_EQ(shown.spheres.states, spheres.states);
  EXPECT_TRUE(same_planes(shown.spheres.planes, spheres.planes));
  EXPECT_EQ(shown.spheres.deciders, spheres.deciders);
  EXPECT_EQ(shown.spheres.unseen, spheres.unseen);
}

}  // namespace palpate::test::path_view
