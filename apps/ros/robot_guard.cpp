// The guard of a whole robot over ROS 2: measures it in the newest scene at a steady rate, and
// publishes the answers.
#include "apps/ros/robot_guard.h"

#include <algorithm>
#include <limits>
#include <tuple>
#include <utility>

#include "apps/ros/newest_scene.h"
#include "apps/ros/wall_time.h"
#include "apps/terminal/terminal.h"
#include "palpate/robot/robot.h"
#include "src/cameras/internal/robot_states.h"
#include "src/core/internal/message_text.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/io/internal/ros_messages.h"
#include "src/robot/internal/robot_joints.h"
#include "src/ros/internal/ros_node.h"

namespace palpate::apps {
namespace {

using State = RosContact::State;

constexpr const char* kGroup = "Robot without a tool";
constexpr const char* kGuardFlags[] = {"--margin", "--slow-from", "--approach", "--velocity-scale"};
/// Options that a guard shares with a tool, beside those of the self filter and of surfaces.
constexpr const char* kSharedFlags[] = {"--depth",
                                        "--camera-info",
                                        "--depth-scale",
                                        "--world",
                                        "--clock",
                                        "--latency",
                                        "--qos",
                                        "--duration",
                                        "--set",
                                        "--threads",
                                        "--unknown",
                                        "--fill-levels",
                                        "--unseen",
                                        "--thickness",
                                        "--ros2-namespace",
                                        "--ros2-camera-frame",
                                        "--contact-message-rate",
                                        "--max-age",
                                        "--robot",
                                        "--joints",
                                        "--robot-pose",
                                        "--robot-packages",
                                        "--robot-skip"};
constexpr double kDiagnosticsPeriod = 1;  // s

/// Returns what counts where no camera has seen anything.
std::string assumption(const DepthFieldOptions& field) {
  const bool is_blocked = field.unknown == UnknownSpace::blocked;
  return std::string("where nothing is seen: pixels without depth count as ") +
         (is_blocked                             ? "occupied"
          : field.unknown == UnknownSpace::solid ? "the surface around them"
                                                 : "free") +
         (field.fill_levels > 0
              ? ", holes of up to about " + std::to_string(1 << field.fill_levels) +
                    " pixels as the surface at their border"
              : "") +
         ", space behind surfaces as " +
         (field.unseen == UnseenSpace::solid
              ? "occupied"
              : "free from " + number_text(1e3 * field.thickness, 3) + " mm on") +
         ", space outside of all images as " + (is_blocked ? "occupied" : "free");
}

/// A robot before cameras, and its answers.
class Guard {
 public:
  Guard(Robot robot, RobotContact contact, std::shared_ptr<const RobotJoints> joints,
        const Pose& X_WB, const TouchOptions& touch, const GuardOptions& options)
      : robot_(std::move(robot)),
        contact_(std::move(contact)),
        joints_(std::move(joints)),
        X_WB_(X_WB),
        touch_(touch),
        options_(options),
        margin_(*options.margin),
        assumes_(assumption(touch.settings.field)) {
    for (const Robot::Joint& joint : robot_.joints()) names_.push_back(joint.name);
    clearances_.resize(robot_.links().size());
    gradients_.resize(robot_.links().size() * names_.size());
  }

  Status open(const SelfFilter& filter) {
    if (const Status status = scene_.open(touch_, filter); !status) return status;
    frame_ = !touch_.ros.camera_frame.empty() ? touch_.ros.camera_frame : scene_.frame();
    auto node = RosNode::join();
    if (!node) return node.error();
    for (const auto& [publisher, topic, type] :
         {std::tuple{&guard_, std::string("guard"), "palpate_msgs/Guard"},
          std::tuple{&clearance_, std::string("clearance"), "std_msgs/Float64"},
          std::tuple{&scale_, options_.scale, "std_msgs/Float64"},
          std::tuple{&diagnostics_, std::string("/diagnostics"),
                     "diagnostic_msgs/DiagnosticArray"}}) {
      auto made = (*node)->publish(full_topic(topic, touch_.ros.name_space), type, {});
      if (!made) return made.error();
      *publisher = *std::move(made);
    }
    return Done{};
  }

  void run() {
    print_note(assumes_);
    const double period = 1 / touch_.ros.contact_rate;
    const double start = monotonic_now();
    const double end =
        touch_.duration ? start + *touch_.duration : std::numeric_limits<double>::infinity();
    for (double next = start; !interrupted() && next < end;) {
      next = std::max(next + period, monotonic_now());
      sleep_until(next);
      publish(answer());
      scene_.print_notes();
    }
    RosGuard last;
    last.state = State::failed;
    last.reason = "the run has ended";
    publish(std::move(last));
  }

