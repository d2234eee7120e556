#include "src/cameras/messages/bag_contents.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "palpate/settings/setting_table.h"
#include "src/cloud/internal/cloud_camera.h"
#include "src/core/internal/shared_library.h"
#include "src/io/internal/cdr.h"
#include "src/io/internal/ros_messages.h"
#include "src/ros/internal/tf_tree.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::string_view kImage = "sensor_msgs/msg/Image";
constexpr std::string_view kCompressed = "sensor_msgs/msg/CompressedImage";
constexpr std::string_view kCloud = "sensor_msgs/msg/PointCloud2";
constexpr std::string_view kCameraInfo = "sensor_msgs/msg/CameraInfo";
constexpr std::string_view kText = "std_msgs/msg/String";
constexpr std::string_view kTransforms = "tf2_msgs/msg/TFMessage";
constexpr std::string_view kNumber = "std_msgs/msg/Float32";
constexpr std::string_view kDepthUnit = "palpate_msgs/msg/DepthUnit";

constexpr std::size_t kLongestTopic = 1024;

/// Returns the value of a parameter of the URI; empty: none.
std::string given(const CameraUri& uri, const char* name) {
  const auto found = uri.extras.find(name);
  return found == uri.extras.end() ? std::string() : found->second;
}

void keep_first(std::string& trouble, const Error& error) {
  if (trouble.empty()) trouble = error.message;
}

/// Tells if a camera_info is that of the images: it lies beside them, or where RealSense puts it.
bool is_camera_of(const std::string& info, const std::string& images) {
  const std::string_view parent = ros_parent(ros_image_topic(images));
  if (ros_parent(info) == parent) return true;
  return parent.ends_with("/image") &&
         ros_parent(info) == std::string(ros_parent(parent)) + "/info";
}

void add_camera(const McapMessage& message, BagContents::Camera& camera) {
  const auto model = read_camera_model(message.data);
  const RosStamp stamp = stamp_of(message);
  if (camera.frame_id.empty()) camera.frame_id = plain_frame(std::string(stamp.frame));
  if (!model) return keep_first(camera.trouble, model.error());
  LensHistory& models = camera.models;
  // Numbers that are none equal nothing, and would be kept again and again.
  const auto is_empty = [](const RosCameraModel& each) {
    return !(each.raw.fx > 0) && !(each.rectified.fx > 0);
  };
  const bool is_same = !models.empty() && (models.back().second == *model ||
                                           (is_empty(models.back().second) && is_empty(*model)));
  if (!is_same) models.emplace_back(stamp.time, *model);
}

/// Returns the lens where it is known for images on that topic; else `trouble` is why it is not.
LensHistory usable_lens(const LensHistory& all, const std::string& topic, std::string& trouble) {
  LensHistory usable;
  for (const auto& each : all) {
    if (const Status status = check_ros_camera(each.second, topic); !status) {
      keep_first(trouble, status.error());
    } else if (usable.empty() || !(usable.back().second == each.second)) {
      usable.push_back(each);
    }
  }
  return usable;
}

/// Tells if that is the topic that is desired, which may lack the first slash.
bool is_called(std::string_view topic, std::string_view desired) {
  return topic == desired || (topic.starts_with('/') && topic.substr(1) == desired);
}

void add_transforms(std::string_view data, bool is_static, BagContents& contents) {
  const auto transforms = read_transforms(data, &contents.unplaced);
  if (!transforms) return keep_first(contents.tf_trouble, transforms.error());
  for (const RosStampedTransform& each : *transforms) contents.transforms.add(each, is_static);
}

/// Unpacks the first good image only: the others are met again when they are read.
void add_image(const std::string& schema, const McapMessage& message, BagContents::Images& topic) {
  const RosStamp stamp = stamp_of(message);
  if (topic.num_frames == 0) {
    const auto frame = read_bag_frame(schema, message, kFloatUnit, 1);
    if (!frame) {
      ++topic.num_bad;
      return keep_first(topic.trouble, frame.error());
    }
    topic.frame_id = std::string(stamp.frame);
    topic.width = frame->width;
    topic.height = frame->height;
    topic.unit = frame->unit;
  }
  ++topic.num_frames;
  topic.stamps.push_back(stamp.time);
}

/// The same of clouds: it is checked whether the first one can be read.
void add_cloud(const McapMessage& message, BagContents::Images& topic) {
  const RosStamp stamp = stamp_of(message);
  CloudPoints points;
  if (topic.num_frames == 0) {
    if (const Status status = read_point_cloud(message.data, 1, {}, points); !status) {
      ++topic.num_bad;
      return keep_first(topic.trouble, status.error());
    }
    topic.frame_id = std::string(stamp.frame);
  }
  ++topic.num_frames;
  topic.stamps.push_back(stamp.time);
}

