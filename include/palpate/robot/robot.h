// Robots: links filled with spheres, moved by joints, and asked in scenes by their positions: how
// far is the arm from what cameras see, which link decides, and what do the joints feel?
//
//   auto robot = palpate::Robot::open("arm.urdf").value();
//   auto contact = palpate::RobotContact::create(robot).value();
//   auto known = contact.measure(scene, {joints}, {.clearance = clearance.data()});
//
// Self collision is not measured: ask a library of rigid bodies, such as coal.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "palpate/cloud/depth_source.h"
#include "palpate/contact/scene.h"
#include "palpate/core/core.h"
#include "palpate/gpu/devices.h"
#include "palpate/math/geometry.h"
#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

/// Options of filling the links of a URDF with spheres.
struct RobotPacking {
  double standoff = 0.01;  ///< m, 1e-4 to 1: of the surface from the nearest sphere (cover_solid)
  int max_spheres = 500;   ///< of a shape
  RobotGeometry geometry = RobotGeometry::collision;  ///< a link without it uses the other
  std::vector<std::string> skip = {};                 ///< links without spheres
  std::string packages = {};                          ///< folders for package://, separated by ':'
};

/// A tree of links and joints; links with a shape have spheres. Immutable; copies share their data.
class Robot {
 public:
  /// A joint that is moved. Others are fixed, or follow one of these (mimic).
  struct Joint {
    std::string name;
    bool turns = true;            ///< else it slides
    double lower = 0, upper = 0;  ///< rad or m; infinite without limits. Those that follow count.
  };

  /// True if a file's name is that of a URDF: it ends in .urdf, .xml or .xacro.
  static bool is_urdf(const std::filesystem::path& path);
  /// Reads a URDF and packs it, or reads a packed robot (.palprobot, to which `packing` does not
  /// apply). Errors: those of the URDF, with the line; a link to skip that is not there; no link
  /// has a shape; a floating joint; limits that are no numbers or exclude all positions; neither
  /// kind of file.
  static Result<Robot> open(const std::filesystem::path& path, const RobotPacking& packing = {});
  /// The same from the text of a URDF. `name`: of the file, for messages and meshes beside it.
  static Result<Robot> from_urdf(std::string_view text, const std::string& name,
                                 const RobotPacking& packing = {});
  /// A packed robot in memory. Errors: not one, newer version, truncated, damaged.
  static Result<Robot> from_bytes(std::string_view bytes);
  Result<std::string> to_bytes() const;
  /// Writes a packed robot, completely or not at all.
  Status save(const std::filesystem::path& path) const;

  /// The same robot, which holds a tool: one more link, fixed to another at X_LT. Errors: no link
  /// has this name; one is called like the tool; a pose that is not finite.
  Result<Robot> with_tool(const Tool& tool, const std::string& tool_name, const std::string& link,
                          const Pose& X_LT = {}) const;

  const std::string& name() const;
  /// n joints, from the base on.
  std::span<const Joint> joints() const;
  /// Names of the L links that have spheres.
  std::span<const std::string> links() const;
  /// Spheres and shapes of a link, in its frame. Shapes may overlap: their volumes count twice.
  const Tool& tool(std::size_t link) const;
  /// m: no checked point of a surface is farther from the spheres of its link. Margins have to
  /// cover it.
  double standoff() const;
  std::size_t num_spheres() const;
  /// Links that are left out or miss the standoff, and why: a sentence each.
  const std::vector<std::string>& notes() const;
  /// Shapes of all links with spheres, for a SelfFilter. In the order of links().
  std::vector<RobotLink> shapes() const;
  /// Removes the robot from a frame of a camera without distortion: pixels that show it, with a
  /// padding (m, 0 to 0.1), or what lies behind, become no measurement. Links without spheres stay.
  /// Errors: as of place; another padding; not width x height pixels.
  Status remove_from(DepthFrame& frame, const Intrinsics& intrinsics,
                     std::span<const double> joints, const Pose& X_WB,
                     double padding = SelfFilterOptions{}.padding) const;
  /// X_WL of the links. Errors: as of RobotContact::measure; `X_WL` is not of L poses.
  Status place(std::span<const double> joints, const Pose& X_WB, std::span<Pose> X_WL) const;

