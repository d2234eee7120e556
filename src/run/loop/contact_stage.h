// The contact thread: measures the tool where it is now against the newest surfaces.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "palpate/run/run_loop.h"
#include "src/run/internal/pipeline.h"
#include "src/run/loop/blend_clock.h"
#include "src/run/loop/queues/record_queue.h"
#include "src/run/loop/stiffness_schedule.h"
#include "src/run/loop/surface_stage.h"

namespace palpate { inline namespace v0 {

/// Pose of the tool at a time.
struct TimedToolPose {
  double time = 0;  ///< s, monotonic
  Pose X_WT;
};

/// New settings of queries, and another part or null; once settled, it holds the previous part.
struct ContactChange {
  std::uint32_t revision = 0;
  std::uint32_t surface_revision = 0;  ///< taken with the first surfaces of this revision
  double rate = 1000;
  ContactScale scale;
  std::unique_ptr<ContactPart> part;
};

class ContactStage {
 public:
  struct Settings {
    double rate = 1000;  ///< queries per second, at most
    double tick_seconds = 1e-3;
    std::size_t num_spheres = 0;  ///< of pictures
    bool wants_real_time = true;
    bool keeps_records = false;
    double start_time = 0;  ///< s, monotonic, of records
  };
  ContactStage(std::unique_ptr<ContactPart> part, SurfaceStage& surfaces, const Settings& settings,
               LatencyHistogram& contact_compute);
  ~ContactStage() { stop(); }

  /// Starts the thread, which reports what it throws to `fail`.
  void start(double start_time, std::function<void(const Error&)> fail);
  void stop() noexcept;
  /// Start function of the other threads that compute queries, if real time is requested.
  static void begin_thread();

  /// Haptic thread: the tool has moved. The contact thread polls when it expects that: waking it
  /// would take the haptic thread longer than all its own computation.
  void move_tool(const TimedToolPose& tool) noexcept;
  /// Haptic thread: the newest contact; its number is 0 if nothing has been measured yet.
  const ContactRecord& newest() noexcept;

  /// A change must be offered before the surfaces that it waits for.
  Mailbox<ContactChange>& changes() noexcept { return changes_; }

  void request_picture(PictureConsumer who) noexcept {
    wants_picture_[std::size_t(who)].store(true);
  }
  /// The newest one, if it is new; one reader of each kind.
  const ContactPicture* new_picture(PictureConsumer who) noexcept {
    TripleBuffer<ContactPicture>& pictures = pictures_[std::size_t(who)];
    return pictures.refresh() ? &pictures.value() : nullptr;
  }

  bool has_backend_failed() const noexcept {
    return backend_failed_.load(std::memory_order_acquire);
  }
  std::uint64_t num_contacts() const noexcept {
    return num_contacts_.load(std::memory_order_acquire);
  }
  /// Contacts that came with an older stiffness.
  std::uint64_t num_spared_stiffnesses() const noexcept { return num_spared_.load(); }
  /// Contacts of a tool that had left the window of the surfaces.
  std::uint64_t num_outside_window() const noexcept { return num_outside_.load(); }
  /// Error number of the request for real time; 0: granted or not requested.
  int real_time_error() const noexcept { return real_time_error_.load(); }
  /// Publishing thread; empty unless records are kept.
  RecordQueue<ContactRecord>& records() noexcept { return records_; }
  std::uint64_t num_lost() const noexcept { return records_.num_lost(); }

 private:
  void work();
  double next_look(double now) const;
  bool is_due(double time);
  void measure(const TimedToolPose& tool);
  void look(double time);
  void take_change();
  void make_picture(const ContactRecord& contact, ContactPicture& picture);

  std::unique_ptr<ContactPart> part_;
  SurfaceStage& surfaces_;
  Settings settings_;
  LatencyHistogram& contact_compute_;

  // Used by the contact thread: its view of each camera.
  struct View {
    LiveSurfaces surfaces;
    BlendClock blend;
  };
  std::vector<View> views_;
  CameraViews cameras_;                // their blends at the last look
  std::uint64_t newest_frame_ = 0;     // in these views
  double last_look_ = 0;               // s, monotonic
  std::uint32_t oldest_revision_ = 0;  // of the surfaces taken last
  StiffnessSchedule schedule_;
  double next_due_ = 0;
  std::uint32_t revision_ = 0;

  TripleBuffer<TimedToolPose> tools_;     // haptic thread to contact thread
  TripleBuffer<ContactRecord> contacts_;  // and back
  RecordQueue<ContactRecord> records_;    // to the publishing thread
  std::array<TripleBuffer<ContactPicture>, kNumPictureConsumers> pictures_;
  Mailbox<ContactChange> changes_;
  std::array<std::atomic<bool>, kNumPictureConsumers> wants_picture_ = {};
  std::atomic<bool> is_stopping_ = false, backend_failed_ = false;
  std::atomic<std::uint64_t> num_contacts_ = 0, num_spared_ = 0, num_outside_ = 0;
  std::atomic<int> real_time_error_ = 0;
  std::thread thread_;
};

}}  // namespace palpate::v0
