// Depth from recordings: of ROS 2 and ROS 1, those of RealSense cameras, and of palpate record.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <map>
#include <utility>
#include <vector>

#include "palpate/settings/setting_table.h"
#include "src/cameras/camera_kinds.h"
#include "src/cameras/depth_messages.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/core/internal/number_text.h"
#include "src/io/cdr.h"
#include "src/io/internal/bag_file.h"
#include "src/io/ros_image.h"
#include "src/io/ros_messages.h"
#include "src/ros/tf_history.h"

namespace palpate::inline v0 {
namespace {

constexpr std::string_view kImage = "sensor_msgs/msg/Image";
constexpr std::string_view kCompressed = "sensor_msgs/msg/CompressedImage";
constexpr std::string_view kCameraInfo = "sensor_msgs/msg/CameraInfo";
constexpr std::string_view kText = "std_msgs/msg/String";
constexpr std::string_view kTransforms = "tf2_msgs/msg/TFMessage";
constexpr std::string_view kNumber = "std_msgs/msg/Float32";
constexpr std::string_view kDepthUnit = "palpate_msgs/msg/DepthUnit";

constexpr std::size_t kLongestTopic = 1024;

double seconds(std::uint64_t nanoseconds) { return 1e-9 * static_cast<double>(nanoseconds); }

/// The lens of a camera from a stamp on, s.
using Models = std::vector<std::pair<double, RosCameraModel>>;

/// What a look through the whole file finds.
struct Contents {
  struct Topic {
    std::string schema;
    int num_frames = 0;
    std::vector<double> stamps;  // s
    int width = 0, height = 0;   // of the first one
    double unit = 0;             // likewise
    std::string frame_id;        // likewise
  };
  std::map<std::string, Topic> images;
  std::map<std::string, Models> cameras;
  std::map<std::string, double> units;  // by topic, likewise
  std::map<std::string, int> messages;  // by topic
  std::map<std::string, SensorKind> sensors;
  TfHistory transforms;
  bool was_cut_off = false;
};

/// When an image was captured, or recorded if it does not say, s; and in which frame.
RosStamp stamp_of(const McapMessage& message) {
  CdrReader from(message.data);
  RosStamp stamp = read_ros_header(from);
  if (stamp.time == 0) stamp.time = seconds(message.time);
  return stamp;
}

Result<DepthFrame> read_frame(const std::string& schema, const McapMessage& message, double unit) {
  auto frame = schema == kImage ? read_depth_image(message.data, unit)
                                : read_compressed_depth(message.data, unit);
  if (frame) frame->timestamp = stamp_of(message).time;
  return frame;
}

/// Metres per count, as in our recordings and those of RealSense cameras.
std::optional<double> declared_unit(const McapChannel& channel, std::string_view message) {
  CdrReader from(message);
  double unit = 0;
  if (channel.schema_name == kDepthUnit) {
    unit = from.number<double>();
  } else if (channel.topic.ends_with("/option/Depth_Units/value") ||
             channel.topic.ends_with("/option/Depth Units/value")) {
    unit = channel.schema_name == kNumber ? static_cast<double>(from.number<float>())
                                          : std::strtod(std::string(from.text()).c_str(), nullptr);
    unit = std::round(unit * 1e9) * 1e-9;  // in single precision: 0.001 is meant
  }
  if (!from.is_good() || !(unit > 0) || !std::isfinite(unit)) return std::nullopt;
  return unit;
}

/// Whether a camera_info is that of the images: it lies beside them, or where RealSense puts it.
bool is_camera_of(const std::string& info, const std::string& images) {
  const std::string_view parent = ros_parent(ros_image_topic(images));
  if (ros_parent(info) == parent) return true;
  return parent.ends_with("/image") &&
         ros_parent(info) == std::string(ros_parent(parent)) + "/info";
}

Result<Contents> look_through(BagReader& reader, const std::string& desired) {
  Contents contents;
  for (;;) {
    const auto message = reader.next();
    if (!message) return message.error();
    if (!*message) break;
    const McapChannel& channel = reader.channels().at((*message)->channel);
    if (channel.topic.size() > kLongestTopic) {
      return Error{Errc::bad_input, "the topic '" + channel.topic.substr(0, 40) + "...' has " +
                                        std::to_string(channel.topic.size()) +
                                        " characters, and at most " +
                                        std::to_string(kLongestTopic) + " are read"};
    }
    ++contents.messages[channel.topic];
    if (const auto unit = declared_unit(channel, (*message)->data)) {
      contents.units.emplace(channel.topic, *unit);
    }
    if (channel.schema_name == kTransforms) {
      const auto transforms = read_transforms((*message)->data);
      if (!transforms) return transforms.error();
      for (const RosStampedTransform& each : *transforms) {
        contents.transforms.add(each, channel.topic.ends_with("static"));
      }
    } else if (channel.schema_name == kText && channel.topic.ends_with("/sensor")) {
      CdrReader from((*message)->data);
      const auto sensor = value_named<SensorKind>(from.text());
      if (from.is_good() && sensor) contents.sensors[channel.topic] = *sensor;
    } else if (channel.schema_name == kCameraInfo) {
      const auto camera = read_camera_model((*message)->data);
      if (!camera && (desired.empty() || is_camera_of(channel.topic, desired))) {
        return Error{camera.error().code, channel.topic + ": " + camera.error().message};
      }
      if (!camera) continue;
      Models& models = contents.cameras[channel.topic];
      const bool is_known = camera->raw.fx > 0 && camera->raw.fy > 0;
      if (models.empty() || (is_known && !(models.back().second == *camera))) {
        models.emplace_back(stamp_of(**message).time, *camera);
      }
    } else if (channel.schema_name == kImage || channel.schema_name == kCompressed) {
      if (!desired.empty() && channel.topic != desired) continue;
      Contents::Topic& topic = contents.images[channel.topic];
      if (topic.num_frames < 0) continue;
      auto frame = topic.num_frames == 0 ? read_frame(channel.schema_name, **message, kFloatUnit)
                                         : Result<DepthFrame>(DepthFrame());
      if (!frame) {
        // Colour images are no error unless they were requested.
        if (!desired.empty()) return frame.error();
        topic.num_frames = -1;
        continue;
      }
      if (topic.num_frames == 0) {
        topic.schema = channel.schema_name;
        topic.frame_id = std::string(stamp_of(**message).frame);
        topic.width = frame->width;
        topic.height = frame->height;
        topic.unit = frame->unit;
      }
      ++topic.num_frames;
      topic.stamps.push_back(stamp_of(**message).time);
    }
  }
  contents.was_cut_off = reader.was_cut_off();
  return contents;
}

/// The topic to read: the requested one, or the only one with depth.
Result<std::string> choose_topic(const CameraUri& uri, Contents& contents,
                                 const std::string& desired) {
  std::erase_if(contents.images, [](const auto& each) { return each.second.num_frames < 1; });
  if (contents.images.empty()) {
    return Error{Errc::bad_input, "camera " + uri.text + " has no depth images" +
                                      (desired.empty() ? "" : " on " + desired) +
                                      "; they are sensor_msgs/Image of 16UC1 or 32FC1, or "
                                      "CompressedImage of compressedDepth" +
                                      (contents.was_cut_off ? "; the file was cut off" : "")};
  }
  if (contents.images.size() == 1) return contents.images.begin()->first;
  std::string topics;
  for (const auto& [name, topic] : contents.images) topics += (topics.empty() ? "" : ", ") + name;
  return Error{
      Errc::invalid_argument,
      "camera " + uri.text + " holds several depth streams; give ?topic= one of " + topics};
}

/// The camera_info beside the images, or the only one that there is.
const Models* find_camera(const Contents& contents, const std::string& topic) {
  for (const auto& [name, models] : contents.cameras) {
    if (is_camera_of(name, topic)) return &models;
  }
  return contents.cameras.size() == 1 ? &contents.cameras.begin()->second : nullptr;
}

/// Whether a unit is that of the images: it lies beside them, or is an option of their sensor.
bool is_unit_of(std::string_view unit, const std::string& images) {
  const std::string_view of_images = ros_image_topic(images);
  if (ros_parent(unit) == ros_parent(of_images)) return true;
  const std::size_t option = unit.find("/option/");
  return option != std::string_view::npos && of_images.starts_with(unit.substr(0, option + 1));
}

/// The first unit declared for these images, or the only one.
std::optional<double> find_unit(const Contents& contents, const std::string& topic) {
  for (const auto& [name, unit] : contents.units) {
    if (is_unit_of(name, topic)) return unit;
  }
  if (contents.units.size() == 1) return contents.units.begin()->second;
  return std::nullopt;
}

/// The pose of a camera from transforms.
struct CameraInTree {
  TfHistory transforms;
  std::string world, frame;
};

/// None unless it is requested. Error: nothing joins the frames.
Result<std::optional<CameraInTree>> place_of(const CameraUri& uri, Contents& contents,
                                             const Contents::Topic& images) {
  const auto extra = [&](const char* name) {
    const auto found = uri.extras.find(name);
    return found == uri.extras.end() ? std::string() : found->second;
  };
  CameraInTree place{std::move(contents.transforms), extra("world"), extra("frame")};
  if (place.world.empty() && place.frame.empty()) return std::optional<CameraInTree>();
  if (place.frame.empty()) place.frame = images.frame_id;
  const bool is_there = place.transforms.are_joined(place.world, place.frame);
  if (is_there) return std::optional(std::move(place));
  std::string frames;
  for (const std::string& frame : place.transforms.frames()) {
    frames += (frames.empty() ? "" : ", ") + frame;
  }
  return Error{Errc::bad_input, "camera " + uri.text + ": no transform joins the world '" +
                                    place.world + "' and the camera '" + place.frame +
                                    "'; the recording knows " + (frames.empty() ? "none" : frames)};
}

/// What the stamps of frames say, s.
struct Periods {
  double rate = 0;  // Hz; 0: nothing
  double longest = 0;
  int num_not_later = 0;  // frames that are no news
};

/// Stamps may leap: then the rate is that of most frames, not of all together.
Periods periods_of(const std::vector<double>& stamps) {
  Periods periods;
  std::vector<double> all;
  double last = stamps.front();
  for (std::size_t i = 1; i < stamps.size(); ++i) {
    const bool is_later = stamps[i] > last;
    if (is_later) all.push_back(stamps[i] - std::exchange(last, stamps[i]));
    if (!is_later) ++periods.num_not_later;
  }
  if (all.empty()) return periods;
  periods.longest = std::ranges::max(all);
  const auto middle = all.begin() + std::ssize(all) / 2;
  std::ranges::nth_element(all, middle);
  const double mean = (last - stamps.front()) / static_cast<double>(all.size());
  periods.rate = 1 / (mean > 0.5 * *middle && mean < 2 * *middle ? mean : *middle);
  return periods;
}

class BagSource final : public DepthSource {
 public:
  BagSource(std::unique_ptr<BagReader> reader, std::string topic, double unit,
            std::optional<double> said, DepthStreamInfo info, Models models,
            std::optional<CameraInTree> place, double latency, std::vector<std::string> notes)
      : reader_(std::move(reader)),
        topic_(std::move(topic)),
        unit_(unit),
        said_(said),
        info_(std::move(info)),
        models_(std::move(models)),
        size_({info_.width, info_.height}),
        place_(std::move(place)),
        latency_(latency),
        notes_(std::move(notes)) {}

