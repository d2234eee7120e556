// Robots as the Unified Robot Description Format has them: links and joints, put in order as a
// tree.
#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <optional>

#include "src/cameras/internal/robot_model.h"
#include "src/cameras/robot/urdf_attributes.h"
#include "src/cameras/robot/urdf_shapes.h"
#include "src/core/internal/message_text.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kMaxLinks = 2000;  // more than any robot has

/// Reads one document: links first, then the joints that name them. The first error ends it.
class Reader : UrdfAttributes {
 public:
  Reader(const std::string& name, const RobotFolders& folders,
         std::optional<RobotGeometry> geometry, const std::vector<std::string>& skipped)
      : UrdfAttributes(name), geometry_(geometry), skipped_(skipped), shapes_(name, folders) {}

  Result<RobotModel> read(std::string_view text) {
    if (text.find_first_not_of(" \t\r\n") == std::string_view::npos) {
      return Error{Errc::bad_input, name_ + " is empty; did xacro or a download fail?"};
    }
    tinyxml2::XMLDocument document;
    if (document.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS) {
      return Error{Errc::bad_input, name_ + " line " + std::to_string(document.ErrorLineNum()) +
                                        ": is not XML as URDF is written in; if it is xacro, "
                                        "turn it into URDF first (xacro FILE > robot.urdf)"};
    }
    const Element* const robot = document.FirstChildElement("robot");
    if (robot == nullptr) return Error{Errc::bad_input, name_ + ": has no <robot>"};
    if (const char* const given = robot->Attribute("name")) model_.name = given;
    Status status = check_expanded(*robot);
    if (status) status = read_links(*robot);
    if (status) status = read_joints(*robot);
    if (status) status = resolve_mimics();
    if (status) status = put_in_order();
    if (!status) return status.error();
    for (const std::string& link : skipped_) {
      if (const auto found = model_.find_link(link); !found) {
        return Error{found.error().code, name_ + ": " + found.error().message};
      }
    }
    return std::move(model_);
  }

 private:
  /// Refuses xacro: links that it would still add are missing here, and the arm would be felt.
  Status check_expanded(const Element& robot) const {
    for (const Element* child = robot.FirstChildElement(); child != nullptr;
         child = child->NextSiblingElement()) {
      if (!std::string_view(child->Name()).starts_with("xacro:")) continue;
      return bad(*child, "<" + shown(child->Name()) +
                             "> is xacro; turn it into URDF first (xacro FILE > robot.urdf)");
    }
    return Done{};
  }

  Status read_links(const Element& robot) {
    for (const Element* link = robot.FirstChildElement("link"); link != nullptr;
         link = link->NextSiblingElement("link")) {
      const auto name = name_of(*link);
      if (!name) return name.error();
      if (!links_.emplace(*name, model_.links.size()).second) {
        return bad(*link, "two links are called '" + shown(*name) + "'");
      }
      if (model_.links.size() == kMaxLinks) return bad(*link, "more links than any robot has");
      model_.links.push_back({*name, {}});
      model_.shape_ends.emplace_back();
      if (!geometry_ || std::ranges::count(skipped_, *name) > 0) continue;
      const bool is_visual = geometry_ == RobotGeometry::visual;
      const char* const desired = is_visual ? "visual" : "collision";
      const char* const else_taken = is_visual ? "collision" : "visual";
      const bool has_desired = link->FirstChildElement(desired) != nullptr;
      const Status status = shapes_.add_shapes(*link, has_desired ? desired : else_taken,
                                               model_.links.back().mesh, model_.shape_ends.back());
      if (status) continue;
      if (!shapes_.lacks_mesh()) return status;
      if (link->FirstChildElement("collision") != nullptr) {
        return Error{status.error().code, status.error().message + "; or leave that link out (" +
                                              "--robot-skip " + shown(*name) + ")"};
      }
      model_.links.back().mesh = {};
      model_.shape_ends.back().clear();
      model_.notes.push_back(
          "link '" + shown(*name) +
          "' of the robot is left out, and stays in the images: " + status.error().message);
    }
    if (model_.links.empty()) return Error{Errc::bad_input, name_ + ": has no <link>"};
    return Done{};
  }

