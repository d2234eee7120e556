#include "src/viewer/sources/run_player.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "src/core/internal/guarded.h"
#include "src/viewer/protocol/view_contact.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::chrono::microseconds kPeriod{16667};

/// Returns settings with the user's changes.
RunSettings changed_by(RunSettings settings, const Json& changes) {
  for (const auto& [key, value] : changes.items()) {
    (void)set_control(settings_of(settings), is_recorded_control, key, value);
  }
  return settings;
}

/// Returns the keys of settings that differ.
std::string differences(const RunSettings& a, const RunSettings& b) {
  const Json values = control_values(settings_of(a), is_recorded_control),
             others = control_values(settings_of(b), is_recorded_control);
  std::string keys;
  for (const auto& [key, value] : values.items()) {
    if (value != others[key]) keys += (keys.empty() ? "" : ", ") + key;
  }
  return keys;
}

void add_note(std::string& note, const std::string& more) {
  if (!more.empty()) note += (note.empty() ? "" : "; ") + more;
}

/// Returns a time shortly before the first contact, s, where a run becomes worth a look. It is
/// searched for in the first minute; the beginning if there is none.
double opening_time(RecordedRun& run) {
  constexpr double kLead = 0.5, kSearched = 60;  // s
  const auto first = run.first_touch(std::min(run.duration(), kSearched));
  return first && *first ? std::max(0.0, **first - kLead) : 0;
}

}  // namespace

RunPlayer::RunPlayer(std::unique_ptr<RecordedRun> run) : run_(std::move(run)), repetition_(*run_) {
  clock_.pause();
  clock_.set(opening_time(*run_));
  last_.frames.resize(run_->streams().size());
  pending_.frames.resize(run_->streams().size());
  shown_.settings = run_->settings(0);
  shown_.duration = run_->duration();
  thread_ = std::thread([this] { work(); });
}

