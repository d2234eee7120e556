#include <algorithm>
#include <cmath>

#include "src/core/internal/select_isa.h"
#include "src/robot/robot_poses.h"

namespace palpate { inline namespace v0 {
PALPATE_DECLARE_KERNELS(void place_links(const PlaceJob&);)

namespace {

constexpr std::size_t kTogether = kPlacedTogether;
constexpr void (*kPlaceLinks[])(const PlaceJob&) = PALPATE_BY_ISA(place_links);

}  // namespace

RobotPlaces::RobotPlaces(Isa isa) : place_links_(select_isa(kPlaceLinks, isa)) {}

void RobotPlaces::resize(const Robot::Data& robot, std::size_t num) {
  const RobotModel& model = robot.model;
  num_links_ = model.links.size();
  held_.resize(num);
  links_.resize(std::max(links_.size(), num_blocks() * num_links_));
  while (moves_.size() < num_blocks() * model.joints.size()) {
    moves_.push_back({model.joints[moves_.size() % model.joints.size()].axis});
  }
}

void RobotPlaces::place(const Robot::Data& robot, std::size_t block, std::span<const double> joints,
                        const Pose& X_WB, std::span<Pose> X_WL) {
  const RobotModel& model = robot.model;
  const std::size_t n = robot.joints.size(), first = block * kTogether;
  const std::size_t num = std::min(kTogether, held_.size() - first);
  JointMoves* const moves = moves_.data() + block * model.joints.size();
  std::fill_n(held_.begin() + static_cast<std::ptrdiff_t>(first), num, std::uint8_t{0});
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    const RobotJoint& joint = model.joints[j];
    if (joint.kind == RobotJoint::Kind::fixed) continue;
    const std::size_t number = robot.number[joint.source];
    for (std::size_t i = 0; i < num; ++i) {
      double position = 0;
      if (number != Robot::Data::kNotMoved) {
        const double given = joints[(first + i) * n + number];
        position = std::clamp(given, robot.joints[number].lower, robot.joints[number].upper);
        if (position != given) held_[first + i] = 1;
      }
      const double by = joint.factor * position + joint.offset;
      if (joint.kind == RobotJoint::Kind::turning) {
        moves[j].by[0][i] = std::sin(by / 2);
        moves[j].by[1][i] = std::cos(by / 2);
      } else {
        moves[j].by[0][i] = by;
      }
    }
  }
  const PlaceJob job{.joints = model.joints.data(),
                     .moves = moves,
                     .num_joints = model.joints.size(),
                     .root = model.root,
                     .X_BL = links_.data() + block * num_links_,
                     .X_WB = X_WB,
                     .limbs = robot.limb_links.data(),
                     .num_limbs = robot.limb_links.size(),
                     .X_WL = X_WL.data() + first * robot.limb_links.size(),
                     .num = static_cast<int>(num)};
  place_links_(job);
}

std::size_t RobotPlaces::num_blocks() const { return (held_.size() + kTogether - 1) / kTogether; }

Pose RobotPlaces::X_BL(std::size_t configuration, std::size_t link) const {
  const auto& numbers = links_[configuration / kTogether * num_links_ + link].numbers;
  const auto at = [&](int k) { return numbers[k][configuration % kTogether]; };
  return {{at(0), at(1), at(2)}, {at(3), at(4), at(5), at(6)}};
}

}}  // namespace palpate::v0
