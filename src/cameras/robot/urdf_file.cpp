// Robots as the Unified Robot Description Format has them.
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include <tinyxml2.h>

#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"
#include "src/cameras/files_once.h"
#include "src/cameras/robot/robot_model.h"
#include "src/cameras/shown_name.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

namespace fs = std::filesystem;
using Element = tinyxml2::XMLElement;

constexpr std::size_t kLongestName = 4096;                          // as a path may be
constexpr std::size_t kMaxLinks = 2000, kMaxTriangles = 2'000'000;  // more than any robot has
constexpr int kSegments = 32;                                       // of a cylinder
constexpr double kLargest = 1e3;                                    // m, and times as large

/// Reads one document. What is wrong is kept until the end, so that readers can go straight on.
class Reader {
 public:
  Reader(const std::string& name, const RobotFolders& folders,
         std::optional<RobotGeometry> geometry, const std::vector<std::string>& skipped)
      : name_(name), folders_(folders), geometry_(geometry), skipped_(skipped) {}

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
  Error bad(const Element& where, const std::string& what) const {
    return {Errc::bad_input, name_ + " line " + std::to_string(where.GetLineNum()) + ": " + what};
  }

  Result<std::string> name_of(const Element& element, const char* attribute = "name") const {
    const char* const given = element.Attribute(attribute);
    if (given == nullptr || *given == '\0') {
      return bad(element, "<" + shown(element.Name()) + "> needs " + attribute + "=\"...\"");
    }
    std::string name(given);
    if (name.size() <= kLongestName) return name;
    return bad(element, "<" + shown(element.Name()) + "> has a longer " + attribute + " than " +
                            std::to_string(kLongestName) + " letters; give it a shorter one");
  }

  /// Numbers of an attribute; `preset` if there is none of that name.
  template <std::size_t num>
  Result<std::array<double, num>> numbers(const Element& element, const char* attribute,
                                          std::optional<std::array<double, num>> preset) const {
    const char* const given = element.Attribute(attribute);
    if (given == nullptr && preset) return *preset;
    std::array<double, num> values{};
    std::string_view rest = given == nullptr ? "" : given;
    bool is_good = true;
    for (double& value : values) {
      const auto number = parse_number<double>(take_word(rest));
      is_good = is_good && number && std::abs(*number) <= kLargest;
      value = number.value_or(0);
    }
    if (is_good && take_word(rest).empty()) return values;
    return bad(element, "<" + shown(element.Name()) + "> needs " + attribute + " as " +
                            std::to_string(num) + " number" + (num > 1 ? "s" : "") +
                            " of at most 1000");
  }

