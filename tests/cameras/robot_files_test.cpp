// Robots by URDF and the states of their joints: against frames multiplied by hand, closed forms
// and exact rays.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "palpate/cameras/cameras.h"
#include "palpate/io/formats.h"
#include "src/cameras/internal/robot_model.h"
#include "src/cameras/robot/joint_history.h"
#include "src/io/internal/mcap_file.h"
#include "src/io/internal/ros_messages.h"
#include "src/io/internal/ros_types.h"
#include "tests/cameras/robot_scene.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::SwingingArm;
using test::TemporaryFolder;

void write(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path) << text;
}

Result<RobotModel> parsed(const std::string& text, const RobotFolders& folders = {},
                          RobotGeometry geometry = RobotGeometry::collision) {
  return parse_urdf(text, "robot.urdf", folders, geometry);
}
std::string why_not(const std::string& inside) {
  const auto robot = parsed("<robot name='r'>" + inside + "</robot>");
  return robot ? std::string() : robot.error().message;
}

void expect_near(const Pose& a, const Pose& b) {
  EXPECT_NEAR(norm(a.translation - b.translation), 0, 1e-12);
  const Quaternion turn = conjugate(a.rotation) * b.rotation;
  EXPECT_NEAR(std::abs(turn.w), 1, 1e-12);
}

/// Returns the pose of link `name` in the base, with these positions of joints by name.
Pose placed(const RobotModel& robot, const std::string& name,
            const std::map<std::string, double>& positions) {
  std::vector<double> all(robot.joints.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto given = positions.find(robot.joints[i].name);
    all[i] = given == positions.end() ? 99 : given->second;  // of nobody
  }
  std::vector<Pose> X_BL(robot.links.size());
  robot.place(all, X_BL);
  for (std::size_t i = 0; i < all.size() + 1; ++i) {
    if (robot.links[i].name == name) return X_BL[i];
  }
  ADD_FAILURE() << "no link " << name;
  return {};
}

constexpr const char* kBall = "<collision><geometry><sphere radius='0.1'/></geometry></collision>";

TEST(Urdf, PlacesLinksByTheirJoints) {
  // Children come first in the file, and a joint is of each kind.
  const auto robot = parsed(R"(<robot name="r">
    <link name="finger"/><link name="hand"/><link name="arm"/><link name="base"/><link name="slide"/>
    <joint name="grip" type="prismatic"><parent link="hand"/><child link="finger"/>
      <origin xyz="0 0 0.1"/><axis xyz="0 3 0"/></joint>
    <joint name="turn" type="continuous"><parent link="arm"/><child link="hand"/>
      <origin xyz="0.4 0 0" rpy="0.1 0.2 0.3"/><axis xyz="0 0 1"/></joint>
    <joint name="lift" type="revolute"><parent link="slide"/><child link="arm"/>
      <axis xyz="0 1 0"/><limit lower="0" upper="0.1" effort="1" velocity="1"/></joint>
    <joint name="rail" type="fixed"><parent link="base"/><child link="slide"/>
      <origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/></joint></robot>)");
  ASSERT_TRUE(robot) << robot.error().message;
  EXPECT_EQ(robot->links[robot->root].name, "base");
  // Far beyond its limit, which is not looked at.
  const double lift = 1.2, turn = -0.7, grip = 0.03;
  // Matrices: Rz(1.57) at (1, 2, 3), Ry(lift), Rz(0.3) Ry(0.2) Rx(0.1) at 0.4 x, Rz(turn).
  const auto rx = [](double a) { return axis_angle({1, 0, 0}, a); };
  const auto ry = [](double a) { return axis_angle({0, 1, 0}, a); };
  const auto rz = [](double a) { return axis_angle({0, 0, 1}, a); };
  const Pose arm = Pose{{1, 2, 3}, rz(std::acos(0.0))} * Pose{{}, ry(lift)};
  const Pose hand = arm * Pose{{0.4, 0, 0}, rz(0.3) * ry(0.2) * rx(0.1)} * Pose{{}, rz(turn)};
  const std::map<std::string, double> positions{{"lift", lift}, {"turn", turn}, {"grip", grip}};
  expect_near(placed(*robot, "slide", positions), {{1, 2, 3}, rz(std::acos(0.0))});
  expect_near(placed(*robot, "arm", positions), arm);
  expect_near(placed(*robot, "hand", positions), hand);
  expect_near(placed(*robot, "finger", positions), hand * Pose{{0, grip, 0.1}, {}});
  // The end of the arm by hand: 0.4 along the lifted x, which the rail has turned to y.
  const Vec3d end = placed(*robot, "hand", positions).translation;
  EXPECT_NEAR(end.x, 1, 1e-12);
  EXPECT_NEAR(end.y, 2 + 0.4 * std::cos(lift), 1e-12);
  EXPECT_NEAR(end.z, 3 - 0.4 * std::sin(lift), 1e-12);
  EXPECT_TRUE(robot->required_joints().empty());  // no link has a shape
}