  const DepthStreamInfo& info() const override { return info_; }

  Result<bool> next(DepthFrame& frame) override {
    for (;;) {
      const auto message = reader_->next();
      if (!message) return message.error();
      if (!*message) return false;
      const McapChannel& channel = reader_->channels().at((*message)->channel);
      if (channel.topic != topic_) {
        // It may change in mid-stream.
        const auto unit = declared_unit(channel, (*message)->data);
        if (said_ && unit && is_unit_of(channel.topic, topic_)) said_ = unit;
        continue;
      }
      if (channel.schema_name != kImage && channel.schema_name != kCompressed) continue;
      auto read = read_frame(channel.schema_name, **message, unit_);
      if (!read) {
        return Error{Errc::bad_input, info_.name + ": " + read.error().message};
      }
      if (num_read_++ > 0 && !(read->timestamp > last_)) continue;
      last_ = read->timestamp;
      follow_camera(*read);
      if (place_) {
        const auto X_WC = place_->transforms.find(place_->world, place_->frame, last_ - latency_);
        if (!X_WC) {
          num_unplaced_.fetch_add(1);
          continue;
        }
        read->X_WC = *X_WC;
      }
      frame = *std::move(read);
      frame.timestamp -= latency_;
      if (said_) frame.unit = *said_;
      return true;
    }
  }

