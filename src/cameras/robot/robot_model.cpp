#include "src/cameras/internal/robot_model.h"

#include <algorithm>

#include "src/core/internal/message_text.h"
#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 {
namespace {

std::vector<std::size_t> numbers_of(const std::vector<bool>& chosen) {
  std::vector<std::size_t> numbers;
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    if (chosen[i]) numbers.push_back(i);
  }
  return numbers;
}

}  // namespace

void RobotModel::place(std::span<const double> positions, std::span<Pose> X_BL) const {
  X_BL[root] = {};
  for (const RobotJoint& joint : joints) {
    const double position = joint.factor * positions[joint.source] + joint.offset;
    X_BL[joint.child] = child_of(X_BL[joint.parent] * joint.X_PJ, joint.kind, joint.axis, position);
  }
}

std::vector<std::size_t> RobotModel::required_joints() const {
  // From the leaves on: whether there is a mesh from this link on.
  std::vector<bool> has_mesh(links.size());
  for (std::size_t i = 0; i < links.size(); ++i) has_mesh[i] = !links[i].mesh.triangles.empty();
  for (auto joint = joints.rbegin(); joint != joints.rend(); ++joint) {
    if (has_mesh[joint->child]) has_mesh[joint->parent] = true;
  }
  std::vector<bool> is_required(joints.size());
  for (const RobotJoint& joint : joints) {
    const bool is_fixed = joint.kind == RobotJoint::Kind::fixed;
    if (!is_fixed && has_mesh[joint.child]) is_required[joint.source] = true;
  }
  return numbers_of(is_required);
}

std::vector<std::size_t> RobotModel::joints_between(std::size_t a, std::size_t b) const {
  // From the leaves on, an odd number of the two means that the joint lies between them.
  std::vector<int> num_below(links.size());
  ++num_below[a];
  ++num_below[b];
  std::vector<bool> is_required(joints.size());
  for (auto joint = joints.rbegin(); joint != joints.rend(); ++joint) {
    const int num = num_below[joint->child];
    num_below[joint->parent] += num;
    if (num == 1 && joint->kind != RobotJoint::Kind::fixed) is_required[joint->source] = true;
  }
  return numbers_of(is_required);
}

Result<std::size_t> RobotModel::find_link(const std::string& link) const {
  const auto found = std::ranges::find(links, link, &RobotLink::name);
  if (found != links.end()) return static_cast<std::size_t>(found - links.begin());
  std::vector<std::string> names;
  for (const RobotLink& each : links) names.push_back(shown(each.name));
  return Error{Errc::bad_input, "there is no link '" + shown(link) + "'; the nearest one is '" +
                                    nearest_word(link, names) + "'"};
}

std::vector<std::filesystem::path> RobotFolders::packages_of(std::string_view list) {
  std::vector<std::filesystem::path> folders;
  const auto add_all = [&](std::string_view rest, const char* below) {
    while (!rest.empty()) {
      const std::size_t end = rest.find(':');
      const std::string_view one = rest.substr(0, end);
      if (!one.empty()) folders.push_back(std::filesystem::path(one) / below);
      rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
    }
  };
  add_all(list, "");
  add_all(environment("ROS_PACKAGE_PATH"), "");
  add_all(environment("AMENT_PREFIX_PATH"), "share");
  return folders;
}

}}  // namespace palpate::v0