RunPlayer::~RunPlayer() {
  is_stopping_ = true;
  has_changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

// Requests of other threads.

ViewUpdate RunPlayer::poll(const ViewSubscription& subscription) {
  ViewUpdate update;
  const std::lock_guard lock(mutex_);
  const bool is_looking =
      subscription.frames || subscription.contacts || subscription.surfaces || subscription.samples;
  if (is_looking && !std::exchange(was_looked_at_, true)) clock_.resume();
  desired_ = subscription;
  for (auto& frame : pending_.frames) {
    if (subscription.frames && frame) update.frames.push_back(std::exchange(frame, nullptr));
  }
  if (subscription.contacts) update.contact = std::exchange(pending_.contact, nullptr);
  if (subscription.surfaces) update.surface = std::exchange(pending_.surface, nullptr);
  if (subscription.samples) samples_.take(update.samples);
  return update;
}

PlayerState RunPlayer::shown() const {
  const std::lock_guard lock(mutex_);
  PlayerState shown = shown_;
  if (is_short_of_memory_) shown.note = "there is not enough memory to show all of the run";
  shown.time = std::min(clock_.now(), shown.duration);
  shown.is_paused = clock_.is_paused();
  shown.speed = clock_.speed();
  return shown;
}

/// Makes the player look at its orders. Under the lock.
void RunPlayer::change() {
  was_looked_at_ = true;  // from now on the user decides
  ++num_orders_;
  has_changed_.notify_all();
}

void RunPlayer::pause() {
  const std::lock_guard lock(mutex_);
  clock_.pause();
  clock_.set(std::min(clock_.now(), shown_.duration));
  change();
}

void RunPlayer::resume() {
  const std::lock_guard lock(mutex_);
  if (clock_.now() >= shown_.duration) {
    clock_.set(0);
    ++num_seeks_;
  }
  clock_.resume();
  change();
}

void RunPlayer::seek(double time) {
  const std::lock_guard lock(mutex_);
  clock_.set(std::clamp(time, 0.0, shown_.duration));
  num_steps_ = 0;
  ++num_seeks_;
  change();
}

void RunPlayer::step(int num_frames) {
  const std::lock_guard lock(mutex_);
  clock_.pause();
  num_steps_ += num_frames;
  change();
}

void RunPlayer::set_speed(double factor) {
  const std::lock_guard lock(mutex_);
  clock_.set_speed(factor);
}

Result<Json> RunPlayer::set(std::string_view key, const Json& value) {
  const std::lock_guard lock(mutex_);
  RunSettings settings = shown_.settings;
  auto taken = set_control(settings_of(settings), is_recorded_control, key, value);
  if (!taken) return taken;
  if (const Status status = check(settings.surface); !status) {
    return status.error();
  }
  changed_[std::string(key)] = *taken;
  shown_.settings = settings;
  ++shown_.revision;
  change();
  return taken;
}

// The player.

void RunPlayer::work() {
  while (!is_stopping_) {
    const auto start = std::chrono::steady_clock::now();
    guarded([&] { show(advance()); },
            [&](const Error&) {
              is_short_of_memory_ = true;
              repetition_.forget();
            });
    std::unique_lock lock(mutex_);
    const std::uint32_t num_seen = num_orders_;
    has_changed_.wait_until(lock, start + kPeriod,
                            [&] { return is_stopping_ || num_orders_ != num_seen; });
  }
}

/// Takes new orders. Returns the time to show now, s.
double RunPlayer::advance() {
  const double duration = run_->duration();
  int num_steps = 0;
  double from = 0;
  {
    const std::lock_guard lock(mutex_);
    num_steps = std::exchange(num_steps_, 0);
    from = std::min(clock_.now(), duration);
    subscription_ = desired_;
    taken_seeks_ = num_seeks_;
  }
  double stepped_to = 0;
  if (num_steps != 0) {
    // Steps count from the frame at the clock's time: after a seek it is not the one shown last.
    const auto query = run_->query_at(from);
    const auto first = static_cast<std::ptrdiff_t>(query ? query->frame : frame_);
    const auto last = static_cast<std::ptrdiff_t>(run_->num_frames()) - 1;
    const auto target = std::clamp<std::ptrdiff_t>(first + num_steps, 0, last);
    stepped_to = run_->needed_from(static_cast<std::size_t>(target));
  }
  const std::lock_guard lock(mutex_);
  shown_.duration = duration;
  if (num_steps != 0) {
    clock_.set(stepped_to);
    taken_seeks_ = ++num_seeks_;
  }
  if (!clock_.is_paused() && clock_.now() >= duration) {
    clock_.pause();
    clock_.set(duration);
  }
  return std::min(clock_.now(), duration);
}

void RunPlayer::show(double time) {
  const auto query = run_->query_at(time);
  if (!query) return tell(query.error().message);
  frame_ = query->frame;
  use_settings_of(*query);
  std::string trouble;
  if (subscription_.samples) show_samples(time, trouble);
  show_frames(*query, trouble);
  if (subscription_.contacts || subscription_.surfaces) show_contact(*query, trouble);
  tell(trouble);
}

/// Uses the run's settings with the user's changes; also for queries.
void RunPlayer::use_settings_of(const RecordedQuery& query) {
  const std::lock_guard lock(mutex_);
  const SettingsInUse desired{query.revision, shown_.revision};
  if (used_ == desired) return;
  used_ = desired;
  const RunSettings recorded = run_->settings(query.revision);
  settings_ = shown_.settings = changed_by(recorded, changed_);
  ++num_settings_;
  what_if_.clear();
  if (const std::string keys = differences(recorded, settings_); !keys.empty()) {
    what_if_ = "contacts are computed with other settings than in the run (" + keys +
               "); the curves are those of the run";
  }
}

/// Shows the frames that the query rests on.
void RunPlayer::show_frames(const RecordedQuery& query, std::string& trouble) {
  if (!subscription_.frames) return;
  const auto leads = repetition_.leads_of(query, 0);
  for (std::size_t k = 0; k < leads.size(); ++k) {
    if (leads[k].empty() || last_.frames[k] == leads[k].back()) continue;
    const auto frame = repetition_.frames().get(leads[k].back());
    if (!frame) return add_note(trouble, frame.error().message);
    last_.frames[k] = leads[k].back();
    const std::lock_guard lock(mutex_);
    // Points into a cached frame and keeps it alive.
    pending_.frames[k] = std::shared_ptr<const ViewFrame>(*frame, &(*frame)->shown);
  }
}

void RunPlayer::show_contact(const RecordedQuery& query, std::string& trouble) {
  const Last::Picture contact{query.time, num_settings_};
  const Last::Picture surface{static_cast<double>(query.frame), num_settings_};
  const bool needs_contact = subscription_.contacts && last_.contact != contact;
  const bool needs_surface = subscription_.surfaces && last_.surface != surface;
  if (!needs_contact && !needs_surface) return;
  const std::uint32_t order = num_orders_;
  const auto is_there =
      repetition_.go_to(query, settings_, [&] { return !is_stopping_ && num_orders_ == order; });
  if (!is_there) add_note(trouble, is_there.error().message);
  if (!is_there || !*is_there) return;
  const std::uint64_t number = run_->frame_number(query.frame);
  ViewUpdate made;
  if (needs_contact) {
    ViewContact shown =
        view_contact(repetition_.query(), repetition_.cameras(), query.X_WT, query.time, number);
    shown.objects = objects_at(run_->objects(), query.bodies);
    made.contact = std::make_shared<const ViewContact>(std::move(shown));
    last_.contact = contact;
  }
  if (needs_surface) {
    made.surface = std::make_shared<const ViewSurface>(repetition_.surface());
    last_.surface = surface;
  }
  const std::lock_guard lock(mutex_);
  if (made.contact) pending_.contact = std::move(made.contact);
  if (made.surface) pending_.surface = std::move(made.surface);
}

/// Shows the samples since the last time; after a leap those of the seconds before.
void RunPlayer::show_samples(double time, std::string& trouble) {
  const bool leaps = seen_seeks_ != taken_seeks_ || time < last_.sample_time;
  seen_seeks_ = taken_seeks_;
  const double after = std::max(leaps ? -1.0 : last_.sample_time, time - SampleQueue::kSeconds);
  const auto samples = run_->samples(after, time);
  if (!samples) return add_note(trouble, samples.error().message);
  last_.sample_time = time;
  const std::lock_guard lock(mutex_);
  if (leaps) samples_.clear();
  for (const ViewSample& sample : *samples) samples_.add(sample);
}

void RunPlayer::tell(std::string note) {
  add_note(note, run_->note());
  add_note(note, repetition_.note());
  add_note(note, what_if_);
  const std::size_t num_marks = run_->num_marks();
  const std::uint64_t number = run_->frame_number(frame_);
  const std::lock_guard lock(mutex_);
  shown_.note = std::move(note);
  shown_.num_marks = num_marks;
  shown_.frame_number = number;
}

}}  // namespace palpate::v0
