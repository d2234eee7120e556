#include "src/run/internal/pipeline.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/core/internal/assert.h"
#include "src/haptics/internal/surface_motion.h"
#include "src/math/internal/rotation_vector.h"
#include "src/run/setting_changes.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kToolBody = 0;
/// Longest time step of moving objects, s.
constexpr double kLongestStep = 0.02;

/// Returns the filter's input of a tick, apart from the force on the hand.
SafetyInput safety_input(const TickRecord& record) {
  SafetyInput input;
  input.time = record.device.time;
  input.state = record.device;
  input.contact_age = record.contact_age;
  input.sensor_age = record.sensor_age;
  input.backend_failed = record.has_backend_failed;
  input.sensor_failed = record.has_sensor_failed;
  input.is_suspended = record.is_suspended;
  return input;
}

}  // namespace

void add_notes(std::vector<std::string>& notes, const std::vector<std::string>& news) {
  for (const std::string& note : news) {
    if (notes.size() == kMaxNotes) return;
    if (std::ranges::find(notes, note) == notes.end()) notes.push_back(note);
  }
}

// From a pose to a contact.

ContactPart::ContactPart(const Tool& tool, std::unique_ptr<ContactQuery> query,
                         const ContactScale& scale, const std::vector<SceneObject>& objects,
                         BodyMethod bodies, std::unique_ptr<MovingBodies> moving)
    : bodies_(bodies),
      world_(bodies),
      query_(query.get()),
      tool_mass_(tool.sphere_mass()),
      scale_(scale),
      moving_(std::move(moving)) {
  world_.add_tool(tool, std::move(query));
  int num_moving = 0;
  for (const SceneObject& object : objects) {
    const bool moves = object.moves && moving_ != nullptr;
    const int body =
        world_.add_object(moves ? moving_->shape(num_moving) : *object.shape, object.X_WB);
    if (moves) {
      world_.set_wants(body, {.stiffness = true});
      ++num_moving;
    }
  }
  scale_.object_frictions = frictions_of(objects);
  pushes_.resize(static_cast<std::size_t>(num_moving));
  velocities_.resize(static_cast<std::size_t>(num_moving));
}

void ContactPart::use(const ContactScale& scale) noexcept {
  PALPATE_ASSERT(scale.object_frictions.size() == scale_.object_frictions.size());
  scale_ = scale;
  if (moving_) moving_->use(scale.bodies, scale.object_frictions);
}

void ContactPart::take_over(const ContactPart& before) noexcept {
  before_ = before.before_;
  if (moving_ && before.moving_) moving_->take_over(*before.moving_);
}

Status ContactPart::measure_pairs_at(Backend backend, int gpu) {
  if (backend == Backend::cpu) return Done{};
  return world_.measure_pairs_by([&](const auto& a, const auto& b) {
    return make_body_pair_query(backend, a, b, {.method = bodies_, .gpu = gpu});
  });
}

void ContactPart::measure(std::span<const SurfaceBlend> cameras, bool with_stiffness,
                          ContactRecord& record) noexcept {
  if (moving_) place_bodies(record);
  world_.set_pose(kToolBody, record.X_WT);
  world_.set_wants(kToolBody, {.stiffness = with_stiffness, .unseen_volume = true});
  world_.measure(cameras);
  const BodyMeasure& measured = world_.measured(kToolBody);
  record.penetration = measured.total();
  record.objects = measured.bodies;
  record.num_object_pairs = measured.num_pairs;
  const bool has_contact = record.penetration.volume > 0 && has_stiffness();
  record.has_new_stiffness = has_contact && measured.stiffness;
  if (!has_contact) stiffness_ = {};
  if (record.has_new_stiffness) {
    stiffness_ = *measured.stiffness;
    if (measured.bodies_stiffness) stiffness_ += *measured.bodies_stiffness;
  }
  const bool is_touched = record.penetration.volume > 0;
  if (!is_touched || record.has_new_stiffness || !has_stiffness()) {
    patch_ = is_touched ? patch_at(cameras, record.X_WT) : ContactPatch{};
    scene_V_W_ = {patch_.ground.velocity_W, patch_.ground.turning_W};
  }
  if (moving_) move_bodies(cameras, record);
  set_contact(record);
}

