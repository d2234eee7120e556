// A robot on another maker's DDS: eProsima Fast DDS, the default of ROS 2. Publishes depth images
// with camera_info and the tool's pose, and reads the wrench. Prints what it saw as JSON.
//
// usage: fastdds_peer DOMAIN WIDTH HEIGHT [IMAGES_PER_SECOND [looks|arm|joints|still|cloud|loose]],
// until the standard input ends; the viewer also requests points and spheres. A bent wall stands
// still, and comes as images, as organized clouds, or as loose points in any order; its stamps are
// exactly the period apart, and none is left out. An arm tells where the tool is by tf, whose fixed
// part it says once, before anybody hears it; it keeps contacts, transforms and markers that come,
// to the last of which it subscribes late, and prints their bytes. An arm with joints shows its
// hand in the middle of the images, tells its joint positions but for half a second of every two,
// and keeps what comes from a guard. Standard error tells that it has begun, and when it has seen
// enough for a test.
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "src/io/internal/cdr.h"
#include "src/io/internal/ros_image.h"
#include "src/io/internal/ros_messages.h"
#include "src/io/internal/ros_types.h"
#include "tests/io/made_cloud.h"

namespace fast = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using Clock = std::chrono::system_clock;

namespace {

double now() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }
std::uint64_t nanoseconds(double seconds) { return static_cast<std::uint64_t>(1e9 * seconds); }

