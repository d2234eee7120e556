// Robots out of URDF: links become spheres, joints what moves them.
#include "palpate/robot/robot.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "src/core/internal/message_text.h"
#include "src/io/internal/atomic_file.h"
#include "src/packing/internal/sphere_cover.h"
#include "src/robot/robot_data.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kMaxUrdf = 64u << 20;  // bytes
constexpr double kMissed = 1.01;  // standoffs: links are checked at other points than their shapes

/// Returns the spheres of all shapes of a link. Error: a shape is no solid, or has no room for one.
Result<Tool> tool_of(const RobotModel& model, std::size_t link, const RobotPacking& packing) {
  const RobotLink& whole = model.links[link];
  TriangleMesh all;
  SpherePacking spheres;
  spheres.stop = PackStop::standoff;
  RobotModel::ShapeEnd from;
  for (const RobotModel::ShapeEnd& to : model.shape_ends[link]) {
    TriangleMesh shape;
    const auto at = [](std::size_t i) { return static_cast<std::ptrdiff_t>(i); };
    shape.vertices.assign(whole.mesh.vertices.begin() + at(from.vertices),
                          whole.mesh.vertices.begin() + at(to.vertices));
    for (std::size_t i = from.triangles; i < to.triangles; ++i) {
      auto triangle = whole.mesh.triangles[i];
      for (std::uint32_t& id : triangle) id -= static_cast<std::uint32_t>(from.vertices);
      shape.triangles.push_back(triangle);
    }
    from = to;
    auto solid = check_solid(shape);
    if (!solid) return solid.error();
    const auto cover = cover_solid(solid->mesh, packing.standoff, packing.max_spheres);
    if (!cover) return cover.error();
    const auto first = static_cast<std::uint32_t>(all.vertices.size());
    const TriangleMesh& mesh = solid->mesh;
    all.vertices.insert(all.vertices.end(), mesh.vertices.begin(), mesh.vertices.end());
    for (const auto& ids : mesh.triangles) {
      all.triangles.push_back({first + ids[0], first + ids[1], first + ids[2]});
    }
    spheres.spheres.insert(spheres.spheres.end(), cover->spheres.begin(), cover->spheres.end());
    spheres.mesh_volume += cover->mesh_volume;
    if (cover->stop != PackStop::standoff) spheres.stop = cover->stop;
  }
  return Tool::build(std::move(all), std::move(spheres), {.source = whole.name});
}

/// Largest distance of a sphere's points from the frame of its tool, m.
double radius_of(const Tool& tool) {
  double radius = 0;
  for (const Sphere& s : tool.spheres()) {
    radius = std::max(radius, norm(to_double(s.center)) + static_cast<double>(s.radius));
  }
  return radius;
}

/// Positions of a joint's own that keep it and all that follow it within their limits.
Status limit(const RobotModel& model, std::size_t source, Robot::Joint& joint,
             const std::string& name) {
  for (const RobotJoint& each : model.joints) {
    if (each.source != source || each.kind == RobotJoint::Kind::fixed) continue;
    if (std::isnan(each.lower) || std::isnan(each.upper)) {
      return Error{Errc::bad_input, name + ": joint '" + shown(each.name) +
                                        "' has limits that are no numbers; write them in rad or m"};
    }
    if (each.factor == 0) continue;
    double low = (each.lower - each.offset) / each.factor,
           high = (each.upper - each.offset) / each.factor;
    if (each.factor < 0) std::swap(low, high);
    joint.lower = std::max(joint.lower, low);
    joint.upper = std::min(joint.upper, high);
  }
  const bool has_any = joint.lower < kMaxJointPosition && joint.upper > -kMaxJointPosition;
  if (has_any && joint.lower <= joint.upper) return Done{};
  return Error{Errc::bad_input, name + ": joint '" + shown(joint.name) +
                                    "' has no position within its limits; correct <limit>, or the "
                                    "<mimic> of those that follow it"};
}

}  // namespace

