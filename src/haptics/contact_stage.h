// The contact thread: measures the tool where it is now against the newest surfaces.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <thread>

#include "palpate/contact/blended_query.h"
#include "palpate/haptics/haptic_loop.h"
#include "src/haptics/bell.h"
#include "src/haptics/blend_clock.h"
#include "src/haptics/record_queue.h"
#include "src/haptics/stiffness_schedule.h"
#include "src/haptics/surface_stage.h"

namespace palpate {

/// Where the tool is.
struct ToolMoment {
  double time = 0;  ///< s, monotonic
  Pose X_WT;
};

/// What is known of its contact.
struct KnownContact {
  LocalContact contact;
  std::uint64_t number = 0;  ///< from 1; 0: nothing has been measured yet
  std::uint64_t frame_number = 0;
  double capture_time = 0;  ///< s, of that frame
};

class ContactStage {
 public:
  struct Settings {
    ContactOptions contact;
    double rate = 1000;  ///< queries per second, at most
    double tick_seconds = 1e-3;
    Vec3d centre_of_mass_T;
    ForceScale scale;
    bool wants_real_time = true;
    bool keeps_records = false;
    double start_time = 0;  ///< s, monotonic, of records
  };
  ContactStage(std::unique_ptr<ContactQuery> query, SurfaceStage& surfaces,
               const Settings& settings, LatencyHistogram& contact_compute);
  ~ContactStage() { stop(); }

  void start(double start_time);
  void stop() noexcept;

  /// Haptic thread: the tool has moved. Wakes the contact thread, never waits.
  void move_tool(const ToolMoment& tool) noexcept;
  /// Haptic thread: the newest contact.
  const KnownContact& newest() noexcept;

  bool has_backend_failed() const noexcept {
    return backend_failed_.load(std::memory_order_acquire);
  }
  std::uint64_t num_contacts() const noexcept {
    return num_contacts_.load(std::memory_order_acquire);
  }
  /// Contacts that came with an older stiffness.
  std::uint64_t num_spared_stiffnesses() const noexcept { return num_spared_.load(); }
  /// Of asking for real time; 0: granted or not wanted.
  int real_time_error() const noexcept { return real_time_error_.load(); }
  /// Publishing thread; empty unless records are kept.
  RecordQueue<ContactRecord>& records() noexcept { return records_; }
  std::uint64_t num_lost() const noexcept { return records_.num_lost(); }

 private:
  void work();
  bool is_due(double time);
  void measure(const ToolMoment& tool);
  SurfaceMoment moment_at(double time);
  void publish(const ToolMoment& tool, const Penetration& penetration);

  BlendedQuery query_;
  SurfaceStage& surfaces_;
  Settings settings_;
  LatencyHistogram& contact_compute_;

  // Of the contact thread.
  BlendClock blend_;
  StiffnessSchedule schedule_;
  Stiffness stiffness_;
  bool has_new_stiffness_ = false;
  double next_due_ = 0, progress_ = 1;

  TripleBuffer<ToolMoment> tools_;       // haptic thread to contact thread
  TripleBuffer<KnownContact> contacts_;  // and back
  RecordQueue<ContactRecord> records_;   // to the publishing thread
  Bell bell_;
  std::atomic<bool> is_stopping_ = false, backend_failed_ = false;
  std::atomic<std::uint64_t> num_contacts_ = 0, num_spared_ = 0;
  std::atomic<int> real_time_error_ = 0;
  std::thread thread_;
};

}  // namespace palpate
