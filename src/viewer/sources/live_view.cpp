#include <algorithm>
#include <atomic>
#include <deque>
#include <mutex>
#include <utility>

#include "palpate/viewer/viewer.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/viewer/protocol/command.h"
#include "src/viewer/protocol/controls.h"
#include "src/viewer/protocol/messages.h"
#include "src/viewer/protocol/samples.h"
#include "src/viewer/protocol/view_contact.h"
#include "src/viewer/sources/recycler.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kPicturePeriod = 1.0 / 60;  // s
constexpr double kSparePeriod = 0.25;        // s, if computing time is short
constexpr std::size_t kNumContacts = 4096;   // whose times are known
constexpr std::size_t kLongestMark = 1000;
constexpr double kMaxSteps = 1000;

/// Data of the publishing thread, until the server takes it.
class PendingData {
 public:
  explicit PendingData(std::size_t num_cameras) : frames_(num_cameras) {}

  void add_frame(const FrameRecord& record, const DepthFrame& frame) {
    auto copy = std::make_shared<ViewFrame>(
        ViewFrame{record.number, record.capture_time, frame, record.camera});
    const std::lock_guard lock(mutex_);
    frames_[record.camera] = std::move(copy);
  }

  void add_contact(const ContactRecord& contact) {
    const std::lock_guard lock(mutex_);
    contact_times_.emplace_back(contact.number, contact.time);
    if (contact_times_.size() > kNumContacts) contact_times_.pop_front();
  }

  void add_ticks(std::span<const TickRecord> ticks) {
    const std::lock_guard lock(mutex_);
    for (const TickRecord& tick : ticks) samples_.add(sample_of(tick, has_hand_));
    if (!ticks.empty()) last_ = ticks.back();
    has_ticked_ = has_ticked_ || !ticks.empty();
  }

  /// Takes the newest frame of each camera that has a new one. Its time is relative to the run's
  /// start, which the first tick reports.
  void take_frames(std::vector<std::shared_ptr<const ViewFrame>>& frames) {
    const std::lock_guard lock(mutex_);
    if (!has_ticked_) return;
    for (std::shared_ptr<ViewFrame>& frame : frames_) {
      if (frame == nullptr) continue;
      frame->time -= last_.device.time - last_.time;
      frames.push_back(std::exchange(frame, nullptr));
    }
  }
  void set_coupling(CouplingKind kind) {
    const std::lock_guard lock(mutex_);
    has_hand_ = kind != CouplingKind::none;
  }
  void take_samples(std::vector<ViewSample>& samples) {
    const std::lock_guard lock(mutex_);
    samples_.take(samples);
  }
  /// Returns the time of the contact of that number, s since the run began: the last tick's if it
  /// has not been published yet.
  double contact_time(std::uint64_t number) const {
    const std::lock_guard lock(mutex_);
    const auto found = std::lower_bound(
        contact_times_.begin(), contact_times_.end(), number,
        [](const auto& contact, std::uint64_t desired) { return contact.first < desired; });
    return found == contact_times_.end() ? last_.time : found->second;
  }
  TickRecord last() const {
    const std::lock_guard lock(mutex_);
    return last_;
  }

 private:
  mutable std::mutex mutex_;                        // each part under it is a copy
  std::vector<std::shared_ptr<ViewFrame>> frames_;  // their times are of the capture, monotonic
  SampleQueue samples_;
  std::deque<std::pair<std::uint64_t, double>> contact_times_;  // number and time, s of the run
  TickRecord last_;
  bool has_ticked_ = false, has_hand_ = true;
};

/// Returns the age at which an image is late, s: by the slowest camera.
double stale_age(const std::vector<DepthStreamInfo>& streams) {
  double longest = 0;
  for (const DepthStreamInfo& stream : streams) {
    longest = std::max(longest, 1 / std::max(stream.rate, 1.0));
  }
  return 0.1 + 4 * longest;
}

class LiveViewImpl final : public LiveView {
 public:
  LiveViewImpl(const Tool& tool, std::vector<DepthStreamInfo> streams, std::string title,
               LiveViewOptions options)
      : content_{"live",
                 std::move(title),
                 &tool,
                 std::move(streams),
                 options.handle ? std::optional(PageHandle::limits().max_force) : std::nullopt,
                 shapes_of(options.objects)},
        objects_(std::move(options.objects)),
        handle_(std::move(options.handle)),
        stale_age_(stale_age(content_.streams)),
        pending_(content_.streams.size()) {
    settings_.objects = objects_;  // pages need controls before there is a loop
    RunObserver& observer = monitor_.observer;
    observer.on_frame = [this](const FrameRecord& record, const DepthFrame& frame) {
      pending_.add_frame(record, frame);
    };
    observer.on_contact = [this](const ContactRecord& contact) { pending_.add_contact(contact); };
    observer.on_ticks = [this](std::span<const TickRecord> ticks) { pending_.add_ticks(ticks); };
    monitor_.on_loop = [this](RunLoop* loop) { show(loop); };
  }