TEST(Urdf, LetsJointsFollowOthers) {
  const std::string links = std::string("<link name='a'/><link name='b'/><link name='c'/>") +
                            "<link name='d'>" + kBall + "</link>";
  const auto joint = [](const char* name, const char* parent, const char* child,
                        const std::string& more) {
    return std::string("<joint name='") + name + "' type='prismatic'><parent link='" + parent +
           "'/><child link='" + child + "'/>" + more + "</joint>";
  };
  const std::string chain =
      joint("third", "c", "d", "<mimic joint='second' multiplier='-3' offset='0.5'/>") +
      joint("first", "a", "b", "") +
      joint("second", "b", "c", "<mimic joint='first' multiplier='2' offset='0.25'/>");
  const auto robot = parsed("<robot>" + links + chain + "</robot>");
  ASSERT_TRUE(robot) << robot.error().message;
  const double first = 0.1, second = 2 * first + 0.25, third = -3 * second + 0.5;
  EXPECT_NEAR(placed(*robot, "d", {{"first", first}}).translation.x, first + second + third, 1e-12);
  // One has to be told of.
  ASSERT_EQ(robot->required_joints().size(), 1u);
  EXPECT_EQ(robot->joints[robot->required_joints()[0]].name, "first");
  const std::string ring = joint("first", "a", "b", "<mimic joint='second'/>") +
                           joint("second", "b", "c", "<mimic joint='first'/>");
  EXPECT_NE(why_not("<link name='a'/><link name='b'/><link name='c'/>" + ring).find("follows"),
            std::string::npos);
}