void ContactPart::place_bodies(ContactRecord& record) noexcept {
  record.bodies.num = static_cast<std::uint32_t>(moving_->num_bodies());
  for (int i = 0; i < moving_->num_bodies(); ++i) {
    const Pose& X_WB = moving_->bodies()[static_cast<std::size_t>(i)].X_WB;
    record.bodies.of[i] = X_WB;
    velocities_[static_cast<std::size_t>(i)] = moving_->bodies()[static_cast<std::size_t>(i)].V_W;
    world_.set_pose(kToolBody + 1 + static_cast<int>(moving_->object(i)), X_WB);
  }
}

/// Moves bodies by the forces that were measured just now.
void ContactPart::move_bodies(std::span<const SurfaceBlend> cameras,
                              ContactRecord& record) noexcept {
  const double time = record.contact.time;
  const double since = before_ ? time - before_->time : 0;
  const double dt = since > 0 ? std::min(since, kLongestStep) : 0;
  for (int i = 0; i < moving_->num_bodies(); ++i) {
    pushes_[static_cast<std::size_t>(i)] = push_on(i, record.X_WT, dt);
  }
  if (!moving_->step(cameras, pushes_, dt)) {
    record.penetration.status |= StepStatus::backend_failed;
  }
  before_ = {time, record.X_WT};
  carry(record.X_WT);
}

/// Extrapolates the motion of touched bodies to the next measurement: a sticking point then keeps
/// its distance from the body instead of lagging one step behind.
void ContactPart::carry(const Pose& X_WT) noexcept {
  const BodyMeasure& measured = world_.measured(kToolBody);
  Ground& ground = patch_.ground;
  ground.velocity_W = scene_V_W_.linear;
  ground.turning_W = scene_V_W_.angular;
  const double all = plus_object_forces(norm(measured.cloud.measure_W.force));
  const Vec3d p_W = X_WT * tool_mass_.center_of_mass + patch_.lever_W;
  if (!(all > 0)) return;
  for (int i = 0; i < moving_->num_bodies(); ++i) {
    const int object = static_cast<int>(moving_->object(i));
    const double share = norm(world_.measured(kToolBody + 1 + object).bodies.measure_W.force) / all;
    const RigidBody& body = moving_->bodies()[static_cast<std::size_t>(i)];
    const Twist& before = velocities_[static_cast<std::size_t>(i)];
    const Twist V_W{2 * body.V_W.linear - before.linear, 2 * body.V_W.angular - before.angular};
    ground.velocity_W += share * (V_W.linear + cross(V_W.angular, p_W - body.center_W()));
    ground.turning_W += share * V_W.angular;
  }
}

/// Returns the tool's push on a body: the opposite of the body's wrench on the tool.
MovingBodies::Push ContactPart::push_on(int body, const Pose& X_WT, double dt) const noexcept {
  const std::size_t object = moving_->object(body);
  const BodyMeasure& measured = world_.measured(kToolBody + 1 + static_cast<int>(object));
  MovingBodies::Push push;
  if (!(measured.bodies.volume > 0) || !measured.bodies_stiffness) return push;
  const RigidBody& own = moving_->bodies()[static_cast<std::size_t>(body)];
  push.F_B_W = scale_.volume * measured.bodies.measure_W;
  const double gain = scale_.volume.newtons_per_cubic_meter;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) push.stiffness.m[i][j] = gain * measured.bodies_stiffness->m[i][j];
  }
  // The patch is the tool's, so that both feel one friction.
  const Vec3d center = own.center_W();
  push.patch = contact_patch({-measured.bodies.measure_W.force, {}}, measured.bodies.volume, {},
                             measured.bodies_moments);
  push.patch.lever_W += X_WT * tool_mass_.center_of_mass - center;
  push.friction = scale_.object_frictions[object].coefficient.value_or(scale_.friction.coefficient);
  push.grip = scale_.grip;
  if (!(dt > 0)) return push;
  const Vec3d was = before_->X_WT * (inverse(X_WT) * center);
  push.V_W = {(center - was) / dt, rotation_between(before_->X_WT.rotation, X_WT.rotation) / dt};
  return push;
}

