// Robots in scenes: forward kinematics, one pose of each link for SceneContact, and what its
// answers mean for the joints (joint_tree.h). The gradient of a clearance is such a force. On a GPU
// the links are placed where they are measured, where only the nearest one counts.
#include <algorithm>
#include <cmath>
#include <utility>

#include "src/cameras/internal/link_image.h"
#include "src/core/internal/message_text.h"
#include "src/robot/robot_measures.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kAtATime = 256;  // configurations, whose results are in memory

}  // namespace

Error refused_joint(const Robot::Data& robot, std::size_t i, double position) {
  const std::size_t n = robot.joints.size();
  const Robot::Joint& joint = robot.joints[i % n];
  const std::string named =
      "joint '" + shown(joint.name) + "' of configuration " + std::to_string(i / n) + " is " +
      (std::isnan(position) ? "not a number" : "at " + number_text(position, 4));
  if (!(std::abs(position) < kMaxJointPosition)) {
    return {Errc::invalid_argument, named + "; give its position in rad or m"};
  }
  return {Errc::invalid_argument, named + ", beyond its limits " + number_text(joint.lower, 4) +
                                      " to " + number_text(joint.upper, 4) +
                                      "; keep it within them, or let it be held there"};
}

Status check_joints(const Robot::Data& robot, const RobotPoses& poses) {
  const std::size_t n = robot.joints.size();
  const std::span<const double> joints = poses.joints;
  if (!is_finite(poses.X_WB)) {
    return Error{Errc::invalid_argument,
                 "the pose of the robot's base is not finite; give it in m"};
  }
  if (joints.size() % n != 0) {
    return Error{Errc::invalid_argument, "positions of " + std::to_string(n) +
                                             " joints are needed for each configuration, " +
                                             std::to_string(joints.size()) +
                                             " numbers were given; the joints are those of "
                                             "Robot::joints"};
  }
  if (poses.gpu != kHostMemory) return Done{};
  const Robot::Joint* next = robot.joints.data();
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const Robot::Joint& joint = *next;
    if (++next == robot.joints.data() + n) next = robot.joints.data();
    const bool is_within = joints[i] >= joint.lower && joints[i] <= joint.upper;
    if (std::abs(joints[i]) < kMaxJointPosition && (is_within || !poses.refuses_beyond_limits)) {
      continue;
    }
    return refused_joint(robot, i, joints[i]);
  }
  return Done{};
}

void add_joint_torque(const Robot::Data& robot, const RobotLimb& limb, const RobotPlaces& places,
                      std::size_t configuration, const Pose& X_WB, const Vec3d& C_W,
                      const Vec3d& force, const Vec3d& torque, double* to) {
  for (const RobotLimb::Mover& mover : limb.movers) {
    const RobotJoint& joint = robot.model.joints[mover.joint];
    const Pose X_WJ = X_WB * places.X_BL(configuration, joint.child);
    to[mover.moved] += joint.factor * effort_of(X_WJ, joint.kind, joint.axis, C_W, force, torque);
  }
}

Status Robot::place(std::span<const double> joints, const Pose& X_WB, std::span<Pose> X_WL) const {
  if (joints.size() != data_->joints.size() || X_WL.size() != data_->limbs.size()) {
    return Error{Errc::invalid_argument, "a robot of " + std::to_string(data_->joints.size()) +
                                             " joints and " + std::to_string(data_->limbs.size()) +
                                             " links is placed by as many numbers"};
  }
  if (const Status status = check_joints(*data_, {joints, X_WB}); !status) return status;
  std::vector<double> positions(data_->model.joints.size());
  for (std::size_t j = 0; j < joints.size(); ++j) {
    positions[data_->moved[j]] =
        std::clamp(joints[j], data_->joints[j].lower, data_->joints[j].upper);
  }
  std::vector<Pose> X_BL(data_->model.links.size());
  data_->model.place(positions, X_BL);
  const Pose unit_X_WB = with_unit_rotation(X_WB);
  for (std::size_t l = 0; l < X_WL.size(); ++l) X_WL[l] = unit_X_WB * X_BL[data_->limb_links[l]];
  return Done{};
}