  RunMonitor& monitor() override { return monitor_; }
  bool wants_end() const noexcept override { return wants_end_; }
  const ViewContent& content() const override { return content_; }
  ViewUpdate poll(const ViewSubscription& subscription) override;
  std::string state() override;
  std::string controls() override;
  Result<std::string> command(std::string_view json) override;
  Status hold(std::uint64_t page) override;
  Status move(std::uint64_t page, const Pose& X_WT) override;
  void release(std::uint64_t page) override;

 private:
  void show(RunLoop* loop);
  void look_at_loop();
  void take_pictures(const ViewSubscription& subscription, ViewUpdate& update);
  Json note(const TickRecord& last) const;
  Result<std::string> set(const ViewCommand& command);

  const ViewContent content_;
  const std::vector<SceneObject> objects_;
  const std::shared_ptr<PageHandle> handle_;  // server's thread; null: no page holds the tool
  const double stale_age_;                    // s
  RunMonitor monitor_;
  PendingData pending_;
  std::atomic<bool> wants_end_ = false;

  std::mutex mutex_;         // guards the members below: server's and run's threads
  RunLoop* loop_ = nullptr;  // not before it has begun, nor after its end
  bool has_begun_ = false, are_frames_held_ = false;
  std::uint32_t revision_ = 0;
  RunSettings settings_;
  LoopReport report_;
  Json stages_ = Json::array();
  Json fault_;
  double next_picture_ = 0, last_poll_ = 0;  // s, monotonic
  Recycler<ViewContact> contacts_;
  Recycler<ViewSurface> surfaces_;
};

/// Keeps the last state of the loop before it goes away.
void LiveViewImpl::show(RunLoop* loop) {
  const std::lock_guard lock(mutex_);
  look_at_loop();
  loop_ = loop;
  has_begun_ = has_begun_ || loop != nullptr;
  look_at_loop();
}

/// Copies the state that pages need without a loop.
void LiveViewImpl::look_at_loop() {
  if (loop_ == nullptr) return;
  settings_ = loop_->settings();
  pending_.set_coupling(settings_.coupling.kind);
  report_ = loop_->report();
  stages_ = stages_json(loop_->times());
  const Status status = loop_->status();
  fault_ = status ? Json() : Json(status.error().message);
}

ViewUpdate LiveViewImpl::poll(const ViewSubscription& subscription) {
  {
    // Everything at once, and rarely if time is short: data that is not sent is not drawn either.
    const std::lock_guard lock(mutex_);
    const double now = monotonic_now();
    if (loop_ != nullptr && loop_->is_short_of_time() && now < last_poll_ + kSparePeriod) return {};
    last_poll_ = now;
  }
  ViewUpdate update;
  if (subscription.frames) pending_.take_frames(update.frames);
  if (subscription.samples) pending_.take_samples(update.samples);
  const std::lock_guard lock(mutex_);
  if (loop_ != nullptr) take_pictures(subscription, update);
  return update;
}

void LiveViewImpl::take_pictures(const ViewSubscription& subscription, ViewUpdate& update) {
  if (const double now = monotonic_now(); now >= next_picture_) {
    next_picture_ = now + kPicturePeriod;
    if (subscription.contacts) loop_->request_contact_picture(PictureConsumer::page);
    if (subscription.surfaces) loop_->request_surface_picture();
  }
  if (const ContactPicture* seen =
          subscription.contacts ? loop_->new_contact_picture(PictureConsumer::page) : nullptr) {
    const auto contact = contacts_.take();
    contact->time = pending_.contact_time(seen->contact_number);
    contact->frame_number = seen->frame_number;
    contact->X_WT = seen->X_WT;
    contact->spheres = seen->spheres;
    contact->objects = objects_at(objects_, std::span(seen->bodies.of, seen->bodies.num));
    update.contact = contact;
  }
  if (const SurfacePicture* seen = subscription.surfaces ? loop_->new_surface_picture() : nullptr) {
    const auto surface = surfaces_.take();
    *surface = *seen;
    update.surface = surface;
  }
}

/// Returns the note for the user now, the most important one first.
Json LiveViewImpl::note(const TickRecord& last) const {
  if (!has_begun_) return "the run has not begun yet";
  if (loop_ == nullptr) {
    return "the run has ended; palpate view with the folder of the run shows it again";
  }
  const auto tenths = [](double seconds) {
    return Json(std::floor(10 * std::clamp(seconds, 0.0, 1e6)) / 10).dump() + " s";
  };
  const SafetyStatus& safety = last.safety;
  if (safety.state == ForceState::ended) return "the force has faded out";
  if (safety.fault != Fault::none) {
    const std::string since = " (for " + tenths(last.device.time - safety.fault_time) + ", fault " +
                              std::to_string(safety.num_faults) + ")";
    const char* const more =
        safety.state == ForceState::held_off
            ? "; too many faults within a minute: it stays off until you ask for it"
            : "";
    return std::string(describe(safety.fault)) + more + since;
  }
  if (safety.state == ForceState::waiting && safety.num_faults > 0) {
    return "all is well again: the force comes back once the hand is free of contact";
  }
  if (last.sensor_age > stale_age_ && last.contact_number > 0) {
    return "no new depth image for " + tenths(last.sensor_age) +
           (safety.is_engaged() ? ": the force is that of the last one"
                                : ": there is no force for now") +
           "; look at the camera, and close other programs if the computer is busy";
  }
  if (are_frames_held_) return "depth frames are held: the scene is frozen";
  return {};
}