  Status read_joints(const Element& robot) {
    for (const Element* joint = robot.FirstChildElement("joint"); joint != nullptr;
         joint = joint->NextSiblingElement("joint")) {
      if (const Status status = read_joint(*joint); !status) return status;
    }
    return Done{};
  }

  Status read_joint(const Element& element) {
    using Kind = RobotJoint::Kind;
    RobotJoint joint;
    const auto name = name_of(element);
    if (!name) return name.error();
    joint.name = *name;
    if (!joints_.emplace(*name, model_.joints.size()).second) {
      return bad(element, "two joints are called '" + shown(*name) + "'");
    }
    static const std::map<std::string, Kind, std::less<>> kKinds{
        {"fixed", Kind::fixed},       {"revolute", Kind::turning},  {"continuous", Kind::turning},
        {"prismatic", Kind::sliding}, {"floating", Kind::floating}, {"planar", Kind::floating}};
    const auto type = name_of(element, "type");
    if (!type) return type.error();
    const auto kind = kKinds.find(*type);
    if (kind == kKinds.end()) {
      return bad(element, "joint '" + shown(*name) + "': there is no type '" + shown(*type) +
                              "'; there are fixed, revolute, continuous, prismatic, floating and "
                              "planar");
    }
    if (model_.joints.size() == kMaxLinks) return bad(element, "more joints than any robot has");
    joint.kind = kind->second;
    joint.is_endless = *type == "continuous";
    for (const auto& [role, link] :
         {std::pair{"parent", &joint.parent}, std::pair{"child", &joint.child}}) {
      const Element* const end = element.FirstChildElement(role);
      const char* const given = end == nullptr ? nullptr : end->Attribute("link");
      const auto found = given == nullptr ? links_.end() : links_.find(given);
      if (found == links_.end()) {
        return bad(element, "joint '" + shown(*name) + "' needs <" + role +
                                " link=\"...\"/> with a link that there is" +
                                (given == nullptr ? "" : ", not '" + shown(given) + "'"));
      }
      *link = found->second;
    }
    const auto origin = origin_of(element);
    if (!origin) return origin.error();
    joint.X_PJ = *origin;
    if (const Element* const axis = element.FirstChildElement("axis")) {
      const auto xyz = numbers<3>(*axis, "xyz", std::array<double, 3>{1, 0, 0});
      if (!xyz) return xyz.error();
      joint.axis = normalized(Vec3d{(*xyz)[0], (*xyz)[1], (*xyz)[2]});
    }
    const bool needs_axis = joint.kind == Kind::turning || joint.kind == Kind::sliding;
    if (needs_axis && !(norm(joint.axis) > 0.5)) {
      return bad(element, "joint '" + shown(*name) + "' has an axis without a direction");
    }
    if (needs_axis && !joint.is_endless) read_limits(element, joint);
    joint.source = model_.joints.size();
    mimics_.push_back(element.FirstChildElement("mimic"));
    model_.joints.push_back(std::move(joint));
    return Done{};
  }

  /// Reads <limit lower upper>, 0 each by default; without one there are no limits.
  static void read_limits(const Element& element, RobotJoint& joint) {
    const Element* const limit = element.FirstChildElement("limit");
    if (limit == nullptr) return;
    const auto number = [&](const char* attribute) {
      const char* const given = limit->Attribute(attribute);
      if (given == nullptr) return 0.0;
      std::string_view rest = given;
      const auto parsed = parse_number<double>(take_word(rest));
      return parsed && take_word(rest).empty() ? *parsed : std::numeric_limits<double>::quiet_NaN();
    };
    joint.lower = number("lower");
    joint.upper = number("upper");
  }