Result<Robot> Robot::Data::complete(Data data, const std::string& name) {
  using Kind = RobotJoint::Kind;
  const RobotModel& model = data.model;
  constexpr double kNone = std::numeric_limits<double>::infinity();
  std::vector<std::size_t>& number = data.number;
  number.assign(model.joints.size(), kNotMoved);
  for (std::size_t i = 0; i < model.joints.size(); ++i) {
    const RobotJoint& joint = model.joints[i];
    if (joint.kind == Kind::floating) {
      return Error{Errc::bad_input,
                   name + ": joint '" + shown(joint.name) +
                       "' is floating or planar: no number says where it is; make it fixed, and "
                       "give the pose of the robot's base"};
    }
    if (joint.source != i || joint.kind == Kind::fixed) continue;
    number[i] = data.joints.size();
    data.joints.push_back({joint.name, joint.kind == Kind::turning, -kNone, kNone});
    data.moved.push_back(i);
    const Status status = limit(model, i, data.joints.back(), name);
    if (!status) return status.error();
  }
  if (data.joints.empty()) {
    return Error{Errc::bad_input,
                 name + ": no joint moves; pack what it holds as a tool (palpate pack MESH)"};
  }
  std::vector<std::size_t> above(model.links.size(), model.joints.size());  // joint of each link
  for (std::size_t i = 0; i < model.joints.size(); ++i) above[model.joints[i].child] = i;
  for (std::size_t link = 0; link < model.links.size(); ++link) {
    if (data.tools[link] == nullptr) continue;
    RobotLimb limb{link, {}, radius_of(*data.tools[link])};
    double reach = limb.radius;  // from the frame of the link that the joint moves
    for (std::size_t at = link; above[at] != model.joints.size();) {
      const RobotJoint& joint = model.joints[above[at]];
      const RobotJoint& source = model.joints[joint.source];
      if (joint.kind != Kind::fixed && source.kind != Kind::fixed) {
        limb.movers.push_back(
            {above[at], number[joint.source], joint.kind == Kind::turning ? reach : 1});
      }
      if (joint.kind == Kind::sliding) {
        const bool stands = joint.factor == 0 || source.kind == Kind::fixed;
        const Joint moved = stands ? Joint{} : data.joints[number[joint.source]];
        reach += std::max(std::abs(joint.factor * moved.lower + joint.offset),
                          std::abs(joint.factor * moved.upper + joint.offset));
      }
      reach += norm(joint.X_PJ.translation);
      at = joint.parent;
    }
    data.limbs.push_back(std::move(limb));
    data.limb_links.push_back(link);
    data.names.push_back(model.links[link].name);
  }
  if (data.limbs.empty()) {
    return Error{Errc::bad_input, name + ": no link has a shape that can be filled with spheres" +
                                      (model.notes.empty() ? "" : "; " + model.notes.front())};
  }
  JointTree tree;
  std::vector<std::int32_t> frames(model.links.size());
  for (std::size_t i = 0; i < model.joints.size(); ++i) {
    const RobotJoint& joint = model.joints[i];
    const bool moves = joint.kind != Kind::fixed && model.joints[joint.source].kind != Kind::fixed;
    tree.joints.push_back({joint.kind, frames[joint.parent],
                           moves ? static_cast<std::int32_t>(number[joint.source]) : -1,
                           joint.factor, joint.offset, joint.X_PJ, joint.axis});
    frames[joint.child] = static_cast<std::int32_t>(i + 1);
  }
  for (const Joint& joint : data.joints) tree.ranges.push_back({joint.lower, joint.upper});
  for (const RobotLimb& limb : data.limbs) tree.frame_of_tool.push_back(frames[limb.link]);
  data.tree = std::make_shared<const JointTree>(std::move(tree));
  return Robot(std::make_shared<const Data>(std::move(data)));
}

