// Messages of a camera over ROS 2 as they come: images, their camera_infos and transforms come in
// threads of their own and in any order, and are put together by their stamps.
#pragma once

#include <cmath>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "src/cameras/messages/depth_messages.h"
#include "src/ros/internal/tf_history.h"

namespace palpate { inline namespace v0 {

/// Messages that the subscriptions have received. Their threads write, one reads.
class ReceivedMessages {
 public:
  /// `topic`: of the images.
  explicit ReceivedMessages(std::string topic) : topic_(std::move(topic)) {}

  /// Called with each message by the thread of its subscription.
  void image(std::string_view message);
  void camera_info(std::string_view message);
  void transforms(std::string_view message, bool is_static);
  /// Forgets the camera_infos that have come: what comes has no lens.
  void forget_lens();

  struct Place {
    Pose X_WC;
    bool is_fixed = false;  // no frame between the two may move
  };
  /// Returns the pose of the camera at a time of the stamps, between the transforms before and
  /// after it; waits a tenth of a second for the latter. None: there is no transform.
  std::optional<Place> place(const std::string& world, const std::string& frame, double time);
  /// Says which frames tf knows, for error messages.
  std::string frames() const;

  struct Image {
    std::string message, frame;
    std::optional<RosCameraModel> model;
  };
  /// Takes the newest image with the camera_info of its stamp; if none comes with it, with the last
  /// one, or not at all if the lens changes: the intrinsics of one lens are wrong for another.
  /// Waits at most a tenth of a second, and a little longer for the camera_info. False: none came.
  bool take(Image& image);

  void cancel();
  bool is_cancelled() const;
  /// Adds a note once.
  void add_note(const std::string& text);
  std::vector<std::string> take_notes();

 private:
  static constexpr std::size_t kNumModels = 32;  // camera_infos that are kept
  static constexpr double kKeptTf = 5;           // s

  const RosCameraModel* model_of_image() const;
  bool has_one_lens() const;
  /// True if one camera_info has come, of about the time of the image: it may be the first of many,
  /// with a lens that changes, or the only one that is sent.
  bool may_be_first_of_many() const;
  /// Counts an image; adds a note if there are too many per second.
  void note_flood(double now);
  /// Adds a note once for each kind: text in quotes is of others, who may write anything there.
  void note(const std::string& text);

  const std::string topic_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::string image_, frame_;
  double image_stamp_ = 0, image_arrival_ = 0;  // s
  std::deque<double> taken_stamps_ =
      std::deque<double>(kNumModels, std::nan(""));  // s, of the last images
  std::deque<std::pair<double, RosCameraModel>> models_;
  TfHistory history_{kKeptTf};
  double since_ = 0;   // s, monotonic: begin of the second in which images are counted
  int num_since_ = 0;  // images in that second
  bool has_image_ = false, comes_in_pairs_ = true, has_come_in_pairs_ = false;
  bool is_cancelled_ = false;
  std::set<std::string> said_;  // kinds of notes
  std::vector<std::string> notes_;
};

}}  // namespace palpate::v0