/// Returns the contact patch of the last measurement.
ContactPatch ContactPart::patch_at(std::span<const SurfaceBlend> cameras,
                                   const Pose& X_WT) const noexcept {
  const BodyMeasure& measured = world_.measured(kToolBody);
  const VolumeWrench &of_cloud = measured.cloud.measure_W, &of_bodies = measured.bodies.measure_W;
  const Vec3d p_WC = X_WT * tool_mass_.center_of_mass;
  ContactPatch cloud =
      measured.stiffness
          ? contact_patch(of_cloud, measured.cloud.volume, *measured.stiffness, measured.moments)
          : guessed_patch(of_cloud, measured.cloud.volume, tool_mass_, X_WT.rotation);
  if (measured.cloud.volume > 0) {
    const TouchedDisc disc{p_WC + cloud.lever_W, of_cloud.force, cloud.torsion_radius};
    if (!regions_.empty()) cloud.ground = ground_at(regions_, cameras, disc);
    cloud.share = 1 - cloud.ground.share;
    const Twist V_W = surface_motion(cameras, disc);
    cloud.ground.velocity_W = V_W.linear;
    cloud.ground.turning_W = V_W.angular;
  }
  if (!(measured.bodies.volume > 0)) return cloud;

  ContactPatch objects =
      measured.bodies_stiffness
          ? contact_patch(of_bodies, measured.bodies.volume, *measured.bodies_stiffness,
                          measured.bodies_moments)
          : guessed_patch(of_bodies, measured.bodies.volume, tool_mass_, X_WT.rotation);
  if (const double all = plus_object_forces(0); all > 0) take_frictions(all, objects);
  return joined(cloud, norm(of_cloud.force), objects, norm(of_bodies.force));
}

double ContactPart::plus_object_forces(double sum) const noexcept {
  for (int body = kToolBody + 1; body < world_.num_bodies(); ++body) {
    sum += norm(world_.measured(body).bodies.measure_W.force);
  }
  return sum;
}

void ContactPart::take_frictions(double all_forces, ContactPatch& objects) const noexcept {
  const FrictionOptions& other = scale_.friction;
  double with_own = 0, weighted = 0;
  Ground& ground = objects.ground;
  for (std::size_t i = 0; i < scale_.object_frictions.size(); ++i) {
    const BodyMeasure& object = world_.measured(kToolBody + 1 + static_cast<int>(i));
    const double force = norm(object.bodies.measure_W.force);
    const ObjectFriction& own = scale_.object_frictions[i];
    if (own.static_ratio || own.viscous) {  // like a region with a material
      const double share = force / all_forces, mu = own.coefficient.value_or(other.coefficient);
      ground.share += share;
      ground.friction += share * mu;
      ground.static_friction += share * mu * own.static_ratio.value_or(other.static_ratio);
      ground.viscous += share * own.viscous.value_or(mu > 0 ? other.viscous : 0);
    } else if (own.coefficient) {
      with_own += force;
      weighted += force * *own.coefficient;
    }
  }
  objects.share = 1 - with_own / all_forces - ground.share;
  objects.own_friction = weighted / all_forces;
}

bool ContactPart::has_stiffness() const noexcept {
  return std::holds_alternative<FieldMethod>(query_->method());
}

