// The options of the self filter: the robot to remove from depth images.
#pragma once

#include <memory>
#include <optional>
#include <span>

#include "apps/options.h"
#include "palpate/cameras/cameras.h"

namespace palpate::apps {

struct RobotOptions {
  RobotFiles files;
  SelfFilterOptions filter;
};
void add_robot_options(CLI::App& app, RobotOptions& options);
/// Ends in wrong usage for options of --robot without it. `verb` is for messages.
void check_robot(const CLI::App& app, const std::string& verb);

/// Opens the self filter; none if no robot is given. Errors: as of open_self_filter; `cameras` are
/// in another world.
Result<std::optional<SelfFilter>> open_robot(const RobotOptions& options,
                                             std::span<const CameraUri> cameras);
/// Applies the filter to `source`, if there is one. Error: as of SelfFilter::applied_to.
Result<std::unique_ptr<DepthSource>> without_robot(const std::optional<SelfFilter>& filter,
                                                   std::unique_ptr<DepthSource> source,
                                                   const Place& place = Place::cpu());
/// Returns the processor that computes the surfaces of a run.
Place place_of_surfaces(const RunSettings& settings);

}  // namespace palpate::apps
