// palpate calibrate: refines the poses of the cameras of a rig from their images, or measures the
// noise of one camera.

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/output_files.h"
#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "apps/touch/sources.h"
#include "apps/verbs.h"
#include "apps/verbs/calibrate_noise.h"
#include "palpate/cameras/cameras.h"
#include "palpate/cloud/point_cloud.h"
#include "palpate/cloud/surface_estimator.h"
#include "src/cloud/internal/mean_frame.h"
#include "src/io/internal/atomic_file.h"

namespace palpate::apps {
namespace {

constexpr double kDegrees = 180 / kPi;

struct Options {
  std::string rig, output;
  std::vector<std::string> noise;  ///< cameras
  int num_frames = 30;
  bool json = false;
};

/// Surface of one camera; `estimator` owns it.
Result<SurfaceEstimator> look(const CameraUri& uri, const std::string& name, int num_frames) {
  const auto X_WC = standing_pose(uri);
  if (!X_WC) return X_WC.error();
  if (!*X_WC) {
    return Error{
        Errc::bad_input,
        name +
            " moves, or is placed by tf: only static cameras with a pose or a URDF can be refined"};
  }
  auto source = open_camera(uri, opening());
  if (!source) return source.error();
  const DepthStreamInfo& stream = (*source)->info();
  const auto frame = mean_frame(**source, num_frames);
  if (!frame) return frame.error();
  if (!(projection_of(**source).value_or(Pose{}) == Pose{})) {
    return Error{Errc::bad_input,
                 name +
                     " sends clouds that are seen from another place or direction than their "
                     "frame; give depth images, or organized clouds of a pinhole camera"};
  }
  auto estimator = SurfaceEstimator::create(stream.width, stream.height, stream.intrinsics,
                                            surface_options_for(stream.sensor));
  if (!estimator) return estimator.error();
  ThreadPool pool(0);
  estimator->update(*frame, pool);
  return estimator;
}

nlohmann::ordered_json to_json(const CameraRig& rig, const AlignedViews& aligned) {
  nlohmann::ordered_json cameras = nlohmann::ordered_json::array(), pairs = cameras;
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    cameras.push_back({{"name", rig.cameras[i].name}, {"pose", seven_numbers(aligned.X_WC[i])}});
  }
  for (const ViewPair& pair : aligned.pairs) {
    pairs.push_back({{"a", rig.cameras[static_cast<std::size_t>(pair.a)].name},
                     {"b", rig.cameras[static_cast<std::size_t>(pair.b)].name},
                     {"points", pair.num_points},
                     {"residual_before_mm", 1e3 * pair.before},
                     {"residual_mm", 1e3 * pair.after},
                     {"moved_mm", 1e3 * pair.moved},
                     {"turned_degrees", kDegrees * pair.turned}});
  }
  return {{"cameras", cameras}, {"pairs", pairs}, {"uncertainty_mm", 1e3 * aligned.uncertainty}};
}

void print(const CameraRig& rig, const AlignedViews& aligned, const std::string& output) {
  for (const ViewPair& pair : aligned.pairs) {
    char text[300];
    std::snprintf(
        text, sizeof text,
        "%s and %s: %.2f mm apart before, %.2f mm after, over %zu points; the pose of one "
        "in the other moved by %.2f mm and turned by %.3f degrees\n",
        rig.cameras[static_cast<std::size_t>(pair.a)].name.c_str(),
        rig.cameras[static_cast<std::size_t>(pair.b)].name.c_str(), 1e3 * pair.before,
        1e3 * pair.after, pair.num_points, 1e3 * pair.moved, kDegrees * pair.turned);
    results() << text;
  }
  char text[100];
  std::snprintf(text, sizeof text, "known to about %.1f mm by this scene\n",
                1e3 * aligned.uncertainty);
  results() << text << "written       " << output << "\n";
}

Status run(const Options& options) {
  if (!options.noise.empty()) {
    return calibrate_noise({options.noise, options.output, options.num_frames, options.json});
  }
  namespace fs = std::filesystem;
  const auto rig = load_rig(options.rig);
  if (!rig) return rig.error();
  const fs::path from = fs::absolute(options.rig).parent_path();
  if (std::error_code ignored;
      !fs::equivalent(from, fs::absolute(options.output).parent_path(), ignored)) {
    return Error{Errc::invalid_argument, "paths in a rig file are relative to it: write " +
                                             options.output + " into the folder of " + options.rig};
  }
  if (const Status status = check_output_file(options.output, OutputKind::rig); !status) {
    return status;
  }
  std::vector<SurfaceEstimator> estimators;
  std::vector<PointCloudView> clouds;
  std::vector<Pose> X_WC;
  std::vector<std::string> names;
  for (const auto& [name, uri] : rig->cameras) {
    auto estimator = look(uri, name, options.num_frames);
    if (!estimator) return estimator.error();
    estimators.push_back(*std::move(estimator));
    X_WC.push_back(**standing_pose(uri));
    names.push_back(name);
  }
  for (const SurfaceEstimator& estimator : estimators) clouds.push_back(estimator.cloud());
  const auto aligned = align_views(clouds, X_WC, names);
  if (!aligned) return aligned.error();
  const auto text = rig_text_with_poses(options.rig, aligned->X_WC);
  if (!text) return text.error();
  if (const Status status = write_file_atomically(options.output, *text); !status) return status;
  if (options.json) {
    print_json(to_json(*rig, *aligned));
  } else {
    print(*rig, *aligned, options.output);
  }
  return Done{};
}

}  // namespace

void add_calibrate(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app = *program.add_subcommand(
      "calibrate",
      "Refine the camera poses of a rig from what the cameras see of one static scene; or measure "
      "the noise of a camera.");
  app.add_option("--rig", options->rig, "rig file, with poses within some centimeters")
      ->type_name("RIG.toml");
  app.add_option("--noise", options->noise,
                 "depth stream of a scene at rest for three seconds; repeat for more scenes of the "
                 "same camera, which add range")
      ->type_name("URI");
  app.add_option("-o,--output", options->output,
                 "rig file to write, in the same folder, may be the input; with --noise: sensor "
                 "file")
      ->required()
      ->type_name("FILE.toml");
  add_number(app, "--frames", options->num_frames, {1, 1000, ""},
             "number of frames: averaged of each camera of a rig, or taken of each scene at most")
      ->default_str("30, or 90 with --noise");
  app.add_flag("--json", options->json, "print what was found as JSON");
  app.footer(
      "Example: palpate calibrate --rig rig.toml -o rig.toml\n"
      "Example: palpate calibrate --noise realsense -o sensor.toml");
  app.callback([options, &app, &action] {
    if (options->rig.empty() == options->noise.empty()) {
      usage_error("calibrate: give one of --rig and --noise");
    }
    constexpr int kThreeSeconds = 90;  // frames
    if (!options->noise.empty() && app.count("--frames") == 0) options->num_frames = kThreeSeconds;
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
