// The loop of live runs: the threads of its stages, and beside them one that publishes records and
// one that changes settings by itself.
//
// Each stage runs at its own rate and reads the newest result of the one before, so none waits for
// another. Publishing and changes have threads of their own, because neither a slow observer nor
// new parts, which take long to make, may delay a tick.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "palpate/run/run_loop.h"
#include "src/run/internal/event.h"
#include "src/run/internal/pipeline.h"
#include "src/run/internal/real_time.h"
#include "src/run/loop/contact_stage.h"
#include "src/run/loop/haptic_stage.h"
#include "src/run/loop/load_governor.h"
#include "src/run/loop/publisher.h"
#include "src/run/loop/surface_stage.h"

namespace palpate { inline namespace v0 {

/// Waits for a condition, at most for `patience` s, of which the rest remains. It counts its
/// rounds: time in which the whole process stands still is not counted.
template <class Condition>
void wait_for(double& patience, const Condition& has_come) {
  constexpr double kRound = 1e-3;  // s
  for (; !has_come() && patience > 0; patience -= kRound) {
    std::this_thread::sleep_for(std::chrono::duration<double>(kRound));
  }
}

class LiveLoop final : public RunLoop {
 public:
  LiveLoop(std::shared_ptr<const ToolIndex> index, const DepthSources& sources,
           HapticDevice& device, const RunSettings& settings, RunObserver observer,
           std::unique_ptr<ThreadPool> query_threads, RunParts parts, SafetyFilter safety)
      : index_(std::move(index)),
        device_(device),
        streams_(sources.infos()),
        first_settings_(settings),
        observer_(std::move(observer)),
        query_threads_(std::move(query_threads)),
        settings_(settings),
        notes_(std::move(parts.notes)),
        governor_(streams_.front(), settings, index_->tool().spheres().size()),
        surfaces_(sources, std::move(parts.timelines), settings, ball_of(index_->tool()),
                  static_cast<bool>(observer_.on_frame), times_.surface_compute),
        contacts_(std::move(parts.contact), surfaces_,
                  {settings.contact_rate, 1 / device.info().rate, index_->tool().spheres().size(),
                   settings.wants_real_time, static_cast<bool>(observer_.on_contact), 0},
                  times_.contact_compute),
        haptic_({std::move(parts.coupling), std::move(safety), 1 / device.info().rate}, surfaces_,
                contacts_,
                {1 / device.info().rate, settings.wants_real_time,
                 static_cast<bool>(observer_.on_ticks)},
                times_),
        publisher_(observer_, {surfaces_.seen(), contacts_.records(), haptic_.records(),
                               haptic_.snapshots(), [this] { return surfaces_.num_frames(); },
                               [this] { return contacts_.num_contacts(); }}) {}
  ~LiveLoop() override { stop(); }

  Status start() override;
  void request_force() noexcept override { haptic_.request_force(); }
  void suspend_force() override;
  void resume_force() noexcept override { haptic_.suspend(false); }
  void stop() noexcept override;
  bool is_running() const noexcept override { return is_running_.load(std::memory_order_acquire); }
  std::optional<TickRecord> latest() noexcept override { return haptic_.latest(); }
  const LoopTimes& times() const noexcept override { return times_; }
  LoopReport report() const override;
  Status status() const override;

  Status change(const RunSettings& settings) override;
  RunSettings settings() const override {
    const std::lock_guard lock(mutex_);
    return settings_;
  }
  void hold_frames(bool is_held) noexcept override { surfaces_.hold(is_held); }
  void step_frame() noexcept override { surfaces_.step(); }
  bool is_short_of_time() const noexcept override { return is_page_thinned_.load(); }
  void request_contact_picture(PictureConsumer who) noexcept override {
    num_pictures_.fetch_add(1);
    contacts_.request_picture(who);
  }
  void request_surface_picture() noexcept override {
    num_pictures_.fetch_add(1);
    surfaces_.request_picture();
  }
  const ContactPicture* new_contact_picture(PictureConsumer who) noexcept override {
    return contacts_.new_picture(who);
  }
  const SurfacePicture* new_surface_picture() noexcept override { return surfaces_.new_picture(); }

 private:
  /// Other settings on their way through the stages.
  struct Change {
    RunSettings settings;
    std::uint32_t revision = 0;
    double patience = 0;  // s left to wait for it
    SurfaceChange surfaces;
    ContactChange contacts;
    HapticChange haptic;
  };

  Status start_all();
  void lock_all_memory();
  Status begin_change(const RunSettings& settings);
  void offer_change();
  bool is_change_taken();
  Status finish_change();
  void end_change();
  void mind_all();
  bool may_begin_change();
  void look_after_backend();
  void look_after_load();
  LoadCounts count_load(double contact_rate) const;
  double slowest_rate() const;
  void publish_all();
  bool has_stopped_ticking();
  bool is_start_long();
  /// True if the device ticks no more: lost, stuck, or at the end of its path.
  bool has_device_ended() const { return is_device_stuck_ || !device_.status(); }
  void end_with(const Error& error);
  void end() noexcept;
  void wait_without(bool (HapticStage::*force)() const noexcept) noexcept;
  std::vector<std::pair<std::string, std::string>> scheduling() const;

  const std::shared_ptr<const ToolIndex> index_;
  HapticDevice& device_;
  const std::vector<DepthStreamInfo> streams_;
  const RunSettings first_settings_;
  const RunObserver observer_;
  LoopTimes times_;
  const std::unique_ptr<ThreadPool> query_threads_;

  // Used by the thread that changes settings.
  std::mutex changing_;
  std::unique_ptr<Change> change_;  // not yet taken by all stages
  // Shared by that thread and the publishing one.
  mutable std::mutex mutex_;
  RunSettings settings_;  // as all stages have them
  std::vector<std::string> notes_;
  Status failure_ = Done{};          // of the first thread that threw
  std::array<double, 3> thinned_{};  // s: page, image, spheres
  // Used by the publishing thread only.
  std::uint64_t num_seen_ticks_ = 0;
  int num_silent_rounds_ = 0;
  bool was_start_long_ = false;
  // Used by the minding thread only.
  bool is_changing_backend_ = false;
  LoadGovernor governor_;

  std::atomic<bool> is_running_ = false, is_backend_lost_ = false, is_page_thinned_ = false;
  std::atomic<bool> has_failed_ = false, is_device_stuck_ = false, is_device_starting_ = false;
  std::atomic<std::uint64_t> num_pictures_ = 0;  // requested
  std::atomic<int> recorder_nice_ = 0;
  std::atomic<double> start_time_ = 0, end_time_ = 0;
  std::atomic<std::uint64_t> num_before_ticks_ = 0;  // frames before the first tick
  std::uint32_t revision_ = 0;
  bool was_started_ = false;
  MemoryLock memory_;
  StopSignal stop_publishing_;

  SurfaceStage surfaces_;
  ContactStage contacts_;
  HapticStage haptic_;
  Publisher publisher_;
  std::thread publishing_thread_, minding_thread_;
};

}}  // namespace palpate::v0
