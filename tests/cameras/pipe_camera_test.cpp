// Raw frames through files, named pipes and sockets.
#include <gtest/gtest.h>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <thread>

#include "palpate/cameras/cameras.h"
#include "src/session/internal/record_stream.h"
#include "tests/cameras/conformance.h"
#include "tests/io/ros1_bag_writer.h"

namespace palpate {
namespace {

constexpr int kWidth = 32, kHeight = 24;
const std::string kSize = "?size=32x24&intrinsics=32,32,15.5,11.5";
const std::string kNoSize = "?intrinsics=32,32,15.5,11.5";

class PipeCamera : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("pipe_camera_" + std::to_string(getpid()) + "_" +
               testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string path(const char* name) const { return (folder_ / name).string(); }

  std::filesystem::path folder_;
};

std::string raw(int number, int width = kWidth, int height = kHeight) {
  const auto pixels = test::pattern(width, height, number);
  return {reinterpret_cast<const char*>(pixels.data()), 2 * pixels.size()};
}

std::string header(double time, double unit, std::uint32_t width = kWidth,
                   std::uint32_t height = kHeight) {
  std::string bytes(32, '\0');
  std::memcpy(bytes.data(), "PALPDEP1", 8);
  std::memcpy(bytes.data() + 8, &width, 4);
  std::memcpy(bytes.data() + 12, &height, 4);
  std::memcpy(bytes.data() + 16, &time, 8);
  std::memcpy(bytes.data() + 24, &unit, 8);
  return bytes;
}

void write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

TEST_F(PipeCamera, AFileGivesEveryFrameAtTheRate) {
  std::string bytes;
  for (int k = 0; k < 5; ++k) bytes += raw(k);
  write(path("raw"), bytes);
  const auto camera = open_camera("pipe:" + path("raw") + kSize + "&rate=10&unit=0.0002").value();
  EXPECT_FALSE(camera->info().is_live);
  EXPECT_EQ(camera->info().unit, 0.0002);
  DepthFrame frame;
  for (int k = 0; k < 5; ++k) {
    ASSERT_TRUE(*camera->next(frame));
    EXPECT_EQ(frame.pixels, test::pattern(kWidth, kHeight, k));
    EXPECT_DOUBLE_EQ(frame.timestamp, k / 10.0);
    EXPECT_EQ(frame.unit, 0.0002);
  }
  EXPECT_FALSE(*camera->next(frame));
}

TEST_F(PipeCamera, HeadersTellSizeTimeAndUnit) {
  const double none = std::numeric_limits<double>::quiet_NaN();
  write(path("raw"), header(5.25, 0.0001) + raw(0) + header(5.5, none) + raw(1) +
                         header(6, 0.0005, 16, 12) + raw(2, 16, 12));
  const auto camera = open_camera("pipe:" + path("raw") + kNoSize).value();
  DepthFrame frame;
  ASSERT_TRUE(*camera->next(frame));
  EXPECT_EQ(frame.timestamp, 5.25);
  EXPECT_EQ(frame.unit, 0.0001);
  EXPECT_EQ(frame.pixels, test::pattern(kWidth, kHeight, 0));
  ASSERT_TRUE(*camera->next(frame));
  EXPECT_EQ(frame.timestamp, 5.5);
  EXPECT_EQ(frame.pixels, test::pattern(kWidth, kHeight, 1));
  ASSERT_TRUE(*camera->next(frame));
  EXPECT_EQ(frame.width, kWidth);  // as before
  EXPECT_EQ(frame.unit, 0.0005);
  EXPECT_EQ(frame.pixels[2 * kWidth + 4], test::count_at(2, 1, 2));
  EXPECT_FALSE(*camera->next(frame));
  // One that is given overrules them all.
  const auto given = open_camera("pipe:" + path("raw") + kNoSize + "&unit=0.002").value();
  for (int k = 0; k < 3; ++k) {
    ASSERT_TRUE(*given->next(frame));
    EXPECT_EQ(frame.unit, 0.002);
  }
}

TEST_F(PipeCamera, SaysWhatIsWrong) {
  const auto opened = [&](const std::string& bytes, const std::string& parameters) {
    write(path("raw"), bytes);
    auto camera = open_camera("pipe:" + path("raw") + parameters);
    if (!camera) return camera.error().message;
    DepthFrame frame;
    Result<bool> got = true;
    while (got && *got) got = (*camera)->next(frame);
    return got ? std::string() : got.error().message;
  };
  const auto has = [](const std::string& text, const char* words) {
    return text.find(words) != std::string::npos;
  };
  EXPECT_EQ(opened(raw(0), kSize), "");
  EXPECT_TRUE(has(opened("", kSize), "has no frames"));
  EXPECT_TRUE(has(opened("abc", kSize), "cut off"));
  EXPECT_TRUE(has(opened(raw(0) + "ab", kSize), "cut off within a frame"));
  EXPECT_TRUE(has(opened(raw(0), kNoSize), "?size="));
  EXPECT_TRUE(has(opened(raw(0), "?size=32x24"), "?intrinsics="));
  EXPECT_TRUE(has(opened(header(0, 0.001).substr(0, 20), kNoSize), "cut off"));
  EXPECT_TRUE(has(opened(header(0, 0.001), kNoSize), "cut off"));
  EXPECT_TRUE(has(opened(header(0, 0.001, 5000, 5), kNoSize), "damaged"));
  EXPECT_TRUE(has(opened(header(0, -1), kNoSize), "damaged"));
  EXPECT_TRUE(has(opened(header(0, 1) + raw(0) + raw(1), kNoSize), "damaged"));
  constexpr double kInf = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(has(opened(header(1e308, 0.001) + raw(0), kNoSize),
                  "the time stamp of frame 0 is 1e+308 s; give seconds, or NaN for none"));
  EXPECT_TRUE(has(opened(header(1, 0.001) + raw(0) + header(-1.7e18, 0.001) + raw(1), kNoSize),
                  "the time stamp of frame 1 is -1.7e+18 s; give seconds"));
  EXPECT_TRUE(has(opened(header(kInf, 0.001) + raw(0), kNoSize), "frame 0 is inf s; give"));
  EXPECT_EQ(opened(header(1.7e9, 0.001) + raw(0), kNoSize), "");  // since 1970
  EXPECT_TRUE(has(opened(header(0, 2) + raw(0), kNoSize),
                  "the unit of frame 0 is 2 m per count; give at most 1 m, NaN for none, or"));
  EXPECT_TRUE(has(opened(header(0, 0) + raw(0), kNoSize), "damaged"));
  for (const double overruled : {2.0, 0.0, -1.0})
    EXPECT_EQ(opened(header(0, overruled) + raw(0), kNoSize + std::string("&unit=0.002")), "");
  EXPECT_TRUE(has(opened(header(0, kInf) + raw(0), kNoSize), "frame 0 is inf m per count"));
  EXPECT_TRUE(has(open_camera("pipe:" + path("nothing") + kSize).error().message, "cannot open"));
  EXPECT_TRUE(has(open_camera("pipe:" + folder_.string() + kSize).error().message, "a folder"));
}

TEST_F(PipeCamera, ANamedPipeIsLiveOrEveryFrameCounts) {
  for (const bool in_real_time : {true, false}) {
    const std::string name = path(in_real_time ? "live" : "all");
    ASSERT_EQ(mkfifo(name.c_str(), 0600), 0);
    std::thread writer([&] {
      test::sleep_seconds(0.1);  // the reader may be first
      std::ofstream pipe(name, std::ios::binary);
      for (int k = 0; k < 40; ++k) pipe << raw(k) << std::flush;
    });
    const auto camera = open_camera("pipe:" + name + kSize, {in_real_time, {}}).value();
    EXPECT_EQ(camera->info().is_live, in_real_time);
    DepthFrame frame;
    int num = 0, last = -1;
    while (*camera->next(frame)) {
      const int number = test::number_of(frame, 40);
      EXPECT_GT(number, last);
      last = number;
      ++num;
    }
    EXPECT_EQ(last, 39);
    EXPECT_TRUE(in_real_time || num == 40);
    writer.join();
  }
}

/// Whoever writes half a header and then nothing is not waited for without end.
TEST_F(PipeCamera, AWriterThatStallsWithinItsFirstHeaderIsTold) {
  const std::string name = path("stalled");
  ASSERT_EQ(mkfifo(name.c_str(), 0600), 0);
  std::atomic<bool> is_over = false;
  std::thread writer([&] {
    std::ofstream pipe(name, std::ios::binary);
    pipe << header(0, 0.001).substr(0, 12) << std::flush;
    for (int i = 0; i < 600 && !is_over; ++i) test::sleep_seconds(0.05);
  });
  const auto camera = open_camera("pipe:" + name + kNoSize);
  is_over = true;
  writer.join();
  ASSERT_FALSE(camera);
  EXPECT_NE(camera.error().message.find("has sent no whole header within 10 s"), std::string::npos)
      << camera.error().message;
}

TEST_F(PipeCamera, LiveFramesWithoutATimeStampAmongOthersCountFromTheirArrival) {
  const std::string name = path("live");
  ASSERT_EQ(mkfifo(name.c_str(), 0600), 0);
  const double none = std::numeric_limits<double>::quiet_NaN();
  std::thread writer([&] {
    std::ofstream pipe(name, std::ios::binary);
    for (int k = 0; k < 20; ++k) {
      pipe << header(k % 3 == 2 ? none : 5000 + 0.01 * k, 0.001) + raw(k) << std::flush;
      test::sleep_seconds(0.01);
    }
  });
  const auto camera = open_camera("pipe:" + name + kNoSize).value();
  DepthFrame frame;
  while (camera->next(frame).value()) {
  }
  writer.join();
  camera->cancel();
  std::string notes;
  for (const std::string& note : camera->take_notes()) notes += note + "\n";
  EXPECT_NE(notes.find("6 had time stamps that are no seconds"), std::string::npos) << notes;
  EXPECT_EQ(notes.find("restarted"), std::string::npos) << notes;
  EXPECT_EQ(notes.find("old timestamps"), std::string::npos) << notes;
}

TEST_F(PipeCamera, ASocketIsReadToo) {
  const std::string name = path("socket");
  const int server = socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, name.c_str(), sizeof address.sun_path - 1);
  ASSERT_EQ(bind(server, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(listen(server, 1), 0);
  std::thread writer([&] {
    const int client = accept(server, nullptr, nullptr);
    for (int k = 0; k < 10; ++k) {
      const std::string bytes = header(k, 0.001) + raw(k);
      EXPECT_EQ(::write(client, bytes.data(), bytes.size()), ssize_t(bytes.size()));
    }
    close(client);
  });
  const auto camera = open_camera("pipe:" + name + kNoSize, {false, {}}).value();
  DepthFrame frame;
  for (int k = 0; k < 10; ++k) {
    ASSERT_TRUE(*camera->next(frame));
    EXPECT_EQ(frame.pixels, test::pattern(kWidth, kHeight, k));
    EXPECT_EQ(frame.timestamp, k);
  }
  EXPECT_FALSE(*camera->next(frame));
  writer.join();
  close(server);
}

TEST_F(PipeCamera, AnotherSizeInMidStreamIsFollowed) {
  // The same view with half as many pixels a side: pixel (u, v) shows the one nearest to its ray.
  write(path("raw"), header(1, 0.001) + raw(0) + header(2, 0.001, kWidth / 2, kHeight / 2) +
                         raw(1, kWidth / 2, kHeight / 2) + header(3, 0.001) + raw(2));
  const auto camera = open_camera("pipe:" + path("raw") + kNoSize).value();
  DepthFrame frame;
  ASSERT_TRUE(camera->next(frame).value());
  EXPECT_EQ(frame.pixels, test::pattern(kWidth, kHeight, 0));
  ASSERT_TRUE(camera->next(frame).value());
  ASSERT_EQ(frame.width, kWidth);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      EXPECT_EQ(frame.pixels[static_cast<std::size_t>(v * kWidth + u)],
                test::count_at(u / 2, v / 2, 1));
    }
  }
  ASSERT_TRUE(camera->next(frame).value());
  EXPECT_EQ(frame.pixels, test::pattern(kWidth, kHeight, 2));
  EXPECT_FALSE(camera->next(frame).value());
}

TEST_F(PipeCamera, TenThousandFramesTakeNoMemoryNorInABag) {
  std::ofstream file(path("raw"), std::ios::binary);
  for (int k = 0; k < 10000; ++k) file << header(1 + k / 30.0, 0.001) + raw(k);
  file.close();
  const std::string uri = "pipe:" + path("raw") + kNoSize;
  test::expect_no_growth(*open_camera(uri).value(), 10000);
  // Read once more from what palpate record makes of it, exact to the count.
  const auto recorded = record_stream(*open_camera(uri).value(), path("bag.mcap"));
  ASSERT_TRUE(recorded) << recorded.error().message;
  const auto open = [&] { return open_camera("bag:" + path("bag.mcap")); };
  test::expect_recording(open, 10000, kWidth, kHeight);
  test::expect_no_growth(*open().value(), 10000);
  // A bag that ends in the middle of a message.
  std::filesystem::resize_file(path("bag.mcap"), std::filesystem::file_size(path("bag.mcap")) / 2);
  const auto cut = open();
  DepthFrame frame;
  Result<bool> got = true;
  int num = 0;
  while (cut && got && *got && num < 10000) {
    got = (*cut)->next(frame);
    ++num;
  }
  EXPECT_LT(num, 9000) << "frames that are not there";
}

/// Two would write into the same file.
TEST_F(PipeCamera, IsNotRecordedToAFileThatAnotherProgramRecordsTo) {
  std::ofstream(path("raw"), std::ios::binary) << header(1, 0.001) + raw(0);
  const std::string uri = "pipe:" + path("raw") + kNoSize;
  const std::string partial = path("bag.mcap") + ".partial";
  const int other = open(partial.c_str(), O_WRONLY | O_CREAT, 0600);
  ASSERT_EQ(flock(other, LOCK_EX), 0);
  const auto refused = record_stream(*open_camera(uri).value(), path("bag.mcap"));
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message, "another program is recording to " + path("bag.mcap") +
                                         "; give another name, or wait until that has ended");
  EXPECT_TRUE(std::filesystem::exists(partial));
  close(other);  // It was killed.
  EXPECT_TRUE(record_stream(*open_camera(uri).value(), path("bag.mcap")));
  EXPECT_FALSE(std::filesystem::exists(partial));
}