Result<Robot> Robot::from_urdf(std::string_view text, const std::string& name,
                               const RobotPacking& packing) {
  if (!(packing.standoff >= 1e-4 && packing.standoff <= 1) || packing.max_spheres < 1) {
    return Error{
        Errc::invalid_argument,
        "a robot's standoff is from 0.0001 to 1 m, and each shape has at least one sphere"};
  }
  const RobotFolders folders{std::filesystem::path(name).parent_path(),
                             RobotFolders::packages_of(packing.packages)};
  auto model = parse_urdf(text, name, folders, packing.geometry, packing.skip);
  if (!model) return model.error();
  Data data;
  data.model = *std::move(model);
  data.tools.resize(data.model.links.size());
  data.standoffs.resize(data.model.links.size());
  for (std::size_t i = 0; i < data.model.links.size(); ++i) {
    RobotLink& link = data.model.links[i];
    if (link.mesh.triangles.empty()) continue;
    auto tool = tool_of(data.model, i, packing);
    link.mesh = {};
    if (tool) {
      data.tools[i] = std::make_shared<const Tool>(*std::move(tool));
      data.standoffs[i] = farthest_standoff(data.tools[i]->mesh(), data.tools[i]->spheres());
      if (data.standoffs[i] > kMissed * packing.standoff) {
        data.model.notes.push_back(
            "link '" + shown(link.name) + "' has surface " +
            number_text(1e3 * data.standoffs[i], 3) + " mm from the nearest sphere, not within " +
            number_text(1e3 * packing.standoff, 3) + " mm: it is too thin, or needs more than " +
            std::to_string(packing.max_spheres) + " spheres in a shape; margins have to cover it");
      }
    } else {
      data.model.notes.push_back("link '" + shown(link.name) +
                                 "' is left out: " + tool.error().message);
    }
  }
  data.model.shape_ends.clear();
  return Data::complete(std::move(data), name);
}

bool Robot::is_urdf(const std::filesystem::path& path) {
  const std::filesystem::path ending = path.extension();
  return ending == ".urdf" || ending == ".xml" || ending == ".xacro";
}

Result<Robot> Robot::open(const std::filesystem::path& path, const RobotPacking& packing) {
  if (is_urdf(path)) {
    const auto text = read_file(path, kMaxUrdf);
    if (!text) return text.error();
    return from_urdf(*text, path.string(), packing);
  }
  const auto bytes = read_file(path);
  if (!bytes) return bytes.error();
  auto robot = from_bytes(*bytes);
  if (!robot) return Error{robot.error().code, path.string() + " " + robot.error().message};
  return robot;
}

Status Robot::save(const std::filesystem::path& path) const {
  const auto bytes = to_bytes();
  if (!bytes) return bytes.error();
  return write_file_atomically(path, *bytes);
}

Result<Robot> Robot::with_tool(const Tool& tool, const std::string& tool_name,
                               const std::string& link, const Pose& X_LT) const {
  const auto parent = data_->model.find_link(link);
  if (!parent) return parent.error();
  if (!is_finite(X_LT)) {
    return Error{Errc::invalid_argument, "the pose of a held tool in link '" + shown(link) +
                                             "' is not finite; give it in m"};
  }
  if (tool_name.empty() || data_->model.find_link(tool_name)) {
    return Error{Errc::invalid_argument,
                 "a held tool needs a name that no link has, not '" + shown(tool_name) + "'"};
  }
  Data data;
  data.model = data_->model;
  data.tools = data_->tools;
  data.standoffs = data_->standoffs;
  RobotJoint joint;
  joint.name = tool_name;
  joint.parent = *parent;
  joint.child = data.model.links.size();
  joint.X_PJ = {X_LT.translation, normalized(X_LT.rotation)};
  joint.source = data.model.joints.size();
  data.model.joints.push_back(std::move(joint));
  data.model.links.push_back({tool_name, {}});
  data.tools.push_back(std::make_shared<const Tool>(tool));
  data.standoffs.push_back(farthest_standoff(tool.mesh(), tool.spheres()));
  return Data::complete(std::move(data), data_->model.name);
}

const std::string& Robot::name() const { return data_->model.name; }
std::span<const Robot::Joint> Robot::joints() const { return data_->joints; }
std::span<const std::string> Robot::links() const { return data_->names; }
const std::vector<std::string>& Robot::notes() const { return data_->model.notes; }
double Robot::standoff() const { return std::ranges::max(data_->standoffs); }

const Tool& Robot::tool(std::size_t link) const { return *data_->tools[data_->limbs[link].link]; }

std::size_t Robot::num_spheres() const {
  std::size_t num = 0;
  for (std::size_t i = 0; i < links().size(); ++i) num += tool(i).spheres().size();
  return num;
}

std::vector<RobotLink> Robot::shapes() const {
  std::vector<RobotLink> shapes;
  for (std::size_t i = 0; i < links().size(); ++i) shapes.push_back({links()[i], tool(i).mesh()});
  return shapes;
}

}}  // namespace palpate::v0
