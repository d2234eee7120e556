// Intake of live frames: any thread delivers them, and the run takes them.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <limits>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "palpate/core/core.h"
#include "src/cameras/stream/capture_clock.h"
#include "src/cameras/stream/rectifier.h"

namespace palpate { inline namespace v0 {

/// The newest frame wins. Frames without any measurement and frames from the past are left out, so
/// that the surface gets old and forces fade, as with a camera that sends nothing.
class FrameIntake {
 public:
  struct Options {
    CameraModel pinhole;                   ///< of the frames that come out
    double rate = 30;                      ///< frames per second
    StampClock stamps = StampClock::none;  ///< without, a frame is captured when it arrives
    double latency = 0;  ///< s, from the exposure to the time stamp, or to the arrival
    std::string name;
  };
  explicit FrameIntake(const Options& options);

  // The camera's side, any thread.

  /// Takes the frame's memory and gives other memory back. Waits at most while another thread swaps
  /// two vectors. `arrival`: s, monotonic.
  void give(DepthFrame& frame, const CameraModel& model, double arrival);
  /// Ends the stream: at the end of the frames, or by an error.
  void end(Result<bool> how);
  void add_note(std::string text);
  /// The camera has been opened again: its clock may have started anew.
  void restart();

  // The run's side.

  /// One thread; see DepthSource. Error: no frame within the first ten seconds.
  Result<bool> next(DepthFrame& frame);
  void cancel();
  bool is_cancelled() const;
  /// False if cancelled.
  bool sleep_for(double seconds);
  std::vector<std::string> take_notes();

 private:
  struct Arrived {
    DepthFrame frame;
    CameraModel model;
    double capture_time = 0;
  };
  double capture_time_of(double stamp, double arrival);
  bool accept(const DepthFrame& frame, const CameraModel& model, double arrival, bool is_black);
  void note_change(const CameraModel& model, double unit);
  void note(std::string text);
  void note_again(std::uint64_t& count, std::string text);
  std::string closing_words() const;

  const Options options_;
  Rectifier rectifier_;  // of the run's side
  DepthFrame taken_;
  CameraModel taken_model_;

  mutable std::mutex mutex_;  // guards the members below
  std::condition_variable changed_;
  Arrived newest_;
  std::optional<CameraModel> last_model_;
  double last_unit_ = 0, last_capture_ = 0;
  double last_stamp_ = -std::numeric_limits<double>::infinity();  // since the camera has started
  double num_without_stamp_since_ = 0;
  bool has_new_ = false, has_ended_ = false, is_cancelled_ = false, has_last_ = false;
  bool has_foreign_stamps_ = false, is_our_clock_ = false;
  int num_foreign_ = 0;  // frames in a row whose stamps are not of our clock
  Result<bool> ending_ = false;
  StampOrder order_;
  CaptureClock clock_;  // of a camera's own clock
  std::vector<std::string> notes_;
  LatencyHistogram lateness_;  // ns after the earliest that the clock expects
  std::uint64_t num_arrived_ = 0, num_missing_ = 0, num_left_out_ = 0, num_from_past_ = 0,
                num_late_ = 0;
  std::uint64_t num_without_stamp_ = 0, num_black_ = 0, num_black_in_a_row_ = 0;
  std::uint64_t num_restarts_ = 0, num_changes_ = 0;  // of its clock; of images, lens and unit
};

}}  // namespace palpate::v0