Status Robot::remove_from(DepthFrame& frame, const Intrinsics& intrinsics,
                          std::span<const double> joints, const Pose& X_WB, double padding) const {
  const bool has_size = frame.width > 0 && frame.height > 0 &&
                        frame.pixels.size() == std::size_t(frame.width) * frame.height;
  if (!has_size) {
    return Error{Errc::invalid_argument,
                 "an image has width x height pixels, not " + std::to_string(frame.pixels.size()) +
                     " for " + std::to_string(frame.width) + " x " + std::to_string(frame.height)};
  }
  if (const Status status = check_settings(SelfFilterOptions{.padding = padding}); !status) {
    return status;
  }
  std::vector<Pose> X_WL(data_->limbs.size());
  if (const Status status = place(joints, X_WB, X_WL); !status) return status;
  LinkImage image(intrinsics, padding);
  image.begin(frame.width, frame.height);
  const Pose X_CW = inverse(frame.X_WC);
  for (std::size_t l = 0; l < X_WL.size(); ++l) image.add(tool(l).mesh(), X_CW * X_WL[l]);
  image.draw();
  image.remove_from(frame);
  return Done{};
}

/// Places the configurations `first` and following, as many as there is room for.
std::size_t RobotContact::Impl::place(const RobotPoses& poses, std::size_t first) {
  const std::size_t n = data().joints.size(), num_limbs = data().limbs.size();
  const std::size_t num = std::min(kAtATime, poses.joints.size() / n - first);
  places.resize(data(), num);
  X_WL.resize(num * num_limbs);
  const std::span<const double> joints = poses.joints.subspan(first * n, num * n);
  pool->parallel_for(static_cast<int>(places.num_blocks()), [&](int block) {
    places.place(data(), static_cast<std::size_t>(block), joints, poses.X_WB, X_WL);
  });
  for (std::size_t i = tool_of_pose.size(); i < num * num_limbs; ++i) {
    tool_of_pose.push_back(static_cast<std::int32_t>(i % num_limbs));
    group_of_pose.push_back(static_cast<std::int32_t>(i / num_limbs));
  }
  return num;
}

ScenePoses RobotContact::Impl::scene_poses(std::size_t num, bool has_groups) const {
  const std::size_t all = num * data().limbs.size();
  ScenePoses of{std::span(X_WL).first(all), std::span(tool_of_pose).first(all), {}, 0};
  if (!has_groups) return of;
  of.group_of_pose = std::span(group_of_pose).first(all);
  of.num_groups = static_cast<int>(num);
  return of;
}

