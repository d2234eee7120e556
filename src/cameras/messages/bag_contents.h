// Contents of a recording after one look through all of it, and the parts that make a camera.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "src/cameras/messages/depth_messages.h"
#include "src/io/internal/bag_file.h"
#include "src/io/internal/ros_image.h"
#include "src/ros/internal/tf_history.h"

namespace palpate { inline namespace v0 {

/// The lens of a camera from a stamp on, s.
using LensHistory = std::vector<std::pair<double, RosCameraModel>>;

/// Contents of a recording. An unreadable message is no error of the recording: why it is
/// unreadable is kept with its topic.
struct BagContents {
  struct Images {
    int num_frames = 0;          // without those that are of another type than the first one
    std::vector<double> stamps;  // s
    int width = 0, height = 0;   // of the first one
    double unit = 0;             // likewise
    std::string frame_id;        // likewise
    int num_bad = 0;             // before the first frame
    std::string trouble;         // why the first of these is none
  };
  struct Camera {
    LensHistory models;
    std::string frame_id;  // of the first one
    std::string trouble;   // likewise
  };
  std::map<std::string, Images> images;  // by topic, as all that follows
  std::map<std::string, Images> clouds;
  std::map<std::string, Camera> cameras;
  std::map<std::string, double> units;  // the first one
  std::map<std::string, int> messages;
  std::map<std::string, SensorKind> sensors;
  TfHistory transforms;
  std::set<std::string> unplaced;  // frames with a transform that is no pose
  std::string tf_trouble;          // why a message of transforms is none; of the first such
  bool was_cut_off = false;

  /// The topic to read: the desired one, or the only one with depth; without any, the only one with
  /// clouds.
  Result<std::string> choose_images(const CameraUri& uri) const;
  /// True if what is to be read of a topic are clouds.
  bool has_clouds(const std::string& topic) const;
  /// Returns why topics of depth images are not read; empty: there are none such.
  std::string unread_depth() const;
  /// The lens of images: that of `info=`, beside them, of their frame, or the only one. None: it is
  /// not known. `notes` get what is to be said of it. Error: it cannot be read, or is that of
  /// another camera, and none is given.
  Result<LensHistory> choose_lens(const CameraUri& uri, const std::string& topic,
                                  std::vector<std::string>& notes) const;
};

/// Adds everything that is found. Errors: of the file.
Status look_through(BagReader& reader, const CameraUri& uri, BagContents& contents);
/// Adds messages that are sent once, and so lie in the first part of a recording: static transforms
/// and lenses.
Status look_through_first_part(BagReader& reader, BagContents& contents);

/// Reads an image of either type. Error: why it is none.
Result<DepthFrame> read_bag_frame(const std::string& schema, const McapMessage& message,
                                  double unit, double scale);
bool is_image_type(const std::string& schema);
bool is_cloud_type(const std::string& schema);
/// Returns when an image was captured, or recorded if it has no stamp, s; and in which frame.
RosStamp stamp_of(const McapMessage& message);
/// Meters per count, as in our recordings and those of RealSense cameras.
std::optional<double> declared_unit(const McapChannel& channel, std::string_view message);
/// Tells if a unit is that of the images: it lies beside them, or is an option of their sensor.
bool is_unit_of(std::string_view unit, const std::string& images);

}}  // namespace palpate::v0
