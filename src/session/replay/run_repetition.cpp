#include "src/session/replay/run_repetition.h"

#include <algorithm>
#include <utility>

namespace palpate { inline namespace v0 {

void ContactRepetition::add(const RunSetup& setup, const RunParts& parts) {
  cameras_.resize(setup.streams.size());
  if (views_.num_cameras() != setup.streams.size()) views_ = CameraViews(setup.streams.size());
  const auto shared = std::make_shared<const RunSetup>(setup);
  if (parts.needs_timelines) {
    for (Camera& camera : cameras_) camera.timelines[setup.revision] = {shared, {}};
  }
  const bool waits = parts.needs_timelines && (part_ || !measuring_.empty());
  measuring_[setup.revision] = {parts.scale, parts.needs_contact ? shared : nullptr, waits};
}

bool ContactRepetition::add(RecordedDepth frame) {
  if (frame.record.camera >= cameras_.size()) return false;
  Camera& camera = cameras_[frame.record.camera];
  const auto number = static_cast<std::int64_t>(frame.record.camera_frame);
  const bool is_next = number == std::exchange(camera.newest, number) + 1;
  camera.frames.push_back(std::move(frame));
  return is_next;
}

bool ContactRepetition::has_frames_of(const ContactRecord& contact) const {
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    if (contact.cameras.of[k].camera_frame > cameras_[k].newest) return false;
  }
  return true;
}

Status ContactRepetition::push_next(std::size_t k) {
  Camera& camera = cameras_[k];
  const RecordedDepth& next = camera.frames.front();
  // Uses the newest timeline that existed at this frame.
  auto& timelines = camera.timelines;
  while (timelines.size() > 1 && std::next(timelines.begin())->first <= next.record.revision) {
    timelines.erase(timelines.begin());
  }
  Timeline& timeline = timelines.begin()->second;
  if (!timeline.surfaces) {
    auto made = make_surfaces(timeline.setup->streams, k, timeline.setup->settings);
    if (!made) return made.error();
    timeline.surfaces = *std::move(made);
  }
  timeline.surfaces->push(next.frame, next.record.capture_time, pool_, next.record.requested);
  camera.blend = timeline.surfaces->at(next.record.capture_time);
  camera.key_frames = timeline.surfaces->key_frames();
  camera.pushed = {static_cast<std::int64_t>(next.record.camera_frame), next.record.capture_time};
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
  views_.begin();
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    Camera& camera = cameras_[k];
    const auto& [desired, progress] = recorded.cameras.of[k];
    while (camera.pushed.number < desired && !camera.frames.empty()) {
      if (const Status status = push_next(k); !status) return status.error();
    }
    camera.blend.progress = progress;
    views_.show(k, camera.pushed, camera.blend, camera.key_frames);
  }
  ContactRecord repeated = recorded;
  repeated.capture_time = views_.capture_time(recorded.capture_time);
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

TickRecord TickRepetition::repeat(const TickRecord& recorded, const ContactRecord& contact) {
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