  /// <origin xyz rpy>, or in newer files <origin xyz quat_xyzw>, of a link's geometry or of a
  /// joint.
  Result<Pose> origin_of(const Element& element) const {
    constexpr std::array<double, 3> kZero{};
    const Element* const origin = element.FirstChildElement("origin");
    if (origin == nullptr) return Pose{};
    const auto xyz = numbers<3>(*origin, "xyz", kZero), rpy = numbers<3>(*origin, "rpy", kZero);
    if (!xyz) return xyz.error();
    if (!rpy) return rpy.error();
    const Vec3d p{(*xyz)[0], (*xyz)[1], (*xyz)[2]};
    if (origin->Attribute("quat_xyzw") != nullptr) {
      const auto q = numbers<4>(*origin, "quat_xyzw", std::nullopt);
      if (!q) return q.error();
      const double length = std::hypot(std::hypot((*q)[0], (*q)[1]), std::hypot((*q)[2], (*q)[3]));
      if (std::abs(length - 1) > 0.01 || origin->Attribute("rpy") != nullptr) {
        return bad(*origin, "<origin> needs either rpy or quat_xyzw with a quaternion 1 long");
      }
      return Pose{p, normalized(Quaternion{(*q)[0], (*q)[1], (*q)[2], (*q)[3]})};
    }
    const Quaternion turned = axis_angle({0, 0, 1}, (*rpy)[2]) * axis_angle({0, 1, 0}, (*rpy)[1]) *
                              axis_angle({1, 0, 0}, (*rpy)[0]);
    return Pose{p, normalized(turned)};
  }

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
      if (!geometry_ || std::ranges::count(skipped_, *name) > 0) continue;
      const bool is_visual = geometry_ == RobotGeometry::visual;
      const char* const desired = is_visual ? "visual" : "collision";
      const char* const else_taken = is_visual ? "collision" : "visual";
      const bool has_desired = link->FirstChildElement(desired) != nullptr;
      lacks_mesh_ = false;
      const Status status = read_geometry(*link, has_desired ? desired : else_taken);
      if (status) continue;
      if (!lacks_mesh_) return status;
      if (link->FirstChildElement("collision") != nullptr) {
        return Error{status.error().code, status.error().message + "; or leave that link out (" +
                                              "--robot-skip " + shown(*name) + ")"};
      }
      model_.links.back().mesh = {};
      model_.notes.push_back(
          "link '" + shown(*name) +
          "' of the robot is left out, and stays in the images: " + status.error().message);
    }
    if (model_.links.empty()) return Error{Errc::bad_input, name_ + ": has no <link>"};
    return Done{};
  }

  Status read_geometry(const Element& link, const char* kind) {
    TriangleMesh& mesh = model_.links.back().mesh;
    for (const Element* part = link.FirstChildElement(kind); part != nullptr;
         part = part->NextSiblingElement(kind)) {
      const auto X_LG = origin_of(*part);
      if (!X_LG) return X_LG.error();
      const Element* const geometry = part->FirstChildElement("geometry");
      const Element* const shape = geometry == nullptr ? nullptr : geometry->FirstChildElement();
      if (shape == nullptr) return bad(*part, "needs a <geometry> with a shape in it");
      const auto added = shape_of(*shape);
      if (!added) return added.error();
      num_triangles_ += std::max(added->triangles.size(), added->vertices.size() / 3);
      if (num_triangles_ > kMaxTriangles) {
        return bad(*shape, "the robot has more than 2 million triangles; take coarser meshes");
      }
      const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
      for (const Vec3d& p_G : added->vertices) mesh.vertices.push_back(*X_LG * p_G);
      for (const auto& ids : added->triangles) {
        mesh.triangles.push_back({first + ids[0], first + ids[1], first + ids[2]});
      }
    }
    return Done{};
  }

  /// Returns the mesh of a shape. Round ones are drawn around the true shape, not into it.
  Result<TriangleMesh> shape_of(const Element& shape) {
    const std::string_view kind = shape.Name();
    const auto positive = [&](double value) { return value > 0; };
    const auto no_size = [&] { return bad(shape, "<" + shown(kind) + "> needs sizes above zero"); };
    if (kind == "mesh") return mesh_of(shape);
    if (kind == "box") {
      const auto size = numbers<3>(shape, "size", {});
      if (!size) return size.error();
      if (!std::ranges::all_of(*size, positive)) return no_size();
      return make_box({(*size)[0], (*size)[1], (*size)[2]});
    }
    const double out = 1 / std::cos(std::acos(-1.0) / kSegments);
    if (kind == "sphere") {
      const auto radius = numbers<1>(shape, "radius", {});
      if (!radius) return radius.error();
      if (!positive(radius->front())) return no_size();
      return make_icosphere(1.01 * radius->front(), 3);
    }
    if (kind == "cylinder") {
      const auto radius = numbers<1>(shape, "radius", {}), length = numbers<1>(shape, "length", {});
      if (!radius) return radius.error();
      if (!length) return length.error();
      if (!positive(radius->front()) || !positive(length->front())) return no_size();
      return make_cylinder(out * radius->front(), length->front(), kSegments);
    }
    return bad(shape, "there is no shape '" + shown(kind) +
                          "' in URDF; there are box, cylinder, "
                          "sphere and mesh");
  }

  Result<TriangleMesh> mesh_of(const Element& shape) {
    const auto filename = name_of(shape, "filename");
    if (!filename) return filename.error();
    const auto scale = numbers<3>(shape, "scale", std::array<double, 3>{1, 1, 1});
    if (!scale) return scale.error();
    if (std::ranges::find(*scale, 0) != scale->end()) {
      return bad(shape, "<mesh> has a scale of zero: nothing would be left of it; write 1 1 1");
    }
    lacks_mesh_ = true;
    const auto path = find(*filename);
    if (!path) return bad(shape, path.error().message);
    const auto unscaled = meshes_.get(*path, [](const fs::path& file) { return load_mesh(file); });
    if (!unscaled) return bad(shape, unscaled.error().message);
    lacks_mesh_ = false;
    TriangleMesh mesh = **unscaled;
    for (Vec3d& p : mesh.vertices) {
      p = {p.x * (*scale)[0], p.y * (*scale)[1], p.z * (*scale)[2]};
      if (!std::isfinite(p.x + p.y + p.z)) return bad(shape, "has a vertex that is not a number");
    }
    return mesh;
  }

  /// Finds a file by "package://NAME/...", "file:///..." or a plain path.
  Result<fs::path> find(const std::string& filename) const {
    constexpr std::string_view kPackage = "package://", kFile = "file://";
    std::error_code ignored;
    if (filename.starts_with(kPackage)) {
      const fs::path inside(filename.substr(kPackage.size()));
      std::string tried;
      for (const fs::path& folder : folders_.packages) {
        // A folder of packages, or that of the package itself.
        const fs::path package = *inside.begin();
        const bool is_itself =
            folder.filename() == package || folder.parent_path().filename() == package;
        const fs::path candidates[] = {
            folder / inside, is_itself ? folder / inside.lexically_relative(package) : fs::path()};
        for (const fs::path& path : candidates) {
          if (!path.empty() && fs::is_regular_file(path, ignored)) return path;
        }
        tried += (tried.empty() ? " in " : ", ") + folder.string();
      }
      return Error{Errc::not_found, "there is no " + shown(filename) + tried +
                                        "; say in which folder its package lies "
                                        "(--robot-packages DIR)"};
    }
    const fs::path plain(filename.starts_with(kFile) ? filename.substr(kFile.size()) : filename);
    const fs::path path = plain.is_absolute() ? plain : folders_.beside / plain;
    if (fs::is_regular_file(path, ignored)) return path;
    return Error{Errc::not_found, "there is no mesh " + shown(path.string())};
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
    joint.source = model_.joints.size();
    mimics_.push_back(element.FirstChildElement("mimic"));
    model_.joints.push_back(std::move(joint));
    return Done{};
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

  const std::string& name_;
  const RobotFolders& folders_;
  const std::optional<RobotGeometry> geometry_;
  const std::vector<std::string>& skipped_;
  bool lacks_mesh_ = false;  // the link that is read: a file of its mesh cannot be read
  RobotModel model_;
  std::map<std::string, std::size_t, std::less<>> links_, joints_;
  FilesOnce<TriangleMesh> meshes_;
  std::size_t num_triangles_ = 0;
  std::vector<const Element*> mimics_;  // of each joint; null: it has a position of its own
};

}  // namespace

Result<RobotModel> parse_urdf(std::string_view text, const std::string& name,
                              const RobotFolders& folders, std::optional<RobotGeometry> geometry,
                              const std::vector<std::string>& skipped) {
  return Reader(name, folders, geometry, skipped).read(text);
}

}}  // namespace palpate::v0
