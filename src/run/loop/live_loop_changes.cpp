// Changes of settings while a live loop runs: those that the user requests, and those by which the
// loop helps itself, with less load or with the CPU in place of a lost GPU.
//
// New parts are made outside of the stages and offered to them. A stage takes its part between two
// of its steps, and the parts that are replaced are destroyed here, once all stages have changed.
#include <algorithm>
#include <utility>

#include "src/core/internal/guarded.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/run/check_settings.h"
#include "src/run/loop/live_loop.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kMindingPeriod = 0.02;  // s
// Longest wait for a change, s, beyond three frames: its caller may also need to request the end of
// the run.
constexpr double kChangeTimeout = 2;

}  // namespace

Status LiveLoop::change(const RunSettings& settings) {
  const std::lock_guard lock(changing_);
  if (change_) {
    if (const Status last = finish_change(); !last) return last;
  }
  if (!is_running() || contacts_.num_contacts() == 0) {
    return Error{Errc::unavailable,
                 "settings change while a tool is in the hand and the loop runs; it has ended or "
                 "not begun to feel"};
  }
  const Status begun = begin_change(settings);
  return begun ? finish_change() : begun;
}

/// Makes the parts of a change and offers them to the stages.
Status LiveLoop::begin_change(const RunSettings& settings) {
  if (const Status status = check_change(settings_, settings); !status) return status;
  if (const Status status = check_rates(settings, device_.info()); !status) return status;
  const RunPartsOptions options{&settings_, SurfaceStage::kNumSpare, query_threads_.get()};
  auto parts = make_run_parts(index_, streams_, device_.info(), settings, options);
  if (!parts) return parts.error();

  change_ = std::make_unique<Change>();
  const std::uint32_t revision = change_->revision = ++revision_;
  change_->settings = settings;
  change_->patience = kChangeTimeout + 3 / std::max(slowest_rate(), 0.1);
  change_->surfaces = {revision, std::move(parts->timelines)};
  change_->contacts = {revision, change_->surfaces.timelines.empty() ? 0 : revision,
                       settings.contact_rate, parts->scale, std::move(parts->contact)};
  change_->haptic = {revision, std::move(parts->coupling)};
  publisher_.add_settings(settings);
  {
    const std::lock_guard lock_others(mutex_);
    add_notes(notes_, parts->notes);
  }
  offer_change();
  return Done{};
}

void LiveLoop::offer_change() {
  const bool has_surfaces = !change_->surfaces.timelines.empty();
  contacts_.changes().offer(change_->contacts);
  if (has_surfaces) {
    surfaces_.changes().offer(change_->surfaces);
  } else {
    surfaces_.set_revision(change_->revision);
  }
  surfaces_.set_motion_scale(change_->settings.coupling.motion_scale);
  haptic_.changes().offer(change_->haptic);
}

bool LiveLoop::is_change_taken() {
  return haptic_.changes().is_settled() && contacts_.changes().is_settled() &&
         surfaces_.changes().is_settled();
}

/// Waits until all stages have taken the change.
Status LiveLoop::finish_change() {
  wait_for(change_->patience, [this] { return is_change_taken() || !is_running(); });
  if (!is_change_taken()) {
    return Error{Errc::unavailable,
                 is_running() ? "the loop has not taken the last change yet: no depth frame or "
                                "tick comes, and it will come with the next ones; check the "
                                "sensor and the device"
                              : "the loop has ended before it took the change"};
  }
  end_change();
  return Done{};
}

/// Makes the new settings the present ones and destroys the parts that they have replaced.
void LiveLoop::end_change() {
  {
    const std::lock_guard lock(mutex_);
    settings_ = change_->settings;
  }
  change_.reset();
}

/// Changes settings without a request of the user. It has its own thread, because new parts may
/// take long to make, and recording must not wait for them.
void LiveLoop::mind_all() {
  if (first_settings_.wants_real_time) take_rank(ThreadRank::recorder);
  while (!stop_publishing_.sleep_for(kMindingPeriod)) {
    // A change that the user requests comes first.
    const std::unique_lock lock(changing_, std::try_to_lock);
    if (!lock || !is_running()) continue;
    look_after_backend();
    if (first_settings_.may_thin) look_after_load();
  }
}

/// True if no change is on its way through the stages; ends the last one if it is through.
bool LiveLoop::may_begin_change() {
  if (change_ && !is_change_taken()) return false;
  if (change_) end_change();
  return true;
}

/// Returns the lowest frame rate of all cameras, Hz: contacts are as old as its frames.
double LiveLoop::slowest_rate() const {
  double slowest = streams_.front().rate;
  for (const DepthStreamInfo& stream : streams_) slowest = std::min(slowest, stream.rate);
  return slowest;
}

LoadCounts LiveLoop::count_load(double contact_rate) const {
  LoadCounts counts;
  counts.ticks = haptic_.num_ticks();
  counts.frames = surfaces_.num_read();
  counts.pictures = num_pictures_.load();
  counts.count_ages(times_, first_settings_.safety, slowest_rate(), contact_rate,
                    device_.info().rate);
  return counts;
}

/// Reduces the load if computing time is short, and restores it later.
void LiveLoop::look_after_load() {
  if (!may_begin_change()) return;
  const RunSettings present = settings();
  LoadGovernor::Decision decision =
      governor_.look(monotonic_now(), present, count_load(present.contact_rate));
  Status done = Done{};
  if (decision.settings) done = begin_change(*decision.settings);
  if (!done) {
    governor_.give_up(present);
    decision.note = "less could not be computed: " + done.error().message;
  }
  is_page_thinned_ = governor_.steps().page > 0;
  const std::lock_guard lock(mutex_);
  thinned_ = {governor_.page_seconds(), governor_.image_seconds(), governor_.spheres_seconds()};
  if (decision.note.empty()) return;
  publisher_.add_note(std::move(decision.note));
  // The new settings are judged by a window of their own.
  governor_.begin_window(monotonic_now(), count_load(present.contact_rate));
}

/// Replaces a lost GPU by the CPU.
void LiveLoop::look_after_backend() {
  const auto has_failed = [&] {
    return surfaces_.has_backend_failed() || contacts_.has_backend_failed();
  };
  if (!has_failed() && !is_changing_backend_) return;
  if (!may_begin_change()) return;
  is_changing_backend_ = false;
  if (!has_failed()) return;
  RunSettings settings = this->settings();
  Status begun = lost_backend();
  if (settings.backend != Backend::cpu) {
    settings.backend = Backend::cpu;
    begun = begin_change(settings);
  }
  is_changing_backend_ = begun.has_value();
  if (begun) {
    const char* const text =
        "the GPU is lost: surfaces and queries are computed on the CPU from now on";
    publisher_.add_note(text);
    const std::lock_guard lock_others(mutex_);
    notes_.push_back(text);
    return;
  }
  is_backend_lost_ = true;
  haptic_.request_stop();
}

}}  // namespace palpate::v0
