// Depth from a topic of ROS 2: Image or compressedDepth, with its CameraInfo, and where the camera
// is by tf.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <set>
#include <thread>
#include <utility>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/messages/depth_messages.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/core/internal/shared_library.h"
#include "src/io/internal/cdr.h"
#include "src/io/internal/ros_image.h"
#include "src/ros/internal/dds_api.h"
#include "src/ros/internal/ros_node.h"
#include "src/ros/internal/tf_history.h"

namespace palpate { inline namespace v0 {
namespace {

using namespace std::chrono_literals;

constexpr double kFirstImage = 10;       // s, while opening
constexpr double kDiscovery = 0.5;       // s: publishers that are there are found
constexpr double kLongestSilence = 2;    // s without an image until a note
constexpr double kLongestPairing = 0.1;  // s that an image waits for its camera_info
constexpr double kLongestLone = 1;       // s from one camera_info to the next, if others follow
constexpr double kLongestTf = 0.1;       // s that an image waits for its transform
constexpr double kKeptTf = 5;            // s
constexpr std::size_t kNumModels = 32;   // camera_infos that are kept
constexpr int kMaxImages = 200;          // per second; more are a mistake, with a note

double seconds_since_1970() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// Messages that the subscriptions have received. Their threads write, one reads.
class ReceivedMessages {
 public:
  /// `topic`: of the images.
  explicit ReceivedMessages(std::string topic) : topic_(std::move(topic)) {}

  void image(std::string_view message) {
    CdrReader from(message);
    const RosStamp stamp = read_ros_header(from);
    const std::lock_guard lock(mutex_);
    image_.assign(message);
    image_stamp_ = stamp.time;
    image_arrival_ = monotonic_now();
    note_flood(image_arrival_);
    frame_ = std::string(stamp.frame);
    has_image_ = true;
    changed_.notify_all();
  }

  void camera_info(std::string_view message) {
    CdrReader from(message);
    const double stamp = read_ros_header(from).time;
    const auto model = read_camera_model(message);
    const std::lock_guard lock(mutex_);
    if (!model) {
      note(model.error().message + "; it is ignored");
      return;
    }
    if (!is_calibrated(*model, topic_)) {
      note(
          "has a camera_info without intrinsics, as of a camera that is not calibrated; it is "
          "ignored");
      return;
    }
    models_.emplace_back(stamp, *model);
    comes_in_pairs_ = comes_in_pairs_ || stamp == taken_stamps_.back();  // it was only late
    has_come_in_pairs_ = has_come_in_pairs_ || std::find(taken_stamps_.begin(), taken_stamps_.end(),
                                                         stamp) != taken_stamps_.end();
    if (models_.size() > kNumModels) models_.pop_front();
    changed_.notify_all();
  }

  void transforms(std::string_view message, bool is_static) {
    const auto transforms = read_transforms(message);
    if (!transforms) return;
    const std::lock_guard lock(mutex_);
    for (const RosStampedTransform& each : *transforms) history_.add(each, is_static);
    changed_.notify_all();
  }

  struct Place {
    Pose X_WC;
    bool is_fixed = false;  // no frame between the two may move
  };
  /// At a time of the stamps, between the transforms before and after it; waits a tenth of a
  /// second for the latter. None: there is no transform.
  std::optional<Place> place(const std::string& world, const std::string& frame, double time) {
    std::unique_lock lock(mutex_);
    double until = 0;
    const bool is_known = changed_.wait_for(lock, std::chrono::duration<double>(kLongestTf), [&] {
      until = history_.known_until(world, frame, time);
      return until >= time || is_cancelled_;
    });
    const auto X_WC = is_known ? history_.find(world, frame, time) : std::nullopt;
    if (!X_WC) return std::nullopt;
    return Place{*X_WC, std::isinf(until)};
  }
  std::string frames() const {
    const std::lock_guard lock(mutex_);
    const auto frames = history_.frames();
    return frames.empty() ? "no tf message has come" : "tf knows " + listed(frames);
  }

  struct Image {
    std::string message, frame;
    std::optional<RosCameraModel> model;
  };
  /// The newest image with the camera_info of its stamp; if none comes with it, with the last one,
  /// or not at all if the lens changes: another lens sees another scene. Waits at most a tenth of a
  /// second, and a little longer for the camera_info. False: none came.
  bool take(Image& image) {
    std::unique_lock lock(mutex_);
    if (!changed_.wait_for(lock, 100ms, [&] { return has_image_ || is_cancelled_; })) return false;
    if (is_cancelled_) return false;
    // Camera_infos that are sent once, or by another clock, are not waited for again and again.
    if (comes_in_pairs_ && !models_.empty() && model_of_image() == nullptr) {
      const std::chrono::duration<double> left(image_arrival_ + kLongestPairing - monotonic_now());
      comes_in_pairs_ = changed_.wait_for(
          lock, left, [&] { return model_of_image() != nullptr || is_cancelled_; });
    }
    const RosCameraModel* const model = model_of_image();
    if (model != nullptr) comes_in_pairs_ = has_come_in_pairs_ = true;
    has_image_ = false;
    taken_stamps_.pop_front();
    taken_stamps_.push_back(image_stamp_);
    if (model == nullptr && has_come_in_pairs_ && !has_one_lens()) {
      note(
          "has a lens that changes, and camera_infos that come more than 0.1 s after their images; "
          "these images are dropped");
      return false;
    }
    if (model == nullptr && has_come_in_pairs_ && may_be_first_of_many()) return false;
    image.model.reset();
    if (model != nullptr) {
      image.model = *model;
    } else if (!models_.empty()) {
      image.model = models_.back().second;
    }
    std::swap(image.message, image_);
    image.frame = frame_;
    return true;
  }