  /// Resolves chains of mimic joints: each follows the last joint of its chain.
  Status resolve_mimics() {
    struct Mimic {
      std::size_t followed = 0;
      double factor = 1, offset = 0;
    };
    std::vector<Mimic> mimics(model_.joints.size());
    for (std::size_t i = 0; i < model_.joints.size(); ++i) {
      if (mimics_[i] == nullptr) continue;
      const Element& mimic = *mimics_[i];
      const auto name = name_of(mimic, "joint");
      if (!name) return name.error();
      const auto factor = numbers<1>(mimic, "multiplier", std::array<double, 1>{1}),
                 offset = numbers<1>(mimic, "offset", std::array<double, 1>{0});
      if (!factor) return factor.error();
      if (!offset) return offset.error();
      const auto followed = joints_.find(*name);
      if (followed == joints_.end()) {
        return bad(mimic, "joint '" + shown(model_.joints[i].name) + "' follows '" + shown(*name) +
                              "', which is not there");
      }
      mimics[i] = {followed->second, factor->front(), offset->front()};
    }
    for (RobotJoint& joint : model_.joints) {
      for (std::size_t steps = 0; mimics_[joint.source] != nullptr; ++steps) {
        const Mimic& mimic = mimics[joint.source];
        if (steps > model_.joints.size()) {
          return bad(*mimics_[joint.source],
                     "joint '" + shown(joint.name) + "' follows one that follows it");
        }
        joint.offset += joint.factor * mimic.offset;
        joint.factor *= mimic.factor;
        joint.source = mimic.followed;
      }
    }
    return Done{};
  }

  /// Parents before children. Error: not a tree.
  Status put_in_order() {
    std::vector<int> num_parents(model_.links.size());
    std::vector<std::vector<std::size_t>> below(model_.links.size());
    for (std::size_t i = 0; i < model_.joints.size(); ++i) {
      const RobotJoint& joint = model_.joints[i];
      below[joint.parent].push_back(i);
      if (++num_parents[joint.child] > 1) {
        return Error{Errc::bad_input, name_ + ": link '" + shown(model_.links[joint.child].name) +
                                          "' is the child of two joints"};
      }
    }
    if (std::ranges::count(num_parents, 0) != 1) {
      return Error{Errc::bad_input,
                   name_ + ": has " + std::to_string(std::ranges::count(num_parents, 0)) +
                       " links that are the child of no joint; a robot has one, its base"};
    }
    model_.root = static_cast<std::size_t>(std::ranges::find(num_parents, 0) - num_parents.begin());
    std::vector<std::size_t> links{model_.root}, order;
    for (std::size_t i = 0; i < links.size(); ++i) {
      for (const std::size_t joint : below[links[i]]) {
        order.push_back(joint);
        links.push_back(model_.joints[joint].child);
      }
    }
    if (order.size() != model_.joints.size()) {
      return Error{Errc::bad_input, name_ + ": has joints that lead round in a circle"};
    }
    std::vector<std::size_t> place(order.size());
    std::vector<RobotJoint> joints;
    for (std::size_t i = 0; i < order.size(); ++i) {
      place[order[i]] = i;
      joints.push_back(std::move(model_.joints[order[i]]));
    }
    for (RobotJoint& joint : joints) joint.source = place[joint.source];
    model_.joints = std::move(joints);
    return Done{};
  }

  const std::optional<RobotGeometry> geometry_;
  const std::vector<std::string>& skipped_;
  UrdfShapes shapes_;
  RobotModel model_;
  std::map<std::string, std::size_t, std::less<>> links_, joints_;
  std::vector<const Element*> mimics_;  // of each joint; null: it has a position of its own
};

}  // namespace

Result<RobotModel> parse_urdf(std::string_view text, const std::string& name,
                              const RobotFolders& folders, std::optional<RobotGeometry> geometry,
                              const std::vector<std::string>& skipped) {
  return Reader(name, folders, geometry, skipped).read(text);
}

}}  // namespace palpate::v0
