#include "src/session/replay/run_repetition.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "src/session/internal/lead_frames.h"

namespace palpate { inline namespace v0 {

void ContactRepetition::add(const RunSetup& setup, const RunParts& parts) {
  const bool is_first = cameras_.empty();
  cameras_.resize(setup.streams.size());
  if (views_.num_cameras() != setup.streams.size()) views_ = CameraViews(setup.streams.size());
  const auto shared = std::make_shared<const RunSetup>(setup);
  if (parts.needs_timelines) {
    times_.emplace(setup.revision, setup.settings.time);
    for (std::size_t k = 0; k < cameras_.size(); ++k) {
      const double first_period = is_first && k < first_periods_.size() ? first_periods_[k] : 0;
      cameras_[k].timelines[setup.revision] = {shared, first_period, {}};
    }
  }
  const bool waits = parts.needs_timelines && (part_ || !measuring_.empty());
  measuring_[setup.revision] = {parts.scale, parts.needs_contact ? shared : nullptr, waits};
}

Result<SurfaceTimeline*> ContactRepetition::made(Timeline& timeline, std::size_t camera) {
  if (!timeline.surfaces) {
    const RunSetup& setup = *timeline.setup;
    auto surfaces = make_surfaces(setup.streams, camera, setup.settings, 0, timeline.first_period);
    if (!surfaces) return surfaces.error();
    timeline.surfaces = *std::move(surfaces);
  }
  return &*timeline.surfaces;
}

bool ContactRepetition::add(RecordedDepth frame) {
  if (frame.record.camera >= cameras_.size()) return false;
  Camera& camera = cameras_[frame.record.camera];
  const auto number = static_cast<std::int64_t>(frame.record.camera_frame);
  const bool is_next = number == camera.newest + 1 || (has_start_ && camera.newest < 0);
  if (camera.newest < 0) {
    camera.first = number;
    camera.first_revision = frame.record.revision;
  }
  camera.newest = number;
  camera.frames.push_back(std::move(frame));
  return is_next;
}

Status ContactRepetition::add(const EstimateStart& estimate) {
  if (estimate.camera >= cameras_.size() || cameras_[estimate.camera].newest >= 0) return Done{};
  auto& timelines = cameras_[estimate.camera].timelines;
  auto of_it = timelines.upper_bound(estimate.revision);
  if (of_it != timelines.begin()) --of_it;
  if (of_it == timelines.end()) return Done{};
  const auto timeline = made(of_it->second, estimate.camera);
  if (!timeline) return timeline.error();
  return (*timeline)->resume_from(estimate.state);
}

bool ContactRepetition::has_frames_of(const ContactRecord& contact) const {
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    if (contact.cameras.of[k].camera_frame > cameras_[k].newest) return false;
  }
  return true;
}

const std::pair<const std::uint32_t, TimeOptions>& ContactRepetition::time_of(
    const ContactRecord& contact) const {
  const auto after = times_.upper_bound(contact.revision);
  return after == times_.begin() ? *after : *std::prev(after);
}

bool ContactRepetition::lacks_frame_of(const ContactRecord& contact) const {
  const auto& [revision, time] = time_of(contact);
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    const std::int64_t desired = contact.cameras.of[k].camera_frame;
    // A timeline does not depend on frames before its own first one.
    const bool is_whole = cameras_[k].first_revision < revision;
    const std::int64_t lead = is_whole ? 0 : num_recorded_lead_frames(time);
    if (desired >= 0 && std::max<std::int64_t>(desired - lead, 0) < cameras_[k].first) return true;
  }
  return false;
}

bool ContactRepetition::rests_on_all(const ContactRecord& contact) const {
  return time_of(contact).second.average.kind == DepthAverage::kalman;
}

Status ContactRepetition::push_next(std::size_t k) {
  Camera& camera = cameras_[k];
  const RecordedDepth& next = camera.frames.front();
  // Uses the newest timeline that existed at this frame.
  auto& timelines = camera.timelines;
  while (timelines.size() > 1 && std::next(timelines.begin())->first <= next.record.revision) {
    timelines.erase(timelines.begin());
  }
  const auto timeline = made(timelines.begin()->second, k);
  if (!timeline) return timeline.error();
  (*timeline)->push(next.frame, next.record.capture_time, pool_, next.record.requested);
  views_[k] = (*timeline)->at(next.record.capture_time);
  camera.key_frames = (*timeline)->key_frames();
  camera.capture_time = next.record.capture_time;
  camera.pushed = static_cast<std::int64_t>(next.record.camera_frame);
  camera.frames.pop_front();
  return Done{};
}

