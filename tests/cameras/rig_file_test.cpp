// Where cameras are in the world: poses in URIs and files, and files of several cameras.
#include "palpate/cameras/cameras.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "palpate/io/files.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::TemporaryFolder;

void write(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path) << text;
}

TEST(CameraPoses, StandInEveryFrame) {
  auto camera = open_camera("scene:wall?noise=off&size=32x24&pose=1,2,-0.5,0,0,0,1").value();
  EXPECT_FALSE(camera->info().is_moving);
  DepthFrame frame;
  ASSERT_TRUE(camera->next(frame).value());
  EXPECT_EQ(frame.X_WC, (Pose{{1, 2, -0.5}, {}}));
  // The wall of the scene stays where it is in the world, half a metre farther from this camera.
  DepthFrame from_origin;
  ASSERT_TRUE(open_camera("scene:wall?noise=off&size=32x24").value()->next(from_origin).value());
  EXPECT_EQ(from_origin.X_WC, Pose{});
  EXPECT_EQ(frame.pixels[400], from_origin.pixels[400] + 5000);
}

TEST(CameraPoses, OfACameraThatMovesAreInterpolatedAtEachFrame) {
  const TemporaryFolder folder;
  const std::string file = (folder.path() / "way.tum").string();
  write(file, "0.05 0 0 0 0 0 0 1\n0.45 0 0 -0.4 0 0 0 1\n");
  const auto camera = open_camera("scene:wall?noise=off&size=32x24&rate=20&poses=" + file).value();
  EXPECT_TRUE(camera->info().is_moving);
  DepthFrame frame;
  int num = 0;
  std::uint16_t first = 0;
  while (*camera->next(frame)) {
    const double way = frame.timestamp - 0.05;
    EXPECT_NEAR(frame.X_WC.translation.z, -way, 1e-12);
    if (num++ == 0) first = frame.pixels[400];
    EXPECT_NEAR(frame.pixels[400] - first, 1e4 * way, 1);
  }
  EXPECT_EQ(num, 9);  // those from 0.05 to 0.45 s
  const auto notes = camera->take_notes();
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("frames were left out"), std::string::npos) << notes[0];
  EXPECT_TRUE(camera->take_notes().empty());
}

TEST(CameraPoses, AreRefusedWhenTheyAreWrong) {
  const auto why_not = [](const std::string& uri) {
    const auto camera = open_camera(uri);
    return camera ? std::string() : camera.error().message;
  };
  EXPECT_NE(why_not("scene:wall?poses=").find("a file of lines"), std::string::npos);
  EXPECT_NE(why_not("scene:wall?poses=/nowhere/a.tum").find("/nowhere/a.tum"), std::string::npos);
  const TemporaryFolder folder;
  const std::string file = (folder.path() / "way.tum").string();
  write(file, "0 0 0 0 0 0 0 1\n1 0 0 1 0 0 0 1\n");
  EXPECT_NE(why_not("scene:wall?pose=1,0,0,0,0,0,1&poses=" + file).find("not both"),
            std::string::npos);
}

class RigFile : public testing::Test {
 protected:
  std::string why_not(const std::string& text) {
    write(path_, text);
    const auto rig = load_rig(path_);
    return rig ? std::string() : rig.error().message;
  }

  TemporaryFolder folder_;
  std::filesystem::path path_ = folder_.path() / "rig.toml";
};