/// Bytes of a message, as they are.
class RawType final : public fast::TopicDataType {
 public:
  RawType(const std::string& type, std::uint32_t most) {
    setName(palpate::dds_type_name(type).c_str());
    m_typeSize = most;
    m_isGetKeyDefined = false;
  }
  bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
    const auto& message = *static_cast<std::string*>(data);
    if (payload->max_size < message.size()) return false;
    std::memcpy(payload->data, message.data(), message.size());
    payload->length = static_cast<std::uint32_t>(message.size());
    payload->encapsulation = CDR_LE;
    return true;
  }
  bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
    static_cast<std::string*>(data)->assign(reinterpret_cast<char*>(payload->data),
                                            payload->length);
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<std::uint32_t>(static_cast<std::string*>(data)->size()); };
  }
  void* createData() override { return new std::string; }
  void deleteData(void* data) override { delete static_cast<std::string*>(data); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

/// Counts wrenches, and how long one takes from an image that shows contact to the first force.
/// Their times apart are told twice: as they came here, and as their writer stamped them.
class WrenchListener final : public fast::DataReaderListener {
 public:
  void on_data_available(fast::DataReader* reader) override {
    std::string message;
    fast::SampleInfo info;
    while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      const double time = now();
      const auto number = static_cast<long long>(info.sample_identity.sequence_number().to64long());
      palpate::CdrReader from(message);
      const double stamp = palpate::read_ros_header(from).time;
      palpate::Vec3d said, torque;
      for (int axis = 0; axis < 3; ++axis) said[axis] = from.number<double>();
      for (int axis = 0; axis < 3; ++axis) torque[axis] = from.number<double>();
      const double force = dot(said, said);
      const double sent = 1e-9 * static_cast<double>(info.source_timestamp.to_ns());
      const std::lock_guard lock(mutex_);
      if (num_ == 0) first_ = number;
      if (num_ > 0) {
        gaps_.push_back(time - last_time_);
        sent_gaps_.push_back(sent - last_sent_);
      }
      delays_.push_back(time - stamp);
      last_sent_ = sent;
      last_ = std::max(last_, number);
      last_time_ = time;
      ++num_;
      num_touching_ += force > 0 ? 1 : 0;
      if (force > 0) force_ = said;
      if (force > 0) torque_ = torque;
      if (force > 0 && shown_ > 0) {
        latencies_.push_back(time - shown_);
        sent_latencies_.push_back(sent - shown_);
        shown_ = 0;
      }
      is_touching_ = force > 0;
    }
  }
  /// An image is about to be sent that shows contact, or none.
  void show(bool is_contact) {
    const std::lock_guard lock(mutex_);
    shown_ = is_contact && !is_touching_ ? now() : 0;
  }
  bool has_heard() {
    const std::lock_guard lock(mutex_);
    return num_ > 0;
  }
  bool has_enough() {
    const std::lock_guard lock(mutex_);
    return num_ > 1000 && num_touching_ > 100;
  }
  void print(int num_images, int num_looked_at, const std::string& messages) {
    const std::lock_guard lock(mutex_);
    std::printf(
        "{\"images\": %d, \"wrenches\": %lld, \"lost\": %lld, \"touching\": %lld, "
        "\"seconds\": %.3f, \"gap_ms\": [%.3f, %.3f, %.3f], \"sent_gap_ms\": [%.3f, %.3f, %.3f], "
        "\"delay_ms\": [%.3f, %.3f, %.3f], "
        "\"image_to_wrench_ms\": [%.3f, %.3f, %.3f], \"image_to_sent_ms\": [%.3f, %.3f, %.3f], "
        "\"measured\": %zu, \"looked_at\": %d, \"force\": [%.9g, %.9g, %.9g], "
        "\"torque\": [%.9g, %.9g, %.9g], \"messages\": {%s}}\n",
        num_images, num_, num_ > 0 ? last_ - first_ + 1 - num_ : 0, num_touching_, sum(gaps_),
        part(gaps_, 0.5), part(gaps_, 0.99), part(gaps_, 1), part(sent_gaps_, 0.5),
        part(sent_gaps_, 0.99), part(sent_gaps_, 1), part(delays_, 0.5), part(delays_, 0.99),
        part(delays_, 1), part(latencies_, 0.5), part(latencies_, 0.99), part(latencies_, 1),
        part(sent_latencies_, 0.5), part(sent_latencies_, 0.99), part(sent_latencies_, 1),
        latencies_.size(), num_looked_at, force_.x, force_.y, force_.z, torque_.x, torque_.y,
        torque_.z, messages.c_str());
  }

 private:
  static double sum(const std::vector<double>& values) {
    double all = 0;
    for (const double value : values) all += value;
    return all;
  }
  /// ms
  static double part(std::vector<double> values, double share) {
    if (values.empty()) return 0;
    const auto at = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at),
                     values.end());
    return 1e3 * values[at];
  }

  std::mutex mutex_;
  long long num_ = 0, first_ = 0, last_ = 0, num_touching_ = 0;
  double last_time_ = 0, last_sent_ = 0, shown_ = 0;
  bool is_touching_ = false;
  palpate::Vec3d force_, torque_;  // the last ones in contact, N, N m
  std::vector<double> gaps_, sent_gaps_, delays_, latencies_, sent_latencies_;
};

/// Keeps what comes.
class RecordingObserver final : public fast::DataReaderListener {
 public:
  void on_data_available(fast::DataReader* reader) override {
    std::string message;
    fast::SampleInfo info;
    while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
      const std::lock_guard lock(mutex_);
      if (info.valid_data) messages_.push_back(message);
    }
  }
  std::size_t num() {
    const std::lock_guard lock(mutex_);
    return messages_.size();
  }
  bool has_newest_with(const std::string& words) {
    const std::lock_guard lock(mutex_);
    return !messages_.empty() && messages_.back().find(words) != std::string::npos;
  }
  /// "name": ["hexadecimal digits", ...]
  std::string reported(const std::string& name) {
    const std::lock_guard lock(mutex_);
    std::string text = "\"" + name + "\": [";
    for (const std::string& message : messages_) {
      text += text.ends_with('[') ? "\"" : ", \"";
      for (const char byte : message) {
        text += "0123456789abcdef"[static_cast<unsigned char>(byte) >> 4];
        text += "0123456789abcdef"[byte & 15];
      }
      text += '"';
    }
    return text + "]";
  }

 private:
  std::mutex mutex_;
  std::vector<std::string> messages_;
};