TEST_F(PipeCamera, LiveCamerasAreRecordedTogetherThoughOneFallsSilent) {
  const auto one = PushedSource::create(test::stream_info(kWidth, kHeight)).value();
  const auto two = PushedSource::create(test::stream_info(kWidth, kHeight)).value();
  std::atomic<bool> is_over = false;
  std::atomic<std::uint64_t> num_recorded = 0;
  std::thread pushing([&] {
    for (int k = 0; !is_over; ++k) {
      DepthFrame frame = test::pattern_frame(kWidth, kHeight, k, 0);
      one->push(frame);
      frame = test::pattern_frame(kWidth, kHeight, k, 0);
      if (num_recorded < 6) two->push(frame);
      test::sleep_seconds(0.002);
    }
  });
  RecordStreamOptions options;
  options.duration = 2;
  options.keep_going = [&](double, std::uint64_t num) {
    num_recorded = num;
    return true;
  };
  const DepthSources both({one.get(), two.get()});
  const auto done = record_stream(both, path("live.mcap"), options);
  is_over = true;
  pushing.join();
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_GT(done->frames_of[0], done->frames_of[1]);
  EXPECT_GT(done->frames_of[1], 0u);
  for (const int camera : {0, 1}) {
    const auto bag = open_camera("bag:" + path("live.mcap") + "?topic=/camera" +
                                 (camera == 0 ? "" : "_2") + "/depth/image_rect_raw");
    ASSERT_TRUE(bag) << bag.error().message;
    DepthFrame frame;
    int last = -1;
    std::uint64_t num = 0;
    for (; (*bag)->next(frame).value(); ++num) {
      const int number = test::number_of(frame, 100000);
      EXPECT_GT(number, last);
      last = number;
    }
    EXPECT_EQ(num, done->frames_of[static_cast<std::size_t>(camera)]);
  }
}

TEST_F(PipeCamera, TenThousandFramesOfABagOfRos1TakeNoMemory) {
  std::vector<std::string> chunks;
  for (int k = 0; k < 10000; ++k) {
    const auto stamp = test::ros1_stamp(static_cast<std::uint32_t>(1 + k / 30),
                                        static_cast<std::uint32_t>(k % 30 * 33'333'333), "c");
    chunks.push_back(test::ros1_chunk(
        test::ros1_connection(1, "/depth", "sensor_msgs/Image") +
        test::ros1_message(1, 1, 1, test::ros1_image(stamp, kWidth, kHeight, raw(k)))));
  }
  std::ofstream(path("bag"), std::ios::binary) << test::ros1_bag(chunks);
  chunks.clear();
  const auto open = [&] { return open_camera("bag:" + path("bag") + kNoSize); };
  test::expect_recording(open, 10000, kWidth, kHeight);
  test::expect_no_growth(*open().value(), 10000);
}

}  // namespace
}  // namespace palpate
