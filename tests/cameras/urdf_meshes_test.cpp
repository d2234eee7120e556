// Meshes of a URDF by the names that files of other programs give them.
#include <gtest/gtest.h>

#include <string>

#include "palpate/io/formats.h"
#include "src/cameras/internal/robot_model.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::TemporaryFolder;

Result<RobotModel> parsed(const std::string& text, const RobotFolders& folders,
                          RobotGeometry geometry = RobotGeometry::collision) {
  return parse_urdf(text, "robot.urdf", folders, geometry);
}

TEST(Urdf, FindsShapesAndMeshes) {
  const TemporaryFolder folder;
  const auto mesh_folder = folder / "ws" / "my_arm" / "meshes";
  std::filesystem::create_directories(mesh_folder);
  ASSERT_TRUE(save_mesh(make_box({0.2, 0.4, 0.6}), mesh_folder / "link.stl"));
  ASSERT_TRUE(save_mesh(make_box({1, 1, 1}), folder / "beside.obj"));
  const std::string text =
      "<robot><link name='l'>"
      "<visual><geometry><mesh filename='beside.obj'/></geometry></visual>"
      "<collision><origin xyz='1 0 0' rpy='0 0 1.5707963267948966'/><geometry>"
      "<mesh filename='package://my_arm/meshes/link.stl' scale='0.5 0.5 "
      "-2'/></geometry></collision>"
      "<collision><origin xyz='0 0 9'/><geometry><sphere radius='1'/></geometry></collision>"
      "</link></robot>";
  const RobotFolders folders{folder.path(), {folder / "elsewhere", folder / "ws"}};
  const auto robot = parsed(text, folders);
  ASSERT_TRUE(robot) << robot.error().message;
  const Bounds box = bounds(robot->links[0].mesh);
  EXPECT_NEAR(box.low.z, -0.6, 1e-6);  // 0.6 twice as high
  EXPECT_NEAR(box.high.z, 10, 0.02);   // a ball around the true one
  EXPECT_GE(box.high.z, 10);
  const auto seen = parsed(text, folders, RobotGeometry::visual);
  ASSERT_TRUE(seen) << seen.error().message;
  EXPECT_EQ(bounds(seen->links[0].mesh).high, (Vec3d{0.5, 0.5, 0.5}));
  // The folder of the package itself will do.
  EXPECT_TRUE(parsed(text, {folder.path(), {folder / "ws" / "my_arm"}}));
  const auto none = parsed(text, {folder.path(), {folder / "elsewhere"}});
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("elsewhere"), std::string::npos) << none.error().message;
  EXPECT_NE(none.error().message.find("package://my_arm"), std::string::npos);
}

/// A robot of one link, whose mesh has this name.
std::string robot_of(const std::string& name) {
  return "<robot><link name='l'><collision><geometry><mesh filename='" + name +
         "'/></geometry></collision></link></robot>";
}

TEST(Urdf, FindsMeshesByPackagesModelsAndUris) {
  const TemporaryFolder folder;
  const auto meshes = folder / "ws" / "my_arm" / "my meshes";
  std::filesystem::create_directories(meshes);
  ASSERT_TRUE(save_mesh(make_box({0.2, 0.4, 0.6}), meshes / "link.stl"));
  ASSERT_TRUE(save_mesh(make_box({0.2, 0.4, 0.6}), meshes / "50%20.stl"));
  const RobotFolders folders{folder.path(), {folder / "ws"}};
  const std::string root = folder.path().string();
  for (const std::string& name : {std::string("package://my_arm/my meshes/link.stl"),
                                  std::string("package://my_arm/my%20meshes/link.stl"),
                                  std::string("package://my_arm/my meshes/50%20.stl"),
                                  std::string("model://my_arm/my meshes/link.stl"),
                                  "file:" + root + "/ws/my_arm/my%20meshes/link.stl",
                                  "file://" + root + "/ws/my_arm/my%20meshes/link.stl",
                                  std::string("file:ws/my_arm/my meshes/link.stl"),
                                  std::string("ws/my_arm/my%20meshes/link.stl")}) {
    const auto robot = parsed(robot_of(name), folders);
    ASSERT_TRUE(robot) << name << ": " << robot.error().message;
    EXPECT_NEAR(bounds(robot->links[0].mesh).high.z, 0.3, 1e-6) << name;
  }
  const auto refused = [&](const std::string& name) {
    const auto robot = parsed(robot_of(name), folders);
    return robot ? std::string() : robot.error().message;
  };
  const std::string none = refused("model://other/link.stl");
  EXPECT_NE(none.find("there is no model://other/link.stl"), std::string::npos) << none;
  EXPECT_NE(none.find("the folder that contains other/"), std::string::npos) << none;
  const std::string xacro = refused("$(find my_arm)/meshes/link.stl");
  EXPECT_NE(xacro.find("$(find my_arm)/meshes/link.stl is named as in xacro"), std::string::npos)
      << xacro;
}

}  // namespace
}  // namespace palpate
