// Depth from a topic of ROS 2: Image or compressedDepth, with its CameraInfo, or PointCloud2, and
// where the camera is by tf.
#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/messages/cloud_messages.h"
#include "src/cameras/messages/depth_messages.h"
#include "src/cameras/messages/received_messages.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/core/internal/shared_library.h"
#include "src/io/internal/ros_image.h"
#include "src/ros/internal/dds_api.h"
#include "src/ros/internal/ros_node.h"

namespace palpate { inline namespace v0 {
namespace {

using namespace std::chrono_literals;

constexpr double kFirstImage = 10;     // s, while opening
constexpr double kDiscovery = 0.5;     // s: publishers that are there are found
constexpr double kLongestSilence = 2;  // s without an image until a note
constexpr char kClouds[] = "sensor_msgs/PointCloud2";

double seconds_since_1970() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

class Ros2Source final : public DepthSource {
 public:
  static Result<std::unique_ptr<Ros2Source>> open(const CameraUri& uri,
                                                  const CameraOpening& opening) {
    const auto scale = scale_of_numbers(uri);
    if (!scale) return scale.error();
    auto node = RosNode::join();
    if (!node) return node.error();
    std::unique_ptr<Ros2Source> source(new Ros2Source(uri, *scale, *node));
    if (const Status status = source->set_clock(); !status) return status.error();
    if (const Status status = source->listen(); !status) return status.error();
    if (const Status status = source->wait_for_first(opening); !status) return status.error();
    return source;
  }

  const DepthStreamInfo& info() const override { return info_; }
  void cancel() noexcept override { received_.cancel(); }
  std::vector<std::string> take_notes() override { return received_.take_notes(); }
  StampClock stamps() const { return clock_; }
  std::optional<Pose> projection() const {
    return clouds_ ? clouds_->camera()->projection() : std::nullopt;
  }

  Result<bool> next(DepthFrame& frame) override {
    if (has_first_) {
      has_first_ = false;
      frame = std::move(first_);
      return true;
    }
    while (!received_.is_cancelled()) {
      if (read(frame)) return true;
      // The sender may come back: DDS finds it again by itself.
      if (monotonic_now() - last_image_ > kLongestSilence) {
        received_.add_note("has stopped sending images; they are used again when it resumes");
      }
    }
    return false;
  }

 private:
  Ros2Source(const CameraUri& uri, double scale, std::shared_ptr<RosNode> node)
      : uri_(uri),
        topic_(uri.target.starts_with('/') ? uri.target : "/" + uri.target),
        is_compressed_(ros_image_topic(topic_) != topic_),
        scale_(scale),
        node_(std::move(node)) {
    const auto given = uri.extras.find("info");
    info_topic_ = given == uri.extras.end()
                      ? std::string(ros_parent(ros_image_topic(topic_))) + "/camera_info"
                      : given->second;
    if (!info_topic_.starts_with('/')) info_topic_.insert(0, "/");
    info_.name = "ros2:" + topic_;
    info_.rate = uri.rate.value_or(30);
    info_.unit = uri.unit.value_or(info_.unit);
    info_.is_live = true;
    if (const auto world = uri.extras.find("world"); world != uri.extras.end()) {
      world_ = world->second;
    }
    if (const auto frame = uri.extras.find("frame"); frame != uri.extras.end()) {
      camera_ = frame->second;
    }
  }

  Status set_clock() {
    const auto given = uri_.extras.find("clock");
    if (given == uri_.extras.end() || given->second == "own") return Done{};
    clock_ = given->second == "shared" ? StampClock::shared : StampClock::none;
    if (given->second == "shared" || given->second == "arrival") return Done{};
    return Error{Errc::invalid_argument, "camera " + uri_.text +
                                             ": clock is own, shared or arrival, not '" +
                                             given->second.substr(0, 40) + "'"};
  }