void ContactPart::set_contact(ContactRecord& record) const noexcept {
  const double time = record.contact.time;
  record.contact =
      local_contact(record.penetration, stiffness_, record.X_WT, tool_mass_.center_of_mass,
                    scale_.volume, time, time - record.capture_time, patch_);
  const BodyMeasure& measured = world_.measured(kToolBody);
  if (record.contact.is_valid) {
    record.contact.energy = stored_energy(measured.cloud, scale_.volume) +
                            stored_energy(measured.bodies, scale_.volume);
  }
  if (moving_) record.contact.energy += moving_->stored();
}

// From a state to a wrench.

HandPart::HandPart(std::unique_ptr<Coupling> coupling, SafetyFilter safety, double tick_seconds)
    : coupling_(std::move(coupling)), safety_(std::move(safety)), tick_seconds_(tick_seconds) {}

void HandPart::tick(const DeviceState& state, const ContactRecord& known, const TickFlags& flags,
                    TickRecord& record) noexcept {
  if (num_ticks_ == 0 || !std::isfinite(first_tick_)) first_tick_ = state.time;
  const bool has_contact = known.number > 0;
  record.revision = revision_;
  record.number = num_ticks_++;
  record.time = state.time - start_time_;
  record.device = state;
  record.dt = step_seconds(state);
  record.step = record.dt > 0 ? coupling_->step(state, known.contact, record.dt) : CouplingStep{};
  record.penetration = known.penetration;
  record.objects = known.objects;
  record.num_object_pairs = known.num_object_pairs;
  record.contact_age = state.time - (has_contact ? known.contact.time : first_tick_);
  record.sensor_age = state.time - (has_contact ? known.capture_time : first_tick_);
  record.contact_number = known.number;
  record.frame_number = known.frame_number;
  record.is_stopping = is_stopping_ = is_stopping_ || flags.is_stopping;
  record.is_force_requested = flags.is_force_requested;
  record.is_suspended = flags.is_suspended;
  record.has_sensor_failed = flags.has_sensor_failed;
  record.has_backend_failed = flags.has_backend_failed;
  if (is_stopping_) safety_.stop();
  if (!coupling_->drives_device()) return end_without_force(record);
  const Wrench& contact_W = record.step.contact_W;
  const bool is_free = known.contact.is_valid && known.penetration.volume == 0 &&
                       contact_W.force == Vec3d{} && contact_W.torque == Vec3d{};
  const std::uint32_t num_faults = safety_.status().num_faults;
  SafetyInput input = safety_input(record);
  input.is_requested = record.is_force_requested;
  input.is_free = is_free;
  input.is_measured = known.contact.is_valid;
  input.is_clutched = record.step.is_clutched;
  input.stored = record.step.stored;
  record.F_H_B = safety_.filter(record.step.F_H_B, input);
  record.safety = safety_.status();
  status_without_force_.num_faults += record.safety.num_faults - num_faults;
  record.safety.num_faults = status_without_force_.num_faults;
}

/// Ends a tick without a force on a hand: reports the contact whenever it is measured. The force of
/// the coupling before fades through the filter, and so does that of the next one.
void HandPart::end_without_force(TickRecord& record) noexcept {
  const Fault fault = record.is_stopping          ? Fault::stopped
                      : record.has_sensor_failed  ? Fault::sensor
                      : record.has_backend_failed ? Fault::backend
                                                  : Fault::none;
  if (fault != Fault::none && status_without_force_.fault == Fault::none) {
    status_without_force_.fault_time = record.device.time;
    ++status_without_force_.num_faults;
  }
  status_without_force_.fault = fault;
  status_without_force_.state = fault == Fault::none ? ForceState::engaged
                                : is_lasting(fault)  ? ForceState::ended
                                                     : ForceState::off;
  status_without_force_.gain = status_without_force_.is_engaged() ? 1 : 0;
  if (record.has_backend_failed) {
    record.step.contact_W = {};
    record.penetration = record.objects = {};
    record.penetration.status = StepStatus::backend_failed;
  }
  record.F_H_B = {};
  if (safety_.has_ticked()) {
    SafetyInput input = safety_input(record);
    input.is_driven = false;
    record.F_H_B = safety_.filter({}, input);
  }
  record.safety = status_without_force_;
}