  std::vector<std::string> take_notes() override {
    std::vector<std::string> notes = std::exchange(notes_, {});
    if (has_other_lens_.exchange(false)) {
      notes.push_back(topic_ + ": its camera_info changes in mid-stream, and is followed");
    }
    if (has_other_size_.exchange(false)) {
      notes.push_back(topic_ + ": the size of its images changes in mid-stream, and is followed");
    }
    if (const int num = num_unplaced_.exchange(0); num > 0) {
      notes.push_back(std::to_string(num) + " frames were dropped: there is no transform for '" +
                      place_->frame + "' in '" + place_->world + "' at their stamps");
    }
    return notes;
  }

 private:
  /// Images of another lens or size are turned into those of the first one by who reads info().
  void follow_camera(const DepthFrame& frame) {
    const ImageSize size{frame.width, frame.height};
    const std::size_t before = model_;
    while (model_ + 1 < models_.size() && models_[model_ + 1].first <= frame.timestamp) ++model_;
    if (model_ == before && size == size_) return;
    (model_ == before ? has_other_size_ : has_other_lens_) = true;
    size_ = size;
    if (models_.empty()) return;
    DepthStreamInfo seen = info_;
    seen.width = frame.width;
    seen.height = frame.height;
    set_ros_camera(models_[model_].second, topic_, seen);
    info_.intrinsics = seen.intrinsics;
    info_.distortion = seen.distortion;
  }

