#include "src/session/run_repetition.h"

#include <cstring>
#include <utility>

namespace palpate {

void ContactRepetition::add(const RunSetup& setup, RunParts& parts) {
  if (parts.timeline) timelines_.emplace(setup.revision, *std::move(parts.timeline));
  measuring_[setup.revision] = {parts.scale, std::move(parts.contact)};
}

void ContactRepetition::push_next() {
  const RecordedDepth& next = frames_.front();
  // The newest timeline that there was for this frame.
  while (timelines_.size() > 1 && std::next(timelines_.begin())->first <= next.record.revision) {
    timelines_.erase(timelines_.begin());
  }
  SurfaceTimeline& timeline = timelines_.begin()->second;
  timeline.push(next.frame, next.record.capture_time, *pool_, next.record.asked);
  moment_ = timeline.at(next.record.capture_time);
  capture_time_ = next.record.capture_time;
  frames_.pop_front();
  ++num_pushed_;
}

ContactRecord ContactRepetition::repeat(const ContactRecord& recorded) {
  while (num_pushed_ <= recorded.frame_number) push_next();
  while (!measuring_.empty() && measuring_.begin()->first <= recorded.revision) {
    auto& [scale, part] = measuring_.begin()->second;
    if (part) part_ = std::move(part);
    part_->use(scale);
    measuring_.erase(measuring_.begin());
  }
  ContactRecord repeated = recorded;
  repeated.capture_time = capture_time_;
  moment_.progress = recorded.progress;
  part_->measure(moment_, recorded.has_new_stiffness, repeated);
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

bool TickRepetition::is_at(const HandMoment& moment) {
  // A change that the last tick has taken is known by the next one only.
  use_couplings(moment.revision);
  const HandMoment now = hand_->moment();
  const auto a = now.numbers.numbers(), b = moment.numbers.numbers();
  return now.tick == moment.tick && a.size() == b.size() &&
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
              {recorded.is_stopping, recorded.is_force_asked_for, recorded.has_sensor_failed,
               recorded.has_backend_failed},
              tick);
  tick.time = recorded.time;  // rounded otherwise
  tick.compute_nanoseconds = recorded.compute_nanoseconds;
  return tick;
}

}  // namespace palpate
