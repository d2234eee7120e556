// palpate ros2 --robot without a tool: how far a whole robot is from what cameras see, rows that
// keep its joints away, and a factor that slows it down.
#pragma once

#include <optional>
#include <string>

#include "apps/touch/touch.h"

namespace palpate::apps {

struct GuardOptions {
  std::optional<double> margin;          ///< m; none: the robot's standoff and 1 cm
  double slow_from = 0.1;                ///< m, of clearance
  double approach = 5;                   ///< 1/s, of rows
  std::string scale = "velocity_scale";  ///< topic of the factor
};
void add_guard_options(CLI::App& app, GuardOptions& options);
/// Ends in wrong usage for options of a guard beside a tool, or of a tool without one.
void check_guard(const CLI::App& app, const TouchOptions& touch);

/// Publishes until it is interrupted, or for the duration of the options:
///
///   NAMESPACE/guard           palpate_msgs/Guard
///   NAMESPACE/clearance       std_msgs/Float64
///   NAMESPACE/velocity_scale  std_msgs/Float64
///   /diagnostics              diagnostic_msgs/DiagnosticArray
///
/// Errors: those of the robot, its joints and the cameras; no Cyclone DDS.
Status run_guard(const TouchOptions& touch, const GuardOptions& options);

}  // namespace palpate::apps
