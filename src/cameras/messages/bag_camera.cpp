// Depth from recordings: of ROS 2 and ROS 1, those of RealSense cameras, and of palpate record.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <utility>
#include <vector>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/messages/bag_contents.h"
#include "src/cameras/messages/cloud_messages.h"
#include "src/cameras/stream/camera_source.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/core/internal/message_text.h"
#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 {
namespace {

/// The first unit declared for these images, or the only one.
std::optional<double> find_unit(const BagContents& contents, const std::string& topic) {
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

/// Returns the camera's transforms if the URI requests them. Error: nothing joins the frames.
Result<std::optional<CameraInTree>> place_of(const CameraUri& uri, BagContents& contents,
                                             const BagContents::Images& images) {
  const auto extra = [&](const char* name) {
    const auto found = uri.extras.find(name);
    return found == uri.extras.end() ? std::string() : found->second;
  };
  CameraInTree place{std::move(contents.transforms), extra("world"), extra("frame")};
  if (place.world.empty() && place.frame.empty()) return std::optional<CameraInTree>();
  if (place.frame.empty()) place.frame = images.frame_id;
  const bool is_there = place.transforms.are_joined(place.world, place.frame);
  if (is_there) return std::optional(std::move(place));
  const auto frames = place.transforms.frames();
  std::string why = "; the recording knows " + (frames.empty() ? "none" : listed(frames));
  if (!contents.unplaced.empty()) {
    const std::vector<std::string> without(contents.unplaced.begin(), contents.unplaced.end());
    why += "; what it says of " + listed(without) +
           " is no pose: its quaternion is not 1 long, as 0 0 0 0, or a number is not finite";
  }
  if (!contents.tf_trouble.empty()) why += "; " + contents.tf_trouble;
  return Error{Errc::bad_input, "camera " + uri.text + ": no transform joins the world '" +
                                    place.world + "' and the camera '" + place.frame + "'" + why};
}

/// Periods of the time stamps of frames, s.
struct Periods {
  double rate = 0;  // Hz; 0: nothing
  double longest = 0;
  int num_not_later = 0;  // frames whose stamp is not later
};

/// Stamps may leap: then the rate is that of most frames, not the mean.
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

/// Reads the recording up to the first cloud that makes a camera. Errors: there is none; of the
/// URI.
Result<CloudMessages> first_cloud(const CameraUri& uri, BagReader& reader, const std::string& topic,
                                  double scale) {
  const auto options = cloud_options(uri);
  if (!options) return options.error();
  CloudMessages clouds(*options, scale);
  if (const Status again = reader.rewind(); !again) return again.error();
  std::string why;
  for (;;) {
    const auto message = reader.next();
    if (!message) return message.error();
    if (!*message) {
      return Error{Errc::bad_input, "camera " + uri.text + ": " + topic + ": " + why};
    }
    const McapChannel& channel = reader.channels().at((*message)->channel);
    if (channel.topic != topic || !is_cloud_type(channel.schema_name)) continue;
    const auto frame = clouds.read((*message)->data);
    if (frame) return clouds;
    if (frame.error().code == Errc::invalid_argument) {
      return Error{frame.error().code,
                   "camera " + uri.text + ": " + topic + ": " + frame.error().message};
    }
    if (why.empty()) why = frame.error().message;
  }
}

class BagSource final : public DepthSource {
 public:
  BagSource(std::unique_ptr<BagReader> reader, std::string topic, double unit, double scale,
            std::optional<double> said, DepthStreamInfo info, LensHistory models,
            std::optional<CameraInTree> place, std::optional<CloudMessages> clouds, double latency,
            std::vector<std::string> notes)
      : reader_(std::move(reader)),
        topic_(std::move(topic)),
        unit_(unit),
        scale_(scale),
        said_(said),
        info_(std::move(info)),
        models_(std::move(models)),
        size_({info_.width, info_.height}),
        place_(std::move(place)),
        clouds_(std::move(clouds)),
        latency_(latency),
        notes_(std::move(notes)) {}

  const DepthStreamInfo& info() const override { return info_; }

  Result<bool> next(DepthFrame& frame) override {
    for (;;) {
      const auto message = reader_->next();
      if (!message) return message.error();
      if (!*message) {
        if (num_bad_ > 1) {
          note(std::to_string(num_bad_) + " messages on " + topic_ + " have been left out");
        }
        return false;
      }
      const McapChannel& channel = reader_->channels().at((*message)->channel);
      if (channel.topic != topic_) {
        // It may change in mid-stream.
        const auto unit = declared_unit(channel, (*message)->data);
        if (said_ && unit && is_unit_of(channel.topic, topic_)) said_ = unit;
        continue;
      }
      const std::string& schema = channel.schema_name;
      if (clouds_ ? !is_cloud_type(schema) : !is_image_type(schema)) continue;
      auto read = clouds_ ? clouds_->read((*message)->data)
                          : read_bag_frame(schema, **message, unit_, scale_);
      if (!read) {
        if (++num_bad_ == 1) note(topic_ + ": a message is left out: " + read.error().message);
        continue;
      }
      if (clouds_) {
        read->timestamp = stamp_of(**message).time;
        if (std::string text = clouds_->take_note(); !text.empty()) note(topic_ + ": " + text);
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
    if (const int num = num_unplaced_.exchange(0); num > 0) {
      note(std::to_string(num) + " frames were dropped: there is no transform for '" +
           place_->frame + "' in '" + place_->world + "' at their stamps");
    }
    const std::lock_guard lock(mutex_);
    return std::exchange(notes_, {});
  }

 private:
  void note(std::string text) {
    const std::lock_guard lock(mutex_);
    notes_.push_back(std::move(text));
  }
  /// Reports a new lens or size in info(); its reader turns images into those of the first one.
  void follow_camera(const DepthFrame& frame) {
    const ImageSize size{frame.width, frame.height};
    const std::size_t before = model_;
    while (model_ + 1 < models_.size() && models_[model_ + 1].first <= frame.timestamp) ++model_;
    if (model_ == before && size == size_) return;
    bool& is_noted = model_ == before ? has_other_size_ : has_other_lens_;
    if (!std::exchange(is_noted, true)) {
      note(topic_ +
           (model_ == before ? ": the size of its images changes" : ": its camera_info changes") +
           " in mid-stream, and is followed");
    }
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
  const double unit_, scale_;
  std::optional<double> said_;
  DepthStreamInfo info_;
  const LensHistory models_;
  std::size_t model_ = 0;  // of the last frame
  ImageSize size_;         // likewise
  const std::optional<CameraInTree> place_;
  std::optional<CloudMessages> clouds_;  // none: images
  const double latency_;                 // s
  double last_ = 0;
  int num_read_ = 0, num_bad_ = 0;
  std::atomic<int> num_unplaced_ = 0;
  bool has_other_lens_ = false, has_other_size_ = false;
  std::mutex mutex_;  // guards the members below
  std::vector<std::string> notes_;
};

}  // namespace

Result<RawStream> open_bag_camera(const CameraUri& uri, const CameraOpening&) {
  if (const Status status =
          uri.check_extras({"topic", "info", "world", "frame", "scale", "viewpoint", "look"});
      !status)
    return status.error();
  const auto scale = scale_of_numbers(uri);
  if (!scale) return scale.error();
  auto reader = BagReader::open(uri.target);
  if (!reader) return reader.error();
  BagContents contents;
  std::vector<std::string> notes;
  if (const auto first = first_part_of(uri.target); !first.empty()) {
    const auto part = BagReader::open(first);
    if (part && look_through_first_part(**part, contents)) {
      notes.push_back("bag:" + uri.target +
                      " is a part of a recording: what is sent once is read in " + first.string() +
                      ", too");
    }
  }
  const Status looked = look_through(**reader, uri, contents);
  if (!looked) return looked.error();
  const std::vector<std::string>& lacks = (*reader)->notes();
  notes.insert(notes.end(), lacks.begin(), lacks.end());
  // The parts that are not there may hold what is not found.
  const auto with_lacks = [&](Error error) {
    for (const std::string& each : lacks) error.message += "; " + each;
    return error;
  };
  const auto topic = contents.choose_images(uri);
  if (!topic) return with_lacks(topic.error());

  const bool has_clouds = contents.has_clouds(*topic);
  const BagContents::Images& images =
      has_clouds ? contents.clouds.at(*topic) : contents.images.at(*topic);
  DepthStreamInfo info;
  std::optional<CloudMessages> clouds;
  if (has_clouds) {
    auto first = first_cloud(uri, **reader, *topic, *scale);
    if (!first) return first.error();
    clouds = *std::move(first);
    clouds->camera()->describe(info);
    if (const std::string unread = contents.unread_depth(); !unread.empty()) {
      notes.push_back("bag:" + uri.target + ": the clouds on " + *topic +
                      " are taken, as its depth images are not read" + unread);
    }
  } else {
    if (const Status status = check_for_images(uri); !status) return status.error();
    info.width = images.width;
    info.height = images.height;
    info.unit = images.unit;
  }
  // Counts of our own recordings may be of any unit; those of meters are made here.
  const bool is_count = !has_clouds && images.unit != kFloatUnit;
  if (is_count && uri.extras.contains("scale")) {
    return Error{Errc::invalid_argument, "camera " + uri.text +
                                             ": 'scale' is for images of 32FC1, and those on " +
                                             *topic + " are counts: pass ?unit=METERS"};
  }
  const double unit = is_count || has_clouds ? info.unit : uri.unit.value_or(kFloatUnit);
  const auto said = is_count ? find_unit(contents, *topic) : std::nullopt;
  if (said && *said > kLargestUnit && !uri.unit) {
    return Error{Errc::bad_input, "camera " + uri.text + " declares a unit of " +
                                      number_text(*said) +
                                      " m per count, which is at most 1 m; pass ?unit=METERS"};
  }
  info.unit = said.value_or(unit);
  info.num_frames = images.num_frames;
  info.name = "bag:" + uri.target;
  if (contents.was_cut_off) {
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
  if (const int num = contents.messages[*topic] - images.num_frames - images.num_bad; num > 0) {
    notes.push_back(info.name + ": " + std::to_string(num) + " messages on " + *topic +
                    " are left out, as they are of another type than its images");
  }
  info.rate = uri.rate.value_or(periods.rate > 0 ? periods.rate : info.rate);
  for (const auto& [name, sensor] : contents.sensors) {
    if (ros_parent(name) == ros_parent(*topic)) info.sensor = sensor;
  }
  auto models = has_clouds ? LensHistory() : contents.choose_lens(uri, *topic, notes);
  if (!models) return with_lacks(models.error());
  if (!models->empty()) set_ros_camera(models->front().second, *topic, info);
  if (const auto truth = truth_of(uri, info); !truth && !lacks.empty()) {
    return with_lacks(truth.error());
  }
  auto place = place_of(uri, contents, images);
  if (!place) return with_lacks(place.error());
  if (*place) info.is_moving = (*place)->transforms.is_moving((*place)->world, (*place)->frame);
  if (*place && !contents.tf_trouble.empty()) {
    notes.push_back(info.name + ": a message of transforms is left out: " + contents.tf_trouble);
  }
  if (const Status again = (*reader)->rewind(); !again) return again.error();
  const std::optional<Pose> X_FC = clouds ? clouds->camera()->projection() : std::nullopt;
  return RawStream{
      std::make_unique<BagSource>(*std::move(reader), *topic, unit, *scale, said, std::move(info),
                                  *std::move(models), *std::move(place), std::move(clouds),
                                  uri.latency, std::move(notes)),
      StampClock::cameras, true, X_FC};
}

FoundCameras find_bag_cameras() {
  return always_there(
      "depth or clouds of ROS 2 and ROS 1 recordings, of RealSense cameras and of palpate record, "
      "with their camera_info; ?world=FRAME: the camera is where their tf says");
}

}}  // namespace palpate::v0