/// Applies due changes of settings. If one waits for a depth frame, those after it wait with it,
/// and only the last one is used.
Status ContactRepetition::use_measuring(std::uint32_t revision) {
  const auto is_due = [&] { return !measuring_.empty() && measuring_.begin()->first <= revision; };
  Setup newest;
  bool waits = false;
  while (is_due()) {
    const auto due = measuring_.extract(measuring_.begin());
    const Measuring& next = due.mapped();
    if (next.part) newest = next.part;
    waits = waits || next.waits;
    if (waits && is_due()) continue;
    if (newest) {
      auto part = make_contact_part(index_, newest->streams, newest->settings, next.scale);
      if (!part) return part.error();
      if (part_) (*part)->take_over(*part_);
      part_ = *std::move(part);
      newest = nullptr;
    }
    part_->use(next.scale);
  }
  return Done{};
}

Result<ContactRecord> ContactRepetition::repeat(const ContactRecord& recorded) {
  ContactRecord repeated = recorded;
  bool is_seen = false;
  times_.erase(times_.begin(), times_.find(time_of(recorded).first));
  views_.begin();
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    Camera& camera = cameras_[k];
    const auto& [desired, progress] = recorded.cameras.of[k];
    while (camera.pushed < desired && !camera.frames.empty()) {
      if (const Status status = push_next(k); !status) return status.error();
    }
    views_[k].progress = progress;
    if (desired < 0) continue;
    views_.remember(camera.key_frames, progress);
    repeated.capture_time =
        is_seen ? std::min(repeated.capture_time, camera.capture_time) : camera.capture_time;
    is_seen = true;
  }
  if (const Status status = use_measuring(recorded.revision); !status) return status.error();
  part_->measure(views_.all(), recorded.has_new_stiffness, repeated);
  if (!recorded.has_new_stiffness) {
    // Kept from an earlier contact, which may not have been recorded.
    repeated.contact.stiffness = recorded.contact.stiffness;
    repeated.contact.max_stiffness = recorded.contact.max_stiffness;
    repeated.contact.patch = recorded.contact.patch;
  }
  return repeated;
}

void TickRepetition::add(const RunSetup& setup, RunParts& parts) {
  couplings_[setup.revision] = std::move(parts.coupling);
  if (hand_ == nullptr) {
    auto& first = couplings_.begin()->second;
    hand_ =
        std::make_unique<HandPart>(std::move(first), std::move(*safety_), 1 / setup.device.rate);
    couplings_.clear();
  }
}

void TickRepetition::use_couplings(std::uint32_t revision) {
  while (!couplings_.empty() && couplings_.begin()->first <= revision) {
    hand_->change(couplings_.begin()->first, couplings_.begin()->second);
    couplings_.erase(couplings_.begin());
  }
}

bool TickRepetition::is_at(const HandSnapshot& snapshot) {
  // A change taken by the last tick is recorded with the next one only.
  use_couplings(snapshot.revision);
  const HandSnapshot now = hand_->snapshot();
  const auto a = now.numbers.numbers(), b = snapshot.numbers.numbers();
  return now.tick == snapshot.tick && a.size() == b.size() &&
         std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

TickRecord TickRepetition::repeat(const TickRecord& recorded, const ContactRecord& contact) {
  if (start_) {
    use_couplings(start_->hand.revision);
    hand_->remember(start_->hand.numbers);
    start_.reset();
  }
  use_couplings(recorded.revision);
  if (hand_->num_ticks() == 0) hand_->set_start_time(recorded.device.time - recorded.time);
  TickRecord tick;
  hand_->tick(recorded.device, contact,
              {recorded.is_stopping, recorded.is_force_requested, recorded.is_suspended,
               recorded.has_sensor_failed, recorded.has_backend_failed},
              tick);
  tick.time = recorded.time;  // it would be rounded otherwise
  tick.compute_nanoseconds = recorded.compute_nanoseconds;
  return tick;
}

}}  // namespace palpate::v0
