// Noise that measurements say they have, against real cameras at rest: a tool that does not move in
// frames that follow each other.
#include <algorithm>
#include <cstdio>
#include <filesystem>

#include <gtest/gtest.h>

#include "palpate/io/files.h"
#include "palpate/io/formats.h"
#include "src/cloud/internal/frame_noise.h"
#include "tests/contact/noise/noise_study.h"
#include "tests/test_util/data.h"

namespace palpate {
namespace {

using namespace test;

/// Frames of a folder by their numbers.
std::vector<DepthFrame> load_frames(const std::filesystem::path& folder, const char* name,
                                    int first, int last) {
  std::vector<DepthFrame> frames;
  for (int i = first; i <= last; ++i) {
    std::string file = name;
    file += std::to_string(i);
    file += ".png";
    frames.push_back(load_depth_png(folder / file).value());
  }
  return frames;
}

struct Shares {
  std::vector<double> errors[3];  // of volumes, forces and torques

  void add(const NoiseStudy& study) {
    for (int k = 0; k < 7; ++k) {
      for (const double error : study.errors(k)) {
        if (std::isfinite(error)) errors[k == 0 ? 0 : k < 4 ? 1 : 2].push_back(error);
      }
    }
  }
};

/// Shares over the frames from `num_moving` on. A frame whose noise a stream does not know yet
/// counts for the mean alone.
Shares shares_of(const std::vector<DepthFrame>& frames, std::size_t num_moving,
                 const Intrinsics& eye, const SurfaceOptions& options, const Tool& tool,
                 double radius) {
  const int wide = frames[0].width, high = frames[0].height;
  const auto depth_at = [&](const DepthFrame& frame, int u, int v) {
    return frame.unit * frame.pixels[static_cast<std::size_t>(v * wide + u)];
  };
  std::vector<Pose> poses;
  for (int v = 40; v < high - 40; v += 24) {
    for (int u = 60; u < wide - 60; u += 24) {
      std::vector<double> depths;
      for (const DepthFrame& frame : frames) {
        for (int q = -20; q <= 20; q += 4) {
          for (int p = -20; p <= 20; p += 4) depths.push_back(depth_at(frame, u + p, v + q));
        }
      }
      std::sort(depths.begin(), depths.end());
      const double z = depths[depths.size() / 2];
      if (z < 0.3 || z > 1.2 || depths[depths.size() / 20] < 0.9 * z ||
          depths[depths.size() - depths.size() / 20] > 1.1 * z) {
        continue;
      }
      const double at = z - radius + 0.012;
      poses.push_back({{(u - eye.cx) / eye.fx * at, (v - eye.cy) / eye.fy * at, at},
                       normalized(Quaternion{0.2, 0.1, 0.3, 0.9})});
    }
  }
  Sensor sensor =
      Sensor::create({wide, high, eye}, Place::cpu(), {.surface = options, .num_threads = 1})
          .value();
  const Contact contact = Contact::create(tool).value();
  std::vector<NoiseStudy> studies(poses.size());
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const SurfaceView surface = sensor.update(frames[k]);
    if (k < num_moving) continue;
    const bool is_told = is_known(options.noise) || surface.field.noise->is_whole;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      studies[i].add(contact.measure(surface, poses[i], {.noise = true}));
      if (!is_told) studies[i].said.back().fill(NAN);
    }
  }
  Shares shares;
  for (const NoiseStudy& study : studies) shares.add(study);
  return shares;
}

// A D4xx that sees a laboratory, with the noise that its frames have in time, and with what the
// stream learns: neighbors share much of it, which no single frame shows. From its first frame to
// the third the camera still moves, by 5 and 1 mm in the median: the stream learns from these, too.
TEST(RestingRecordings, OfAStereoCameraErrByWhatTheySay) {
  PALPATE_DATA_OR_SKIP(folder, "recordings/aims-d4xx-lab/depth");
  const std::vector<DepthFrame> frames = load_frames(folder, "", 139, 155);
  constexpr std::size_t num_moving = 2;
  constexpr Intrinsics eye{383, 383, 320, 240};
  struct Case {
    const char* name;
    Tool tool;
    double radius;  // m
  };
  const Case cases[] = {
      {"ball", Tool::pack(make_icosphere(0.03, 4), {.max_spheres = 1000}).value(), 0.03},
      {"box", Tool::pack(make_box({0.06, 0.04, 0.05}), {.max_spheres = 1500}).value(), 0.025}};
  for (const Smoothing smoothing : {Smoothing::bilateral, Smoothing::adaptive}) {
    for (const bool is_set : {true, false}) {
      if (!is_set && smoothing == Smoothing::bilateral) continue;  // it learns nothing
      SurfaceOptions options;
      options.filter.smoothing = smoothing;
      if (is_set) options.noise = {0.0006, 0.0034, 13};
      for (const Case& c : cases) {
        const Shares shares = shares_of(frames, num_moving, eye, options, c.tool, c.radius);
        const std::string what =
            std::string(c.name) + (is_set ? ", set, " : ", learned, ") + name_of(smoothing);
        std::printf("%-26s", what.c_str());
        for (const auto& errors : shares.errors) {
          std::printf("  %.0f, %.0f %%", 100 * share_within(errors, 1),
                      100 * share_within(errors, 2));
        }
        std::printf("  of %zu\n", shares.errors[0].size());
        EXPECT_GT(shares.errors[0].size(), 1000u) << what;
        for (int k = 0; k < 2; ++k) {
          EXPECT_GT(share_within(shares.errors[k], 1), 0.57) << what;
          EXPECT_LT(share_within(shares.errors[k], 1), 0.78) << what;
          EXPECT_GT(share_within(shares.errors[k], 2), 0.85) << what;
        }
      }
    }
  }
}

}  // namespace
}  // namespace palpate
