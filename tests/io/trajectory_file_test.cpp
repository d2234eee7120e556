#include "palpate/io/files.h"

#include <cmath>

#include <gtest/gtest.h>
#include <unistd.h>

#include "palpate/math/geometry.h"
#include "src/io/internal/atomic_file.h"
#include "tests/io/files.h"
#include "tests/test_util/data.h"

namespace palpate {
namespace {

using test::expect_error;
using test::TemporaryFolder;
using test::write_bytes;

TEST(TrajectoryFile, RoundTrips) {
  const TemporaryFolder folder;
  std::vector<TimedPose> poses;
  for (int k = 0; k < 100; ++k) {
    poses.push_back(
        {1305031098.6659 + 0.01 * k,
         {{0.1 * k, 1.0 / (k + 3), -1e-9 * k}, axis_angle({1, 2, double(k)}, 0.1 * k)}});
  }
  ASSERT_TRUE(save_trajectory(poses, folder / "path.txt").has_value());
  const auto loaded = load_trajectory(folder / "path.txt");
  ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
  ASSERT_EQ(loaded->size(), poses.size());
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const Pose &a = poses[k].X_WT, &b = (*loaded)[k].X_WT;
    EXPECT_EQ(poses[k].time, (*loaded)[k].time);
    EXPECT_EQ(a.translation, b.translation);
    EXPECT_NEAR(a.rotation.x, b.rotation.x, 1e-15);
    EXPECT_NEAR(a.rotation.w, b.rotation.w, 1e-15);
  }
}

TEST(TrajectoryFile, AcceptsTabsLineEndsCommentsAndPlusSigns) {
  const TemporaryFolder folder;
  write_bytes(folder / "path.txt",
              "# comment\r\n\r\n0\t1 2 3\t0 0 0 2\r\n  \t\n+0.5 1e0 +2 3. 0 0 1e200 0 # end\n");
  const auto loaded = load_trajectory(folder / "path.txt");
  ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
  ASSERT_EQ(loaded->size(), 2u);
  EXPECT_EQ((*loaded)[0].X_WT, (Pose{{1, 2, 3}, {0, 0, 0, 1}}));
  EXPECT_EQ((*loaded)[1].X_WT, (Pose{{1, 2, 3}, {0, 0, 1, 0}}));
}

TEST(TrajectoryFile, TimesInOtherUnitsThanSecondsAreToldAndRefused) {
  const TemporaryFolder folder;
  const auto with = [&](const std::vector<std::string>& times) {
    std::string lines = "# t tx ty tz qx qy qz qw\n";
    for (const std::string& time : times) lines += time + " 1 2 3 0 0 0 1\n";
    write_bytes(folder / "path.txt", lines);
    const auto loaded = load_trajectory(folder / "path.txt");
    return loaded ? "" : loaded.error().message;
  };
  EXPECT_EQ(with({"1700000000.1", "1700000000.2"}), "");
  const std::string words = "as if in nanoseconds or the like";
  for (const std::vector<std::string>& times :
       {std::vector<std::string>{"1700000000000000000", "1700000000033333333"},
        {"1.7e18"},
        {"1700000000000", "1700000000033"},
        {"0", "33333333", "66666666", "100000000"}}) {
    EXPECT_NE(with(times).find(words), std::string::npos) << with(times);
  }
  EXPECT_NE(with({"1.7e18"}).find("path.txt line 2 has the time 1.7e+18"), std::string::npos);
}

TEST(TrajectoryFile, SkipsAByteOrderMark) {
  const TemporaryFolder folder;
  write_bytes(folder / "path.txt",
              "\xef\xbb\xbf"
              "0 1 2 3 0 0 0 1\n");
  const auto loaded = load_trajectory(folder / "path.txt");
  ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
  EXPECT_EQ((*loaded)[0].X_WT, (Pose{{1, 2, 3}, {0, 0, 0, 1}}));
}

TEST(AtomicFile, KeepsThePermissionsOfTheFileItReplaces) {
  const TemporaryFolder folder;
  namespace fs = std::filesystem;
  const auto secret = fs::perms::owner_read | fs::perms::owner_write;
  write_bytes(folder / "a.txt", "old");
  fs::permissions(folder / "a.txt", secret);
  ASSERT_TRUE(write_file_atomically(folder / "a.txt", "new").has_value());
  EXPECT_EQ(fs::status(folder / "a.txt").permissions(), secret);
  EXPECT_EQ(test::read_bytes(folder / "a.txt"), "new");
}

TEST(AtomicFile, ReplacesFilesWithTheLongestNames) {
  const TemporaryFolder folder;
  for (const std::size_t length : {1, 240, 254, 255}) {
    const auto file = folder / std::string(length, 'n');
    for (const char* const text : {"old", "new"}) {
      const Status written = write_file_atomically(file, text);
      ASSERT_TRUE(written) << length << ": " << written.error().message;
      EXPECT_EQ(test::read_bytes(file), text);
    }
  }
}

// A program of the same number was killed here: in a container, every one may have that number.
TEST(AtomicFile, IsNotHeldUpByWhatWasLeftOfAnother) {
  const TemporaryFolder folder;
  write_bytes(folder / "a.txt", "old");
  const auto left = [&](int number) {
    return folder /
           (".palpate." + std::to_string(getpid()) + "." + std::to_string(number) + ".part");
  };
  for (int number = 0; number < 200; ++number) write_bytes(left(number), "half");
  const Status written = write_file_atomically(folder / "a.txt", "new");
  ASSERT_TRUE(written) << written.error().message;
  EXPECT_EQ(test::read_bytes(folder / "a.txt"), "new");
  EXPECT_EQ(test::read_bytes(left(199)), "half");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 201);
}

