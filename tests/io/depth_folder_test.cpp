#include <unistd.h>

#include <fstream>

#include <gtest/gtest.h>

#include "palpate/io/formats.h"
#include "tests/io/files.h"
#include "tests/test_util/data.h"

namespace palpate {
namespace {

using test::expect_error;
using test::TemporaryFolder;
using test::write_bytes;

const DepthFolderOptions kOptions{{525, 525, 319.5, 239.5}, 0.001, 30};

/// A tiny frame that tells its number.
void save_numbered(const std::filesystem::path& path, int number, int width = 4) {
  std::filesystem::create_directories(path.parent_path());
  DepthFrame frame{width, 3, 0.001, {}, 0};
  frame.pixels.assign(std::size_t(width) * 3, static_cast<std::uint16_t>(number));
  ASSERT_TRUE(save_depth_png(frame, path).has_value());
}

/// The numbers of all frames in order; checks that time stamps increase.
std::vector<int> numbers_of(DepthSource& source) {
  std::vector<int> numbers;
  DepthFrame frame;
  double last = -1e300;
  for (;;) {
    const auto more = source.next(frame);
    EXPECT_TRUE(more.has_value());
    if (!more || !*more) return numbers;
    EXPECT_GT(frame.timestamp, last);
    last = frame.timestamp;
    numbers.push_back(frame.pixels[0]);
  }
}

TEST(DepthFolder, PlainFolderInNaturalOrder) {
  const TemporaryFolder folder;
  for (const char* place : {"", "depth/"}) {
    const auto where = folder / "a" / place;
    save_numbered(where / "frame_10.png", 10);
    save_numbered(where / "frame_9.png", 9);
    save_numbered(where / "frame_0100.png", 100);
    save_numbered(where / "b.png", 1);
    write_bytes(where / "notes.txt", "not a frame");
    write_bytes(where / "._b.png", "of an archive of macOS");
    const auto source = open_depth_folder(folder / "a", kOptions);
    ASSERT_TRUE(source.has_value()) << source.error().message;
    EXPECT_EQ((*source)->info().num_frames, 4);
    EXPECT_EQ((*source)->info().width, 4);
    EXPECT_EQ((*source)->info().height, 3);
    EXPECT_EQ((*source)->info().rate, 30);
    EXPECT_EQ((*source)->info().intrinsics, kOptions.intrinsics);
    EXPECT_EQ(numbers_of(**source), (std::vector<int>{1, 9, 10, 100}));
    std::filesystem::remove_all(folder / "a");
  }
}

TEST(DepthFolder, TumLayout) {
  const TemporaryFolder folder;
  save_numbered(folder / "depth/x.png", 7);
  save_numbered(folder / "depth/a.png", 8);
  write_bytes(folder / "depth.txt",
              "# depth maps\r\n10.5 depth/x.png\r\n\r\n10.6\tdepth/a.png\r\n");
  const auto source = open_depth_folder(folder.path(), kOptions);
  ASSERT_TRUE(source.has_value()) << source.error().message;
  EXPECT_NEAR((*source)->info().rate, 10, 1e-9);
  DepthFrame frame;
  ASSERT_TRUE((*source)->next(frame).value());
  EXPECT_EQ(frame.timestamp, 10.5);
  EXPECT_EQ(frame.pixels[0], 7);
  ASSERT_TRUE((*source)->next(frame).value());
  EXPECT_EQ(frame.timestamp, 10.6);
  EXPECT_FALSE((*source)->next(frame).value());
  EXPECT_FALSE((*source)->next(frame).value());
}

/// As OpenCV writes it (cv2.writeOpticalFlow).
std::string flow_bytes(std::int32_t width, std::int32_t height, const std::vector<float>& uv) {
  std::string bytes = "PIEH" + test::bytes_of(width, height);
  for (const float number : uv) bytes += test::bytes_of(number);
  return bytes;
}

TEST(DepthFolder, OpticalFlowBesideIt) {
  const TemporaryFolder folder;
  for (int i = 1; i <= 3; ++i) {
    save_numbered(folder / "depth" / (std::to_string(i) + ".png"), i);
  }
  std::filesystem::create_directories(folder / "flow");
  DepthFolderOptions options = kOptions;
  options.flow = folder / "flow";
  expect_error(open_depth_folder(folder.path(), options), "NAME.flo");
  std::vector<float> uv;
  for (int i = 0; i < 24; ++i) uv.push_back(static_cast<float>(0.25 * i - 2));
  write_bytes(folder / "flow/2.flo", flow_bytes(4, 3, uv));
  const auto source = open_depth_folder(folder.path(), options);
  ASSERT_TRUE(source.has_value()) << source.error().message;
  EXPECT_TRUE((*source)->info().has_flow);
  DepthFrame frame;
  for (int i = 1; i <= 3; ++i) {
    ASSERT_TRUE((*source)->next(frame).value());
    EXPECT_EQ(frame.flow, i == 2 ? uv : std::vector<float>{}) << i;
  }
  EXPECT_FALSE((*open_depth_folder(folder.path(), kOptions))->info().has_flow);
  for (const std::string& bytes : {flow_bytes(3, 4, uv), flow_bytes(4, 3, {1, 2}),
                                   "HEIP" + flow_bytes(4, 3, uv).substr(4), std::string("PIEH")}) {
    write_bytes(folder / "flow/1.flo", bytes);
    const auto damaged = open_depth_folder(folder.path(), options);
    ASSERT_TRUE(damaged.has_value());
    expect_error((*damaged)->next(frame), "1.flo is not an optical flow of 4 x 3");
  }
}

TEST(DepthFolder, SaysWhatIsWrong) {
  const TemporaryFolder folder;
  EXPECT_EQ(open_depth_folder(folder / "absent", kOptions).error().code, Errc::not_found);
  expect_error(open_depth_folder(folder.path(), kOptions), "no depth frames");
  EXPECT_EQ(open_depth_folder(folder.path(), {}).error().code, Errc::invalid_argument);

  save_numbered(folder / "1.png", 1);
  save_numbered(folder / "2.png", 2, 5);
  expect_error(open_depth_folder(folder.path(), kOptions), "2.png is not of the same size");
  write_bytes(folder / "2.png", "no image");
  expect_error(open_depth_folder(folder.path(), kOptions), "2.png is not a 16-bit");

  std::filesystem::remove(folder / "2.png");
  std::filesystem::create_directory(folder / "2.png");
  expect_error(open_depth_folder(folder.path(), kOptions), "2.png is not a file");
  expect_error(open_depth_folder(folder / "1.png", kOptions), "1.png is not a folder");
  std::filesystem::remove(folder / "2.png");
  save_numbered(folder / "2.png", 2);
  std::filesystem::permissions(folder / "2.png", std::filesystem::perms::none);
  if (::geteuid() != 0) expect_error(open_depth_folder(folder.path(), kOptions), "cannot read");

  const auto expect_bad_list = [&](const std::string& text, const std::string& words) {
    write_bytes(folder / "depth.txt", text);
    expect_error(open_depth_folder(folder.path(), kOptions), words);
  };
  expect_bad_list("# nothing\n", "no depth frames");
  expect_bad_list("1 1.png\n1 1.png\n", "line 2 does not come after");
  expect_bad_list("2 1.png\n1 1.png\n", "line 2 does not come after");
  expect_bad_list("one 1.png\n", "line 1 is not");
  for (const std::string stamp : {"nan", "inf", "1305031453374000000", "-1e300"}) {
    expect_bad_list(stamp + " 1.png\n", "line 1 has the time stamp " + stamp +
                                            ", which is no time in seconds; give seconds");
  }
  expect_bad_list("0 1.png\n5e-324 2.png\n", "depth.txt has timestamps that are not seconds");
  expect_bad_list("0 1.png\n33333333 1.png\n66666666 1.png\n",
                  "depth.txt has timestamps that are not seconds; divide nanoseconds by 1e9");
  expect_bad_list("1\n", "line 1 is not");
  expect_bad_list("1 absent.png\n", "no such frame");
}

TEST(DepthFolder, FramesThatBreakLaterAreNamed) {
  const TemporaryFolder folder;
  save_numbered(folder / "1.png", 1);
  save_numbered(folder / "2.png", 2);
  const auto source = open_depth_folder(folder.path(), kOptions);
  ASSERT_TRUE(source.has_value());
  std::filesystem::resize_file(folder / "1.png", 50);
  save_numbered(folder / "2.png", 2, 6);
  DepthFrame frame;
  expect_error((*source)->next(frame), "1.png");
  expect_error((*source)->next(frame), "2.png is not of the size of the first frame");
}

TEST(DepthFolder, SizesOfLateFramesAreCheckedWhenTheyAreRead) {
  const TemporaryFolder folder;
  save_numbered(folder / "1.png", 1);
  save_numbered(folder / "2.png", 2, 6);
  std::ofstream list(folder / "depth.txt");
  for (int i = 0; i < 10'000; ++i) list << i << " 1.png\n";
  list << "10000 2.png\n";
  list.close();
  const auto source = open_depth_folder(folder.path(), kOptions);
  ASSERT_TRUE(source.has_value());
  DepthFrame frame;
  for (int i = 0; i < 10'000; ++i) ASSERT_TRUE((*source)->next(frame)) << i;
  expect_error((*source)->next(frame), "2.png is not of the size of the first frame");
}

TEST(DepthFolder, ReadsRealSequences) {
  PALPATE_DATA_OR_SKIP(folder, "sequences");
  for (const auto& [name, count] : {std::pair("hand_sr305_20210326-230536", 8), {"visp_rbt", 99}}) {
    const auto source = open_depth_folder(folder / name, kOptions);
    ASSERT_TRUE(source.has_value()) << source.error().message;
    EXPECT_EQ((*source)->info().num_frames, count);
    EXPECT_EQ(static_cast<int>(numbers_of(**source).size()), count);
  }
}

}  // namespace
}  // namespace palpate
