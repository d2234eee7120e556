// What one or more cameras see at one moment, read once: what palpate query measures against.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "apps/options.h"
#include "palpate/cameras/cameras.h"
#include "palpate/field/sensor.h"

namespace palpate::apps {

/// --cloud, or --depth and --camera, any number of them.
struct FrozenOptions {
  std::string cloud;
  std::vector<std::string> depths, streams;  ///< depth images, and streams of which the first frame
  std::vector<Intrinsics> intrinsics;        ///< of the images: of all, or of each
  std::vector<Pose> X_WC;                    ///< of the images: of each, or of all but the first
  double unit = 0.001;                       ///< m, of a count of the images
  std::optional<SensorKind> sensor = {};     ///< of all; none: as each camera says
  std::vector<CameraUri> cameras = {};       ///< the streams, once they are checked
};
void add_frozen_options(CLI::App& app, FrozenOptions& options);
/// What the parser cannot see by itself; wrong usage ends the program.
void check(FrozenOptions& options);

/// Owns all that the views show.
class FrozenViews {
 public:
  /// With depth fields, and what each camera has seen to be free, for the field method; the methods
  /// of points get one cloud of all points. `given`: keys of settings that no kind of sensor
  /// changes. Warns of images that show little. Errors: a file or a stream that cannot be read;
  /// options that cameras do not take.
  static Result<FrozenViews> read(const FrozenOptions& options, const RunSettings& settings,
                                  const std::vector<std::string>& given, ThreadPool& pool);

  /// Of each camera.
  std::span<const Pose> X_WC() const { return X_WC_; }
  std::span<const SurfaceBlend> views() const { return views_; }
  /// Points with a normal.
  std::size_t num_usable() const { return num_usable_; }

 private:
  struct Frozen;
  FrozenViews() = default;
  Status add(Frozen frozen, const Pose& X_WC, const RunSettings& settings, ThreadPool& pool);
  void join_points();

  std::vector<std::shared_ptr<Frozen>> frozen_;
  std::vector<SurfaceBlend> views_;
  std::vector<Pose> X_WC_;
  PointCloud joined_;
  std::size_t num_usable_ = 0;
};

}  // namespace palpate::apps
