// Poses of cameras in the world, in URIs and files, and files of several cameras.
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
  // The wall of the scene stays where it is in the world, half a meter farther from this camera.
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
  EXPECT_NE(notes[0].find("frames were dropped"), std::string::npos) << notes[0];
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
  EXPECT_NE(why_not("scene:wall?urdf=a.urdf%23b&poses=" + file).find("FILE.urdf#LINK"),
            std::string::npos);
  EXPECT_NE(why_not("scene:wall?urdf=a.urdf#b&poses=" + file).find("one of 'poses'"),
            std::string::npos);
  EXPECT_NE(why_not("scene:wall?joints=a.csv").find("goes with 'urdf'"), std::string::npos);
  EXPECT_NE(why_not("scene:wall?accelerometer=0,0,1").find("m/s2"), std::string::npos);
}

TEST(CameraPoses, OfAHandAndOfTheCameraInItAreJoined) {
  const TemporaryFolder folder;
  const std::string file = (folder.path() / "hand.tum").string();
  // The hand turns by 0.8 rad about z in 0.4 s; the camera is 0.1 m along its x.
  write(file, "0.05 0 0 0 0 0 0 1\n0.45 0 0 0 0 0 0.3894183423 0.9210609940\n");
  const auto camera =
      open_camera("scene:wall?noise=off&size=32x24&rate=20&pose=0.1,0,0,0,0,0,1&poses=" + file)
          .value();
  DepthFrame frame;
  int num = 0;
  for (; *camera->next(frame); ++num) {
    const double angle = 2 * (frame.timestamp - 0.05);
    EXPECT_NEAR(frame.X_WC.translation.x, 0.1 * std::cos(angle), 1e-9);
    EXPECT_NEAR(frame.X_WC.translation.y, 0.1 * std::sin(angle), 1e-9);
  }
  EXPECT_EQ(num, 9);
}

/// A column with a head that turns about it, on which a camera looks along the head's x: its
/// optical frame has z there and y down. The cell around it is called "table".
constexpr const char* kCell = R"(<robot name="cell">
  <link name="floor"/><link name="table"><visual><geometry><mesh filename="package://none/a.stl"/>
  </geometry></visual></link><link name="head"/><link name="front_optical"/><link name="bench"/>
  <joint name="top" type="fixed"><parent link="floor"/><child link="table"/>
    <origin xyz="0 0 0.8"/></joint>
  <joint name="neck" type="revolute"><parent link="table"/><child link="head"/>
    <origin xyz="0.5 0 0.2"/><axis xyz="0 0 1"/></joint>
  <joint name="mount" type="fixed"><parent link="head"/><child link="front_optical"/>
    <origin xyz="0.1 0 0" rpy="-1.5707963267948966 0 -1.5707963267948966"/></joint>
  <joint name="there" type="fixed"><parent link="floor"/><child link="bench"/>
    <origin xyz="1 2 0.8" rpy="0 0 1.5707963267948966"/></joint></robot>)";

void expect_near(const Pose& a, const Pose& b) {
  for (const Vec3d& p : {Vec3d{}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}}) {
    EXPECT_NEAR(norm(a * p - b * p), 0, 1e-9);
  }
}

