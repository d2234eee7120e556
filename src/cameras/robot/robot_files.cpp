// Opens a self filter from the options: a URDF or a mesh, and a source of its pose.
#include <algorithm>
#include <utility>

#include "palpate/cameras/cameras.h"
#include "palpate/io/files.h"
#include "palpate/io/formats.h"
#include "src/cameras/internal/link_in_tree.h"
#include "src/cameras/internal/robot_model.h"
#include "src/cameras/internal/robot_states.h"
#include "src/core/internal/message_text.h"
#include "src/io/internal/atomic_file.h"

namespace palpate { inline namespace v0 {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxBytes = 64u << 20;  // of a URDF

/// Poses of links by joints, from the base on.
class TreePoses final : public LinkPoses {
 public:
  /// `states`: null if no joint state is needed.
  TreePoses(RobotModel model, std::vector<TimedPose> X_WB, std::unique_ptr<RobotStates> states,
            double max_age)
      : model_(std::move(model)),
        X_WB_(std::move(X_WB)),
        states_(std::move(states)),
        max_age_(max_age),
        required_(model_.required_joints()) {
    for (std::size_t i = 0; i < model_.links.size(); ++i) {
      if (!model_.links[i].mesh.triangles.empty()) shown_.push_back(i);
    }
  }

  std::optional<bool> is_live() const override {
    if (states_ && states_->is_live()) return true;
    if (states_ || X_WB_.size() > 1) return false;
    return std::nullopt;
  }
  Status at(double time, std::span<Pose> X_WL) const override { return place({time, 0}, X_WL); }
  Status at_frame(const DepthFrame& frame, std::span<Pose> X_WL) const override {
    return place({frame.timestamp, frame.stamp}, X_WL);
  }

 private:
  Status place(RobotStates::Moment moment, std::span<Pose> X_WL) const {
    moment.max_age = max_age_;
    const double time = moment.time;
    std::vector<double> values, positions(model_.joints.size());
    if (states_) {
      if (const Status status = states_->positions(moment, values); !status) return status;
      for (std::size_t i = 0; i < required_.size(); ++i) positions[required_[i]] = values[i];
    }
    if (X_WB_.size() > 1 && (time < X_WB_.front().time || time > X_WB_.back().time)) {
      return Error{Errc::unavailable, "the pose of the robot's base is unknown"};
    }
    std::vector<Pose> X_BL(model_.links.size());
    model_.place(positions, X_BL);
    const Pose base = pose_at(X_WB_, time);
    for (std::size_t i = 0; i < shown_.size(); ++i) {
      X_WL[i] = base * X_BL[shown_[i]];
      if (!is_finite(X_WL[i])) {
        return Error{Errc::bad_input,
                     "link '" + shown(model_.links[shown_[i]].name) + "' is nowhere"};
      }
    }
    return Done{};
  }

  const RobotModel model_;
  const std::vector<TimedPose> X_WB_;
  const std::unique_ptr<RobotStates> states_;
  const double max_age_;
  const std::vector<std::size_t> required_;  // joints
  std::vector<std::size_t> shown_;           // links with a mesh
};

/// Poses of links by the frames of tf that have their names.
class FramePoses final : public LinkPoses {
 public:
  FramePoses(std::vector<std::string> links, std::unique_ptr<RobotStates> states, double max_age)
      : links_(std::move(links)), states_(std::move(states)), max_age_(max_age) {}

  std::optional<bool> is_live() const override { return states_->is_live(); }
  Status at(double time, std::span<Pose> X_WL) const override {
    return states_->links_in_world(links_, {time, 0, max_age_}, X_WL);
  }
  Status at_frame(const DepthFrame& frame, std::span<Pose> X_WL) const override {
    return states_->links_in_world(links_, {frame.timestamp, frame.stamp, max_age_}, X_WL);
  }

