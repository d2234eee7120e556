#include "src/cameras/robot/urdf_shapes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string_view>
#include <system_error>
#include <utility>

#include "palpate/io/formats.h"
#include "src/io/internal/file_names.h"

namespace palpate { inline namespace v0 {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxTriangles = 2'000'000;  // more than any robot has
constexpr int kSegments = 32;                     // of a cylinder

}  // namespace

Status UrdfShapes::add_shapes(const Element& link, const char* kind, TriangleMesh& mesh,
                              std::vector<RobotModel::ShapeEnd>& ends) {
  lacks_mesh_ = false;
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
    ends.push_back({mesh.vertices.size(), mesh.triangles.size()});
  }
  return Done{};
}

Result<TriangleMesh> UrdfShapes::shape_of(const Element& shape) {
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

Result<TriangleMesh> UrdfShapes::mesh_of(const Element& shape) {
  const auto filename = name_of(shape, "filename");
  if (!filename) return filename.error();
  const auto scale = numbers<3>(shape, "scale", std::array<double, 3>{1, 1, 1});
  if (!scale) return scale.error();
  if (std::ranges::find(*scale, 0) != scale->end()) {
    return bad(shape, "<mesh> has a scale of zero: nothing would be left of it; write 1 1 1");
  }
  lacks_mesh_ = true;
  auto path = find(*filename);
  if (const std::string plain = unescaped(*filename); !path && plain != *filename) {
    if (auto other = find(plain)) path = std::move(other);
  }
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

Result<fs::path> UrdfShapes::find(const std::string& filename) const {
  const std::string_view name = filename;
  if (name.starts_with("$(")) {
    return Error{Errc::bad_input, "the mesh " + shown(filename) +
                                      " is named as in xacro; turn the robot into URDF first "
                                      "(xacro FILE > robot.urdf)"};
  }
  std::error_code ignored;
  if (name.starts_with("package://") || name.starts_with("model://")) {
    const fs::path inside(name.substr(name.find("//") + 2));
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
                                      "; give the folder that contains " +
                                      shown(inside.begin()->string()) + "/ (--robot-packages DIR)"};
  }
  const auto without = [](std::string_view start, std::string_view text) {
    return text.starts_with(start) ? text.substr(start.size()) : text;
  };
  const bool is_uri = name.starts_with("file:");
  const fs::path plain(is_uri ? without("//", without("file:", name)) : name);
  const fs::path path = plain.is_absolute() ? plain : folders_.beside / plain;
  if (fs::is_regular_file(path, ignored)) return path;
  return Error{Errc::not_found, "there is no mesh " + shown(path.string())};
}

}}  // namespace palpate::v0
