// A recording with random access.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/run/run_loop.h"
#include "palpate/viewer/viewer.h"

namespace palpate { inline namespace v0 {

/// A recorded query.
struct RecordedQuery {
  double time = 0;   ///< s since the run began
  double clock = 0;  ///< the same moment on the clock by which frames were taken
  Pose X_WT;
  std::size_t frame = 0;  ///< index of the newest frame that it was made with
  CameraBlends cameras;
  std::vector<Pose> bodies;    ///< of objects that move, X_WB
  std::uint32_t revision = 0;  ///< of the settings
};

struct RecordedFrame {
  ViewFrame shown;
  double clock = 0;  ///< s, as for the surfaces
};

struct RecordedMark {
  double time = 0;
  std::string text;
};

/// For one thread. Frames are counted from 0 as they are in the recording.
class RecordedRun {
 public:
  virtual ~RecordedRun() = default;

  virtual const Tool& tool() const = 0;
  virtual const std::vector<DepthStreamInfo>& streams() const = 0;
  /// All objects, with their shapes.
  virtual const std::vector<SceneObject>& objects() const = 0;
  /// Settings of a revision.
  virtual RunSettings settings(std::uint32_t revision) = 0;
  /// Duration of the recording that is known by now, s.
  virtual double duration() = 0;
  virtual std::size_t num_frames() = 0;
  /// Number of a frame in the run: some may have been lost.
  virtual std::uint64_t frame_number(std::size_t index) = 0;
  /// Index of the frame's camera, and FrameRecord::camera_frame.
  virtual std::pair<std::size_t, std::int64_t> camera_frame(std::size_t index) = 0;
  virtual Result<RecordedFrame> read_frame(std::size_t index) = 0;
  /// SurfaceTimeline::period after this frame, s.
  virtual double period_after(std::size_t index) = 0;
  /// Time of its first use, s since the run began.
  virtual double needed_from(std::size_t index) = 0;
  /// The last query that is not later, else the first one. Error: it cannot be read any more.
  virtual Result<RecordedQuery> query_at(double time) = 0;
  /// Ticks later than `after` until `until`, in order.
  virtual Result<std::vector<ViewSample>> samples(double after, double until) = 0;
  /// Time of the first tick with a contact until `until`, if there is one, s.
  virtual Result<std::optional<double>> first_touch(double until) = 0;
  /// Marks so far, also from another thread: there are more once more of the recording is known.
  virtual std::vector<RecordedMark> marks() const = 0;
  virtual std::size_t num_marks() const = 0;
  /// Note on the recording for the user; else empty.
  virtual std::string note() = 0;
};

/// Opens the run in this folder.
Result<std::unique_ptr<RecordedRun>> open_recorded_run(const std::filesystem::path& folder);

}}  // namespace palpate::v0
