#include "src/cameras/stream/frame_intake.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "src/cloud/internal/frame_limits.h"
#include "src/core/internal/message_text.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kFirstFrameTimeout = 10;  // s
constexpr double kBlackSeconds = 1;        // s without any measurement until a note
constexpr double kLate = 1;                // s: more than that is worth a note
constexpr std::size_t kMaxNotes = 100;
constexpr std::uint64_t kMaxTold = 10;  // of what may happen with every frame

bool is_black(const DepthFrame& frame) {
  return std::all_of(frame.pixels.begin(), frame.pixels.end(),
                     [](std::uint16_t count) { return count == 0; });
}

std::string size_text(const CameraModel& model) {
  return std::to_string(model.width) + " x " + std::to_string(model.height);
}

std::string number(const char* format, double value) {
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace

FrameIntake::FrameIntake(const Options& options) : options_(options), rectifier_(options.pinhole) {}

void FrameIntake::give(DepthFrame& frame, const CameraModel& model, double arrival) {
  const bool black = is_black(frame);
  const std::lock_guard lock(mutex_);
  if (is_cancelled_ || has_ended_) return;
  ++num_arrived_;
  if (!accept(frame, model, arrival, black)) return;
  if (has_new_) ++num_left_out_;
  std::swap(newest_.frame, frame);
  newest_.model = model;
  newest_.capture_time = last_capture_;
  has_new_ = true;
  changed_.notify_all();
}

/// Returns the capture time of a stamp, s; may find that the camera has started its clock anew.
double FrameIntake::capture_time_of(double stamp, double arrival) {
  if (options_.stamps == StampClock::cameras) return clock_.add(stamp, arrival);
  // Stamps said to be of this computer's clock are believed once plausible: then old is late.
  constexpr double kOldest = 1;         // s
  constexpr double kLargestOff = 0.01;  // s, as clocks that are synchronized may be
  constexpr int kNumForeign = 10;       // frames in a row
  const bool is_ahead = stamp > arrival;
  is_our_clock_ = is_our_clock_ || options_.stamps == StampClock::shared ||
                  (!is_ahead && stamp >= arrival - kOldest);
  const bool is_foreign = !is_our_clock_ || stamp > arrival + kLargestOff;
  num_foreign_ = is_foreign ? num_foreign_ + 1 : 0;
  if (num_foreign_ == kNumForeign && !has_foreign_stamps_) {
    has_foreign_stamps_ = true;
    note(
        "has time stamps that are not of this computer's clock; its frames count as captured "
        "when they arrive");
  }
  return is_ahead || !is_our_clock_ ? arrival : stamp;
}

/// Sets last_capture_ if the frame is used.
bool FrameIntake::accept(const DepthFrame& frame, const CameraModel& model, double arrival,
                         bool black) {
  double capture = arrival;
  const double stamp = frame.timestamp;
  if (options_.stamps != StampClock::none && !is_in_seconds(stamp)) {
    ++num_without_stamp_since_;
    if (num_without_stamp_++ == 0) {
      note("has time stamps that are no seconds, such as " + number_text(stamp) +
           "; these frames count as captured when they arrive");
    }
  } else if (options_.stamps != StampClock::none) {
    const int num_restarts = clock_.num_restarts();
    const StampOrder::Step step = order_.add(stamp, arrival);
    if (step == StampOrder::Step::set_back) is_our_clock_ = false;
    const double earliest = capture_time_of(stamp, arrival);
    if (clock_.num_restarts() > num_restarts || step == StampOrder::Step::set_back) {
      note_again(num_restarts_, "has restarted its clock");
    } else if (step == StampOrder::Step::older) {
      if (num_from_past_++ == 0) note("sends frames with old timestamps, which are dropped");
      return false;
    } else if (options_.rate > 0) {
      const double periods = (stamp - last_stamp_) * options_.rate;
      const double num_between = std::round(periods) - 1 - num_without_stamp_since_;
      if (periods < 1e6) num_missing_ += static_cast<std::uint64_t>(std::max(0.0, num_between));
    }
    num_without_stamp_since_ = 0;
    if (arrival - earliest > kLate && num_late_++ == 0) {
      note("sends frames that are " + number("%.1f", arrival - earliest) +
           " s late; is what sends them, or the network, too slow for them? If it stood still "
           "and goes on where it was (a simulator, a player), start the run again");
    }
    last_stamp_ = stamp;
    lateness_.record(static_cast<std::int64_t>(1e9 * std::max(0.0, arrival - earliest)));
    capture = earliest;
  }
  if (black) {
    ++num_black_;
    const double least = kBlackSeconds * std::max(options_.rate, 1.0);
    if (static_cast<double>(++num_black_in_a_row_) == std::ceil(least)) {
      note(
          "sends images without any measurement: is its lens covered, or all nearer than it can "
          "see?");
    }
    has_last_ = true;
    return false;
  }
  num_black_in_a_row_ = 0;
  note_change(model, frame.unit);
  capture -= options_.latency;
  last_capture_ =
      has_last_
          ? std::max(capture, std::nextafter(last_capture_, std::numeric_limits<double>::max()))
          : capture;
  has_last_ = true;
  return true;
}

void FrameIntake::note_change(const CameraModel& model, double unit) {
  if (last_model_ && !(*last_model_ == model)) {
    const bool has_new_size =
        last_model_->width != model.width || last_model_->height != model.height;
    note_again(num_changes_,
               has_new_size ? "has changed its image from " + size_text(*last_model_) + " to " +
                                  size_text(model) + " pixels; it is resampled to the previous size"
                            : "has changed its intrinsics; they are followed");
  }
  if (last_model_ && last_unit_ != unit) {
    note_again(num_changes_, "has changed its depth unit from " + number("%g", last_unit_) +
                                 " to " + number("%g", unit) + " m; it is followed");
  }
  last_model_ = model;
  last_unit_ = unit;
}

void FrameIntake::end(Result<bool> how) {
  const std::lock_guard lock(mutex_);
  has_ended_ = true;
  ending_ = std::move(how);
  changed_.notify_all();
}

void FrameIntake::restart() {
  const std::lock_guard lock(mutex_);
  clock_.reset();
  // Time stamps of another start are not compared with those before.
  last_stamp_ = -std::numeric_limits<double>::infinity();
  order_ = {};
  is_our_clock_ = false;
}

Result<bool> FrameIntake::next(DepthFrame& frame) {
  std::unique_lock lock(mutex_);
  const auto is_over = [&] { return has_new_ || has_ended_ || is_cancelled_; };
  if (taken_model_.width > 0) {
    changed_.wait(lock, is_over);
  } else if (!changed_.wait_for(lock, std::chrono::duration<double>(kFirstFrameTimeout), is_over)) {
    return Error{Errc::unavailable,
                 options_.name + " has sent no " + (num_black_ > 0 ? "measurement" : "frame") +
                     " within 10 s; check the camera, its cable and what it looks at"};
  }
  if (is_cancelled_) return false;
  if (!has_new_) return ending_;
  has_new_ = false;
  std::swap(taken_, newest_.frame);
  taken_model_ = newest_.model;
  taken_.timestamp = newest_.capture_time;
  lock.unlock();
  rectifier_.apply(taken_model_, taken_);
  std::swap(frame, taken_);
  return true;
}

void FrameIntake::cancel() {
  const std::lock_guard lock(mutex_);
  if (!is_cancelled_) note(closing_words());
  is_cancelled_ = true;
  changed_.notify_all();
}

bool FrameIntake::is_cancelled() const {
  const std::lock_guard lock(mutex_);
  return is_cancelled_;
}

bool FrameIntake::sleep_for(double seconds) {
  std::unique_lock lock(mutex_);
  return !changed_.wait_for(lock, std::chrono::duration<double>(seconds),
                            [&] { return is_cancelled_; });
}

void FrameIntake::add_note(std::string text) {
  const std::lock_guard lock(mutex_);
  note(std::move(text));
}

void FrameIntake::note(std::string text) {
  if (notes_.size() < kMaxNotes) notes_.push_back(options_.name + " " + std::move(text));
}

/// Adds the note ten times; then only counts.
void FrameIntake::note_again(std::uint64_t& count, std::string text) {
  if (++count > kMaxTold) return;
  note(std::move(text) + (count == kMaxTold ? "; from now on, that is only counted" : ""));
}

std::string FrameIntake::closing_words() const {
  std::string text = "has sent " + std::to_string(num_arrived_) + " frames";
  const auto add = [&](std::uint64_t count, const char* what) {
    if (count > 0) text += "; " + std::to_string(count) + " " + what;
  };
  add(num_missing_, "are missing between them");
  add(num_left_out_, "were dropped for newer ones");
  add(num_from_past_, "had old timestamps");
  add(num_late_, "came more than a second late");
  add(num_without_stamp_, "had time stamps that are no seconds");
  add(num_black_, "had no measurement");
  if (num_restarts_ > kMaxTold) add(num_restarts_, "times, its clock was restarted");
  if (num_changes_ > kMaxTold) add(num_changes_, "times, image, intrinsics or unit changed");
  if (options_.stamps == StampClock::none) {
    return text + "; it has no timestamps: a frame counts as captured on arrival";
  }
  if (lateness_.summary().num == 0) return text;
  const std::string late = number("%.1f", lateness_.summary().p99 * 1e-3) + " ms of ";
  if (options_.stamps != StampClock::cameras) {
    return text + "; capture times are by this computer's clock; 99 % came within " + late +
           "their capture";
  }
  return text + "; capture times are from its clock, which drifts by " +
         number("%+.0f", 1e6 * clock_.drift()) + " ppm; 99 % came within " + late + "the earliest";
}

std::vector<std::string> FrameIntake::take_notes() {
  const std::lock_guard lock(mutex_);
  return std::exchange(notes_, {});
}

}}  // namespace palpate::v0