/// Counts what comes.
class Dropper final : public fast::DataReaderListener {
 public:
  void on_data_available(fast::DataReader* reader) override {
    std::string message;
    fast::SampleInfo info;
    while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) ++num_;
  }
  int num() const { return num_; }

 private:
  std::atomic<int> num_ = 0;
};

/// A bent wall, in counts of a millimeter, deepest in the middle of the tool.
palpate::DepthFrame bent_wall(int width, int height) {
  palpate::DepthFrame frame{width, height, 0.001, {}};
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const double x = 2.0 * u / width - 1, y = 2.0 * v / height - 1;
      frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(485 + 60 * (x * x + y * y))));
    }
  }
  return frame;
}

/// The points of an image as a message: organized, or in any order without those of no measurement.
std::string cloud_of(const palpate::DepthFrame& frame, const palpate::Intrinsics& k,
                     bool is_organized) {
  palpate::CloudPoints cloud{frame.width, frame.height, {}, {}};
  for (std::size_t i = 0; i < frame.pixels.size(); ++i) {
    const auto width = static_cast<std::size_t>(frame.width);
    const double z = frame.unit * frame.pixels[i];
    cloud.points.push_back(
        palpate::to_float({(static_cast<double>(i % width) - k.cx) / k.fx * z,
                           (static_cast<double>(i / width) - k.cy) / k.fy * z, z}));
  }
  if (!is_organized) {
    std::shuffle(cloud.points.begin(), cloud.points.end(), std::mt19937(1));
    cloud.width = static_cast<int>(cloud.points.size());
    cloud.height = 1;
  }
  palpate::test::CloudLayout layout;
  layout.point_step = 16;
  return palpate::test::cloud_message(cloud.view(), layout, 1, "camera");
}