TEST(Urdf, SaysWhatIsWrongAndWhere) {
  EXPECT_NE(parsed("<robot><link").error().message.find("line 1"), std::string::npos);
  EXPECT_NE(parsed("solid").error().message.find("robot.urdf"), std::string::npos);
  EXPECT_NE(parsed("<sdf/>").error().message.find("no <robot>"), std::string::npos);
  EXPECT_NE(why_not("").find("no <link>"), std::string::npos);
  for (const char* const nothing : {"", " \n\t\r\n"}) {
    EXPECT_EQ(parsed(nothing).error().message,
              "robot.urdf is empty; did xacro or a download fail?");
  }
  EXPECT_NE(why_not("\n<link/>").find("line 2: <link> needs name"), std::string::npos);
  EXPECT_NE(why_not("<link name='a'/><link name='a'/>").find("two links"), std::string::npos);
  const std::string two = "<link name='a'/><link name='b'/>";
  const auto joint = [](const std::string& type, const std::string& inside) {
    return "<joint name='j' type='" + type + "'>" + inside + "</joint>";
  };
  const std::string ends = "<parent link='a'/><child link='b'/>";
  EXPECT_NE(why_not(two + joint("hinge", ends)).find("no type 'hinge'"), std::string::npos);
  EXPECT_NE(why_not(two + joint("fixed", "<parent link='a'/>")).find("<child link"),
            std::string::npos);
  EXPECT_NE(why_not(two + joint("fixed", "<parent link='x'/><child link='b'/>")).find("not 'x'"),
            std::string::npos);
  EXPECT_NE(why_not(two + joint("revolute", ends + "<axis xyz='0 0 0'/>")).find("direction"),
            std::string::npos);
  EXPECT_NE(why_not(two + joint("fixed", ends + "<origin xyz='0 0'/>")).find("3 numbers"),
            std::string::npos);
  EXPECT_NE(why_not(two + joint("fixed", ends + "<origin xyz='0 0 nan'/>")).find("3 numbers"),
            std::string::npos);
  const auto turned =
      parsed("<robot>" + two +
             joint("fixed", ends + "<origin xyz='1 2 3' quat_xyzw='0 0 0.6 0.8'/>") + "</robot>");
  ASSERT_TRUE(turned) << turned.error().message;
  EXPECT_EQ(turned->joints[0].X_PJ, (Pose{{1, 2, 3}, {0, 0, 0.6, 0.8}}));
  for (const char* const wrong : {"0 0 0 0", "0 0 1", "0 0 0.6 0.8' rpy='0 0 0"}) {
    EXPECT_NE(why_not(two + joint("fixed", ends + "<origin quat_xyzw='" + wrong + "'/>"))
                  .find("quat_xyzw"),
              std::string::npos)
        << wrong;
  }
  EXPECT_NE(why_not(two).find("2 links that are the child of no joint"), std::string::npos);
  EXPECT_NE(why_not("<link name='c'/>" + two + joint("fixed", ends) +
                    "<joint name='k' type='fixed'><parent link='b'/><child link='a'/></joint>")
                .find("circle"),
            std::string::npos);
  EXPECT_NE(why_not(two + joint("fixed", ends) + joint("fixed", ends)).find("two joints"),
            std::string::npos);
  const auto shape = [](const std::string& text) {
    return why_not("<link name='a'><collision><geometry>" + text +
                   "</geometry></collision></link>");
  };
  EXPECT_NE(shape("<cone radius='1'/>").find("no shape 'cone'"), std::string::npos);
  EXPECT_NE(shape("").find("needs a <geometry>"), std::string::npos);
  EXPECT_NE(shape("<sphere radius='-1'/>").find("above zero"), std::string::npos);
  EXPECT_NE(shape("<box size='1 1'/>").find("3 numbers"), std::string::npos);
  EXPECT_NE(shape("<mesh/>").find("filename"), std::string::npos);
  EXPECT_NE(shape("<mesh filename='a.stl' scale='1 0 1'/>").find("a scale of zero"),
            std::string::npos);
  // Left to xacro, which would still add links.
  EXPECT_NE(why_not("<link name='a'/>\n<xacro:include filename='arm.xacro'/>")
                .find("line 2: <xacro:include> is xacro; turn it into URDF first"),
            std::string::npos);
  EXPECT_NE(shape("<mesh filename='no.stl'/>").find("no mesh no.stl"), std::string::npos);
  EXPECT_NE(shape("<mesh filename='package://'/>").find("package://"), std::string::npos);
  const std::string longest(4096, 'n');
  EXPECT_NE(why_not("<link name='" + longest + "n'/>").find("<link> has a longer name than 4096"),
            std::string::npos);
  const auto model = parsed("<robot><link name='" + longest + "'/></robot>");
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_LT(model->find_link(longest + "m").error().message.size(), 200u);
}