 private:
  /// Returns the guard of the newest scene: without numbers unless it is valid.
  RosGuard answer() {
    RosGuard guard;
    scene_.with_newest([&](const Scene& scene, double captured, const std::string& ending) {
      const auto refuse = [&](State state, const std::string& why) {
        guard = {};
        guard.state = state;
        guard.reason = why;
      };
      if (!ending.empty()) return refuse(State::failed, ending);
      if (scene.surfaces.empty()) return refuse(State::stale, "nothing has been measured yet");
      const auto joints = joints_->known_at(monotonic_now());
      if (!joints) {  // without which images are dropped, too
        refuse(State::stale, joints.error().message);
      } else if (Status status = measure(scene, *joints, guard); !status) {
        refuse(State::failed, status.error().message);
      }
      // All may have aged while the answer was found.
      const double now = monotonic_now(), age = now - captured;
      if (guard.state == State::valid) {
        if (const auto still = joints_->known_at(now); !still) {
          refuse(State::stale, still.error().message);
        } else if (!(age <= touch_.ros.max_age)) {
          refuse(State::stale, "the depth image is " + number_text(1e3 * age, 3) + " ms old");
        }
      }
      guard.depth_age = age;
    });
    return guard;
  }

  /// Errors: the joint that is farther beyond its limits than an encoder errs: a robot is measured
  /// within its limits.
  Status check_limits(const std::vector<double>& joints) const {
    constexpr double kEncoderError = 0.01;  // rad or m
    for (std::size_t i = 0; i < joints.size(); ++i) {
      const Robot::Joint& joint = robot_.joints()[i];
      if (joints[i] >= joint.lower - kEncoderError && joints[i] <= joint.upper + kEncoderError) {
        continue;
      }
      return Error{Errc::unavailable,
                   "joint " + joint.name + " is at " + number_text(joints[i], 4) +
                       ", beyond its limits of " + number_text(joint.lower, 4) + " and " +
                       number_text(joint.upper, 4) + ": correct them in the URDF"};
    }
    return Done{};
  }

  Status measure(const Scene& scene, const std::vector<double>& joints, RosGuard& guard) {
    if (const Status status = check_limits(joints); !status) return status;
    std::int32_t link = -1;
    std::uint8_t is_held = 0;
    RobotAnswers answers;
    answers.clearance = &guard.clearance;
    answers.link = &link;
    answers.link_clearance = clearances_.data();
    answers.link_clearance_by_joint = gradients_.data();
    answers.unseen = &guard.unseen;
    answers.held = &is_held;
    answers.clearance_limit = limit();
    if (const Status status = contact_.measure(scene, {joints, X_WB_}, answers); !status) {
      return status;
    }
    guard.is_held = is_held != 0;
    if (link >= 0) guard.link = robot_.links()[static_cast<std::size_t>(link)];
    guard.scale = std::clamp((guard.clearance - margin_) / (options_.slow_from - margin_), 0., 1.);
    guard.joints = names_;
    const std::size_t n = names_.size();
    for (std::size_t l = 0; l < clearances_.size(); ++l) {
      if (clearances_[l] >= limit()) continue;
      guard.links.push_back(robot_.links()[l]);
      guard.clearances.push_back(clearances_[l]);
      for (std::size_t j = 0; j < n; ++j) guard.rows.push_back(-gradients_[l * n + j]);
      guard.bounds.push_back(options_.approach * (clearances_[l] - margin_));
    }
    return Done{};
  }
  /// Largest clearance that is measured, m.
  double limit() const { return std::max(kClearanceLimit, 2 * options_.slow_from); }

  void publish(RosGuard guard) {
    guard.assumes = assumes_;
    const double time = monotonic_now();
    const RosHeader header{wall_time(time), frame_};
    guard_->publish(ros_guard_message(header, guard));
    clearance_->publish(number_message(guard.clearance));
    scale_->publish(number_message(guard.scale));
    if (time < next_diagnostics_ && guard.state == last_state_) return;
    next_diagnostics_ = time + kDiagnosticsPeriod;
    last_state_ = guard.state;
    constexpr RosDiagnostic::Level kLevels[] = {
        RosDiagnostic::Level::ok, RosDiagnostic::Level::stale, RosDiagnostic::Level::error};
    const RosDiagnostic status[] = {
        {kLevels[static_cast<int>(guard.state)],
         "palpate: guard",
         guard.state == State::valid ? "the clearance is valid" : guard.reason,
         "",
         {{"assumption", assumes_},
          {"clearance, m", number_text(guard.clearance, 4)},
          {"unseen share", number_text(guard.unseen, 3)},
          {"age of the depth image, ms", number_text(1e3 * guard.depth_age, 3)}}}};
    diagnostics_->publish(diagnostics_message(header, status));
  }

