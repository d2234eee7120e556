// The parts of a robot: tree, tools and what follows from them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/robot/robot.h"
#include "src/cameras/internal/robot_model.h"
#include "src/contact/internal/joint_tree.h"

namespace palpate { inline namespace v0 {

/// A link with spheres, and the joints that move it.
struct RobotLimb {
  /// A joint between the base and the link that is moved, or follows one that is.
  struct Mover {
    std::size_t joint = 0;  ///< in the model
    std::size_t moved = 0;  ///< in Robot::joints
    /// m, of a turning one: no point of a sphere is ever farther from its axis. 1 of a sliding one.
    double reach = 1;
  };
  std::size_t link = 0;  ///< in the model
  std::vector<Mover> movers;
  double radius = 0;  ///< m: no point of a sphere is farther from the frame of the link
};

struct Robot::Data {
  static constexpr std::size_t kNotMoved = -1;

  RobotModel model;                                ///< without meshes
  std::vector<std::shared_ptr<const Tool>> tools;  ///< of each link of the model; null: no spheres
  std::vector<double> standoffs;                   ///< m, of each link of the model

  // Made from these by `complete`.
  std::vector<Joint> joints;
  std::vector<std::size_t> moved;   ///< in the model, of each of `joints`
  std::vector<std::size_t> number;  ///< in `joints`, of each in the model; or kNotMoved
  std::vector<RobotLimb> limbs;
  std::vector<std::size_t> limb_links;    ///< of limbs
  std::vector<std::string> names;         ///< of limbs
  std::shared_ptr<const JointTree> tree;  ///< the same for a GPU; its tools are the limbs

  /// Errors: a floating joint; limits that exclude all positions; no spheres.
  static Result<Robot> complete(Data data, const std::string& name);
};

}}  // namespace palpate::v0