std::string described(const std::string& frame, int width, int height) {
  return "frame '" + frame + "' and " + std::to_string(width) + " x " + std::to_string(height) +
         " pixels";
}

/// "/a: why; /b: why", those first that are called depth.
std::string troubles_of(const std::map<std::string, BagContents::Images>& images) {
  constexpr std::size_t kMax = 3;
  std::vector<std::string> all;
  for (const bool is_depth : {true, false}) {
    for (const auto& [name, topic] : images) {
      const bool is_called_depth = name.find("depth") != std::string::npos;
      if (topic.trouble.empty() || is_called_depth != is_depth || all.size() == kMax) continue;
      all.push_back(name + ": " + topic.trouble);
    }
  }
  std::string text;
  for (const std::string& each : all) text += "; " + each;
  return text;
}

}  // namespace

bool is_image_type(const std::string& schema) { return schema == kImage || schema == kCompressed; }

bool is_cloud_type(const std::string& schema) { return schema == kCloud; }

RosStamp stamp_of(const McapMessage& message) {
  CdrReader from(message.data);
  RosStamp stamp = read_ros_header(from);
  if (stamp.time == 0) stamp.time = 1e-9 * static_cast<double>(message.time);
  return stamp;
}

Result<DepthFrame> read_bag_frame(const std::string& schema, const McapMessage& message,
                                  double unit, double scale) {
  auto frame = schema == kImage ? read_depth_image(message.data, unit, scale)
                                : read_compressed_depth(message.data, unit, scale);
  if (frame) frame->timestamp = stamp_of(message).time;
  return frame;
}

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

bool is_unit_of(std::string_view unit, const std::string& images) {
  const std::string_view of_images = ros_image_topic(images);
  if (ros_parent(unit) == ros_parent(of_images)) return true;
  const std::size_t option = unit.find("/option/");
  return option != std::string_view::npos && of_images.starts_with(unit.substr(0, option + 1));
}

Status look_through_first_part(BagReader& reader, BagContents& contents) {
  for (;;) {
    const auto message = reader.next();
    if (!message) return message.error();
    if (!*message) return Done{};
    const McapChannel& channel = reader.channels().at((*message)->channel);
    if (channel.schema_name == kTransforms && channel.topic.ends_with("static")) {
      add_transforms((*message)->data, true, contents);
    } else if (channel.schema_name == kCameraInfo && channel.topic.size() <= kLongestTopic) {
      add_camera(**message, contents.cameras[channel.topic]);
    }
  }
}

Status look_through(BagReader& reader, const CameraUri& uri, BagContents& contents) {
  const std::string desired = given(uri, "topic");
  for (;;) {
    const auto message = reader.next();
    if (!message) return message.error();
    if (!*message) break;
    const std::string_view data = (*message)->data;
    const McapChannel& channel = reader.channels().at((*message)->channel);
    if (channel.topic.size() > kLongestTopic) {
      return Error{Errc::bad_input, "the topic '" + channel.topic.substr(0, 40) + "...' has " +
                                        std::to_string(channel.topic.size()) +
                                        " characters, and at most " +
                                        std::to_string(kLongestTopic) + " are read"};
    }
    ++contents.messages[channel.topic];
    if (const auto unit = declared_unit(channel, data)) {
      contents.units.emplace(channel.topic, *unit);
    }
    if (channel.schema_name == kTransforms) {
      add_transforms(data, channel.topic.ends_with("static"), contents);
    } else if (channel.schema_name == kText && channel.topic.ends_with("/sensor")) {
      CdrReader from(data);
      const auto sensor = value_named<SensorKind>(from.text());
      if (from.is_good() && sensor) contents.sensors[channel.topic] = *sensor;
    } else if (channel.schema_name == kCameraInfo) {
      add_camera(**message, contents.cameras[channel.topic]);
    } else if (!desired.empty() && !is_called(channel.topic, desired)) {
      continue;
    } else if (is_image_type(channel.schema_name)) {
      add_image(channel.schema_name, **message, contents.images[channel.topic]);
    } else if (is_cloud_type(channel.schema_name)) {
      add_cloud(**message, contents.clouds[channel.topic]);
    }
  }
  contents.was_cut_off = reader.was_cut_off();
  return Done{};
}

