// The first two threads of the loop: frames are read as time passes, and made into surfaces.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "palpate/run/run_loop.h"
#include "src/core/internal/triple_buffer.h"
#include "src/run/loop/event.h"
#include "src/run/loop/mailbox.h"
#include "src/run/loop/paced_source.h"
#include "src/run/loop/record_queue.h"

namespace palpate {

/// What the contact thread looks at until it takes the next ones.
struct LiveSurfaces {
  SurfaceBlend moment;                      ///< progress 1: there is nothing to blend
  double ready_time = 0, capture_time = 0;  ///< s, monotonic
  double period = 1;                        ///< s, expected until the next ones
  std::uint64_t frame_number = 0;           ///< of `moment.to`, from 0; `from` is the one before
  std::uint32_t revision = 0;               ///< of the settings it was made with
};

/// A frame that has become a surface, for observers.
struct SeenFrame {
  DepthFrame frame;
  FrameRecord record = {};
};

/// What the surface thread is to know about the tool.
struct ToolBall {
  Vec3d p_TC;        ///< centre of mass
  double reach = 0;  ///< no element's centre is farther from it, m
};
ToolBall ball_of(const Tool& tool);

/// Another timeline; once settled, the one before.
struct SurfaceChange {
  std::uint32_t revision = 0;
  std::optional<SurfaceTimeline> timeline;
};

/// The timeline keeps one surface more than are looked at: the next frame is made into that one
/// while the contact thread looks at the last two. Before the frame after that, which goes into the
/// older of these two, the surface thread waits until the contact thread has taken the new
/// surfaces. The contact thread never waits.
class SurfaceStage {
 public:
  /// A timeline for this has kNumSpare spare surfaces.
  static constexpr int kNumSpare = 1;

  SurfaceStage(DepthSource& source, SurfaceTimeline timeline, const RunSettings& settings,
               const ToolBall& tool, bool keeps_frames, LatencyHistogram& surface_compute);
  ~SurfaceStage() { stop(); }

  /// Begins, and returns when the first surface is there. Errors: the first frame, or none comes.
  Status start();
  void stop() noexcept;

  /// Contact thread: takes the newest surfaces if there are new ones; looks no more at the older.
  bool take() noexcept;
  const LiveSurfaces& taken() const noexcept { return surfaces_.value(); }

  /// Haptic thread: where the tool is.
  void move_tool(const Pose& X_WT) noexcept { tools_.publish(X_WT); }

  /// The next frame goes into another timeline. The surfaces of the one before are looked at until
  /// the contact thread takes newer ones.
  Mailbox<SurfaceChange>& changes() noexcept { return changes_; }
  /// Of settings that do not concern surfaces.
  void set_revision(std::uint32_t revision) noexcept { revision_.store(revision); }

  /// While frames are held, the last one comes again and again, as from a camera; `step` lets one
  /// more through. Any thread.
  void hold(bool is_held) noexcept { is_held_.store(is_held); }
  void step() noexcept { num_steps_.fetch_add(1); }

  void ask_for_picture() noexcept { wants_picture_.store(true); }
  /// The newest one, if it is new; one reader.
  const SurfacePicture* new_picture() noexcept {
    return pictures_.refresh() ? &pictures_.value() : nullptr;
  }

  /// How the stage has ended, if it has; a backend that has failed may be changed. Any thread.
  bool has_source_ended() const noexcept { return source_ended_.load(std::memory_order_acquire); }
  bool has_source_failed() const noexcept { return source_failed_.load(std::memory_order_acquire); }
  bool has_backend_failed() const noexcept {
    return backend_failed_.load(std::memory_order_acquire);
  }
  Status status() const;

  /// The nice value of the threads that make surfaces.
  int nice() const noexcept { return nice_.load(); }
  std::uint64_t num_frames() const noexcept { return num_made_.load(std::memory_order_acquire); }
  std::uint64_t num_read() const noexcept { return num_read_.load(std::memory_order_acquire); }
  /// Frames that came while the one before was still being worked on, and were left out.
  std::uint64_t num_skipped() const noexcept;
  /// Frames that the source gave too late.
  std::uint64_t num_late() const noexcept { return source_.num_late(); }
  /// Publishing thread; empty unless frames are kept.
  RecordQueue<SeenFrame>& seen() noexcept { return seen_; }
  std::uint64_t num_lost() const noexcept { return seen_.num_lost(); }

 private:
  struct TimedFrame {
    DepthFrame frame;
    double capture_time = 0;
  };

  void read_frames();
  bool may_read();
  void make_surfaces();
  PixelWindow next_window(double time);
  std::uint32_t take_change();
  const TimedFrame* next_frame();
  void make_picture(std::uint64_t number);
  void fail(const Error& error, std::atomic<bool>& flag);

  PacedSource source_;
  SurfaceTimeline timeline_;
  ThreadPool pool_;
  LatencyHistogram& surface_compute_;
  const bool keeps_frames_, wants_real_time_;
  const double period_;  // s, of frames, as the stream says
  const WindowOptions window_;
  const ToolBall tool_;

  // Of the surface thread: the tool at the last frame.
  std::optional<Vec3d> p_WC_;
  double tool_time_ = 0;

  TripleBuffer<TimedFrame> frames_;      // sensor thread to surface thread
  TripleBuffer<Pose> tools_;             // haptic thread to surface thread
  TripleBuffer<LiveSurfaces> surfaces_;  // surface thread to contact thread
  RecordQueue<SeenFrame> seen_;          // surface thread to publishing thread
  TripleBuffer<SurfacePicture> pictures_;
  Mailbox<SurfaceChange> changes_;
  Event bell_;  // for the surface thread
  StopSignal stop_;
  std::atomic<std::uint64_t> num_read_ = 0, num_made_ = 0, num_taken_ = 0;
  std::atomic<std::uint32_t> revision_ = 0, num_steps_ = 0;
  std::uint32_t num_stepped_ = 0;  // of the sensor thread
  std::atomic<int> nice_ = 0;
  std::atomic<bool> is_held_ = false, wants_picture_ = false;
  std::atomic<bool> source_ended_ = false, source_failed_ = false, backend_failed_ = false;
  mutable std::mutex error_mutex_;
  Status status_ = Done{};
  std::thread sensor_thread_, surface_thread_;
};

}  // namespace palpate