void HandPart::change(std::uint32_t revision, std::unique_ptr<Coupling>& coupling) noexcept {
  revision_ = revision;
  if (coupling == nullptr) return;
  if (has_tool_) coupling->take_over(coupling_->state());
  std::swap(coupling_, coupling);
}

/// Returns the time step, s; 0 until the first usable state, from which on the hand moves the tool.
/// A tick without a time counts as a nominal one; the next one covers both.
double HandPart::step_seconds(const DeviceState& state) noexcept {
  const bool has_time = std::isfinite(state.time);
  if (has_tool_ && !has_time) return tick_seconds_;
  if (!has_tool_) {
    if (!state.is_valid || !has_time) return 0;
    coupling_->reset(state);
    has_tool_ = true;
    last_state_time_ = state.time - tick_seconds_;
  }
  // A late tick is a longer step, within bounds.
  const double dt =
      std::clamp(state.time - last_state_time_, tick_seconds_ / 10, 10 * tick_seconds_);
  last_state_time_ = state.time;
  return dt;
}

// All of it in one thread.

Pipeline::Pipeline(std::shared_ptr<const ToolIndex> index, std::vector<DepthStreamInfo> streams,
                   const DeviceInfo& device, const RunSettings& settings,
                   std::unique_ptr<ThreadPool> pool, RunParts parts, SafetyFilter safety)
    : index_(std::move(index)),
      streams_(std::move(streams)),
      device_(device),
      settings_(settings),
      checked_coupling_(parts.checked_coupling),
      notes_(std::move(parts.notes)),
      pool_(std::move(pool)),
      timelines_(std::move(parts.timelines)),
      contacts_(std::move(parts.contact)),
      hand_(std::make_unique<HandPart>(std::move(parts.coupling), std::move(safety),
                                       1 / device.rate)),
      cameras_(streams_.size()),
      seen_(streams_.size()),
      num_camera_frames_(streams_.size()) {}

Result<Pipeline> Pipeline::create(const Tool& tool, std::vector<DepthStreamInfo> streams,
                                  const DeviceInfo& device, const RunSettings& settings) {
  auto pool = std::make_unique<ThreadPool>(std::clamp(settings.num_threads, 0, 256));
  RunPartsOptions options;
  if (settings.num_threads > 1) options.query_threads = pool.get();
  auto index = ToolIndex::create(tool);
  auto parts = make_run_parts(index, streams, device, settings, options);
  if (!parts) return parts.error();
  auto safety = SafetyFilter::create(device.limits, settings.safety);
  if (!safety) return safety.error();
  return Pipeline(std::move(index), std::move(streams), device, settings, std::move(pool),
                  *std::move(parts), *std::move(safety));
}

SurfaceStats Pipeline::push(const DepthFrame& frame, double time, std::size_t camera) {
  ++num_frames_;
  const CameraFrame now{num_camera_frames_[camera]++, time};
  if (!pending_) {
    seen_[camera] = now;
    return timelines_[camera].push(frame, time, *pool_);
  }
  // A query never mixes surfaces made with the old settings and with the new ones: these wait until
  // all cameras have one.
  const SurfaceStats stats = pending_->timelines[camera].push(frame, time, *pool_);
  pending_->seen[camera] = now;
  frame_revision_ = pending_->revision;
  const bool has_all = std::all_of(pending_->seen.begin(), pending_->seen.end(),
                                   [](const CameraFrame& one) { return one.number >= 0; });
  if (has_all) use(*pending_);
  return stats;
}