  const std::unique_ptr<BagReader> reader_;
  const std::string topic_;
  const double unit_;
  std::optional<double> said_;
  DepthStreamInfo info_;
  const Models models_;
  std::size_t model_ = 0;  // of the last frame
  ImageSize size_;         // likewise
  const std::optional<CameraInTree> place_;
  const double latency_;  // s
  double last_ = 0;
  int num_read_ = 0;
  std::atomic<int> num_unplaced_ = 0;
  std::atomic<bool> has_other_lens_ = false, has_other_size_ = false;
  std::vector<std::string> notes_;  // of who calls take_notes
};

}  // namespace

Result<RawStream> open_bag_camera(const CameraUri& uri, const CameraOpening&) {
  if (const Status status = uri.check_extras({"topic", "world", "frame"}); !status)
    return status.error();
  auto reader = BagReader::open(uri.target);
  if (!reader) return reader.error();
  const auto given = uri.extras.find("topic");
  const std::string desired = given == uri.extras.end() ? "" : given->second;
  auto contents = look_through(**reader, desired);
  if (!contents) return contents.error();
  const auto topic = choose_topic(uri, *contents, desired);
  if (!topic) return topic.error();

  const Contents::Topic& images = contents->images.at(*topic);
  DepthStreamInfo info;
  info.width = images.width;
  info.height = images.height;
  // Counts of our own recordings may be of any unit; those of metres are made here.
  const bool is_count = images.unit != kFloatUnit;
  const double unit = is_count ? images.unit : uri.unit.value_or(kFloatUnit);
  const auto said = is_count ? find_unit(*contents, *topic) : std::nullopt;
  if (said && *said > kLargestUnit && !uri.unit) {
    return Error{Errc::bad_input, "camera " + uri.text + " declares a unit of " +
                                      number_text(*said) +
                                      " m per count, which is at most 1 m; pass ?unit=METERS"};
  }
  info.unit = said.value_or(unit);
  info.num_frames = images.num_frames;
  info.name = "bag:" + uri.target;
  std::vector<std::string> notes;
  if (contents->was_cut_off) {
    notes.push_back(info.name + " was cut off: it ends where its last whole chunk does");
  }
  const Periods periods = periods_of(images.stamps);
  constexpr double kPause = 10;  // s
  if (periods.longest > kPause && periods.longest * periods.rate > 10) {
    notes.push_back(info.name + ": by their stamps, " +
                    std::to_string(std::lround(periods.longest)) +
                    " s lie between two of its frames");
  }
  if (periods.num_not_later > 0) {
    notes.push_back(info.name + ": " + std::to_string(periods.num_not_later) + " of its " +
                    std::to_string(images.num_frames) +
                    " frames are left out, as their stamps are not later than that of one before");
  }
  if (const int num = contents->messages[*topic] - images.num_frames; num > 0) {
    notes.push_back(info.name + ": " + std::to_string(num) + " messages on " + *topic +
                    " are left out, as they are of another type than its images");
  }
  info.rate = uri.rate.value_or(periods.rate > 0 ? periods.rate : info.rate);
  for (const auto& [name, sensor] : contents->sensors) {
    if (ros_parent(name) == ros_parent(*topic)) info.sensor = sensor;
  }
  Models models;
  if (const Models* const found = find_camera(*contents, *topic)) {
    models = *found;
    set_ros_camera(models.front().second, *topic, info);
  }
  auto place = place_of(uri, *contents, images);
  if (!place) return place.error();
  if (*place) info.is_moving = (*place)->transforms.is_moving((*place)->world, (*place)->frame);
  auto again = BagReader::open(uri.target);
  if (!again) return again.error();
  return RawStream{std::make_unique<BagSource>(*std::move(again), *topic, unit, said,
                                               std::move(info), std::move(models),
                                               *std::move(place), uri.latency, std::move(notes))};
}

FoundCameras find_bag_cameras() {
  return {"bag",
          "bag:FILE.mcap|FILE.bag|FILE.db3[?topic=/T&world=FRAME]",
          true,
          "",
          "",
          {},
          "depth of ROS 2 and ROS 1 recordings, of RealSense cameras and of palpate record, with "
          "their camera_info; ?world=FRAME: the camera is where their tf says"};
}

}  // namespace palpate::inline v0
