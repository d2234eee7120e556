// Views of one or more cameras at one moment, read once: the surfaces of palpate query.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "apps/options.h"
#include "apps/sensor_choice.h"
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
  SensorChoice sensor = {};                  ///< of all
  std::vector<CameraUri> cameras = {};       ///< the streams, once they are checked
};
void add_frozen_options(CLI::App& app, FrozenOptions& options);
/// Checks combinations of options, which the parser cannot; wrong usage ends the program.
void check(FrozenOptions& options);

/// Owns the data of the views.
class FrozenViews {
 public:
  /// Reads the views. For the field method they have depth fields, and fields of free space; point
  /// methods get one cloud of all points. `given`: keys of settings that no kind of sensor changes.
  /// Warns of images that show little. Errors: a file or a stream that cannot be read; options that
  /// cameras do not take.
  static Result<FrozenViews> read(const FrozenOptions& options, const RunSettings& settings,
                                  const std::vector<std::string>& given, ThreadPool& pool);

  /// Returns the pose of each camera.
  std::span<const Pose> X_WC() const { return X_WC_; }
  std::span<const SurfaceBlend> views() const { return views_; }
  /// Number of points with a normal.
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