/// Sets the stamp of a message that begins with a header.
void set_stamp(std::string& message, std::uint64_t time) {
  const std::uint32_t stamp[] = {static_cast<std::uint32_t>(time / 1'000'000'000),
                                 static_cast<std::uint32_t>(time % 1'000'000'000)};
  std::memcpy(message.data() + 4, stamp, sizeof stamp);
}

struct Robot {
  fast::DomainParticipant* participant = nullptr;
  fast::Publisher* publisher = nullptr;
  fast::Subscriber* subscriber = nullptr;

  explicit Robot(std::uint32_t domain) {
    fast::DomainParticipantQos qos = fast::PARTICIPANT_QOS_DEFAULT;
    const auto loopback = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    loopback->interfaceWhiteList.emplace_back("127.0.0.1");
    loopback->sendBufferSize = loopback->receiveBufferSize = 4 << 20;
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(loopback);
    participant = fast::DomainParticipantFactory::get_instance()->create_participant(domain, qos);
    publisher = participant->create_publisher(fast::PUBLISHER_QOS_DEFAULT);
    subscriber = participant->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT);
  }
  fast::Topic* topic(const std::string& name, const std::string& type, std::uint32_t most) {
    if (auto* const known = participant->lookup_topicdescription("rt" + name)) {
      return dynamic_cast<fast::Topic*>(known);
    }
    const fast::TypeSupport support(new RawType(type, most));
    support.register_type(participant);
    return participant->create_topic("rt" + name, support.get_type_name(), fast::TOPIC_QOS_DEFAULT);
  }
  fast::DataWriter* writer(const std::string& name, const std::string& type, std::uint32_t most,
                           bool is_kept = false) {
    fast::DataWriterQos qos = fast::DATAWRITER_QOS_DEFAULT;
    if (is_kept) qos.durability().kind = fast::TRANSIENT_LOCAL_DURABILITY_QOS;
    qos.reliability().kind = fast::RELIABLE_RELIABILITY_QOS;
    qos.history().depth = 5;
    qos.publish_mode().kind = fast::ASYNCHRONOUS_PUBLISH_MODE;
    qos.endpoint().history_memory_policy = rtps::DYNAMIC_RESERVE_MEMORY_MODE;
    return publisher->create_datawriter(topic(name, type, most), qos);
  }
  fast::DataReader* reader(const std::string& name, const std::string& type, std::uint32_t most,
                           fast::DataReaderListener* listener, bool is_kept = false) {
    fast::DataReaderQos qos = fast::DATAREADER_QOS_DEFAULT;
    if (is_kept) qos.durability().kind = fast::TRANSIENT_LOCAL_DURABILITY_QOS;
    qos.reliability().kind = fast::RELIABLE_RELIABILITY_QOS;
    qos.history().depth = 1000;
    qos.endpoint().history_memory_policy = rtps::DYNAMIC_RESERVE_MEMORY_MODE;
    return subscriber->create_datareader(topic(name, type, most), qos, listener);
  }
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr,
                 "usage: fastdds_peer DOMAIN WIDTH HEIGHT [IMAGES_PER_SECOND "
                 "[looks|arm|joints|still|cloud|loose]]\n");
    return 2;
  }
  const double rate = argc > 4 ? std::atof(argv[4]) : 30;
  palpate::DepthFrame frame;
  frame.width = std::atoi(argv[2]);
  frame.height = std::atoi(argv[3]);
  palpate::DepthStreamInfo stream;
  stream.width = frame.width;
  stream.height = frame.height;
  stream.intrinsics = {0.8 * frame.width, 0.8 * frame.width, 0.5 * frame.width - 0.5,
                       0.5 * frame.height - 0.5};
  const auto num_pixels = static_cast<std::size_t>(frame.width * frame.height);

  Robot robot(static_cast<std::uint32_t>(std::atoi(argv[1])));
  WrenchListener listener;
  robot.reader("/palpate/wrench", "geometry_msgs/WrenchStamped", 1024, &listener);
  Dropper dropper;
  const std::string part = argc > 5 ? argv[5] : "";
  const bool is_arm = part == "arm", has_joints = part == "joints";
  const bool is_cloud = part == "cloud" || part == "loose";
  const bool is_still = is_cloud || part == "still";
  if (part == "looks") {
    robot.reader("/palpate/points", "sensor_msgs/PointCloud2", 1 << 20, &dropper);
    robot.reader("/palpate/spheres", "visualization_msgs/MarkerArray", 1 << 20, &dropper);
  }
  auto* const images = robot.writer("/camera/depth/image_raw", "sensor_msgs/Image",
                                    static_cast<std::uint32_t>(2 * num_pixels + 1024));
  auto* const infos = robot.writer("/camera/depth/camera_info", "sensor_msgs/CameraInfo", 4096);
  fast::DataWriter* clouds = nullptr;
  std::string cloud;
  if (is_still) frame = bent_wall(frame.width, frame.height);
  if (is_cloud) {
    cloud = cloud_of(frame, stream.intrinsics, part == "cloud");
    clouds = robot.writer("/camera/depth/points", "sensor_msgs/PointCloud2",
                          static_cast<std::uint32_t>(cloud.size()));
  }
  auto* const poses = robot.writer("/tool_pose", "geometry_msgs/PoseStamped", 1024);
  RecordingObserver contacts, transforms, markers, guards, clearances, scales;
  fast::DataWriter *moving = nullptr, *joints = nullptr;
  if (has_joints) {
    robot.reader("/palpate/guard", "palpate_msgs/Guard", 4096, &guards);
    robot.reader("/palpate/clearance", "std_msgs/Float64", 64, &clearances);
    robot.reader("/servo/scale", "std_msgs/Float64", 64, &scales);
    joints = robot.writer("/joint_states", "sensor_msgs/JointState", 1024);
  }
  if (is_arm) {
    robot.reader("/palpate/contact", "palpate_msgs/Contact", 4096, &contacts);
    robot.reader("/tf", "tf2_msgs/TFMessage", 4096, &transforms);
    moving = robot.writer("/tf", "tf2_msgs/TFMessage", 4096);
    auto* const fixed = robot.writer("/tf_static", "tf2_msgs/TFMessage", 4096, true);
    const palpate::RosTransform stands[] = {{"base", "camera", {}}};
    std::string message = palpate::transform_message(nanoseconds(now()), stands);
    fixed->write(&message);
  }
  bool has_requested_markers = false;

  // The tool stays at 0.5 m; every fourth part of a second the wall comes to it and goes again.
  std::atomic<bool> has_ended = false;
  std::thread([&has_ended] {
    while (std::getchar() != EOF) {
    }
    has_ended = true;
  }).detach();
  const double begin = now();
  int num_images = 0;
  double next_image = begin, next_pose = begin;
  bool has_told_enough = false;
  std::fputs("begun\n", stderr);
  while (!has_ended) {
    std::this_thread::sleep_for(
        std::chrono::duration<double>(std::min(next_image, next_pose) - now()));
    const double time = now();
    if (time >= next_pose) {
      next_pose = std::max(next_pose + 0.005, time);
      const palpate::Pose X{{0, 0, 0.5}, {}};
      std::string pose = palpate::pose_message({nanoseconds(time), "camera"}, X);
      poses->write(&pose);
      const palpate::RosTransform transform[] = {{"base", "tool0", X}};
      std::string reported = palpate::transform_message(nanoseconds(time), transform);
      if (is_arm) moving->write(&reported);
      if (has_joints && std::fmod(time - begin, 2) < 1.5) {
        const std::string names[] = {"turn", "wheel", "slide"};
        const double positions[] = {0, 5, 0.1};
        std::string state =
            palpate::joint_state_message({nanoseconds(time), "base"}, names, positions);
        joints->write(&state);
      }
      if (is_arm && !has_requested_markers && listener.has_heard()) {
        has_requested_markers = true;
        robot.reader("/palpate/markers", "visualization_msgs/MarkerArray", 1 << 20, &markers, true);
      }
    }
    if (is_still && time >= next_image) {
      const std::uint64_t stamp = nanoseconds(next_image);
      next_image += 1 / rate;
      ++num_images;
      if (is_cloud) {
        set_stamp(cloud, stamp);
        clouds->write(&cloud);
      } else {
        std::string info = palpate::camera_info_message({stamp, "camera"}, stream);
        std::string image = palpate::image_message({stamp, "camera"}, frame);
        infos->write(&info);
        images->write(&image);
      }
    } else if (time >= next_image) {
      next_image = std::max(next_image + 1 / rate, time - std::max(1 / rate, 0.05));
      const bool is_contact = num_images / std::max(1, static_cast<int>(rate / 4)) % 2 == 1;
      frame.pixels.assign(num_pixels, is_contact ? 490 : 700);
      for (int v = -4; has_joints && v < 4; ++v) {
        for (int u = -4; u < 4; ++u) {
          const int pixel = (frame.height / 2 + v) * frame.width + frame.width / 2 + u;
          frame.pixels[static_cast<std::size_t>(pixel)] = 380;
        }
      }
      const palpate::RosHeader header{nanoseconds(time), "camera"};
      std::string info = palpate::camera_info_message(header, stream);
      std::string image = palpate::image_message(header, frame);
      infos->write(&info);
      if (num_images % std::max(1, static_cast<int>(rate / 4)) == 0) listener.show(is_contact);
      images->write(&image);
      ++num_images;
    }
    if (!has_told_enough && (has_joints ? guards.num() > 500 : listener.has_enough())) {
      has_told_enough = true;
      std::fputs("enough\n", stderr);
    }
  }
  // The last word may still be on its way.
  const std::string end = "the run has ended";
  for (int k = 0;
       k < 1000 && ((is_arm && !contacts.has_newest_with(end)) ||
                    (has_joints && (!guards.has_newest_with(end) || scales.num() < guards.num())));
       ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  listener.print(num_images, dropper.num(),
                 contacts.reported("contact") + ", " + transforms.reported("tf") + ", " +
                     markers.reported("markers") + ", " + guards.reported("guard") + ", " +
                     clearances.reported("clearance") + ", " + scales.reported("scale"));
  std::fflush(stdout);
  std::_Exit(0);
}
