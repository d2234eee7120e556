// Packs the links of a robot.
#pragma once

#include <string>

#include "apps/options.h"
#include "palpate/robot/robot.h"

namespace palpate::apps {

struct RobotJob {
  std::string robot, output;  ///< a URDF, and the packed robot
  RobotPacking packing;
  bool json = false;
};

void add_robot_packing(CLI::App& app, RobotJob& job);
/// Ends in wrong usage for options of --robot without it, and for options of meshes with it.
void check_robot_packing(const CLI::App& app);
/// Fills all links with spheres, writes the robot and prints what it has; links that are left out
/// or miss the standoff are warnings. Errors: no URDF, or those of it; the file cannot be written.
Status pack_robot(const RobotJob& job);
/// Prints what a packed robot has. Errors: those of Robot::open.
Status print_robot(const std::string& path, bool is_json);

}  // namespace palpate::apps
