// Bags of ROS 1, databases of ROS 2 and what else messages are stored in: they come in the bytes of
// CDR, and damaged files give nothing but an error. Those that the programs of ROS wrote are read
// in tests/apps/bags_test.py.
#include "src/io/internal/bag_file.h"

#include <zstd.h>

#include <fstream>
#include <random>

#include <gtest/gtest.h>

#include "src/io/internal/ros_messages.h"
#include "src/io/internal/ros_types.h"
#include "tests/io/made_mcap.h"
#include "tests/io/ros1_bag_writer.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::Bytes;

constexpr std::uint64_t kTime = 12'000'000'345;

Bytes stamp() { return test::ros1_stamp(12, 345, "cam"); }

void add(Bytes& to, std::initializer_list<double> numbers) {
  for (const double number : numbers) {
    to.raw({reinterpret_cast<const char*>(&number), sizeof number});
  }
}

TEST(Ros1Messages, BecomeThoseOfRos2ToTheByte) {
  DepthFrame frame{3, 2, 0.001, {1, 2, 3, 40000, 0, 65535}};
  const std::string_view counts(reinterpret_cast<const char*>(frame.pixels.data()), 12);
  const std::string image = test::ros1_image(stamp(), 3, 2, counts);
  EXPECT_EQ(cdr_of_ros1("sensor_msgs/Image", image), image_message({kTime, "cam"}, frame));
  // RealSense puts a number behind it.
  EXPECT_EQ(cdr_of_ros1("sensor_msgs/Image", image + "1234"), image_message({kTime, "cam"}, frame));

  DepthStreamInfo stream;
  stream.width = 640;
  stream.height = 480;
  stream.intrinsics = {500, 510, 320.5, 241};
  Bytes info = stamp();
  info.number(480).number(640).text("plumb_bob").number(5);
  add(info, {0, 0, 0, 0, 0, 500, 0, 320.5, 0, 510, 241, 0, 0, 1});
  add(info, {1, 0, 0, 0, 1, 0, 0, 0, 1, 500, 0, 320.5, 0, 0, 510, 241, 0, 0, 0, 1, 0});
  for (int i = 0; i < 6; ++i) info.number(0);
  info.number(std::uint8_t{0});
  EXPECT_EQ(cdr_of_ros1("sensor_msgs/CameraInfo", info.str()),
            camera_info_message({kTime, "cam"}, stream));

  Bytes transforms;
  transforms.number(2);
  for (const char* child : {"a", "longer"}) {
    transforms.raw(test::ros1_stamp(12, 345, "world").str()).text(child);
    add(transforms, {1, 2, 3, 0, 0, 0.6, 0.8});
  }
  const Pose X{{1, 2, 3}, {0, 0, 0.6, 0.8}};
  const RosTransform both[] = {{"world", "a", X}, {"world", "longer", X}};
  EXPECT_EQ(cdr_of_ros1("tf2_msgs/TFMessage", transforms.str()), transform_message(kTime, both));

  EXPECT_FALSE(cdr_of_ros1("nav_msgs/Odometry", image)) << "it is not known";
  for (std::size_t size = 0; size < image.size(); ++size) {
    EXPECT_FALSE(cdr_of_ros1("sensor_msgs/Image", image.substr(0, size))) << size;
  }
}

TEST(Ros1Messages, ThatSayTheyAreHugeTakeNoMemory) {
  Bytes transforms;
  transforms.number(std::uint32_t{0xffffffff}).raw(stamp().str());
  EXPECT_FALSE(cdr_of_ros1("tf2_msgs/TFMessage", transforms.str()));
}

class Ros1Bag : public testing::Test {
 protected:
  Result<std::unique_ptr<BagReader>> open(const std::string& bytes) {
    std::ofstream(path_, std::ios::binary) << bytes;
    return BagReader::open(path_);
  }
  static std::string image(int number) {
    const std::string counts(2 * 4 * 3, static_cast<char>(number));
    return test::ros1_image(test::ros1_stamp(static_cast<std::uint32_t>(number), 0, "cam"), 4, 3,
                            counts);
  }
  static std::string whole() {
    std::vector<std::string> chunks;
    for (int k = 0; k < 4; ++k) {
      const auto time = static_cast<std::uint32_t>(10 + k);
      chunks.push_back(
          test::ros1_chunk(test::ros1_connection(70000, "/depth", "sensor_msgs/Image") +
                           test::ros1_message(70000, time, 5, image(k))));
      chunks.push_back(test::ros1_connection(3, "/odom", "nav_msgs/Odometry"));
      chunks.push_back(test::ros1_chunk(test::ros1_message(3, time, 6, "unknown")));
    }
    return test::ros1_bag(chunks);
  }
  const test::TemporaryFolder folder_;
  const std::filesystem::path path_ = folder_ / "x.bag";
};

