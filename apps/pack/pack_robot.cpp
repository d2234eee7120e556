#include "apps/pack/pack_robot.h"

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>

#include "apps/output_files.h"
#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "src/core/internal/message_text.h"

namespace palpate::apps {
namespace {

constexpr const char* kRobotGroup = "Robot";
constexpr const char* kRobotFlags[] = {"--standoff", "--robot-skip", "--robot-packages",
                                       "--robot-geometry"};
constexpr const char* kOtherFlags[] = {"--robot", "--output", "--json"};  // go with --robot, too

nlohmann::ordered_json json_of(const Robot& robot) {
  nlohmann::ordered_json json{{"name", robot.name()},
                              {"spheres", robot.num_spheres()},
                              {"standoff", robot.standoff()},
                              {"joints", nlohmann::json::array()},
                              {"links", nlohmann::json::array()},
                              {"notes", robot.notes()}};
  for (const Robot::Joint& joint : robot.joints()) json["joints"].push_back(joint.name);
  for (std::size_t i = 0; i < robot.links().size(); ++i) {
    json["links"].push_back(
        {{"name", robot.links()[i]}, {"spheres", robot.tool(i).spheres().size()}});
  }
  return json;
}

std::string summary_of(const Robot& robot) {
  std::string text;
  for (std::size_t i = 0; i < robot.links().size(); ++i) {
    text += "link          " + robot.links()[i] + ": " +
            std::to_string(robot.tool(i).spheres().size()) + " spheres\n";
  }
  return text + "joints        " + std::to_string(robot.joints().size()) + "\nspheres       " +
         std::to_string(robot.num_spheres()) + ", no surface farther than " +
         number_text(1e3 * robot.standoff(), 3) + " mm from one\n";
}

}  // namespace

void add_robot_packing(CLI::App& app, RobotJob& job) {
  app.add_option("--robot", job.robot, "pack the links of this robot instead of a mesh")
      ->type_name("FILE.urdf")
      ->group(kRobotGroup);
  add_number(app, "--standoff", job.packing.standoff, {1e-4, 1},
             "m: no surface of a link is farther from a sphere")
      ->group(kRobotGroup);
  app.add_option("--robot-skip", job.packing.skip, "links without spheres")
      ->type_name("LINK[,LINK]")
      ->delimiter(',')
      ->group(kRobotGroup);
  app.add_option("--robot-packages", job.packing.packages,
                 "folders searched for package://, in addition to ROS_PACKAGE_PATH and "
                 "AMENT_PREFIX_PATH")
      ->type_name("DIR[:DIR]")
      ->group(kRobotGroup);
  add_word(app, "--robot-geometry", job.packing.geometry,
           "meshes of a link; one without them uses the others")
      ->group(kRobotGroup);
}

void check_robot_packing(const CLI::App& app) {
  if (app.count("--robot") > 0) {
    if (app.count("mesh") > 0) usage_error("pack: give either a mesh or --robot FILE.urdf");
    for (const CLI::Option* option : app.get_options()) {
      const std::string flag = option->get_name();
      if (option->count() == 0 || std::ranges::count(kRobotFlags, flag) > 0 ||
          std::ranges::count(kOtherFlags, flag) > 0) {
        continue;
      }
      usage_error("pack: " + flag + " is for meshes and does not go with --robot; leave it out");
    }
    return;
  }
  if (app.count("mesh") == 0) usage_error("pack: give a mesh, or a robot (--robot FILE.urdf)");
  for (const char* const flag : kRobotFlags) {
    if (app.count(flag) > 0) usage_error(std::string("pack: ") + flag + " goes with --robot");
  }
}

Status pack_robot(const RobotJob& job) {
  if (!Robot::is_urdf(job.robot)) {
    return Error{Errc::bad_input,
                 job.robot +
                     " does not end in .urdf, .xml or .xacro; give the robot's URDF, as a "
                     "packed robot is not packed again"};
  }
  const Status status = check_output_file(job.output, OutputKind::robot, job.robot);
  if (!status) return status;
  const auto robot = Robot::open(job.robot, job.packing);
  if (!robot) return robot.error();
  for (const std::string& note : robot->notes()) print_warning(note);
  if (const Status saved = robot->save(job.output); !saved) return saved;
  if (job.json) {
    nlohmann::ordered_json json{{"output", job.output}};
    json.update(json_of(*robot));
    print_json(json);
    return Done{};
  }
  results() << summary_of(*robot) << "written       " << job.output << '\n';
  return Done{};
}

Status print_robot(const std::string& path, bool is_json) {
  const auto robot = Robot::open(path);
  if (!robot) return robot.error();
  if (is_json) {
    print_json(json_of(*robot));
  } else {
    std::cout << summary_of(*robot);
  }
  return Done{};
}

}  // namespace palpate::apps