  Status listen() {
    if (const auto given = uri_.extras.find("qos"); given != uri_.extras.end()) {
      qos_.is_reliable = given->second == "reliable";
      if (!qos_.is_reliable && given->second != "best_effort") {
        return Error{Errc::invalid_argument, "camera " + uri_.text +
                                                 ": qos is reliable or best_effort, not '" +
                                                 given->second.substr(0, 40) + "'"};
      }
    }
    if (const Status status =
            listen_to(is_compressed_ ? "sensor_msgs/CompressedImage" : "sensor_msgs/Image");
        !status) {
      return status;
    }
    auto infos =
        node_->subscribe(info_topic_, "sensor_msgs/CameraInfo", qos_,
                         [this](std::string_view message) { received_.camera_info(message); });
    if (!infos) return infos.error();
    infos_ = *std::move(infos);
    if (world_.empty()) return Done{};
    const auto subscribe_tf = [&](const char* topic, bool is_static,
                                  std::unique_ptr<RosSubscription>& to) -> Status {
      auto subscription = node_->subscribe(topic, "tf2_msgs/TFMessage", {true, is_static, 100},
                                           [this, is_static](std::string_view message) {
                                             received_.transforms(message, is_static);
                                           });
      if (!subscription) return subscription.error();
      to = *std::move(subscription);
      return Done{};
    };
    if (const Status status = subscribe_tf("/tf", false, transforms_); !status) return status;
    return subscribe_tf("/tf_static", true, statics_);
  }

  Status listen_to(const char* type) {
    auto images = node_->subscribe(topic_, type, qos_,
                                   [this](std::string_view message) { received_.image(message); });
    if (!images) return images.error();
    images_ = *std::move(images);
    return Done{};
  }

  /// Listens to clouds once it is known that the topic has them, and no images.
  Status follow_type() {
    const std::vector<RosTopic> topics = node_->topics();
    const auto has = [&](const char* type) {
      return std::ranges::find(topics, RosTopic{topic_, type}) != topics.end();
    };
    if (clouds_ || !has(kClouds) || has("sensor_msgs/Image")) return Done{};
    const auto options = cloud_options(uri_);
    if (!options) return options.error();
    clouds_.emplace(*options, scale_);
    infos_.reset();
    images_.reset();
    received_.forget_lens();
    return listen_to(kClouds);
  }

  /// Says what the images are like. Error: none has come, or none that is understood.
  Status wait_for_first(const CameraOpening& opening) {
    const double begin = monotonic_now();
    bool has_reported = !opening.on_wait;
    while (monotonic_now() - begin < kFirstImage) {
      if (!has_reported && monotonic_now() - begin > kDiscovery) {
        has_reported = true;
        opening.on_wait(info_.name +
                        " waits up to 10 s for its first depth image: " + what_there_is());
      }
      if (const Status status = follow_type(); !status) return status;
      if (!read(first_)) {
        if (refused_) return Error{refused_->code, info_.name + ": " + refused_->message};
        continue;
      }
      if (const Status status = clouds_ ? Done{} : check_for_images(uri_); !status) return status;
      has_first_ = true;
      info_.width = first_.width;
      info_.height = first_.height;
      info_.unit = first_.unit;
      is_open_ = info_.intrinsics.fx > 0 || uri_.intrinsics;
      if (is_open_) return Done{};
    }
    std::string why;
    for (const std::string& note : received_.take_notes()) why += ": " + note;
    if (is_unplaced_) {
      return Error{Errc::unavailable, info_.name + " sends images, but tf has no transform for '" +
                                          camera_ + "' in '" + world_ + "' at their stamps; " +
                                          received_.frames()};
    }
    if (has_first_) {
      return Error{Errc::unavailable, info_.name + " sends images, but " + info_topic_ +
                                          " has sent no intrinsics within 10 s" + why +
                                          "; give ?info=/TOPIC or ?intrinsics=fx,fy,cx,cy"};
    }
    return Error{Errc::unavailable, info_.name + " has sent no depth image within 10 s" + why +
                                        (why.empty() ? "; " + what_there_is() : "")};
  }

  std::string what_there_is() const {
    std::vector<std::string> others;
    for (const RosTopic& topic : node_->topics()) {
      if (topic.type == "sensor_msgs/Image" || topic.type == "sensor_msgs/CompressedImage" ||
          topic.type == kClouds) {
        others.push_back(topic.name);
      }
    }
    if (images_->num_writers() > 0) return "the topic has a publisher that sends nothing";
    return others.empty() ? "there is no publisher of images; check ROS_DOMAIN_ID, the network and "
                            "ROS_LOCALHOST_ONLY"
                          : "there are images on " + listed(others);
  }