TEST_F(Ros1Bag, GivesItsMessages) {
  const auto bag = open(whole()).value();
  for (int k = 0; k < 4; ++k) {
    const auto message = bag->next().value();
    ASSERT_TRUE(message);
    const McapChannel& channel = bag->channels().at(message->channel);
    EXPECT_EQ(channel.topic, "/depth");
    EXPECT_EQ(channel.schema_name, "sensor_msgs/msg/Image");
    EXPECT_EQ(message->time, (10 + static_cast<std::uint64_t>(k)) * 1'000'000'000 + 5);
    EXPECT_EQ(message->data, cdr_of_ros1("sensor_msgs/Image", image(k)));
    const auto other = bag->next().value();
    ASSERT_TRUE(other);
    EXPECT_EQ(bag->channels().at(other->channel).schema_name, "nav_msgs/msg/Odometry");
    EXPECT_EQ(other->data, "");
  }
  EXPECT_FALSE(bag->next().value());
  EXPECT_FALSE(bag->was_cut_off());
}

TEST_F(Ros1Bag, IsReadAgainFromItsBegin) {
  // A chunk of bzip2 that is there once, and gone when it is read again.
  const std::string records = test::ros1_connection(0, "/depth", "sensor_msgs/Image") +
                              test::ros1_message(0, 1, 2, image(1));
  const std::string packed = test::packed_by_bzip2(records, folder_.path());
  if (packed.empty()) GTEST_SKIP() << "SKIPPED: there is no bzip2";
  std::string bytes =
      test::ros1_bag({test::ros1_chunk(records), test::ros1_chunk(packed, "bz2", records.size())});
  const auto bag = open(bytes).value();
  const auto expect_both = [&] {
    for (int k = 0; k < 2; ++k) {
      const auto message = bag->next();
      ASSERT_TRUE(message) << message.error().message;
      ASSERT_TRUE(*message);
      EXPECT_EQ((*message)->data, cdr_of_ros1("sensor_msgs/Image", image(1)));
    }
    EXPECT_FALSE(bag->next().value());
  };
  expect_both();
  bytes.replace(bytes.find(packed), packed.size(), packed.size(), '?');
  std::ofstream(path_, std::ios::binary) << bytes;
  ASSERT_TRUE(bag->rewind());
  expect_both();
}

TEST_F(Ros1Bag, IsReadUpToWhereItWasCutOff) {
  const std::string bytes = whole();
  int most = 0;
  for (std::size_t size = bytes.size() - 1; size > 50; size -= 31) {
    const auto bag = open(bytes.substr(0, size));
    ASSERT_TRUE(bag) << size;
    int num = 0;
    for (;;) {
      const auto message = (*bag)->next();
      ASSERT_TRUE(message) << size << ": " << message.error().message;
      if (!*message) break;
      ++num;
    }
    EXPECT_LT(num, 8);
    most = std::max(most, num);
  }
  EXPECT_EQ(most, 7);
}

TEST_F(Ros1Bag, ThatIsDamagedGivesErrorsAndNoHarm) {
  std::mt19937 random(5);
  const std::string bytes = whole();
  int num_errors = 0;
  for (int round = 0; round < 500; ++round) {
    std::string damaged = bytes;
    for (int i = 0; i < 3; ++i)
      damaged[4100 + random() % (bytes.size() - 4100)] = static_cast<char>(random());
    const auto bag = open(damaged);
    ASSERT_TRUE(bag);
    for (int num = 0; num < 100; ++num) {
      const auto message = (*bag)->next();
      if (!message) {
        ++num_errors;
        EXPECT_NE(message.error().message.find(path_.string()), std::string::npos);
        EXPECT_FALSE((*bag)->next().value()) << "an error is the end";
      }
      if (!message || !*message) break;
    }
  }
  EXPECT_GT(num_errors, 25);
}

TEST_F(Ros1Bag, SaysWhatIsWrong) {
  const auto expect = [&](const std::string& bytes, const char* words) {
    auto bag = open(bytes);
    ASSERT_TRUE(bag);
    auto message = (*bag)->next();
    while (message && *message) message = (*bag)->next();
    ASSERT_FALSE(message) << words;
    EXPECT_NE(message.error().message.find(words), std::string::npos) << message.error().message;
  };
  const std::string topic = test::ros1_connection(0, "/depth", "sensor_msgs/Image");
  expect(test::ros1_bag({test::ros1_chunk(test::ros1_message(0, 1, 2, image(1)))}),
         "refers to an undeclared connection");
  expect(test::ros1_bag({test::ros1_chunk(topic, "zip")}), "compressed by 'zip'");
  expect(test::ros1_bag({test::ros1_chunk(topic, "bz2")}), "damaged");
  expect(test::ros1_bag({test::ros1_chunk(topic, "lz4")}), "damaged");
  expect("#ROSBAG V2.0\n" + test::ros1_record({{"op", test::op(3)}, {"encryptor", "x"}}, ""),
         "encrypted");
  EXPECT_NE(open("nothing").error().message.find("is not a recording"), std::string::npos);
  EXPECT_NE(open("SQLite format 3" + std::string(100, '\0')).error().message.find(path_.string()),
            std::string::npos);
  EXPECT_EQ(BagReader::open("/nowhere/x.bag").error().code, Errc::not_found);
}

// A short message comes as an empty one, for its reader to refuse; others on the topic are whole.
TEST_F(Ros1Bag, AMessageThatIsShorterThanItsFieldsIsEmpty) {
  const auto bag =
      open(test::ros1_bag({test::ros1_chunk(
               test::ros1_connection(0, "/depth", "sensor_msgs/Image") +
               test::ros1_message(0, 1, 2, "short") + test::ros1_message(0, 1, 3, image(1)))}))
          .value();
  EXPECT_EQ(bag->next().value()->data, "");
  EXPECT_EQ(bag->next().value()->data, cdr_of_ros1("sensor_msgs/Image", image(1)));
}

/// Files of a folder, and what a recording has in it: topic, type, time and message of each.
class Recordings : public testing::Test {
 protected:
  struct Got {
    std::string topic, type;
    std::uint64_t time;
    std::string data;
    friend bool operator==(const Got&, const Got&) = default;
  };
  void write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
  }
  static std::vector<Got> read(const std::filesystem::path& path) {
    const auto bag = BagReader::open(path);
    EXPECT_TRUE(bag) << bag.error().message;
    std::vector<Got> all;
    for (auto message = (*bag)->next(); message && *message; message = (*bag)->next()) {
      const McapChannel& channel = (*bag)->channels().at((*message)->channel);
      all.push_back(
          {channel.topic, channel.schema_name, (*message)->time, std::string((*message)->data)});
    }
    return all;
  }
  std::string error_of(const std::string& name) const {
    const auto bag = BagReader::open(folder_ / name);
    return bag ? "none" : bag.error().message;
  }
  /// Returns the notes of a recording, in lines.
  std::string notes_of(const std::string& name) const {
    const auto bag = BagReader::open(folder_ / name).value();
    std::string notes;
    for (const std::string& each : bag->notes()) notes += each + "\n";
    return notes;
  }
  std::string path(const char* name) const { return (folder_ / name).string(); }
  /// A part whose channels have numbers of its own.
  static std::string part(std::uint16_t number) {
    const auto id = static_cast<std::uint16_t>(7 * number);
    return test::mcap_file(
        test::mcap_channel(id, "/b", "std_msgs/msg/String") +
        test::mcap_channel(static_cast<std::uint16_t>(id + 1), "/a", "std_msgs/msg/String") +
        test::mcap_message(static_cast<std::uint16_t>(id + 1), number, "a") +
        test::mcap_message(id, number, "b"));
  }
  std::vector<std::uint64_t> times(const std::string& name) const {
    std::vector<std::uint64_t> times;
    for (const Got& each : read(folder_ / name)) {
      EXPECT_EQ("/" + each.data, each.topic);
      if (each.data == "a") times.push_back(each.time);
    }
    return times;
  }

  const test::TemporaryFolder folder_;
};