std::string LiveViewImpl::state() {
  const TickRecord last = pending_.last();
  const std::lock_guard lock(mutex_);
  look_at_loop();
  Json state{{"time", last.time},
             {"running", loop_ != nullptr && loop_->is_running()},
             {"fault", fault_},
             {"note", note(last)},
             {"force", name_of(last.safety.state)},
             {"paused", are_frames_held_},
             {"revision", revision_},
             {"settings", control_values(settings_of(settings_), is_live_control)},
             {"frame_number", last.frame_number},
             {"ticks", report_.num_ticks},
             {"missed", report_.num_missed},
             {"lost", report_.num_lost_records},
             {"frames", report_.num_frames},
             {"contacts", report_.num_contacts},
             {"sensor_age", last.sensor_age},
             {"stages", stages_}};
  if (handle_) state["handle"] = handle_->is_held() ? "held" : "free";
  return state.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string LiveViewImpl::controls() {
  const std::lock_guard lock(mutex_);
  look_at_loop();
  return list_controls(settings_of(settings_), is_live_control).dump();
}

Result<std::string> LiveViewImpl::command(std::string_view json) {
  const auto command = ViewCommand::parse(json);
  if (!command) return command.error();
  const std::string& name = command->name();
  constexpr const char* kKnown =
      "show, get, set, pause, resume, step, force, mark, end, hold and release";
  const bool is_known = name == "set" || name == "pause" || name == "resume" || name == "step" ||
                        name == "force" || name == "mark" || name == "end";
  if (name == "hold" || name == "release") {
    return Error{Errc::invalid_argument, "the tool is held over a WebSocket: send " + name +
                                             " there; closing it releases the tool"};
  }
  if (!is_known) return command->unknown(kKnown);
  const std::lock_guard lock(mutex_);
  if (loop_ == nullptr) {
    return Error{Errc::unavailable, has_begun_ ? "the run has ended" : "the run has not begun yet"};
  }
  if (name == "set") return set(*command);
  if (name == "mark") {
    auto text = command->text("text", kLongestMark);
    if (!text) return text.error();
    monitor_.marks.add(*std::move(text));
  } else if (name == "force") {
    loop_->request_force();
  } else if (name == "end") {
    wants_end_ = true;
  } else {
    const auto num_steps = command->number("frames", 1, kMaxSteps, 1);
    if (name == "step" && !num_steps) return num_steps.error();
    are_frames_held_ = name != "resume";
    loop_->hold_frames(are_frames_held_);
    for (int i = 0; name == "step" && i < static_cast<int>(*num_steps); ++i) loop_->step_frame();
  }
  return std::string("{}");
}

Result<std::string> LiveViewImpl::set(const ViewCommand& command) {
  const auto key = command.text("key", 100);
  if (!key) return key.error();
  RunSettings changed = loop_->settings();
  const auto value = set_control(settings_of(changed), is_live_control, *key, command["value"]);
  if (!value) return value.error();
  if (const Status status = loop_->change(changed); !status) return status.error();
  ++revision_;
  if (handle_) handle_->grip_anew();  // the motion scale may have changed
  return Json{{"value", *value}}.dump();
}

Status LiveViewImpl::hold(std::uint64_t page) {
  if (!handle_) return ViewSource::hold(page);
  const std::lock_guard lock(mutex_);
  if (loop_ == nullptr) {
    return Error{Errc::unavailable, has_begun_ ? "the run has ended" : "the run has not begun yet"};
  }
  return handle_->hold(page, monotonic_now());
}

Status LiveViewImpl::move(std::uint64_t page, const Pose& X_WT) {
  if (!handle_) return ViewSource::move(page, X_WT);
  const std::lock_guard lock(mutex_);
  return handle_->move(page, handle_at(settings_.coupling, X_WT), monotonic_now());
}

void LiveViewImpl::release(std::uint64_t page) {
  if (handle_) handle_->release(page);
}

}  // namespace

std::unique_ptr<LiveView> LiveView::create(const Tool& tool, std::vector<DepthStreamInfo> streams,
                                           std::string title, LiveViewOptions options) {
  return std::make_unique<LiveViewImpl>(tool, std::move(streams), std::move(title),
                                        std::move(options));
}

}}  // namespace palpate::v0