  void cancel() {
    const std::lock_guard lock(mutex_);
    is_cancelled_ = true;
    changed_.notify_all();
  }
  bool is_cancelled() const {
    const std::lock_guard lock(mutex_);
    return is_cancelled_;
  }
  /// Adds a note once.
  void add_note(const std::string& text) {
    const std::lock_guard lock(mutex_);
    note(text);
  }
  std::vector<std::string> take_notes() {
    const std::lock_guard lock(mutex_);
    return std::exchange(notes_, {});
  }

 private:
  const RosCameraModel* model_of_image() const {
    for (auto each = models_.rbegin(); each != models_.rend(); ++each) {
      if (each->first == image_stamp_) return &each->second;
    }
    return nullptr;
  }
  bool has_one_lens() const {
    return std::all_of(models_.begin(), models_.end(),
                       [&](const auto& each) { return each.second == models_.back().second; });
  }
  /// True if this camera_info may be the first of many, with a lens that changes, or be sent once.
  bool may_be_first_of_many() const {
    return models_.size() == 1 && std::abs(image_stamp_ - models_.back().first) < kLongestLone;
  }
  void note_flood(double now) {
    ++num_since_;
    if (now - since_ < 1) return;
    if (num_since_ > kMaxImages * (now - since_)) {
      note("sends more than " + std::to_string(kMaxImages) +
           " images per second; the newest one is used, the others are dropped");
    }
    since_ = now;
    num_since_ = 0;
  }
  /// Adds a note once for each kind: text in quotes is of others, who may write anything there.
  void note(const std::string& text) {
    if (said_.insert(text.substr(0, text.find('\''))).second) notes_.push_back(text);
  }

  const std::string topic_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::string image_, frame_;
  double image_stamp_ = 0, image_arrival_ = 0;  // s
  std::deque<double> taken_stamps_ =
      std::deque<double>(kNumModels, std::nan(""));  // s, of the last images
  std::deque<std::pair<double, RosCameraModel>> models_;
  TfHistory history_{kKeptTf};
  double since_ = 0;   // s, monotonic: images are counted
  int num_since_ = 0;  // these
  bool has_image_ = false, comes_in_pairs_ = true, has_come_in_pairs_ = false;
  bool is_cancelled_ = false;
  std::set<std::string> said_;  // kinds of notes
  std::vector<std::string> notes_;
};

class Ros2Source final : public DepthSource {
 public:
  static Result<std::unique_ptr<Ros2Source>> open(const CameraUri& uri,
                                                  const CameraOpening& opening) {
    const auto scale = scale_of_floats(uri);
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
    RosQos qos = RosQos::sensor();
    if (const auto given = uri_.extras.find("qos"); given != uri_.extras.end()) {
      qos.is_reliable = given->second == "reliable";
      if (!qos.is_reliable && given->second != "best_effort") {
        return Error{Errc::invalid_argument, "camera " + uri_.text +
                                                 ": qos is reliable or best_effort, not '" +
                                                 given->second.substr(0, 40) + "'"};
      }
    }
    auto images = node_->subscribe(
        topic_, is_compressed_ ? "sensor_msgs/CompressedImage" : "sensor_msgs/Image", qos,
        [this](std::string_view message) { received_.image(message); });
    if (!images) return images.error();
    images_ = *std::move(images);
    auto infos =
        node_->subscribe(info_topic_, "sensor_msgs/CameraInfo", qos,
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
      if (!read(first_)) continue;
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
      if (topic.type == "sensor_msgs/Image" || topic.type == "sensor_msgs/CompressedImage") {
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
    auto got = is_compressed_ ? read_compressed_depth(image_.message, unit, scale_)
                              : read_depth_image(image_.message, unit, scale_);
    if (!got) {
      received_.add_note("sends images that are dropped: " + got.error().message);
      return false;
    }
    frame = *std::move(got);
    if (frame.timestamp != 0) frame.stamp = frame.timestamp - uri_.latency;
    if (!place(frame)) return false;
    if (clock_ == StampClock::shared) frame.timestamp += monotonic_now() - seconds_since_1970();
    if (image_.model) {
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
  if (const Status status = uri.check_extras({"info", "qos", "clock", "world", "frame", "scale"});
      !status)
    return status.error();
  if (uri.target.empty()) {
    return Error{Errc::invalid_argument,
                 "ros2: needs the topic of the depth image, e.g. ros2:/camera/depth/image_raw"};
  }
  if (uri.extras.contains("world") && (!(uri.X_WC == Pose{}) || !uri.poses.empty())) {
    return Error{
        Errc::invalid_argument,
        "camera " + uri.text + ": pass either 'world', to take its pose from tf, or its pose"};
  }
  auto source = Ros2Source::open(uri, opening);
  if (!source) return source.error();
  const StampClock clock = (*source)->stamps();
  return RawStream{*std::move(source), clock, false};
}

FoundCameras find_ros2_cameras() {
  FoundCameras found{"ros2", "ros2:/TOPIC[?info=/TOPIC&qos=reliable]", false, "", "", {}, ""};
  const auto& api = dds::api();
  if (!api) {
    found.reason = api.error().message;
    return found;
  }
  found.is_usable = true;
  found.library = api->path;
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
    if (is_compressed || topic.type == "sensor_msgs/Image") {
      found.devices.push_back("ros2:" + topic.name);
    }
  }
  found.reason = found.devices.empty() ? "there is no publisher of images over ROS 2 now"
                                       : "images of ROS 2; not all of them need be of depth";
  return found;
}

}}  // namespace palpate::v0