TEST(JointHistory, GoesBetweenWhatWasTold) {
  JointHistory history({{"elbow", false}, {"wheel", true}});
  for (const double t : {1.02, 1.0, 1.04}) history.add("elbow", t, 10 * t);
  history.add("elbow", 1.04, 99);  // twice
  history.add("nobody's", 1, 1);
  const double pi = std::acos(-1.0);
  history.add("wheel", 1, 3.0);
  history.add("wheel", 1.1, 3.2 - 2 * pi);
  const auto at = [&](std::size_t joint, double time) {
    return history.at(joint, time, 0.1, false).value();
  };
  EXPECT_NEAR(at(0, 1.01), 10.1, 1e-12);
  EXPECT_NEAR(at(0, 1.035), 10.35, 1e-12);
  EXPECT_NEAR(at(0, 0.95), 10, 1e-12);    // what was told first
  EXPECT_NEAR(at(0, 1.09), 10.9, 1e-12);  // as fast as before
  EXPECT_FALSE(history.at(0, 1.141, 0.1, false));
  EXPECT_FALSE(history.at(0, 0.89, 0.1, false));
  EXPECT_NEAR(std::remainder(at(1, 1.05) - 3.1, 2 * pi), 0, 1e-12);  // the short way
  // In a gap the position is unknown.
  history.add("elbow", 1.5, 0);
  EXPECT_TRUE(history.at(0, 1.45, 0.1, false));
  const auto gap = history.at(0, 1.25, 0.1, false);
  ASSERT_FALSE(gap);
  EXPECT_NE(gap.error().message.find("'elbow'"), std::string::npos);
  EXPECT_NE(gap.error().message.find("0.1 s"), std::string::npos) << gap.error().message;
  EXPECT_EQ(JointHistory({{"a", false}, {"b", false}}).missing(), "a, b");
  const JointHistory long_name({{std::string(10'000, 'n'), false}});
  EXPECT_LT(long_name.missing().size(), 200u);
  EXPECT_LT(long_name.at(0, 1, 0.1, false).error().message.size(), 200u);
  EXPECT_EQ(history.missing(), "");
}

TEST(JointHistory, KeepsTheNewest) {
  JointHistory history({{"j", false}}, 10);
  EXPECT_LT(history.known_until(), -1e9);
  for (int i = 0; i < 1000; ++i) history.add("j", i, i);
  for (const double time : {990.0, 990.5, 998.9}) {
    EXPECT_NEAR(*history.at(0, time, 0.6, false), time, 1e-12);
  }
  EXPECT_FALSE(history.at(0, 970, 0.6, false));
  EXPECT_EQ(history.known_until(), 999);
  history.add("j", 998.5, 998.5);  // only late
  EXPECT_EQ(history.known_until(), 999);
  history.add("j", 997.5, 3);  // its clock has been set back
  EXPECT_EQ(history.known_until(), 997.5);
  EXPECT_FALSE(history.at(0, 999, 0.6, false));
}

// The last valid position of a live robot's joint counts until it is too old.
TEST(JointHistory, HoldsAJointThatIsToldToBeWhereNoneIs) {
  JointHistory history({{"elbow", false}, {"wheel", true}}, 10);
  history.add("elbow", 1, 0.5);
  history.add("wheel", 1, 6e5);  // turned often
  EXPECT_EQ(history.impossible(), "");
  for (const double position : {1e300, -1.1e6, std::nan("")}) {
    history.add("elbow", 1.1, position);
    EXPECT_EQ(history.at(0, 1.1, 0.2, false).value(), 0.5) << position;
  }
  EXPECT_EQ(history.at(1, 1.1, 0.2, false).value(), 6e5);
  const auto missed = history.at(0, 2, 0.2, false);
  ASSERT_FALSE(missed);
  EXPECT_NE(missed.error().message.find("told to be where no joint is"), std::string::npos)
      << missed.error().message;
  EXPECT_NE(history.impossible().find("joint 'elbow' is at "), std::string::npos);
  // An impossible position that a valid one followed does not explain the later silence.
  history.add("elbow", 3, 0.6);
  const auto silent = history.at(0, 4, 0.2, false);
  ASSERT_FALSE(silent);
  EXPECT_EQ(silent.error().message,
            "no state for joint 'elbow' within 0.2 s, the nearest is 1 s away");
  EXPECT_NE(history.impossible().find("joint 'elbow' is at "), std::string::npos);
}

TEST(JointHistory, SaysWhichJointIsAtNaN) {
  JointHistory history({{"elbow", false}, {"finger", false}, {"wrist", false}});
  history.add("elbow", 1, 0.5);
  history.add("finger", 1, std::nan(""));
  EXPECT_EQ(history.missing(), "finger (at NaN), wrist");
  EXPECT_NE(history.at(1, 1, 0.1, false).error().message.find("it is told to be at NaN"),
            std::string::npos);
  EXPECT_EQ(history.impossible(), "");  // others of the recording are right
  history.add("finger", 2, 0.1);
  EXPECT_EQ(history.missing(), "wrist");
}

TEST(JointTable, IsReadAndRefused) {
  JointHistory history({{"a", false}, {"b", false}});
  const Status read =
      read_joint_table("# exported\n\"time\",\"b\",\"a\"\r\n0, 1, 2\n1;3;4\n", "f.csv", history);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_NEAR(*history.at(0, 0.5, 1, false), 3, 1e-12);
  EXPECT_NEAR(*history.at(1, 0.5, 1, false), 2, 1e-12);
  const auto why = [](const std::string& text) {
    JointHistory any({{"a", false}});
    const Status status = read_joint_table(text, "f.csv", any);
    return status ? std::string() : status.error().message;
  };
  EXPECT_NE(why("").find("no joint positions"), std::string::npos);
  EXPECT_NE(why("time,a\n").find("no joint positions"), std::string::npos);
  EXPECT_NE(why("0,1\n").find("line 1 must name"), std::string::npos);
  EXPECT_NE(why("time,a\n0,1\n1\n").find("line 3 has 1 values"), std::string::npos);
  EXPECT_NE(why("time,a\n0,x\n").find("'x'"), std::string::npos);
  EXPECT_NE(why("time,a\n0,inf\n").find("finite"), std::string::npos);
  EXPECT_NE(why("time,a\n0,1\n1,-1e300\n").find("line 3 has '-1e300' where a position is needed"),
            std::string::npos);
  EXPECT_EQ(why("time,a\n1.7e9,1e6\n"), "");
  EXPECT_NE(why("time,a\n1,0\n0,0\n").find("back in time"), std::string::npos);
  EXPECT_NE(why("time,a,b,a\n0,1,2,3\n").find("line 1 has two columns 'a'"), std::string::npos);
  EXPECT_NE(why("a,time\n0,1\n").find("the time as its first column"), std::string::npos);
}

/// The arm by files: filtered frames show only the table, by exact rays.
class ArmFiles : public testing::Test {
 protected:
  ArmFiles() {
    write(folder_ / "arm.urdf", test::kArmUrdf);
    files_.robot = folder_ / "arm.urdf";
    files_.joints = folder_ / "joints.csv";
    const Pose X_WB = SwingingArm::base();
    const auto& [p, q] = X_WB;
    char text[200];
    std::snprintf(text, sizeof text, "%.17g,%.17g,%.17g %.17g %.17g %.17g %.17g", p.x, p.y, p.z,
                  q.x, q.y, q.z, q.w);
    files_.pose = text;
  }
  /// At 50 Hz, not in step with the frames.
  void write_joints(double end = 0.5) {
    std::ofstream file(files_.joints);
    file.precision(17);
    file << "time,elbow,shoulder\n";
    for (double t = -0.013; t < end; t += 0.02) {
      file << t << "," << SwingingArm::elbow(t) << "," << SwingingArm::shoulder(t) << "\n";
    }
  }
  /// The frames that come through.
  std::vector<DepthFrame> filtered(std::vector<std::string>* notes = nullptr) const {
    const auto filter = open_self_filter(files_);
    if (!filter) {
      ADD_FAILURE() << filter.error().message;
      return {};
    }
    auto source = filter->applied_to(std::make_unique<test::FrameList>(with_)).value();
    std::vector<DepthFrame> out;
    DepthFrame frame;
    while (*source->next(frame)) out.push_back(frame);
    if (notes != nullptr) *notes = source->take_notes();
    return out;
  }
  std::string why_not() const {
    const auto filter = open_self_filter(files_);
    return filter ? std::string() : filter.error().message;
  }

  const TemporaryFolder folder_;
  RobotFiles files_;
  const std::vector<DepthFrame> with_ = test::frames_of_arm([](double) { return Pose{}; }, true),
                                without_ =
                                    test::frames_of_arm([](double) { return Pose{}; }, false);
};

TEST_F(ArmFiles, LeaveTheTable) {
  write_joints();
  const auto left = filtered();
  ASSERT_EQ(left.size(), with_.size());
  for (std::size_t k = 0; k < left.size(); ++k) {
    int num_arm = 0, num_lost = 0;
    for (std::size_t i = 0; i < left[k].pixels.size(); ++i) {
      const bool is_arm = with_[k].pixels[i] != without_[k].pixels[i];
      const int desired = is_arm || left[k].pixels[i] == 0 ? 0 : without_[k].pixels[i];
      ASSERT_EQ(left[k].pixels[i], desired) << i << " of frame " << k;
      num_arm += is_arm;
      num_lost += !is_arm && left[k].pixels[i] == 0;
    }
    EXPECT_GT(num_arm, 8000);
    EXPECT_LT(num_lost, 3 * num_arm);
  }
}

// Most of the robot is better than none of it, if that is said.
TEST_F(ArmFiles, OfWhichAnOrnamentCannotBeReadLeaveItOutWithANote) {
  write_joints();
  const auto plain = filtered();
  const auto with = [&](const char* kind, const std::string& mesh) {
    std::string urdf = test::kArmUrdf;
    urdf.insert(urdf.rfind("</robot>"),
                "<link name='lamp'><" + std::string(kind) + "><geometry><mesh filename='" + mesh +
                    "'/></geometry></" + kind +
                    "></link><joint name='on' type='fixed'><parent link='" +
                    parsed(test::kArmUrdf)->links.front().name + "'/><child link='lamp'/></joint>");
    write(files_.robot, urdf);
  };
  write(folder_ / "lamp.dae", "<COLLADA/>");
  write(folder_ / "lamp.stl", "damaged");
  for (const char* mesh : {"lamp.dae", "lamp.stl", "package://lamps/lamp.dae"}) {
    files_.skip = {};
    with("visual", mesh);
    std::vector<std::string> notes;
    const auto left = filtered(&notes);
    ASSERT_EQ(notes.size(), 1u);
    EXPECT_NE(notes[0].find("link 'lamp' of the robot is left out"), std::string::npos) << notes[0];
    ASSERT_EQ(left.size(), plain.size());
    for (std::size_t k = 0; k < left.size(); ++k) EXPECT_EQ(left[k].pixels, plain[k].pixels);
    with("collision", mesh);
    EXPECT_NE(why_not().find("or leave that link out (--robot-skip lamp)"), std::string::npos)
        << why_not();
    files_.skip = {"lamp"};
    EXPECT_EQ(filtered(&notes).size(), plain.size());
    EXPECT_TRUE(notes.empty());
  }
  files_.skip = {"lamp", "lump"};
  EXPECT_NE(why_not().find("there is no link 'lump'; the nearest one is 'lamp'"), std::string::npos)
      << why_not();
}

TEST_F(ArmFiles, ThatAreTooOldLeaveFramesOut) {
  write_joints(0.15);
  std::vector<std::string> notes;
  const auto left = filtered(&notes);
  EXPECT_EQ(left.size(), 5u);  // up to 0.2 s: the last states are of 0.147 s
  ASSERT_EQ(notes.size(), 2u);
  EXPECT_NE(notes[0].find("no state for joint"), std::string::npos) << notes[0];
  EXPECT_NE(notes[1].find("2 depth images were dropped"), std::string::npos) << notes[1];
}

// The images are fine: it is the states that are of another time.
TEST_F(ArmFiles, OfAnotherTimeAreNamedAsTheReason) {
  write(files_.joints, "time,elbow,shoulder\n100,0,0\n101,0,0\n");
  const auto filter = open_self_filter(files_);
  ASSERT_TRUE(filter) << filter.error().message;
  const auto source = filter->applied_to(std::make_unique<test::FrameList>(with_)).value();
  DepthFrame frame;
  const auto got = source->next(frame);
  ASSERT_FALSE(got);
  EXPECT_NE(got.error().message.find("all " + std::to_string(with_.size()) +
                                     " depth images were dropped: no state for joint"),
            std::string::npos)
      << got.error().message;
  EXPECT_NE(got.error().message.find("give the robot's states for the times of the images"),
            std::string::npos);
}

TEST_F(ArmFiles, SaysWhatIsWrong) {
  EXPECT_NE(why_not().find("joints.csv"), std::string::npos) << why_not();
  write(files_.joints, "time,elbow\n0,1\n");
  EXPECT_NE(why_not().find("no states for joints of"), std::string::npos) << why_not();
  EXPECT_NE(why_not().find("shoulder"), std::string::npos);
  files_.joints = "";
  EXPECT_NE(why_not().find("--joints"), std::string::npos) << why_not();
  files_.joints = "bag:" + (folder_ / "no.mcap").string();
  EXPECT_NE(why_not().find("no.mcap"), std::string::npos) << why_not();
  files_.joints = "bag:a.mcap?topics=/a";
  EXPECT_NE(why_not().find("'topics=/a' is not known"), std::string::npos) << why_not();
  write_joints();
  files_.joints = folder_ / "joints.csv";
  write(files_.joints, "time,elbow,shoulder\n0,0,0\n");
  files_.pose = "1 2 3";
  EXPECT_NE(why_not().find("neither a file nor a pose"), std::string::npos) << why_not();
  files_.pose = "";
  files_.robot = folder_ / "no.urdf";
  EXPECT_NE(why_not().find("no.urdf"), std::string::npos) << why_not();
  write(folder_ / "empty.urdf", "<robot><link name='a'/></robot>");
  files_.robot = folder_ / "empty.urdf";
  EXPECT_NE(why_not().find("no link has a shape"), std::string::npos) << why_not();
  write(folder_ / "float.urdf", std::string("<robot><link name='a'/><link name='b'>") + kBall +
                                    "</link><joint name='f' type='floating'><parent link='a'/>"
                                    "<child link='b'/></joint></robot>");
  files_.robot = folder_ / "float.urdf";
  EXPECT_NE(why_not().find("world=FRAME"), std::string::npos) << why_not();
}

TEST_F(ArmFiles, OfAStillRobotHoldForLiveFramesAndOthersDoNot) {
  class LiveList : public test::FrameList {
   public:
    explicit LiveList(std::vector<DepthFrame> frames) : FrameList(std::move(frames)) {
      live_ = FrameList::info();
      live_.is_live = true;
    }
    const DepthStreamInfo& info() const override { return live_; }

   private:
    DepthStreamInfo live_;
  };
  write_joints();
  const auto refused = open_self_filter(files_)->applied_to(std::make_unique<LiveList>(with_));
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("is live and the robot's poses are recorded"),
            std::string::npos);
  // A mesh is a robot of one link.
  ASSERT_TRUE(save_mesh(make_box({0.1, 0.1, 0.1}), folder_ / "box.ply"));
  RobotFiles box;
  box.robot = folder_ / "box.ply";
  box.pose = "0 0 0.6 0 0 0 1";
  auto source = open_self_filter(box)->applied_to(std::make_unique<LiveList>(without_)).value();
  DepthFrame frame;
  ASSERT_TRUE(*source->next(frame));
  EXPECT_EQ(frame.pixels[240 * 640 + 320], 0);
  EXPECT_NE(frame.pixels[240 * 640 + 20], 0);
}

/// The same states in a recording, as joints and as frames.
class ArmBag : public ArmFiles {
 protected:
  ArmBag() {
    auto bag = McapWriter::create(folder_ / "arm.mcap").value();
    const auto channel = [&](const char* topic, const char* type) {
      return bag.add_channel({topic, ros_interface_name(type), message_schema(type)});
    };
    const auto joints = channel("/joint_states", "sensor_msgs/JointState");
    const auto gripper = channel("/gripper/joint_states", "sensor_msgs/JointState");
    const auto tf = channel("/tf", "tf2_msgs/TFMessage");
    const auto fixed = channel("/tf_static", "tf2_msgs/TFMessage");
    const RosTransform base{"world", "base", SwingingArm::base()};
    const RosTransform wrist{"forearm", "hand", {{0, 0, 0.3}, axis_angle({0, 0, 1}, 0.5)}};
    const RosTransform still[] = {base, wrist};
    EXPECT_TRUE(bag.write(fixed, 1, transform_message(1, still)));
    for (int i = 0; i < 25; ++i) {
      const double t = 0.007 + 0.02 * i;
      const auto ns = static_cast<std::uint64_t>(std::llround(t * 1e9));
      // Each by a publisher of its own, as arms and grippers have them.
      const std::string shoulder[] = {"shoulder", "another"}, elbow[] = {"elbow"};
      const double positions[] = {SwingingArm::shoulder(t), 7}, bent[] = {SwingingArm::elbow(t)};
      EXPECT_TRUE(bag.write(joints, ns, joint_state_message({ns, ""}, shoulder, positions)));
      EXPECT_TRUE(bag.write(gripper, ns, joint_state_message({ns, ""}, elbow, bent)));
      const RosTransform moving[] = {
          {"base", "upper_arm", {{}, axis_angle({1, 0, 0}, SwingingArm::shoulder(t))}},
          {"upper_arm", "forearm", {{0, 0, 0.3}, axis_angle({1, 0, 0}, SwingingArm::elbow(t))}}};
      EXPECT_TRUE(bag.write(tf, ns, transform_message(ns, moving)));
    }
    EXPECT_TRUE(bag.finish());
  }
  void expect_no_arm(const std::vector<DepthFrame>& left, std::size_t first) const {
    ASSERT_EQ(left.size() + first, with_.size());
    for (std::size_t k = first; k < with_.size(); ++k) {
      ASSERT_EQ(left[k - first].timestamp, with_[k].timestamp);
      for (std::size_t i = 0; i < with_[k].pixels.size(); ++i) {
        if (with_[k].pixels[i] != without_[k].pixels[i]) {
          ASSERT_EQ(left[k - first].pixels[i], 0) << i << " of frame " << k;
        }
      }
    }
  }
};

TEST_F(ArmBag, TellsOfJointsOrOfFrames) {
  const std::string bag = "bag:" + (folder_ / "arm.mcap").string();
  files_.joints = bag;
  expect_no_arm(filtered(), 0);
  files_.joints = bag + "?topic=/joint_states";
  EXPECT_NE(why_not().find("elbow"), std::string::npos) << why_not();
  files_.joints = bag + "?world=world";
  EXPECT_NE(why_not().find("leave its pose out"), std::string::npos) << why_not();
  files_.pose = "";
  // The first frame is older than all transforms of tf.
  std::vector<std::string> notes;
  expect_no_arm(filtered(&notes), 1);
  ASSERT_EQ(notes.size(), 2u);
  EXPECT_NE(notes[0].find("tf has no transform for 'upper_arm'"), std::string::npos) << notes[0];
  files_.joints = bag + "?world=moon";
  EXPECT_NE(why_not().find("no transform joins 'moon'"), std::string::npos) << why_not();
}

TEST_F(ArmBag, WithAJointThatIsWhereNoneIsIsRefused) {
  auto bag = McapWriter::create(folder_ / "odd.mcap").value();
  const auto joints =
      bag.add_channel({"/joint_states", ros_interface_name("sensor_msgs/JointState"),
                       message_schema("sensor_msgs/JointState")});
  const std::string names[] = {"shoulder", "elbow"};
  const double good[] = {0.1, 0.2}, odd[] = {0.1, 1e300};
  EXPECT_TRUE(bag.write(joints, 1, joint_state_message({1, ""}, names, good)));
  EXPECT_TRUE(bag.write(joints, 2, joint_state_message({2, ""}, names, odd)));
  EXPECT_TRUE(bag.finish());
  files_.joints = "bag:" + (folder_ / "odd.mcap").string();
  EXPECT_NE(why_not().find("joint 'elbow' is at 1e+300 rad or m"), std::string::npos) << why_not();
}

}  // namespace
}  // namespace palpate