 private:
  const std::vector<std::string> links_;
  const std::unique_ptr<RobotStates> states_;
  const double max_age_;
};

Result<RobotModel> load_robot(const RobotFiles& files, RobotGeometry geometry) {
  const fs::path path(files.robot);
  const fs::path ending = path.extension();
  if (ending == ".urdf" || ending == ".xml" || ending == ".xacro") {
    const auto text = read_file(path, kMaxBytes);
    if (!text) return text.error();
    const RobotFolders folders{path.parent_path(), RobotFolders::packages_of(files.packages)};
    return parse_urdf(*text, files.robot, folders, geometry, files.skip);
  }
  if (!files.skip.empty()) {
    return Error{Errc::invalid_argument,
                 files.robot + " is a mesh: it has no link '" + files.skip.front() + "' to skip"};
  }
  auto mesh = load_mesh(path);
  if (!mesh) return mesh.error();
  RobotModel model;
  model.name = path.stem().string();
  model.links.push_back({model.name, *std::move(mesh)});
  return model;
}

}  // namespace

Result<std::vector<TimedPose>> base_poses(const std::string& text) {
  if (text.empty()) return std::vector<TimedPose>{{0, {}}};
  std::error_code ignored;
  if (fs::is_regular_file(text, ignored)) return load_trajectory(text);
  std::string blanks = text;
  std::ranges::replace(blanks, ',', ' ');
  const auto pose = parse_pose(blanks);
  if (!pose) {
    return Error{pose.error().code,
                 "the robot's base: neither a file nor a pose: " + pose.error().message};
  }
  return std::vector<TimedPose>{{0, *pose}};
}

Result<SelfFilter> open_self_filter(const RobotFiles& files, const SelfFilterOptions& options) {
  if (const Status status = check_settings(options); !status) return status.error();
  auto model = load_robot(files, options.geometry);
  if (!model) return model.error();
  const auto address = parse_state_address(files.joints);
  if (!address) return address.error();
  std::vector<RobotLink> links;
  std::vector<std::string> names;
  for (const RobotLink& link : model->links) {
    if (link.mesh.triangles.empty()) continue;
    links.push_back(link);
    names.push_back(link.name);
  }
  if (links.empty()) {
    return Error{Errc::bad_input, files.robot +
                                      ": no link has a shape; there is nothing to leave "
                                      "out of depth images" +
                                      (model->notes.empty() ? "" : "; " + model->notes.front())};
  }
  if (!address->world.empty()) {
    if (!files.pose.empty()) {
      return Error{Errc::invalid_argument,
                   "the robot's base is where tf says (world=); leave its pose out"};
    }
    auto states = RobotStates::open(*address, {});
    if (!states) return states.error();
    const std::string missing =
        what_is_missing(**states, [&] { return (*states)->missing_links(names); });
    if (!missing.empty()) {
      return Error{Errc::unavailable, address->text + ": no transform joins '" + address->world +
                                          "' and the links " + missing + " of " + files.robot};
    }
    return SelfFilter::create(
        std::move(links),
        std::make_shared<FramePoses>(std::move(names), *std::move(states), options.max_age),
        options, std::move(model->notes));
  }

  auto X_WB = base_poses(files.pose);
  if (!X_WB) return X_WB.error();
  auto states = open_joint_states(*model, model->required_joints(), files.joints, files.robot);
  if (!states) return states.error();
  std::vector<std::string> notes = model->notes;
  auto poses = std::make_shared<TreePoses>(*std::move(model), *std::move(X_WB), *std::move(states),
                                           options.max_age);
  return SelfFilter::create(std::move(links), std::move(poses), options, std::move(notes));
}

Status check_one_world(std::span<const CameraUri> cameras, const RobotFiles& robot) {
  const auto states = parse_state_address(robot.joints);
  if (!states) return states.error();
  for (const CameraUri& camera : cameras) {
    const auto given = camera.extras.find("world");
    if (given == camera.extras.end() || states->world.empty()) continue;
    if (given->second == states->world) continue;
    return Error{Errc::invalid_argument, "--robot is placed in the world '" + states->world +
                                             "' and a camera in '" + given->second +
                                             "': give both the same world=FRAME"};
  }
  return Done{};
}

}}  // namespace palpate::v0