const ContactRecord& Pipeline::measure(const Pose& X_WT, double time) noexcept {
  ContactRecord contact;
  contact.capture_time = time;
  contact.cameras.num = static_cast<std::uint32_t>(timelines_.size());
  bool has_failed = false, is_seen = false;
  cameras_.begin();
  for (std::size_t k = 0; k < timelines_.size(); ++k) {
    cameras_[k] = timelines_[k].at(time);
    cameras_.remember(timelines_[k].key_frames(), cameras_[k].progress);
    contact.cameras.of[k] = {seen_[k].number, cameras_[k].progress};
    if (seen_[k].number >= 0) {
      contact.capture_time =
          is_seen ? std::min(contact.capture_time, seen_[k].capture_time) : seen_[k].capture_time;
      is_seen = true;
    }
    has_failed = has_failed || !timelines_[k].status();
  }
  contact.revision = surface_revision_;
  contact.number = contact_.number + 1;
  contact.time = time - start_time_;
  contact.X_WT = X_WT;
  contact.frame_number = num_frames_ - 1;
  contact.contact.time = time;
  const bool is_coupled = settings_.coupling.kind != CouplingKind::none;
  contacts_->measure(cameras_.all(), is_coupled || has_friction(settings_), contact);
  if (contact.penetration.status.has(StepStatus::backend_failed) || has_failed) {
    has_backend_failed_ = true;
    return contact_;
  }
  return contact_ = contact;
}

const TickRecord& Pipeline::tick(const DeviceState& state, TickFlags flags) noexcept {
  const bool has_time = std::isfinite(state.time);
  if (!has_begun_ && has_time) {
    start_time_ = state.time;
    hand_->set_start_time(start_time_);
    has_begun_ = true;
  }
  const bool is_prescribed = settings_.coupling.kind == CouplingKind::none;
  const bool can_measure = num_frames_ > 0 && !has_backend_failed_ && has_time;
  if (is_prescribed && can_measure &&
      (hand_->has_tool() || (state.is_valid && is_finite(state.X_BH)))) {
    measure(hand_->held_pose(state), state.time);
  }
  flags.has_backend_failed = flags.has_backend_failed || has_backend_failed_;
  hand_->tick(state, contact_, flags, record_);
  if (!is_prescribed && can_measure && hand_->has_tool()) measure(record_.step.X_WT, state.time);
  return record_;
}

Status Pipeline::change(const RunSettings& settings) {
  if (const Status status = check_change(settings_, settings); !status) return status;
  RunPartsOptions options;
  options.before = &settings_;
  if (settings_.num_threads > 1) options.query_threads = pool_.get();
  auto parts = make_run_parts(index_, streams_, device_, settings, options);
  if (!parts) return parts.error();
  ++revision_;
  hand_->change(revision_, parts->coupling);
  checked_coupling_ = parts->checked_coupling;
  add_notes(notes_, parts->notes);
  settings_ = settings;
  Pending news{revision_, std::move(parts->timelines), std::move(parts->contact), parts->scale,
               std::vector<CameraFrame>(streams_.size())};
  if (pending_ && news.timelines.empty()) {
    news.timelines = std::move(pending_->timelines);
    news.seen = std::move(pending_->seen);
  }
  if (pending_ && !news.contact) news.contact = std::move(pending_->contact);
  pending_ = std::move(news);
  if (pending_->timelines.empty()) use(*pending_);
  return Done{};
}

void Pipeline::use(Pending& pending) {
  if (!pending.timelines.empty()) {
    timelines_ = std::move(pending.timelines);
    seen_ = std::move(pending.seen);
  }
  if (pending.contact) {
    pending.contact->take_over(*contacts_);
    contacts_ = std::move(pending.contact);
  }
  contacts_->use(pending.scale);
  surface_revision_ = frame_revision_ = pending.revision;
  pending_.reset();
}

Status Pipeline::status() const {
  for (const SurfaceTimeline& timeline : timelines_) {
    if (!timeline.status()) return timeline.status();
  }
  if (!has_backend_failed_) return Done{};
  return lost_backend();
}

}}  // namespace palpate::v0
