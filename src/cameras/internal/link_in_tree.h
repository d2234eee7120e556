// The pose of a robot's link in another one, from a URDF: for cameras and other mounted parts.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>

#include "src/cameras/files_once.h"
#include "src/cameras/internal/robot_model.h"
#include "src/cameras/internal/robot_states.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {

/// URDFs without their meshes, each read once for everything that is opened together.
using RobotTrees = FilesOnce<RobotModel>;

/// Pose of a link in a base, FILE.urdf#LINK[#BASE]; the base is the URDF's root by default. Optical
/// frames of ROS have x right, y down, z forward (REP 103), as cameras here.
class LinkInTree {
 public:
  /// `joints`: source of the states of joints between the two, as RobotFiles::joints; empty if
  /// none. Errors: no such form; as of parse_urdf; no such link; joints without a source,
  /// or that do not move. Not received: no source of joint states is opened or waited for, and
  /// the pose of a moving link may not be queried.
  static Result<LinkInTree> open(const std::string& address, const std::string& joints,
                                 bool is_received, RobotTrees& trees);

  /// True if anything between the two moves.
  bool is_moving() const { return !required_.empty(); }
  /// True if times are on the clock of this computer. None: nothing moves.
  std::optional<bool> is_live() const {
    return states_ ? std::optional(states_->is_live()) : std::nullopt;
  }
  /// X_BL at a time on the clock of the frames, s; `stamp`: as of DepthFrame. Error: a joint has no
  /// state within 0.1 s.
  Result<Pose> at(double time, double stamp = 0) const;

 private:
  LinkInTree() = default;

  std::shared_ptr<const RobotModel> model_;
  std::size_t link_ = 0, base_ = 0;
  std::vector<std::size_t> required_;  // joints
  std::shared_ptr<const RobotStates> states_;
};

/// Returns where FILE ends in FILE#LINK..., as its name may have a '#': at the first one before
/// which there is such a file, else at the first one.
std::size_t end_of_file(const std::string& address);

/// The source of these joint states of a robot, once all have been received; null if there are
/// none. `robot` is its file, for messages. Errors: as of RobotStates::open; a floating joint;
/// no source is given, or one where nothing moves; a joint without states.
Result<std::unique_ptr<RobotStates>> open_joint_states(const RobotModel& model,
                                                       std::span<const std::size_t> required,
                                                       const std::string& joints,
                                                       const std::string& robot);

/// Waits for live states; recorded ones are all there. Returns what is missing.
template <class Missing>
std::string what_is_missing(const RobotStates& states, const Missing& missing) {
  constexpr double kFirstStates = 10;  // s that live ones are waited for
  const double start = monotonic_now();
  std::string names = missing();
  while (!names.empty() && states.is_live() && monotonic_now() - start < kFirstStates) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    names = missing();
  }
  return names;
}

}}  // namespace palpate::v0
