// Bags of ROS 1 and databases of ROS 2: messages in the bytes of CDR, whatever they were stored in,
// and nothing but an error of damaged ones. Those that the programs of ROS wrote are read in
// tests/apps/bags_test.py.
#include "src/io/internal/bag_file.h"

#include <fstream>
#include <random>

#include <gtest/gtest.h>

#include "src/io/ros1_messages.h"
#include "src/io/ros_messages.h"
#include "tests/io/ros1_bag_writer.h"

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
  void TearDown() override { std::filesystem::remove(path_); }
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
  const std::filesystem::path path_ =
      std::filesystem::temp_directory_path() / ("palpate_" + std::to_string(getpid()) + ".bag");
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
  expect(test::ros1_bag({test::ros1_chunk(topic + test::ros1_message(0, 1, 2, "short"))}),
         "shorter than a sensor_msgs/Image");
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

}  // namespace
}  // namespace palpate