  const Robot robot_;
  const RobotContact contact_;
  const std::shared_ptr<const RobotJoints> joints_;
  const Pose X_WB_;
  const TouchOptions& touch_;
  const GuardOptions& options_;
  const double margin_;  // m
  const std::string assumes_;
  std::string frame_;
  std::vector<std::string> names_;
  std::vector<double> clearances_, gradients_;
  NewestScene scene_;
  std::unique_ptr<RosPublisher> guard_, clearance_, scale_, diagnostics_;
  double next_diagnostics_ = 0;  // s
  State last_state_ = State::valid;
};

}  // namespace

void add_guard_options(CLI::App& app, GuardOptions& options) {
  app.add_option_function<double>(
         "--margin", [&options](double margin) { options.margin = margin; },
         "m: clearance that is kept, at which the robot stops; default: its standoff and 0.01")
      ->check(CLI::Range(0., 1.).description(""))
      ->type_name("m")
      ->group(kGroup);
  add_number(app, "--slow-from", options.slow_from, {1e-3, 5, "m"},
             "clearance below which the factor of velocities falls from 1 to 0 at the margin")
      ->group(kGroup);
  add_number(app, "--approach", options.approach, {0.01, 1000, "1/s"},
             "rows: share of the clearance beyond the margin that may be lost, in a second")
      ->group(kGroup);
  app.add_option("--velocity-scale", options.scale,
                 "topic of the factor: for MoveIt Servo /servo_node/collision_velocity_scale")
      ->type_name("TOPIC")
      ->capture_default_str()
      ->group(kGroup);
}

void check_guard(const CLI::App& app, const TouchOptions& touch) {
  if (!touch.tool.empty()) {
    for (const char* const flag : kGuardFlags) {
      if (app.count(flag) > 0) {
        usage_error(std::string("ros2: ") + flag + " is for a robot without a tool: leave out " +
                    touch.tool);
      }
    }
    return;
  }
  const std::string& robot = touch.robot.files.robot;
  if (robot.empty()) usage_error("ros2: give a TOOL.palp, or --robot arm.urdf for a whole robot");
  const auto is_in = [](const auto& options, const std::string& flag) {
    return std::ranges::any_of(options, [&](const auto& option) { return flag == option.flag; });
  };
  for (const CLI::Option* const option : app.get_options()) {
    const std::string flag = option->get_name();
    if (option->count() == 0 || std::ranges::count(kSharedFlags, flag) > 0 ||
        std::ranges::count(kGuardFlags, flag) > 0 || is_in(kSurfaceOptions, flag) ||
        is_in(kRobotOptions, flag)) {
      continue;
    }
    usage_error("ros2: " + flag + " is for a tool; without a TOOL.palp leave it out");
  }
  for (const std::string& word : app["--set"]->results()) {
    const std::string key = word.substr(0, word.find('='));
    const std::string table = key.substr(0, key.find('.'));
    if (table == "surface" || table == "field" || table == "robot" || key == "loop.threads") {
      continue;
    }
    usage_error("ros2: --set " + key + " is for a tool; a whole robot has settings of surface, " +
                "field and robot, and loop.threads");
  }
  if (touch.robot.files.joints.find("world=") != std::string::npos) {
    usage_error("ros2: a whole robot needs positions of its joints, not tf: --joints ros2:/TOPIC");
  }
}

Status run_guard(const TouchOptions& touch, const GuardOptions& given) {
  catch_interrupts();
  const RobotFiles& files = touch.robot.files;
  if (!Robot::is_urdf(files.robot) && !files.skip.empty()) {
    return Error{Errc::invalid_argument,
                 files.robot + " is packed already: give --robot-skip to palpate pack --robot"};
  }
  RobotPacking packing;
  packing.geometry = touch.robot.filter.geometry;
  packing.skip = files.skip;
  packing.packages = files.packages;
  auto robot = Robot::open(files.robot, packing);
  if (!robot) return robot.error();
  for (const std::string& note : robot->notes()) print_warning(note);
  GuardOptions options = given;
  if (!options.margin) options.margin = robot->standoff() + 0.01;
  if (*options.margin < robot->standoff()) {
    print_warning(
        "--margin is below the robot's standoff of " + number_text(robot->standoff(), 4) +
        " m, by which its surface may be before its spheres: it may touch before it stops");
  }
  if (!(*options.margin < options.slow_from)) {
    return Error{Errc::invalid_argument,
                 "--slow-from " + number_text(options.slow_from, 4) +
                     " is not above the margin of " + number_text(*options.margin, 4) +
                     " m: the robot would have no way to slow down; raise it, or pack the robot "
                     "with a smaller --standoff"};
  }
  if (files.pose.empty()) {
    print_note(
        "the base of the robot is taken to be at the frame of --world; else give "
        "--robot-pose");
  }
  const auto poses = base_poses(files.pose);
  if (!poses) return poses.error();
  if (poses->size() != 1) {
    return Error{Errc::invalid_argument,
                 "--robot-pose has " + std::to_string(poses->size()) +
                     " poses: the base of a guarded robot stands still, or moves with --world"};
  }
  const Pose X_WB = poses->front().X_WT;
  const double max_age = std::min(touch.robot.filter.max_age, touch.ros.max_age);
  auto joints = RobotJoints::open(*robot, files.joints, X_WB, max_age);
  if (!joints) return joints.error();
  const auto filter = SelfFilter::create(robot->shapes(), *joints, touch.robot.filter);
  if (!filter) return filter.error();
  auto contact = RobotContact::create(*robot, Place::cpu(), 1);
  if (!contact) return contact.error();
  Guard guard(*robot, *std::move(contact), *joints, X_WB, touch, options);
  if (const Status status = guard.open(*filter); !status) return status;
  guard.run();
  print_kept();
  return Done{};
}

}  // namespace palpate::apps
