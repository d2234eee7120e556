// The first threads of the loop: frames of each camera are read as time passes, and made into
// surfaces by one thread.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <vector>

#include "palpate/run/run_loop.h"
#include "src/core/internal/triple_buffer.h"
#include "src/run/internal/event.h"
#include "src/run/loop/queues/mailbox.h"
#include "src/run/loop/queues/paced_source.h"
#include "src/run/loop/queues/record_queue.h"

namespace palpate { inline namespace v0 {

/// Views of SurfaceTimeline::key_frames. Copying takes only those that there are.
class KeyFrameViews {
 public:
  KeyFrameViews() = default;
  KeyFrameViews(const KeyFrameViews& other) { *this = other.all(); }
  KeyFrameViews& operator=(const KeyFrameViews& other) { return *this = other.all(); }
  KeyFrameViews& operator=(std::span<const SurfaceBlend> views) {
    num_ = std::min(views.size(), views_.size());
    std::copy_n(views.begin(), num_, views_.begin());
    return *this;
  }
  std::span<const SurfaceBlend> all() const { return {views_.data(), num_}; }

 private:
  std::array<SurfaceBlend, kMaxCameras> views_;
  std::size_t num_ = 0;
};

/// Surfaces of a camera that the contact thread uses until it takes the next ones.
struct LiveSurfaces {
  SurfaceBlend blend;  ///< progress 1: there is nothing to blend
  KeyFrameViews key_frames;
  double ready_time = 0, capture_time = 0;  ///< s, monotonic
  double period = 1;                        ///< s, expected until the next ones
  std::uint64_t frame_number = 0;           ///< FrameRecord::number of `blend.to`
  std::uint64_t camera_frame = 0;           ///< likewise; `from` is the one before
  std::uint32_t revision = 0;               ///< of the settings it was made with
};

/// A frame that has become a surface, for observers.
struct PublishedFrame {
  DepthFrame frame;
  FrameRecord record = {};
};

/// Ball around the tool, for the window of the surface thread.
struct ToolBall {
  Vec3d p_TC;        ///< center of mass
  double reach = 0;  ///< bound on the distance of all its elements' centers, m
};
ToolBall ball_of(const Tool& tool);

/// Other timelines; once settled, it holds the previous ones.
struct SurfaceChange {
  std::uint32_t revision = 0;
  std::vector<SurfaceTimeline> timelines;
};

/// A timeline keeps one surface more than are in use: the next frame is made into that one while
/// the contact thread uses the last two. Before the camera's frame after that, which goes into the
/// older of these two, the surface thread waits until the contact thread has taken the new
/// surfaces. The contact thread never waits.
class SurfaceStage {
 public:
  /// Number of spare surfaces in each timeline.
  static constexpr int kNumSpare = 1;

  SurfaceStage(const DepthSources& sources, std::vector<SurfaceTimeline> timelines,
               const RunSettings& settings, const ToolBall& tool, bool keeps_frames,
               LatencyHistogram& surface_compute);
  ~SurfaceStage() { stop(); }

  /// Begins, and returns when the first surface of each camera is there. Errors: a first frame, or
  /// none comes.
  Status start();
  void stop() noexcept;

  std::size_t num_cameras() const noexcept { return cameras_.size(); }
  /// Contact thread: takes the newest surfaces of a camera if there are new ones; releases the
  /// older.
  bool take(std::size_t camera) noexcept;
  const LiveSurfaces& taken(std::size_t camera) const noexcept {
    return cameras_[camera]->surfaces.value();
  }

  /// Haptic thread: where the tool is.
  void move_tool(const Pose& X_WT) noexcept { tools_.publish(X_WT); }

  /// Changes the timelines of the next frames. The surfaces of those before are used until the
  /// contact thread has newer ones of all cameras.
  Mailbox<SurfaceChange>& changes() noexcept { return changes_; }
  /// Sets the revision of settings that do not concern surfaces.
  void set_revision(std::uint32_t revision) noexcept { revision_.store(revision); }
  /// Sets the coupling's motion scale from the next frame on: tool speed over hand speed.
  void set_motion_scale(double scale) noexcept { motion_scale_.store(scale); }