  struct Data;
  const Data& data() const { return *data_; }
  explicit Robot(std::shared_ptr<const Data> data) : data_(std::move(data)) {}

 private:
  std::shared_ptr<const Data> data_;
};

/// Positions of the joints of P configurations.
struct RobotPoses {
  std::span<const double> joints = {};  ///< P x n, rad and m
  Pose X_WB = {};                       ///< base of the robot
  /// Refuses positions beyond limits. Otherwise they are held at the limit, and told
  /// (RobotAnswers::held).
  bool refuses_beyond_limits = false;
  /// Memory of `joints` and of all answers. On a GPU: those of a contact there, which then tells
  /// the clearance, its link and its derivative, held ones, and yes or no.
  int gpu = kHostMemory;
};

/// Row-major arrays of the caller, where the positions are; null: not computed.
struct RobotAnswers {
  double* clearance = nullptr;  ///< P, m: least of all links, SceneAnswers::clearance
  /// P: the link that has it, one of them where several are deeper than the limit; -1: none is
  /// nearer than the limit.
  std::int32_t* link = nullptr;
  double* clearance_by_joint = nullptr;       ///< P x n: its derivative, m/rad and m/m
  double* link_clearance = nullptr;           ///< P x L, m: the same of each link
  double* link_clearance_by_joint = nullptr;  ///< P x L x n: 0 of saturated ones
  double* volume = nullptr;                   ///< P, m3: of all links
  /// P x L x 6: force (m3) and torque (m4) on each link about its center of mass C, in W.
  double* wrench = nullptr;
  double* joint_torque =
      nullptr;               ///< P x n: J^T of all wrenches, m4 of turning, m3 of sliding ones
  double* unseen = nullptr;  ///< P: share of the robot's volume in space that no camera has seen
  std::uint8_t* held = nullptr;              ///< P: 1 if a joint was beyond its limits
  double clearance_limit = kClearanceLimit;  ///< m, above 0

  bool wants_clearance() const {
    return clearance || link || clearance_by_joint || link_clearance || link_clearance_by_joint;
  }
};

/// Measures a robot against scenes. On a GPU the clearance of the nearest link and `any` take
/// positions of joints there; all else places the links on the CPU. One thread at a time.
class RobotContact {
 public:
  /// `num_threads`: of a CPU; 0: one per core. Errors: the place is not in this build or on this
  /// machine.
  static Result<RobotContact> create(const Robot& robot, const Place& place = Place::cpu(),
                                     int num_threads = 0);
  RobotContact(RobotContact&&) noexcept;
  RobotContact& operator=(RobotContact&&) noexcept;
  ~RobotContact();

  const Robot& robot() const;

  /// Errors: not P x n positions; one that is not finite, or beyond its limits and refused; those
  /// of SceneContact::measure.
  Status measure(const Scene& scene, const RobotPoses& poses, const RobotAnswers& answers) const;
  /// Writes 1 for each configuration whose clearance is below `margin` (m), else 0. Errors as
  /// above.
  Status any(const Scene& scene, const RobotPoses& poses, double margin, std::uint8_t* hits) const;
  /// Straight motions between P pairs of configurations, from `poses.joints` to `ends`, past what
  /// cameras see. Writes 1 where `any` is 0 at every point of the motion, which is proved: no
  /// sphere moves farther in a step than its link is clear. `until`, unless null: share of the
  /// motion that is proved free. A motion that comes nearer to `margin` than the clearance is
  /// certain, about 4 mm at 1 m, is not proved. Errors as above; a scene with CAD bodies, whose
  /// distance is sampled; a margin below 0; a motion of more than 100 rad or m.
  Status free_motions(const Scene& scene, const RobotPoses& poses, std::span<const double> ends,
                      double margin, std::uint8_t* is_free, double* until = nullptr) const;

 private:
  friend struct RobotContactMaker;
  struct Impl;
  explicit RobotContact(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}}  // namespace palpate::v0