TEST_F(Recordings, PartsOfOneAreReadOneAfterTheOther) {
  std::filesystem::create_directory(folder_ / "bag");
  for (const std::uint16_t k : {10, 0, 2}) {
    write("bag/run_2024_" + std::string(k == 10 ? "11" : "09") + "_" + std::to_string(k) + ".mcap",
          part(k));
  }
  using Times = std::vector<std::uint64_t>;
  EXPECT_EQ(times("bag"), (Times{0, 2, 10}));
  // As it was noted; a file that was unpacked since, and the older way to name them.
  write("bag/metadata.yaml",
        "rosbag2_bagfile_information:\n  compression_format: ''\n  relative_file_paths:\n"
        "    - bag/run_2024_09_2.mcap\r\n    - \"run_2024_11_10.mcap.zstd\"\n"
        "    - run_2024_09_7.mcap\n  version: 4\n  topics:\n    - run_2024_09_0.mcap\n");
  EXPECT_EQ(times("bag"), (Times{2, 10}));
  EXPECT_EQ(times("bag/metadata.yaml"), (Times{2, 10}));
  // Notes of other files are none.
  write("bag/metadata.yaml", "  relative_file_paths:\n  - other.mcap\n");
  EXPECT_EQ(times("bag"), (Times{0, 2, 10}));
}

