#include "src/cameras/messages/received_messages.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "src/core/internal/monotonic_clock.h"
#include "src/core/internal/shared_library.h"
#include "src/io/internal/cdr.h"
#include "src/io/internal/ros_image.h"

namespace palpate { inline namespace v0 {
namespace {

using namespace std::chrono_literals;

constexpr double kLongestPairing = 0.1;  // s that an image waits for its camera_info
constexpr double kLongestLone = 1;       // s from one camera_info to the next, if others follow
constexpr double kLongestTf = 0.1;       // s that an image waits for its transform
constexpr int kMaxImages = 200;          // per second; more are a mistake, with a note

}  // namespace

void ReceivedMessages::image(std::string_view message) {
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

void ReceivedMessages::camera_info(std::string_view message) {
  CdrReader from(message);
  const double stamp = read_ros_header(from).time;
  const auto model = read_camera_model(message);
  const std::lock_guard lock(mutex_);
  if (!model) {
    note(model.error().message + "; it is ignored");
    return;
  }
  if (const Status status = check_ros_camera(*model, topic_); !status) {
    note(status.error().message + "; it is ignored");
    return;
  }
  models_.emplace_back(stamp, *model);
  comes_in_pairs_ = comes_in_pairs_ || stamp == taken_stamps_.back();  // it was only late
  has_come_in_pairs_ = has_come_in_pairs_ || std::find(taken_stamps_.begin(), taken_stamps_.end(),
                                                       stamp) != taken_stamps_.end();
  if (models_.size() > kNumModels) models_.pop_front();
  changed_.notify_all();
}

void ReceivedMessages::transforms(std::string_view message, bool is_static) {
  const auto transforms = read_transforms(message);
  if (!transforms) return;
  const std::lock_guard lock(mutex_);
  for (const RosStampedTransform& each : *transforms) history_.add(each, is_static);
  changed_.notify_all();
}

void ReceivedMessages::forget_lens() {
  const std::lock_guard lock(mutex_);
  models_.clear();
}

std::optional<ReceivedMessages::Place> ReceivedMessages::place(const std::string& world,
                                                               const std::string& frame,
                                                               double time) {
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

std::string ReceivedMessages::frames() const {
  const std::lock_guard lock(mutex_);
  const auto frames = history_.frames();
  return frames.empty() ? "no tf message has come" : "tf knows " + listed(frames);
}

bool ReceivedMessages::take(Image& image) {
  std::unique_lock lock(mutex_);
  if (!changed_.wait_for(lock, 100ms, [&] { return has_image_ || is_cancelled_; })) return false;
  if (is_cancelled_) return false;
  // Camera_infos that are sent once, or by another clock, are not waited for again and again.
  if (comes_in_pairs_ && !models_.empty() && model_of_image() == nullptr) {
    const std::chrono::duration<double> left(image_arrival_ + kLongestPairing - monotonic_now());
    comes_in_pairs_ =
        changed_.wait_for(lock, left, [&] { return model_of_image() != nullptr || is_cancelled_; });
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

void ReceivedMessages::cancel() {
  const std::lock_guard lock(mutex_);
  is_cancelled_ = true;
  changed_.notify_all();
}

bool ReceivedMessages::is_cancelled() const {
  const std::lock_guard lock(mutex_);
  return is_cancelled_;
}

void ReceivedMessages::add_note(const std::string& text) {
  const std::lock_guard lock(mutex_);
  note(text);
}

std::vector<std::string> ReceivedMessages::take_notes() {
  const std::lock_guard lock(mutex_);
  return std::exchange(notes_, {});
}

const RosCameraModel* ReceivedMessages::model_of_image() const {
  for (auto each = models_.rbegin(); each != models_.rend(); ++each) {
    if (each->first == image_stamp_) return &each->second;
  }
  return nullptr;
}

bool ReceivedMessages::has_one_lens() const {
  return std::all_of(models_.begin(), models_.end(),
                     [&](const auto& each) { return each.second == models_.back().second; });
}

bool ReceivedMessages::may_be_first_of_many() const {
  return models_.size() == 1 && std::abs(image_stamp_ - models_.back().first) < kLongestLone;
}

void ReceivedMessages::note_flood(double now) {
  ++num_since_;
  if (now - since_ < 1) return;
  if (num_since_ > kMaxImages * (now - since_)) {
    note("sends more than " + std::to_string(kMaxImages) +
         " images per second; the newest one is used, the others are dropped");
  }
  since_ = now;
  num_since_ = 0;
}

void ReceivedMessages::note(const std::string& text) {
  constexpr std::size_t kMaxNotes = 100;  // whatever a stranger sends
  if (said_.size() >= kMaxNotes) return;
  if (said_.insert(text.substr(0, text.find('\''))).second) notes_.push_back(text);
}

}}  // namespace palpate::v0