TEST(CameraPoses, OfAUrdfFollowItsJoints) {
  const TemporaryFolder folder;
  const std::string urdf = (folder.path() / "cell.urdf").string(),
                    joints = (folder.path() / "joints.csv").string();
  write(urdf, kCell);
  std::string reported = "time,neck\n";
  for (int i = 0; i < 20; ++i) {
    reported += std::to_string(0.05 * i) + "," + std::to_string(0.05 * i) + "\n";
  }
  write(joints, reported);
  const std::string camera =
      "scene:wall?noise=off&size=32x24&rate=20&urdf=" + urdf + "#front_optical#table";
  const auto opened = open_camera(camera + "&joints=" + joints);
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_TRUE((*opened)->info().is_moving);
  DepthFrame frame;
  for (int num = 0; num < 8; ++num) {
    ASSERT_TRUE(*(*opened)->next(frame));
    const double neck = frame.timestamp;
    const Quaternion optical = axis_angle({0, 0, 1}, -kPi / 2) * axis_angle({1, 0, 0}, -kPi / 2);
    expect_near(frame.X_WC, Pose{{0.5 + 0.1 * std::cos(neck), 0.1 * std::sin(neck), 0.2},
                                 axis_angle({0, 0, 1}, neck) * optical});
  }
  // A camera on a link is known to move without opening the source of its joints.
  const std::string elsewhere = camera + "&joints=bag:/nowhere/work.mcap";
  const auto stands = standing_pose(parse_camera_uri(elsewhere).value());
  ASSERT_TRUE(stands) << stands.error().message;
  EXPECT_FALSE(*stands);
  EXPECT_NE(
      standing_pose(parse_camera_uri(camera).value()).error().message.find("joints that move"),
      std::string::npos);
  // It looks along the head's x, with y down.
  EXPECT_NEAR(rotate(frame.X_WC.rotation, {0, 1, 0}).z, -1, 1e-9);

  const auto why_not = [](const std::string& uri) {
    const auto made = open_camera(uri);
    return made ? std::string() : made.error().message;
  };
  EXPECT_NE(why_not(camera).find("has joints that move: neck"), std::string::npos);
  EXPECT_NE(why_not(elsewhere).find("/nowhere/work.mcap"), std::string::npos);
  EXPECT_NE(why_not("scene:wall?urdf=" + urdf + "#fornt_optical").find("is 'front_optical'"),
            std::string::npos);
  EXPECT_NE(why_not("scene:wall?urdf=" + urdf + "#bench&joints=" + joints).find("no joints"),
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

TEST_F(RigFile, NamesFilesInAnyLanguage) {
  write(path_,
        "# gr\u00fc\u00df\n[world]\nframe = 'T\u00efsch'  # \"\u00e4\n[[camera]]\nname = "
        "\"\"\"v\u00f6rn\"\"\"\"\n"
        "uri = \"folder:M\u00f6bel/\u6df1\u5ea6\"\npose_from = 'W\u00e9g.tum'\n[frames]\n"
        "\"B\\\"\u00e4nk\" = [1, 0, 0, 0, 0, 0, 1]\n");
  const auto rig = load_rig(path_);
  ASSERT_TRUE(rig) << rig.error().message;
  EXPECT_EQ(rig->frame, "T\u00efsch");
  EXPECT_EQ(rig->cameras[0].name, "v\u00f6rn\"");
  EXPECT_EQ(rig->cameras[0].uri.target, (path_.parent_path() / "M\u00f6bel/\u6df1\u5ea6").string());
  EXPECT_EQ(rig->cameras[0].uri.poses, (path_.parent_path() / "W\u00e9g.tum").string());
  EXPECT_TRUE(rig->frames.contains("B\"\u00e4nk"));
  // Invalid UTF-8, and keys beyond ASCII, are errors with their line.
  for (const char* text : {"[world]\nframe = \"\xc1\"\n", "[world]\nfr\u00e4me = \"a\"\n"}) {
    write(path_, text);
    EXPECT_NE(load_rig(path_).error().message.find("line 2"), std::string::npos) << text;
  }
}

TEST_F(RigFile, APoseInAUriGivesWayToTheOneThatIsWritten) {
  write(path_,
        "[[camera]]\nuri = \"scene:wall?pose=9,0,0,0,0,0,1\"\n"
        "[[camera]]\nuri = \"scene:hand?pose=9,0,0,0,0,0,1&rate=20\"\n"
        "[[camera]]\nuri = \"scene:hand?rate=20&pose=9,0,0,0,0,0,1\"\n");
  const auto text = rig_text_with_poses(path_, {Pose{{1, 2, 3}, {}}, Pose{}, Pose{{4, 5, 6}, {}}});
  ASSERT_TRUE(text) << text.error().message;
  write(path_, *text);
  const auto rig = load_rig(path_);
  ASSERT_TRUE(rig) << rig.error().message << *text;
  EXPECT_EQ(rig->cameras[0].uri.X_WC, (Pose{{1, 2, 3}, {}}));
  EXPECT_EQ(rig->cameras[1].uri.X_WC, Pose{});
  EXPECT_EQ(rig->cameras[1].uri.rate, 20);
  EXPECT_EQ(rig->cameras[2].uri.X_WC, (Pose{{4, 5, 6}, {}}));
  EXPECT_EQ(rig->cameras[2].uri.rate, 20);
}

TEST_F(RigFile, WithAnOpenListOfParametersIsWrittenAnew) {
  write(path_, "[[camera]]\nuri = \"scene:wall?\"\n[[camera]]\nuri = \"scene:hand?rate=20&\"\n");
  const auto text = rig_text_with_poses(path_, {Pose{{1, 2, 3}, {}}, Pose{}});
  ASSERT_TRUE(text) << text.error().message;
  write(path_, *text);
  const auto rig = load_rig(path_);
  ASSERT_TRUE(rig) << rig.error().message << *text;
  EXPECT_EQ(rig->cameras[0].uri.X_WC.translation, (Vec3d{1, 2, 3}));
  EXPECT_EQ(rig->cameras[1].uri.rate, 20);
}

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

  write(folder_.path() / "hand.tum", "0 0 0 0 0 0 0 1\n1 0 0 1 0 0 0 1\n");  // its camera moves
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

TEST_F(RigFile, TakesFramesOfAUrdfAndGravityOfACamera) {
  write(folder_.path() / "cell.urdf", kCell);
  write(folder_.path() / "joints.csv", "time,neck\n0,0\n1,0\n");
  write(path_, R"([world]
frame = "table"

[frames]
mine = [1, 2, 3, 0, 0, 0.6, 0.8]
bench = "urdf:cell.urdf#bench"

[[camera]]
name = "beside"
uri = "scene:wall"
pose_from = "urdf:cell.urdf#bench"
pose = [0, 0, 0.5, 0.6, 0, 0, 0.8]
accelerometer = [0.5, -9.7, 1]

[[camera]]
uri = "scene:wall"
pose_from = "urdf:cell.urdf#front_optical"
joints = "joints.csv"
)");
  const auto rig = load_rig(path_);
  ASSERT_TRUE(rig) << rig.error().message;
  const Pose X_WBench{{1, 2, 0}, axis_angle({0, 0, 1}, kPi / 2)};  // in the table's frame
  expect_near(rig->frames.at("mine"), Pose{{1, 2, 3}, {0, 0, 0.6, 0.8}});
  expect_near(rig->frames.at("bench"), X_WBench);
  const Pose X_WC = X_WBench * Pose{{0, 0, 0.5}, {0.6, 0, 0, 0.8}};
  expect_near(standing_pose(rig->cameras[0].uri).value().value(), X_WC);
  // An accelerometer at rest measures the upward reaction: gravity is the other way, in the world.
  EXPECT_NEAR(norm(*rig->gravity - rotate(X_WC.rotation, {-0.5, 9.7, -1})), 0, 1e-9);
  EXPECT_EQ(rig->cameras[1].uri.joints, (folder_.path() / "joints.csv").string());
  // Others may see another gravity.
  const std::vector<CameraUri> uris{rig->cameras[0].uri, rig->cameras[1].uri};
  EXPECT_TRUE(gravity_doubts(uris, *rig->gravity).empty());
  EXPECT_TRUE(gravity_doubts(uris, rotate(axis_angle({1, 2, 3}, 0.08), *rig->gravity)).empty());
  EXPECT_TRUE(gravity_doubts(uris, {}).empty());
  const auto turned = gravity_doubts(uris, rotate(axis_angle({-2, 1, 0}, 0.8), *rig->gravity));
  ASSERT_EQ(turned.size(), 1u);
  EXPECT_NE(turned[0].find("accelerometer"), std::string::npos) << turned[0];
  EXPECT_EQ(gravity_doubts(uris, 1.2 * *rig->gravity).size(), 1u);

  // A better pose is where the camera was refined to, also on its link.
  const auto text = rig_text_with_poses(path_, {{{4, 5, 6}, {}}, {}});
  ASSERT_TRUE(text);
  write(path_, *text);
  expect_near(standing_pose(load_rig(path_)->cameras[0].uri).value().value(), {{4, 5, 6}, {}});

  EXPECT_NE(why_not("[frames]\na = [1, 2]\n[[camera]]\nuri = 'scene:wall'").find("[frames] a must"),
            std::string::npos);
  EXPECT_NE(why_not("[world]\nframe = 'desk'\n[[camera]]\nuri = 'scene:wall'\n[frames]\n"
                    "a = 'urdf:cell.urdf#bench'")
                .find("there is no link 'desk'"),
            std::string::npos);
}

// Anybody's folders are called as they are.
TEST_F(RigFile, TakesFilesWhoseNamesHaveSignsOfAUri) {
  const auto folder = folder_.path() / "R&D #3?";
  std::filesystem::create_directory(folder);
  write(folder / "a&b #1.urdf", kCell);
  write(folder / "a=1&b.csv", "time,neck\n0,0\n1,0\n");
  write(folder / "way #2&3.tum", "0 1 0 0 0 0 0 1\n");
  write(folder / "rig.toml", R"([world]
frame = "table"
[frames]
bench = "urdf:a&b #1.urdf#bench"
[[camera]]
uri = "scene:wall"
pose_from = "urdf:a&b #1.urdf#front_optical"
joints = "a=1&b.csv"
[[camera]]
uri = "scene:wall"
pose_from = "way #2&3.tum"
)");
  const auto rig = load_rig(folder / "rig.toml");
  ASSERT_TRUE(rig) << rig.error().message;
  expect_near(rig->frames.at("bench"), Pose{{1, 2, 0}, axis_angle({0, 0, 1}, kPi / 2)});
  for (const CameraRig::Camera& camera : rig->cameras) {
    const auto opened = open_camera(camera.uri);
    ASSERT_TRUE(opened) << opened.error().message;
    DepthFrame frame;
    ASSERT_TRUE(*(*opened)->next(frame));
    EXPECT_NEAR(frame.X_WC.translation.x, camera.name == "camera 1" ? 0.6 : 1, 1e-9);
  }
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
  EXPECT_NE(why_not("[world]\ngravity = [0, 9007199254740993, 0]").find("gravity must be numbers"),
            std::string::npos);
  for (const char* const wrong : {"''", "3", "'urdf:a.urdf'"}) {
    EXPECT_NE(why_not("[[camera]]\nuri = 'scene:wall'\npose_from = " + std::string(wrong))
                  .find("camera 1: pose_from must be"),
              std::string::npos);
  }
  EXPECT_NE(why_not("[[camera]]\nuri = 'scene:wall?poses=a.tum'\npose_from = 'b.tum'")
                .find("must be given once"),
            std::string::npos);
  EXPECT_NE(why_not("[world]\ngravity = [1]").find("gravity = [x, y, z]"), std::string::npos);
  EXPECT_NE(why_not("[world]\ngravity = [0, nan, 0]").find("line 2: gravity must be numbers from"),
            std::string::npos);
  EXPECT_NE(why_not("[[camera]]\nuri = 'scene:wall?pose=0,0,0,0,0,0,1'\npose = [0,0,1,0,0,0,1]")
                .find("'pose' must be given once"),
            std::string::npos);
  for (const char* const name : {"''", "3"}) {
    EXPECT_NE(why_not("[[camera]]\nuri = 'scene:wall'\nname = " + std::string(name))
                  .find("camera 1 needs a name"),
              std::string::npos);
  }
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