RobotContact::RobotContact(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RobotContact::RobotContact(RobotContact&&) noexcept = default;
RobotContact& RobotContact::operator=(RobotContact&&) noexcept = default;
RobotContact::~RobotContact() = default;

const Robot& RobotContact::robot() const { return impl_->robot; }

Result<RobotContact> RobotContact::create(const Robot& robot, const Place& place, int num_threads) {
  auto contact = SceneContact::create(tools_of(robot), FieldMethod{}, place, num_threads);
  if (!contact) return contact.error();
  return RobotContactMaker::make(robot, *std::move(contact), place, num_threads);
}

RobotContact RobotContactMaker::make(const Robot& robot, SceneContact contact, const Place& place,
                                     int num_threads) {
  return RobotContact(
      std::make_unique<RobotContact::Impl>(robot, std::move(contact), place, num_threads));
}

/// Errors: as of check_joints; positions that are not where they are measured.
Status RobotContact::Impl::check(const RobotPoses& poses) const {
  if (poses.gpu != kHostMemory && !is_on_gpu) {
    return Error{Errc::invalid_argument,
                 "positions of joints in the memory of GPU " + std::to_string(poses.gpu) +
                     " were given to a robot on the CPU; create its contact with Place::cuda(" +
                     std::to_string(poses.gpu) + "), or copy them to host memory"};
  }
  return check_joints(data(), poses);
}

Status RobotContact::Impl::measure_on_gpu(const Scene& scene, const RobotPoses& poses,
                                          const TreeAnswers& to) const {
  const auto refused = measure_tree(
      contact, scene,
      {data().tree, poses.X_WB, poses.joints, poses.refuses_beyond_limits, poses.gpu}, to);
  if (!refused) return refused.error();
  if (*refused) return refused_joint(data(), (*refused)->number, (*refused)->value);
  return Done{};
}

Status RobotContact::measure(const Scene& scene, const RobotPoses& given,
                             const RobotAnswers& all) const {
  Impl& impl = *impl_;
  RobotPoses poses = given;
  poses.X_WB = with_unit_rotation(given.X_WB);
  const Robot::Data& robot = impl.data();
  if (const Status s = impl.check(poses); !s) return s;
  RobotAnswers to = all;
  const bool is_there = poses.gpu != kHostMemory;
  if (is_there && (all.volume || all.wrench || all.joint_torque || all.unseen ||
                   all.link_clearance || all.link_clearance_by_joint)) {
    return Error{
        Errc::invalid_argument,
        "a GPU tells the clearance, its link and its derivative of joints in its memory; give "
        "the positions in host memory for more"};
  }
  if (impl.is_on_gpu &&
      (all.clearance || all.link || all.clearance_by_joint || (is_there && all.held))) {
    const Status s = impl.measure_on_gpu(
        scene, poses,
        {all.clearance, all.link, all.clearance_by_joint, all.held, nullptr, all.clearance_limit});
    if (!s) return s;
    to.clearance = to.clearance_by_joint = nullptr;
    to.link = nullptr;
    to.held = nullptr;
  }
  const bool wants_more =
      to.wants_clearance() || to.volume || to.wrench || to.joint_torque || to.unseen || to.held;
  if (!wants_more) return Done{};
  const std::size_t n = robot.joints.size(), num_limbs = robot.limbs.size();
  const std::size_t total = poses.joints.size() / n;
  RobotMeasures found;
  for (std::size_t first = 0; first < total;) {
    const std::size_t num = impl.place(poses, first);
    const SceneAnswers requested = found.make_room(to, num * num_limbs);
    const ScenePoses places = impl.scene_poses(num, requested.only_least_of_groups);
    if (const Status s = impl.contact.measure(scene, places, requested); !s) return s;
    for (std::size_t i = 0; i < num; ++i) {
      found.reduce(robot, impl.places, i, poses.X_WB, impl.X_WL.data() + i * num_limbs, first + i,
                   to);
      if (to.held != nullptr) to.held[first + i] = impl.places.held(i);
    }
    first += num;
  }
  return Done{};
}

Status RobotContact::any(const Scene& scene, const RobotPoses& given, double margin,
                         std::uint8_t* hits) const {
  Impl& impl = *impl_;
  RobotPoses poses = given;
  poses.X_WB = with_unit_rotation(given.X_WB);
  if (const Status s = impl.check(poses); !s) return s;
  if (impl.is_on_gpu) return impl.measure_on_gpu(scene, poses, {.hits = hits, .limit = margin});
  const std::size_t total = poses.joints.size() / impl.data().joints.size();
  for (std::size_t first = 0; first < total;) {
    const std::size_t num = impl.place(poses, first);
    const ScenePoses places = impl.scene_poses(num, true);
    if (const Status s = impl.contact.any(scene, places, margin, hits + first); !s) return s;
    first += num;
  }
  return Done{};
}

SceneAnswers RobotMeasures::make_room(const RobotAnswers& to, std::size_t num_poses) {
  SceneAnswers requested;
  const auto use = [&](std::vector<double>& numbers, std::size_t each) {
    numbers.resize(num_poses * each);
    return numbers.data();
  };
  if (to.wants_clearance()) {
    requested.clearance = use(clearance, 1);
    requested.clearance_limit = to.clearance_limit;
    requested.only_least_of_groups = !to.link_clearance && !to.link_clearance_by_joint;
    nearest.resize(num_poses);
    requested.nearest = nearest.data();
    if (to.clearance_by_joint || to.link_clearance_by_joint) {
      requested.clearance_gradient = use(gradient, 6);
    }
  }
  if (to.volume) requested.contact.volume = use(volume, 1);
  if (to.wrench || to.joint_torque) {
    requested.contact.force = use(force, 3);
    requested.contact.torque = use(torque, 3);
  }
  if (to.unseen) requested.unseen = use(unseen, 1);
  return requested;
}

void RobotMeasures::reduce(const Robot::Data& robot, const RobotPlaces& places,
                           std::size_t configuration, const Pose& X_WB, const Pose* X_WL,
                           std::size_t i, const RobotAnswers& to) const {
  const std::size_t n = robot.joints.size(), num_limbs = robot.limbs.size();
  const std::size_t from = configuration * num_limbs;
  const auto vector_at = [](const std::vector<double>& numbers, std::size_t at) {
    return Vec3d{numbers[at], numbers[at + 1], numbers[at + 2]};
  };
  const auto center = [&](std::size_t l) {
    return X_WL[l] * robot.tools[robot.limbs[l].link]->sphere_mass().center_of_mass;
  };
  if (to.wants_clearance()) {
    const double* const here = clearance.data() + from;
    const auto least = static_cast<std::size_t>(std::min_element(here, here + num_limbs) - here);
    if (to.clearance) to.clearance[i] = here[least];
    if (to.link) to.link[i] = here[least] < to.clearance_limit ? static_cast<int>(least) : -1;
    const auto add_gradient = [&](std::size_t l, double* by_joint) {
      std::fill_n(by_joint, n, 0.0);
      if (nearest[from + l] < 0) return;
      add_joint_torque(robot, robot.limbs[l], places, configuration, X_WB, center(l),
                       vector_at(gradient, 6 * (from + l)), vector_at(gradient, 6 * (from + l) + 3),
                       by_joint);
    };
    if (to.clearance_by_joint) add_gradient(least, to.clearance_by_joint + i * n);
    for (std::size_t l = 0; l < num_limbs; ++l) {
      if (to.link_clearance) to.link_clearance[i * num_limbs + l] = here[l];
      if (to.link_clearance_by_joint) {
        add_gradient(l, to.link_clearance_by_joint + (i * num_limbs + l) * n);
      }
    }
  }
  if (to.joint_torque) std::fill_n(to.joint_torque + i * n, n, 0.0);
  double all = 0, not_seen = 0, inside = 0;
  for (std::size_t l = 0; l < num_limbs; ++l) {
    const std::size_t at = from + l;
    if (to.volume) inside += volume[at];
    if (to.unseen) {
      const double full = full_volume(*robot.tools[robot.limbs[l].link], FieldMethod{}.volumes);
      all += full;
      not_seen += full * unseen[at];
    }
    if (to.wrench) {
      std::copy_n(force.data() + 3 * at, 3, to.wrench + 6 * (i * num_limbs + l));
      std::copy_n(torque.data() + 3 * at, 3, to.wrench + 6 * (i * num_limbs + l) + 3);
    }
    if (to.joint_torque) {
      add_joint_torque(robot, robot.limbs[l], places, configuration, X_WB, center(l),
                       vector_at(force, 3 * at), vector_at(torque, 3 * at),
                       to.joint_torque + i * n);
    }
  }
  if (to.volume) to.volume[i] = inside;
  if (to.unseen) to.unseen[i] = std::min(1.0, not_seen / all);
}

}}  // namespace palpate::v0