Result<std::string> BagContents::choose_images(const CameraUri& uri) const {
  for (const auto* const streams : {&images, &clouds}) {
    std::vector<std::string> topics;
    for (const auto& [name, topic] : *streams) {
      if (topic.num_frames > 0) topics.push_back(name);
    }
    if (topics.size() == 1) return topics.front();
    if (topics.empty()) continue;
    return Error{Errc::invalid_argument, "camera " + uri.text +
                                             " holds several depth streams; give ?topic= one of " +
                                             listed(topics)};
  }
  const std::string desired = given(uri, "topic");
  return Error{Errc::bad_input,
               "camera " + uri.text + " has no depth images" +
                   (desired.empty() ? "" : " on " + desired) +
                   "; they are sensor_msgs/Image of 16UC1 or 32FC1, or CompressedImage of "
                   "compressedDepth or PNG; nor clouds, sensor_msgs/PointCloud2" +
                   troubles_of(images) + troubles_of(clouds) +
                   (was_cut_off ? "; the file was cut off" : "")};
}

bool BagContents::has_clouds(const std::string& topic) const {
  const auto found = images.find(topic);
  return found == images.end() || found->second.num_frames == 0;
}

std::string BagContents::unread_depth() const {
  std::map<std::string, Images> depth = images;
  std::erase_if(depth,
                [](const auto& each) { return each.first.find("depth") == std::string::npos; });
  return troubles_of(depth);
}

Result<LensHistory> BagContents::choose_lens(const CameraUri& uri, const std::string& topic,
                                             std::vector<std::string>& notes) const {
  const Images& of_images = images.at(topic);
  const std::string frame = plain_frame(of_images.frame_id), desired = given(uri, "info");
  std::vector<std::string> names, of_frame;
  auto chosen = cameras.end();
  for (auto each = cameras.begin(); each != cameras.end(); ++each) {
    names.push_back(each->first);
    if (each->second.frame_id == frame) of_frame.push_back(each->first);
    const bool is_it =
        desired.empty() ? is_camera_of(each->first, topic) : is_called(each->first, desired);
    if (is_it && chosen == cameras.end()) chosen = each;
  }
  const auto refused = [&](const std::string& why) {
    return Error{Errc::bad_input, "camera " + uri.text + ": " + why + "; pass ?info=/TOPIC (" +
                                      (names.empty() ? "there is none" : listed(names)) +
                                      ") or ?intrinsics=fx,fy,cx,cy in pixels"};
  };
  if (!desired.empty() && chosen == cameras.end()) {
    return refused("it holds no camera_info on " + desired);
  }
  const bool is_sure = chosen != cameras.end();  // it was asked for, or lies beside them
  if (!is_sure && of_frame.size() == 1) chosen = cameras.find(of_frame.front());
  if (!is_sure && cameras.size() == 1) chosen = cameras.begin();
  if (chosen == cameras.end()) {
    if (cameras.empty() || uri.intrinsics) return LensHistory();
    return refused("no camera_info lies beside " + topic);
  }
  const auto& [name, camera] = *chosen;
  std::string trouble = camera.trouble;
  const LensHistory models = usable_lens(camera.models, topic, trouble);
  if (desired.empty()) {
    const LensHistory& any = models.empty() ? camera.models : models;
    const RosCameraModel shown = any.empty() ? RosCameraModel{} : any.front().second;
    const bool is_other_frame =
        camera.frame_id != frame && !camera.frame_id.empty() && !frame.empty();
    const bool is_other_size =
        shown.width > 0 && (shown.width != of_images.width || shown.height != of_images.height);
    const bool is_others = is_other_frame && is_other_size;
    const std::string whose = "the camera_info on " + name + " is of " +
                              described(camera.frame_id, shown.width, shown.height) +
                              ", the images on " + topic + " are of " +
                              described(frame, of_images.width, of_images.height);
    const bool is_theirs = is_sure ? !is_others : !is_other_frame && !models.empty();
    if (uri.intrinsics && !is_theirs) return LensHistory();
    if (is_others) return refused(whose);
    // Beside them, images of another size are binned ones.
    if (!models.empty() && (is_other_frame || (is_other_size && !is_sure)))
      notes.push_back(whose + "; it is taken for theirs");
  }
  if (models.empty() && !trouble.empty() && !uri.intrinsics) {
    return Error{Errc::bad_input,
                 name + ": " + trouble + ", or pass ?intrinsics=fx,fy,cx,cy in pixels"};
  }
  if (!trouble.empty()) notes.push_back(name + " has messages that are left out: " + trouble);
  return models;
}

}}  // namespace palpate::v0
