// Shapes of the links of a URDF file as triangle meshes: boxes, spheres, cylinders, and meshes in
// files of their own, which are found in the folders of the robot.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "palpate/mesh/mesh.h"
#include "src/cameras/files_once.h"
#include "src/cameras/internal/robot_model.h"
#include "src/cameras/robot/urdf_attributes.h"

namespace palpate { inline namespace v0 {

class UrdfShapes : UrdfAttributes {
 public:
  /// Both must outlive it.
  UrdfShapes(const std::string& name, const RobotFolders& folders)
      : UrdfAttributes(name), folders_(folders) {}

  /// Adds the shapes of a link to its mesh, in the frame of the link. `kind`: "visual" or
  /// "collision".
  Status add_shapes(const Element& link, const char* kind, TriangleMesh& mesh,
                    std::vector<RobotModel::ShapeEnd>& ends);
  /// True if the last link failed because a file of its mesh cannot be read.
  bool lacks_mesh() const { return lacks_mesh_; }

 private:
  /// Returns the mesh of a shape. Round ones are drawn around the true shape, not into it.
  Result<TriangleMesh> shape_of(const Element& shape);
  Result<TriangleMesh> mesh_of(const Element& shape);
  /// Finds a file by "package://NAME/...", "model://NAME/...", "file:///..." or a plain path.
  Result<std::filesystem::path> find(const std::string& filename) const;

  const RobotFolders& folders_;
  bool lacks_mesh_ = false;
  FilesOnce<TriangleMesh> meshes_;
  std::size_t num_triangles_ = 0;  // of all links
};

}}  // namespace palpate::v0