TEST(TrajectoryFile, NamesTheLineOfEveryMistake) {
  const TemporaryFolder folder;
  const auto expect_bad = [&](const std::string& text, const std::string& words) {
    write_bytes(folder / "bad.txt", text);
    expect_error(load_trajectory(folder / "bad.txt"), words);
  };
  const std::string good = "1 0 0 0 0 0 0 1\n";
  expect_bad("", "no pose");
  expect_bad("# only a comment\n", "no pose");
  expect_bad(good + "2 0 0 0 0 0 0\n", "line 2 has fewer");
  expect_bad(good + "\n2 0 0 0 0 0 0 1 9\n", "line 3 has more");
  expect_bad("1 0 0 zero 0 0 0 1\n", "line 1 has 'zero'");
  expect_bad("1 0 0 1,5 0 0 0 1\n", "'1,5'");
  expect_bad("1 0 0 nan 0 0 0 1\n", "'nan'");
  expect_bad("inf 0 0 0 0 0 0 1\n", "'inf'");
  expect_bad("1 0 0 0 0 0 0 0\n", "zero quaternion");
  expect_bad(good + "0.5 0 0 0 0 0 0 1\n", "line 2 goes back in time");
  expect_bad(std::string("\0\x01\xff", 3), "line 1");
  EXPECT_EQ(load_trajectory(folder / "absent.txt").error().code, Errc::not_found);
}

TEST(TrajectoryFile, TruncationsNeverCrash) {
  const TemporaryFolder folder;
  std::vector<TimedPose> poses(20);
  ASSERT_TRUE(save_trajectory(poses, folder / "path.txt").has_value());
  test::for_each_truncation(folder / "path.txt", 200,
                            [](const std::filesystem::path& cut, std::size_t) {
                              (void)load_trajectory(cut).has_value();
                            });
}

TEST(TrajectoryFile, ParsesOnePose) {
  const auto pose = parse_pose(" 1 2\t3 0 0 -3 0 ");
  ASSERT_TRUE(pose.has_value());
  EXPECT_EQ(*pose, (Pose{{1, 2, 3}, {0, 0, -1, 0}}));
  expect_error(parse_pose("1 2 3 0 0 0"), "fewer than 7");
  expect_error(parse_pose("1 2 3 0 0 0 1 1"), "more than 7");
  expect_error(parse_pose("1 2 3 0 0 0 0"), "zero quaternion");
}

TEST(TrajectoryFile, InterpolatesAndClamps) {
  const Quaternion quarter = axis_angle({0, 0, 1}, kPi / 2);
  const std::vector<TimedPose> poses{{1, {{0, 0, 0}, {}}}, {3, {{2, 0, 0}, quarter}}};
  EXPECT_EQ(pose_at(poses, 0), poses[0].X_WT);
  EXPECT_EQ(pose_at(poses, 9), poses[1].X_WT);
  const Pose middle = pose_at(poses, 2);
  EXPECT_NEAR(middle.translation.x, 1, 1e-15);
  EXPECT_NEAR(middle.rotation.z, std::sin(kPi / 8), 1e-15);
  const std::vector<TimedPose> twice{{1, {{0, 0, 0}, {}}}, {1, {{2, 0, 0}, {}}}};
  EXPECT_EQ(pose_at(twice, 1), twice[1].X_WT);
}

TEST(TrajectoryFile, LoadsRealTrajectories) {
  PALPATE_DATA_OR_SKIP(folder, "trajectories");
  const auto hand = load_trajectory(folder / "tum_fr1_xyz_handheld_100hz.txt");
  ASSERT_TRUE(hand.has_value()) << hand.error().message;
  EXPECT_EQ(hand->size(), 3000u);
  const auto camera = load_trajectory(folder / "visp_rbt_camera_in_grid_tum.txt");
  ASSERT_TRUE(camera.has_value()) << camera.error().message;
  EXPECT_EQ(camera->size(), 99u);
}

}  // namespace
}  // namespace palpate
