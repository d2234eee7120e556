#include "src/session/haptic_repetition.h"

#include <utility>

namespace palpate {

Result<RevisionParts> make_revision(const Tool& tool, const HapticSetup& setup,
                                    const HapticSettings* before) {
  const HapticSettings& s = setup.settings;
  const DeviceLimits& limits = setup.device.limits;
  const auto coupling = check_coupling(s.coupling, limits, 1 / setup.device.rate);
  if (!coupling) return coupling.error();
  RevisionParts parts;
  parts.contact = s.contact;
  parts.scale = thesis_force_scale(coupling->options.force_at_eighth, full_volume(tool, s.contact));
  if (before == nullptr || !keeps_coupling(*before, s)) {
    parts.coupling = make_coupling(coupling->options, limits, tool.sphere_mass());
  }
  if (before == nullptr || !keeps_surfaces(*before, s)) {
    std::optional<DepthFieldOptions> field;
    if (s.contact.method == InsideMethod::field) field = s.field;
    auto timeline =
        SurfaceTimeline::create(setup.stream, s.surface, field, s.time, {s.backend, s.sensing_gpu});
    if (!timeline) return timeline.error();
    parts.timeline.emplace(*std::move(timeline));
  }
  if (before == nullptr || before->backend != s.backend) {
    ContactCapacities capacities;
    capacities.gpu = s.contact_gpu;
    auto query = make_contact_query(s.backend, tool, capacities);
    if (!query) return query.error();
    parts.query = std::make_unique<BlendedQuery>(*std::move(query));
  }
  return parts;
}

void ContactRepetition::add(std::uint32_t revision, RevisionParts& parts) {
  if (parts.timeline) timelines_.emplace(revision, *std::move(parts.timeline));
  measuring_[revision] = {parts.contact, parts.scale, std::move(parts.query)};
}

void ContactRepetition::push_next() {
  const HapticFrame& next = frames_.front();
  // The newest timeline that there was for this frame.
  while (timelines_.size() > 1 && std::next(timelines_.begin())->first <= next.revision) {
    timelines_.erase(timelines_.begin());
  }
  SurfaceTimeline& timeline = timelines_.begin()->second;
  timeline.push(next.frame, next.capture_time, *pool_);
  moment_ = timeline.at(next.capture_time);
  capture_time_ = next.capture_time;
  frames_.pop_front();
  ++num_pushed_;
}

ContactRecord ContactRepetition::repeat(const ContactRecord& recorded) {
  while (num_pushed_ <= recorded.frame_number) push_next();
  auto newest = measuring_.begin();
  for (auto at = newest; at != measuring_.end() && at->first <= recorded.revision; ++at) {
    if (at->second.query) query_ = std::move(at->second.query);
    newest = at;
  }
  measuring_.erase(measuring_.begin(), newest);
  const Measuring& how = newest->second;

  ContactRecord repeated = recorded;
  repeated.capture_time = capture_time_;
  moment_.progress = recorded.progress;
  query_->set_moment(moment_);
  repeated.penetration = query_->query(recorded.X_WT, how.contact);
  // A stiffness that was kept from an earlier contact is taken as it was.
  Stiffness stiffness = recorded.contact.stiffness;
  if (recorded.has_new_stiffness) stiffness = query_->stiffness();
  repeated.contact =
      local_contact(repeated.penetration, stiffness, recorded.X_WT, centre_of_mass_T_, how.scale,
                    recorded.contact.time, recorded.contact.time - capture_time_);
  if (!recorded.has_new_stiffness) {
    repeated.contact.stiffness = recorded.contact.stiffness;
    repeated.contact.max_stiffness = recorded.contact.max_stiffness;
  }
  return repeated;
}

void TickRepetition::add(std::uint32_t revision, RevisionParts& parts) {
  if (parts.coupling) couplings_[revision] = std::move(parts.coupling);
}

void TickRepetition::go_on_with(std::unique_ptr<Coupling> coupling) {
  if (has_tool_) coupling->take_over(coupling_->state());
  coupling_ = std::move(coupling);
}

HapticRecord TickRepetition::repeat(const HapticRecord& recorded, const LocalContact& contact) {
  while (!couplings_.empty() && couplings_.begin()->first <= recorded.revision) {
    go_on_with(std::move(couplings_.begin()->second));
    couplings_.erase(couplings_.begin());
  }
  HapticRecord tick = recorded;
  tick.step = {};
  if (recorded.dt > 0) {
    if (!std::exchange(has_tool_, true)) coupling_->reset(recorded.device);
    tick.step = coupling_->step(recorded.device, contact, recorded.dt);
  }
  if (recorded.is_stopping && safety_.status().fault == Fault::none) safety_.stop();
  tick.F_H_B = safety_.filter(tick.step.F_H_B,
                              {recorded.device.time, recorded.device, recorded.contact_age,
                               recorded.has_sensor_failed ? kLostSensorAge : recorded.sensor_age,
                               recorded.has_backend_failed});
  tick.safety = safety_.status();
  return tick;
}

}  // namespace palpate