TEST_F(RigFile, NamesCamerasAndWhereTheyAre) {
  write(path_, R"([world]
frame = "table"
gravity = [0, 9.81, 0.5]

[[camera]]
name = "front"
uri = "folder:left?rate=15"
intrinsics = [525, 526.5, 319.5, 239.5]
distortion = [0.1, -0.2, 0, 0]
unit = 0.0002
pose = [1, 2, 3, 0, 0, 0.6, 0.8]

[[camera]]
name = "hand"
uri = "scene:wall"
pose_from = "hand.tum"

[[camera]]
uri = "bag:run.mcap"
pose_from = "tf:wrist"
)");
  const auto rig = load_rig(path_);
  ASSERT_TRUE(rig) << rig.error().message;
  EXPECT_EQ(rig->frame, "table");
  EXPECT_EQ(*rig->gravity, (Vec3d{0, 9.81, 0.5}));
  ASSERT_EQ(rig->cameras.size(), 3u);
  const CameraUri& front = rig->cameras[0].uri;
  EXPECT_EQ(rig->cameras[0].name, "front");
  EXPECT_EQ(front.kind, "folder");
  EXPECT_EQ(front.target, (folder_.path() / "left").string());  // beside the file
  EXPECT_EQ(*front.intrinsics, (Intrinsics{525, 526.5, 319.5, 239.5}));
  EXPECT_EQ(front.distortion->k2, -0.2);
  EXPECT_EQ(*front.unit, 0.0002);
  EXPECT_EQ(*front.rate, 15);
  EXPECT_EQ(front.X_WC, (Pose{{1, 2, 3}, {0, 0, 0.6, 0.8}}));
  EXPECT_EQ(rig->cameras[1].uri.poses, (folder_.path() / "hand.tum").string());
  EXPECT_EQ(rig->cameras[1].uri.target, "wall");
  EXPECT_EQ(rig->cameras[2].name, "camera 3");
  EXPECT_EQ(rig->cameras[2].uri.extras.at("world"), "table");
  EXPECT_EQ(rig->cameras[2].uri.extras.at("frame"), "wrist");

  const Pose moved{{4, 5, 6.25}, {0, 1, 0, 0}};
  const auto text = rig_text_with_poses(path_, {moved, {}, {}});
  ASSERT_TRUE(text);
  write(path_, *text);
  const auto again = load_rig(path_);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->cameras[0].uri.X_WC, moved);
  EXPECT_EQ(again->cameras[0].uri.intrinsics, front.intrinsics);
  EXPECT_EQ(again->gravity, rig->gravity);
}

TEST_F(RigFile, SaysWhatIsWrongAndWhere) {
  EXPECT_NE(why_not("").find("has 0 [[camera]]"), std::string::npos);
  EXPECT_NE(why_not("[[camera]]\nuri = ").find("line 2"), std::string::npos);
  EXPECT_NE(why_not("[[camera]]\nname = 'a'").find("needs uri"), std::string::npos);
  EXPECT_NE(why_not("[[camera]]\nuri = 'scene:wall'\nposse = [1]").find("nearest one is 'pose'"),
            std::string::npos);
  EXPECT_NE(why_not("[[camera]]\nuri = 'scene:wall'\npose = [1, 2]").find("tx,ty,tz"),
            std::string::npos);
  EXPECT_NE(why_not("[[camera]]\nuri = 'scene:wall'\npose = ['a']").find("a list of numbers"),
            std::string::npos);
  EXPECT_NE(why_not("[[camera]]\nname = 'a'\nuri = 'scene:wall'\n[[camera]]\nname = 'a'\n"
                    "uri = 'scene:wall'")
                .find("two cameras are called 'a'"),
            std::string::npos);
  EXPECT_NE(why_not("[world]\ngravity = [1]").find("gravity = [x, y, z]"), std::string::npos);
  EXPECT_NE(why_not("[wordl]\nframe = 'a'").find("[[camera]]"), std::string::npos);
  EXPECT_NE(why_not("camera = 3").find("is not known"), std::string::npos);
  std::string many;
  for (int i = 0; i < 17; ++i) many += "[[camera]]\nuri = 'scene:wall'\n";
  EXPECT_NE(why_not(many).find("has 17"), std::string::npos);
  EXPECT_NE(load_rig(folder_.path() / "none.toml").error().message.find("none.toml"),
            std::string::npos);
}

}  // namespace
}  // namespace palpate
