// The contact side of a run, from a pose to a contact: the tool against surfaces and objects, the
// patch at which friction acts, and the motion of objects that the tool pushes.
//
// A measurement takes objects where the one before has left them, then moves them by the forces
// that it has found. A contact thus depends on surfaces and earlier contacts alone and can be
// repeated to the bit.
#include <algorithm>
#include <utility>

#include "src/core/internal/assert.h"
#include "src/haptics/internal/surface_motion.h"
#include "src/math/internal/rotation_vector.h"
#include "src/run/internal/pipeline.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kToolBody = 0;
/// Longest time step of moving objects, s.
constexpr double kLongestStep = 0.02;

}  // namespace

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

Status ContactPart::measure_at(const Place& place) {
  is_on_cpu_ = place.backend == Backend::cpu;
  if (is_on_cpu_) return Done{};
  return world_.measure_pairs_by([&](const auto& a, const auto& b) {
    return make_body_pair_query(place, a, b, {.method = bodies_});
  });
}

void ContactPart::measure(std::span<const SurfaceBlend> cameras, bool with_stiffness,
                          ContactRecord& record) noexcept {
  if (moving_) place_bodies(record);
  world_.set_pose(kToolBody, record.X_WT);
  // A camera by itself tells the unseen volume by a launch of its own on a GPU: too much for a
  // tick.
  world_.set_wants(kToolBody, {.stiffness = with_stiffness,
                               .noise = scale_.wants_noise,
                               .unseen_volume = is_on_cpu_ || cameras.size() > 1});
  world_.measure(cameras);
  const BodyMeasure& measured = world_.measured(kToolBody);
  record.penetration = measured.total();
  record.objects = measured.bodies;
  record.noise = measured.noise;
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

}}  // namespace palpate::v0