TEST_F(Recordings, PartsThatAreMissingAreNamed) {
  std::filesystem::create_directory(folder_ / "bag");
  for (const char* name : {"bag/x_0.mcap", "bag/x_2.mcap", "bag/x_6.mcap"}) write(name, part(1));
  const std::string lacks = path("bag") + " lacks parts of its recording: ";
  EXPECT_EQ(notes_of("bag"), lacks +
                                 "number 1 between x_0.mcap and x_2.mcap, number 3 to 5 "
                                 "between x_2.mcap and x_6.mcap\n");
  std::string listed = "  relative_file_paths:\n";
  for (int k = 0; k < 10; ++k) listed += "    - x_" + std::to_string(k) + ".mcap\n";
  write("bag/metadata.yaml", listed);
  EXPECT_EQ(notes_of("bag"), lacks +
                                 "x_1.mcap, x_3.mcap, x_4.mcap, x_5.mcap, x_7.mcap and 2 "
                                 "more\n");
  write("bag/metadata.yaml", "  relative_file_paths:\n    - x_0.mcap\n    - x_2.mcap\n");
  EXPECT_EQ(notes_of("bag"), "");
  EXPECT_EQ(notes_of("bag/x_0.mcap"), "");
}

TEST_F(Recordings, PartsThatAreEmptyAreLeftOut) {
  std::filesystem::create_directory(folder_ / "bag");
  for (const std::uint16_t k : {0, 2}) {
    write("bag/x_" + std::to_string(k) + ".mcap", part(k));
    write("bag/x_" + std::to_string(k + 1) + ".mcap", "");
  }
  const auto expect = [&] {
    EXPECT_EQ(times("bag"), (std::vector<std::uint64_t>{0, 2}));
    const std::string words = " is empty, as of a recorder that was killed: it is left out\n";
    EXPECT_EQ(notes_of("bag"), path("bag/x_1.mcap") + words + path("bag/x_3.mcap") + words);
  };
  expect();
  write("bag/metadata.yaml",
        "  relative_file_paths:\n  - x_0.mcap\n  - x_1.mcap\n  - x_2.mcap\n  - x_3.mcap\n");
  expect();
  for (const char* name : {"bag/x_0.mcap", "bag/x_2.mcap"}) write(name, "");
  EXPECT_NE(error_of("bag").find("x_0.mcap is empty, as of a recorder that was killed"),
            std::string::npos)
      << error_of("bag");
}

TEST_F(Recordings, OthersInOneFolderAreNotJoined) {
  for (const auto& [a, b] : {std::pair{"run_0.mcap", "other_1.mcap"},
                             {"run.mcap", "run_1.mcap"},
                             {"run_0.mcap", "run_1.db3"},
                             {"run_2024_01_0.mcap", "run_2024_02_0.mcap"}}) {
    std::filesystem::create_directory(folder_ / "bag");
    for (const std::string name : {a, b}) write("bag/" + name, part(1));
    EXPECT_NE(
        error_of("bag").find("holds 2 .mcap, .db3 and .bag files, not parts of one recording"),
        std::string::npos)
        << error_of("bag");
    std::filesystem::remove_all(folder_ / "bag");
  }
}