  /// While frames are held, the last one comes again and again, as from a camera; `step` lets one
  /// more through. Any thread.
  void hold(bool is_held) noexcept { is_held_.store(is_held); }
  void step() noexcept { num_steps_.fetch_add(1); }

  void request_picture() noexcept { wants_picture_.store(true); }
  /// The newest one, if it is new; one reader.
  const SurfacePicture* new_picture() noexcept {
    return pictures_.refresh() ? &pictures_.value() : nullptr;
  }

  /// Ends and failures of the stage, by the first camera that ends or fails. A backend that has
  /// failed may be changed. Any thread.
  bool has_source_ended() const noexcept {
    return ended_camera_.load(std::memory_order_acquire) >= 0;
  }
  /// Index of the camera whose frames ended first; -1: none.
  int ended_camera() const noexcept { return ended_camera_.load(std::memory_order_acquire); }
  bool has_source_failed() const noexcept { return source_failed_.load(std::memory_order_acquire); }
  bool has_backend_failed() const noexcept {
    return backend_failed_.load(std::memory_order_acquire);
  }
  Status status() const;

  /// The nice value of the threads that make surfaces.
  int nice() const noexcept { return nice_.load(); }
  std::uint64_t num_frames() const noexcept { return num_made_.load(std::memory_order_acquire); }
  std::uint64_t num_read() const noexcept;
  /// Frames that came while the one before was still being worked on, and were left out.
  std::uint64_t num_skipped() const noexcept;
  /// Frames that a source gave too late.
  std::uint64_t num_late() const noexcept;
  /// Publishing thread; empty unless frames are kept.
  RecordQueue<PublishedFrame>& seen() noexcept { return seen_; }
  std::uint64_t num_lost() const noexcept { return seen_.num_lost(); }

 private:
  struct TimedFrame {
    DepthFrame frame;
    double capture_time = 0;
  };

  /// A camera with its own sensor thread.
  struct Camera {
    Camera(DepthSource& from, SurfaceTimeline into);

    PacedSource source;
    SurfaceTimeline timeline;
    const double period;  // s, of frames, as the stream says

    // Used by the sensor thread only.
    std::uint32_t num_stepped = 0;
    // Used by the surface thread only: the tool's center in the camera frame, at the last frame.
    std::optional<Vec3d> p_CQ;
    double tool_time = 0;

    TripleBuffer<TimedFrame> frames;      // sensor thread to surface thread
    TripleBuffer<LiveSurfaces> surfaces;  // surface thread to contact thread
    std::atomic<std::uint64_t> num_read = 0, num_made = 0, num_taken = 0;
    std::thread thread;
  };

  Status wait_for_first(const Camera& camera);
  void read_frames(std::size_t number);
  bool may_read(Camera& camera);
  void make_surfaces();
  void make_surface(Camera& camera, std::uint32_t index);
  PixelWindow next_window(Camera& camera, const Pose& X_WC, double time);
  std::uint32_t take_change();
  Camera* next_camera(std::size_t& last);
  void make_picture(std::uint64_t number);
  void fail(const Error& error);

  std::vector<std::unique_ptr<Camera>> cameras_;
  ThreadPool pool_;
  LatencyHistogram& surface_compute_;
  const bool keeps_frames_, wants_real_time_;
  const WindowOptions window_;
  const ToolBall tool_;

  TripleBuffer<Pose> tools_;          // haptic thread to surface thread
  bool has_tool_ = false;             // for the surface thread
  RecordQueue<PublishedFrame> seen_;  // surface thread to publishing thread
  TripleBuffer<SurfacePicture> pictures_;
  Mailbox<SurfaceChange> changes_;
  Event event_;  // for the surface thread
  StopSignal stop_;
  std::atomic<std::uint64_t> num_made_ = 0;  // of all cameras
  std::atomic<std::uint32_t> revision_ = 0, num_steps_ = 0;
  std::atomic<int> nice_ = 0;
  std::atomic<double> motion_scale_;
  std::atomic<bool> is_held_ = false, wants_picture_ = false;
  std::atomic<int> ended_camera_ = -1;
  std::atomic<bool> source_failed_ = false, backend_failed_ = false;
  mutable std::mutex error_mutex_;
  Status status_ = Done{};
  std::thread surface_thread_;
};

}}  // namespace palpate::v0
