// Plays a recording, in a thread of its own.
#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "src/viewer/protocol/controls.h"
#include "src/viewer/protocol/samples.h"
#include "src/viewer/sources/repetition.h"
#include "src/viewer/sources/view_clock.h"

namespace palpate { inline namespace v0 {

/// State of the player, for pages.
struct PlayerState {
  double time = 0, duration = 0, speed = 1;
  bool is_paused = false;
  std::uint64_t frame_number = 0;
  std::uint32_t revision = 0;  ///< number of changes by the user
  RunSettings settings;        ///< settings of the computed contacts
  std::size_t num_marks = 0;
  std::string note;  ///< else empty
};

class RunPlayer {
 public:
  /// Starts paused shortly before the first contact, and plays once a page is open. Lets
  /// std::system_error out if the thread cannot start.
  explicit RunPlayer(std::unique_ptr<RecordedRun> run);
  ~RunPlayer();

  const Tool& tool() const { return run_->tool(); }
  const std::vector<DepthStreamInfo>& streams() const { return run_->streams(); }
  const std::vector<SceneObject>& objects() const { return run_->objects(); }

  // For one other thread; none of these waits for a picture.
  ViewUpdate poll(const ViewSubscription& subscription);
  PlayerState shown() const;
  std::vector<RecordedMark> marks() const { return run_->marks(); }
  void pause();
  void resume();  ///< at the end: from the beginning
  void seek(double time);
  void step(int num_frames);  ///< negative: back
  void set_speed(double factor);
  /// Sets a control; returns its value. Errors: as set_control; settings that do not go together.
  Result<nlohmann::ordered_json> set(std::string_view key, const nlohmann::ordered_json& value);

 private:
  /// State shown last, to detect news.
  struct Last {
    struct Picture {
      double when = -1;
      std::uint64_t num_settings = 0;
      bool operator==(const Picture&) const = default;
    };
    std::vector<std::optional<std::size_t>> frames;  // of each camera
    Picture contact, surface;
    double sample_time = -1;
  };
  /// Revisions in use: of the run's settings, and of the user's changes.
  struct SettingsInUse {
    std::uint32_t recorded = 0, changed = 0;
    bool operator==(const SettingsInUse&) const = default;
  };

  void work();
  double advance();
  void show(double time);
  void use_settings_of(const RecordedQuery& query);
  void show_frames(const RecordedQuery& query, std::string& trouble);
  void show_contact(const RecordedQuery& query, std::string& trouble);
  void show_samples(double time, std::string& trouble);
  void tell(std::string note);
  void change();

  std::unique_ptr<RecordedRun> run_;

  // Used by the player's thread only.
  Repetition repetition_;
  Last last_;
  std::size_t frame_ = 0;  // the newest one shown now
  ViewSubscription subscription_;
  std::uint32_t taken_seeks_ = 0, seen_seeks_ = 0;
  std::optional<SettingsInUse> used_;
  RunSettings settings_;
  std::uint64_t num_settings_ = 0;  // counts their changes
  std::string what_if_;

  mutable std::mutex mutex_;  // guards the members below
  std::condition_variable has_changed_;
  ViewClock clock_;
  bool was_looked_at_ = false;
  int num_steps_ = 0;
  std::uint32_t num_seeks_ = 0;
  ViewSubscription desired_;
  nlohmann::ordered_json changed_ = nlohmann::ordered_json::object();  // {key: value}
  PlayerState shown_;
  ViewUpdate pending_;  // `frames` of each camera, null where there is no news
  SampleQueue samples_;

  std::atomic<std::uint32_t> num_orders_ = 0;  // orders, each of which cancels a long repetition
  std::atomic<bool> is_stopping_ = false, is_short_of_memory_ = false;
  std::thread thread_;
};

}}  // namespace palpate::v0