TEST_F(Recordings, ThatAreCompressedAsAWholeAreNamed) {
  std::filesystem::create_directory(folder_ / "bag");
  std::string packed(1000, '\0');
  packed.resize(ZSTD_compress(packed.data(), packed.size(), "MCAP", 4, 1));
  write("bag/run_0.mcap.zstd", packed);
  EXPECT_NE(error_of("bag/run_0.mcap.zstd").find("compressed as a whole; unpack it with 'zstd -d'"),
            std::string::npos);
  EXPECT_EQ(error_of("bag"), error_of("bag/run_0.mcap.zstd"));
  write("x.bag.gz", "\x1f\x8b more");
  EXPECT_NE(error_of("x.bag.gz").find("gunzip"), std::string::npos);
}

TEST_F(Recordings, MessagesThatAreCompressedOneByOneAreUnpacked) {
  const std::string text("\0\1\0\0\5\0\0\0four\0", 13);
  std::string packed(1000, '\0');
  packed.resize(ZSTD_compress(packed.data(), packed.size(), text.data(), text.size(), 1));
  write("x.mcap",
        test::mcap_file(test::mcap_channel(1, "/a", "std_msgs/msg/String") +
                        test::mcap_message(1, 5, packed) + test::mcap_message(1, 6, text) +
                        test::mcap_message(1, 7, packed.substr(0, 6))));
  const std::vector<Got> got = read(folder_ / "x.mcap");
  ASSERT_EQ(got.size(), 3u);
  EXPECT_EQ(got[0].data, text);
  EXPECT_EQ(got[1].data, text);
  EXPECT_EQ(got[2].data, "") << "damaged";
}

TEST_F(Recordings, AWindowThatIsTooWideIsNoDamage) {
  // One frame of 8 bytes whose header asks for 1 GiB to look back at.
  const std::string_view frame("\x28\xb5\x2f\xfd\0\xa0\x41\0\0four4444", 17);
  write("x.mcap", test::mcap_file(test::mcap_chunk(frame, 8, "zstd")));
  const auto bag = BagReader::open(folder_ / "x.mcap").value();
  const auto message = bag->next();
  ASSERT_FALSE(message);
  EXPECT_EQ(message.error().message.find(path("x.mcap") + ": a chunk is compressed with a window"),
            0u)
      << message.error().message;
}

TEST_F(Recordings, TypesAreKnownBySeveralNames) {
  const std::string image = test::ros1_image(stamp(), 4, 3, std::string(24, 'x'));
  const std::string cdr = cdr_of_ros1("sensor_msgs/Image", image).value();
  for (const char* name : {"sensor_msgs/Image", "sensor_msgs/msg/Image", "sensor_msgs::Image",
                           "sensor_msgs::msg::Image", "sensor_msgs::msg::dds_::Image_"}) {
    for (const bool is_ros1 : {true, false}) {
      write("x.mcap", test::mcap_file(test::mcap_channel(1, "/a", name, is_ros1 ? "ros1" : "cdr") +
                                      test::mcap_message(1, 5, is_ros1 ? image : cdr)));
      EXPECT_EQ(read(folder_ / "x.mcap"),
                (std::vector<Got>{{"/a", "sensor_msgs/msg/Image", 5, cdr}}))
          << name;
    }
  }
}

TEST_F(Recordings, MessagesOfRos1InMcapAndTypesOfOldAreThoseOfRos2) {
  const std::string counts(24, 'x');
  const std::string image = test::ros1_image(stamp(), 4, 3, counts);
  const std::string cdr = cdr_of_ros1("sensor_msgs/Image", image).value();
  write("x.mcap", test::mcap_file(test::mcap_channel(1, "/a", "sensor_msgs/Image", "ros1") +
                                  test::mcap_message(1, 5, image) +
                                  test::mcap_channel(2, "/tf", "tf/tfMessage", "ros1") +
                                  test::mcap_message(2, 6, Bytes().number(0).str()) +
                                  test::mcap_channel(3, "/b", "sensor_msgs/Image") +
                                  test::mcap_message(3, 7, cdr)));
  const std::string none = cdr_of_ros1("tf2_msgs/TFMessage", Bytes().number(0).str()).value();
  EXPECT_EQ(read(folder_ / "x.mcap"), (std::vector<Got>{{"/a", "sensor_msgs/msg/Image", 5, cdr},
                                                        {"/tf", "tf2_msgs/msg/TFMessage", 6, none},
                                                        {"/b", "sensor_msgs/msg/Image", 7, cdr}}));
}

}  // namespace
}  // namespace palpate
