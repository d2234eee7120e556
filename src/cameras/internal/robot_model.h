// A robot as links and joints, and where its links are for positions of its joints.
#pragma once

#include <cstddef>
#include <filesystem>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "src/math/internal/joint_motion.h"

namespace palpate { inline namespace v0 {

struct RobotJoint {
  using Kind = JointKind;
  std::string name;
  Kind kind = Kind::fixed;
  bool is_endless = false;  ///< a turning one without limits: positions may jump by a turn
  std::size_t parent = 0, child = 0;  ///< links
  Pose X_PJ;                          ///< of the joint in its parent link
  Vec3d axis{1, 0, 0};                ///< in J, 1 long
  /// Its position is factor * that of the joint `source` + offset; of most joints their own.
  std::size_t source = 0;
  double factor = 1, offset = 0;
  /// Limits of its own position; NaN: given, but no number.
  double lower = -std::numeric_limits<double>::infinity(),
         upper = std::numeric_limits<double>::infinity();
};

/// A tree. Parents come before their children.
struct RobotModel {
  std::string name;
  std::vector<RobotLink> links;  ///< meshes in link frames; some have none
  /// Numbers of vertices and of triangles of a link's mesh up to the end of each of its shapes.
  struct ShapeEnd {
    std::size_t vertices = 0, triangles = 0;
  };
  std::vector<std::vector<ShapeEnd>> shape_ends;  ///< of each link
  std::vector<RobotJoint> joints;
  std::size_t root = 0;            ///< link whose frame is that of the base, B
  std::vector<std::string> notes;  ///< of links that are left out, and why

  /// X_BL of every link. `positions`: of every joint; those of fixed and of following ones are not
  /// looked at.
  void place(std::span<const double> positions, std::span<Pose> X_BL) const;
  /// Joints whose positions are needed to place every link with a mesh.
  std::vector<std::size_t> required_joints() const;
  /// Joints whose positions are needed to place these links in each other.
  std::vector<std::size_t> joints_between(std::size_t a, std::size_t b) const;
  /// Error: no link has this name; it names the nearest one.
  Result<std::size_t> find_link(const std::string& name) const;
};

/// Folders that are searched for files of a robot.
struct RobotFolders {
  std::filesystem::path beside;                 ///< the robot's own folder
  std::vector<std::filesystem::path> packages;  ///< folders with packages of ROS
  /// Splits a list at ':'; then adds the folders of ROS_PACKAGE_PATH and AMENT_PREFIX_PATH.
  static std::vector<std::filesystem::path> packages_of(std::string_view list);
};

/// URDF: links with boxes, cylinders, spheres and meshes, joints of all kinds with their
/// limits. Errors: not XML, with the line; what is missing, or no number, with its name; a link
/// or joint that is not there, or is there twice; not a tree; a mesh that cannot be read, unless it
/// is how a link looks that has no collision mesh: that link is left out, with a note. Without a
/// `geometry` links have no meshes, and none is looked for; nor do links that are `skipped`.
Result<RobotModel> parse_urdf(std::string_view text, const std::string& name,
                              const RobotFolders& folders, std::optional<RobotGeometry> geometry,
                              const std::vector<std::string>& skipped = {});

}}  // namespace palpate::v0