  /// False: no image now, or one that is not understood, with one note.
  bool read(DepthFrame& frame) {
    if (!received_.take(image_)) return false;
    last_image_ = monotonic_now();
    const double unit = uri_.unit.value_or(kFloatUnit);
    auto got = clouds_          ? clouds_->read(image_.message)
               : is_compressed_ ? read_compressed_depth(image_.message, unit, scale_)
                                : read_depth_image(image_.message, unit, scale_);
    if (!got) {
      if (got.error().code == Errc::invalid_argument && !refused_) refused_ = got.error();
      received_.add_note("sends images that are dropped: " + got.error().message);
      return false;
    }
    frame = *std::move(got);
    if (frame.timestamp != 0) frame.stamp = frame.timestamp - uri_.latency;
    if (!place(frame)) return false;
    if (clock_ == StampClock::shared) frame.timestamp += monotonic_now() - seconds_since_1970();
    if (clouds_) {
      clouds_->camera()->describe(info_);
      if (const std::string text = clouds_->take_note(); !text.empty()) received_.add_note(text);
    } else if (image_.model) {
      info_.width = frame.width;
      info_.height = frame.height;
      set_ros_camera(*image_.model, topic_, info_);
    }
    return true;
  }

  /// False: tf has no pose of the camera, with one note, and one at the end.
  bool place(DepthFrame& frame) {
    info_.frame = world_.empty() ? image_.frame : world_;
    if (world_.empty()) return true;
    if (camera_.empty()) camera_ = image_.frame;
    const auto place = received_.place(world_, camera_, frame.stamp);
    is_unplaced_ = !place;
    if (is_unplaced_) {
      if (!is_open_) return false;  // tf may take longer to be found than images
      received_.add_note("has images without a tf transform within 0.1 s for '" + camera_ +
                         "' in '" + world_ + "'; they are dropped");
      return false;
    }
    frame.X_WC = place->X_WC;
    info_.is_moving = !place->is_fixed;
    return true;
  }

  const CameraUri uri_;
  const std::string topic_;
  const bool is_compressed_;
  const double scale_;
  std::string info_topic_;
  const std::shared_ptr<RosNode> node_;
  RosQos qos_ = RosQos::sensor();
  std::optional<CloudMessages> clouds_;  // none: images
  std::optional<Error> refused_;         // by the parameters of the URI
  DepthStreamInfo info_;
  ReceivedMessages received_{topic_};
  ReceivedMessages::Image image_;
  DepthFrame first_;
  std::string world_, camera_;  // frames of tf; no world: the camera's own is
  bool has_first_ = false, is_open_ = false, is_unplaced_ = false;
  StampClock clock_ = StampClock::cameras;
  double last_image_ = monotonic_now();
  std::unique_ptr<RosSubscription> images_, infos_, transforms_,
      statics_;  // last: they use the members above
};

}  // namespace

Result<RawStream> open_ros2_camera(const CameraUri& uri, const CameraOpening& opening) {
  if (const Status status = uri.check_extras(
          {"info", "qos", "clock", "world", "frame", "scale", "viewpoint", "look"});
      !status)
    return status.error();
  if (uri.target.empty()) {
    return Error{
        Errc::invalid_argument,
        "ros2: needs the topic of the depth image or cloud, e.g. ros2:/camera/depth/image_raw"};
  }
  if (uri.extras.contains("world") && (!(uri.X_WC == Pose{}) || !uri.poses.empty())) {
    return Error{
        Errc::invalid_argument,
        "camera " + uri.text + ": pass either 'world', to take its pose from tf, or its pose"};
  }
  auto source = Ros2Source::open(uri, opening);
  if (!source) return source.error();
  const StampClock clock = (*source)->stamps();
  const std::optional<Pose> X_FC = (*source)->projection();
  return RawStream{*std::move(source), clock, false, X_FC};
}

FoundCameras find_ros2_cameras() {
  const auto& api = dds::api();
  FoundCameras found = found_by(api);
  found.is_live = false;
  if (!api) return found;
  found.version = api->version;
  // Users who have nothing to do with ROS are not joined to a network unasked.
  if (environment("ROS_DOMAIN_ID").empty() && environment("ROS_DISTRO").empty()) {
    found.reason =
        "depth images of ROS 2, without a ROS installation; set ROS_DOMAIN_ID to see "
        "topics here";
    return found;
  }
  const auto node = RosNode::join();
  if (!node) {
    found.is_usable = false;
    found.reason = node.error().message;
    return found;
  }
  std::this_thread::sleep_for(1s);  // others say what they have
  for (const RosTopic& topic : (*node)->topics()) {
    const bool is_compressed = topic.type == "sensor_msgs/CompressedImage";
    if (is_compressed && !topic.name.ends_with("/compressedDepth")) continue;
    if (is_compressed || topic.type == "sensor_msgs/Image" || topic.type == kClouds) {
      found.devices.push_back("ros2:" + topic.name);
    }
  }
  found.reason = found.devices.empty() ? "there is no publisher of images over ROS 2 now"
                                       : "images of ROS 2; not all of them need be of depth";
  return found;
}

}}  // namespace palpate::v0
