// Questions and answers of palpate query, and how they are printed, as JSON or as a table.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "apps/touch/frames.h"
#include "apps/touch/objects.h"
#include "apps/verbs/caps.h"
#include "apps/verbs/frozen_views.h"
#include "palpate/contact/body_contact.h"

namespace palpate::apps {

/// Options of palpate query.
struct QueryOptions {
  std::string tool, pose, poses, shard, output;
  FrozenOptions views;
  RunSettings settings;
  std::vector<std::string> given;  ///< keys of settings
  std::vector<ObjectOption> objects;
  FrameOptions frames;
  CapsOptions caps;
  int num_spheres = 0;   ///< of the tool file; 0: all
  double stiffness = 0;  ///< N/m3, of forces beside the volumes; 0: none
  bool json = false;
  bool std = false;  ///< standard deviations
  bool wants_clearance = false;
  std::vector<Pose> X_WT;  ///< from --pose or, later, --poses
};

/// A measurement at one pose.
struct QueryMeasurement {
  Penetration penetration;
  BodyMeasure shares;  ///< of cloud and objects
  /// Penetration::unseen_volume; none with a point method.
  std::optional<double> unseen;
  std::vector<int> decided;  ///< spheres in contact decided by each camera; last: by none
  double seconds = 0;
  Pose X_WT;
  std::optional<MeasureNoise> noise;               ///< with --std
  std::optional<double> clearance = std::nullopt;  ///< m, with its sphere and its gradient
  int nearest = -1;
  std::array<double, 6> clearance_gradient = {};
};

/// Name of a camera by its number, in results: camera, camera_2, ...
std::string camera_name(std::size_t number);

/// Prints all measurements to standard output, as JSON. `tool_volume`: that of the whole tool, m3.
void print_results_json(const QueryOptions& options, const RunSettings& settings, const Tool& tool,
                        const Pose& X_WCamera, Backend backend, std::size_t num_usable,
                        double tool_volume, const std::vector<QueryMeasurement>& measurements);
/// A pose that comes near to what the cameras measured.
struct NearestPose {
  double distance = 0;  ///< m
  std::size_t pose = 0;
};

/// Prints that no pose touches, and how near the nearest of `num_poses` is.
void print_nearest(const NearestPose& nearest, std::size_t num_poses);
/// The same as print_results_json(), as a table.
void print_results_table(const QueryOptions& options, double tool_volume,
                         const std::vector<QueryMeasurement>& measurements);

}  // namespace palpate::apps
