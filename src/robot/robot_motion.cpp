// Proves that straight motions in joint space are free. A step by a share ds of the motion moves no
// point of a link's spheres farther than ds times the sum over its joints of |dq| times the
// farthest that such a point ever is from the joint's axis. So a link stays clear for as long as
// that is less than its clearance: the motion is walked in such steps, all motions side by side.
// This takes distances whose change is bounded, as to what cameras see (clearance_slack).
#include <algorithm>
#include <cmath>
#include <limits>

#include "src/contact/internal/clearance_slack.h"
#include "src/core/internal/message_text.h"
#include "src/robot/robot_measures.h"

namespace palpate { inline namespace v0 {
namespace {

/// m. Nearer to the margin a motion is given up: steps would be as short as that.
constexpr double kShortestStep = 2e-4;
/// rad or m, of a joint. Longer motions would take steps without end.
constexpr double kLongestMotion = 100;

/// One motion, and how far it is proved.
struct Motion {
  std::size_t number = 0;
  std::vector<double> from, change;  // of the joints
  std::vector<double> speeds;        // m for the whole motion, of each limb
  double longest = 0;                // rad or m, of a joint that moves a limb
  double done = 0;                   // share
};

Motion motion_of(const Robot::Data& robot, const double* from, const double* to,
                 std::size_t number) {
  Motion motion;
  motion.number = number;
  for (std::size_t j = 0; j < robot.joints.size(); ++j) {
    const Robot::Joint& joint = robot.joints[j];
    motion.from.push_back(std::clamp(from[j], joint.lower, joint.upper));
    motion.change.push_back(std::clamp(to[j], joint.lower, joint.upper) - motion.from[j]);
  }
  for (const RobotLimb& limb : robot.limbs) {
    double speed = 0;
    for (const RobotLimb::Mover& mover : limb.movers) {
      const double turn =
          std::abs(robot.model.joints[mover.joint].factor * motion.change[mover.moved]);
      motion.longest = std::max(motion.longest, turn);
      if (turn > 0) speed += turn * mover.reach;
    }
    motion.speeds.push_back(speed);
  }
  return motion;
}

}  // namespace

Status RobotContact::free_motions(const Scene& scene, const RobotPoses& poses,
                                  std::span<const double> ends, double margin,
                                  std::uint8_t* is_free, double* until) const {
  Impl& impl = *impl_;
  const Robot::Data& robot = impl.data();
  const std::size_t n = robot.joints.size(), num_limbs = robot.limbs.size();
  if (poses.gpu != kHostMemory) {
    return Error{Errc::invalid_argument,
                 "motions are proved step by step; give their starts and ends in host memory"};
  }
  for (const std::span<const double> joints : {poses.joints, ends}) {
    RobotPoses checked = poses;
    checked.joints = joints;
    if (const Status s = check_joints(robot, checked); !s) return s;
  }
  if (ends.size() != poses.joints.size() || !(margin >= 0 && std::isfinite(margin))) {
    return Error{Errc::invalid_argument,
                 "motions need as many ends as starts, and a margin of 0 m or more"};
  }
  if (!scene.bodies.empty()) {
    return Error{Errc::invalid_argument,
                 "motions past CAD bodies are not proved, as the distance to them is sampled; ask "
                 "'any' about samples of each motion"};
  }
  std::vector<Motion> open;
  for (std::size_t i = 0; i < ends.size() / n; ++i) {
    open.push_back(motion_of(robot, poses.joints.data() + i * n, ends.data() + i * n, i));
    if (!(open.back().longest <= kLongestMotion)) {
      return Error{Errc::invalid_argument,
                   "motion " + std::to_string(i) + " moves a joint by more than " +
                       number_text(kLongestMotion, 3) + " rad or m; ask about parts of it"};
    }
  }
  std::fill_n(is_free, open.size(), std::uint8_t{0});
  if (until != nullptr) std::fill_n(until, open.size(), 0.0);
  std::vector<double> joints, clearance;
  SceneAnswers requested;
  requested.clearance_limit = margin + kClearanceLimit;
  while (!open.empty()) {
    joints.clear();
    for (const Motion& motion : open) {
      for (std::size_t j = 0; j < n; ++j) {
        joints.push_back(motion.from[j] + motion.done * motion.change[j]);
      }
    }
    std::vector<Motion> next;
    for (std::size_t first = 0; first < open.size();) {
      const std::size_t num = impl.place({joints, with_unit_rotation(poses.X_WB)}, first);
      clearance.resize(num * num_limbs);
      requested.clearance = clearance.data();
      if (const Status s = impl.contact.measure(scene, impl.scene_poses(num, false), requested); !s)
        return s;
      for (std::size_t i = 0; i < num; ++i) {
        Motion& motion = open[first + i];
        double step = std::numeric_limits<double>::infinity();  // share
        for (std::size_t l = 0; l < num_limbs && step > 0; ++l) {
          const double clear = clearance[i * num_limbs + l] - margin;
          if (clear < 0) step = 0;
          if (motion.speeds[l] == 0) continue;  // as clear as it is now
          if (!std::isfinite(motion.speeds[l])) step = 0;
          const RobotLimb& limb = robot.limbs[l];
          const double room =
              clear - clearance_slack(scene, impl.X_WL[i * num_limbs + l].translation,
                                      limb.radius + margin + clear);
          step = !(room >= kShortestStep) ? 0 : std::min(step, room / motion.speeds[l]);
        }
        motion.done += step;
        if (until != nullptr) until[motion.number] = std::min(motion.done, 1.0);
        if (motion.done >= 1) is_free[motion.number] = 1;
        if (step > 0 && motion.done < 1) next.push_back(std::move(motion));
      }
      first += num;
    }
    open = std::move(next);
  }
  return Done{};
}

}}  // namespace palpate::v0
