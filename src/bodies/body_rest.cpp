// Rest and energy of moving bodies: when they wake and fall asleep, and how much of their energy
// the tool has put in and may get back.
//
// Sensor noise shakes every surface, so a body that nothing pushes is put to sleep instead of
// drifting. It wakes when its supporting force changes by more than noise does.
#include <algorithm>
#include <utility>

#include "src/bodies/internal/moving_bodies.h"

namespace palpate { inline namespace v0 {
namespace {

/// Averaging time of the supporting force, s: sensors shake it 30 times a second.
constexpr double kMeanSeconds = 0.25;
/// Wake thresholds: share of the supporting force, penetration (m).
constexpr double kWakeShare = 0.5, kWakeDepth = 1e-3 /* m */;

}  // namespace

/// Wakes sleeping bodies whose supporting force has changed or that a moving body touches.
void MovingBodies::wake(double dt) {
  const double share = dt / (dt + kMeanSeconds);
  for (int i = 0; i < num_bodies(); ++i) {
    Rest& own = rest(i);
    own.mean_W += share * (own.force_W - own.mean_W);
    if (!own.is_asleep || own.is_covered) continue;
    const double weight = std::max(norm(own.mean_asleep_W), moving(i).mass * norm(gravity()));
    const Vec3d now = own.force_W - own.mean_asleep_W, mean = own.mean_W - own.mean_asleep_W;
    const bool has_changed = norm(mean) > kWakeShare * weight ||
                             norm(now) > kWakeDepth * own.stiffness + kWakeShare * weight;
    if (has_changed || own.is_pushed) own.is_asleep = false;
  }
  for (const BodyTouch& touch : touches_) {
    if (touch.b == BodyTouch::kNoBody) continue;
    Rest &a = rest(touch.a), &b = rest(touch.b);
    if (!a.is_asleep && a.seconds < kStillSeconds) b.is_asleep = false;
    if (!b.is_asleep && b.seconds < kStillSeconds) a.is_asleep = false;
  }
  for (int i = 0; i < num_bodies(); ++i) {
    Rest& own = rest(i);
    RigidBody& body = moving(i);
    if (body.is_asleep && !own.is_asleep && !own.is_covered) {
      own.seconds = 0;
      own.X_WB = body.X_WB;
    }
    body.is_asleep = own.is_asleep || own.is_covered;
    if (body.is_asleep) body.V_W = {};
  }
}

int MovingBodies::group_of(int body) {
  while (groups_[static_cast<std::size_t>(body)] != body) {
    body = groups_[static_cast<std::size_t>(body)];
  }
  return body;
}

/// Puts bodies that touch each other to sleep together, once none of them moves.
void MovingBodies::fall_asleep(double dt) {
  for (int i = 0; i < num_bodies(); ++i) {
    Rest& own = rest(i);
    const RigidBody& body = moving(i);
    groups_[static_cast<std::size_t>(i)] = i;
    const Quaternion &p = own.X_WB.rotation, &q = body.X_WB.rotation;
    const double sine = norm(Vec3d{p.w * q.x - q.w * p.x + q.y * p.z - q.z * p.y,
                                   p.w * q.y - q.w * p.y + q.z * p.x - q.x * p.z,
                                   p.w * q.z - q.w * p.z + q.x * p.y - q.y * p.x});
    const bool is_near =
        norm(body.X_WB.translation - own.X_WB.translation) < kStillShift && 2 * sine < kStillTurn;
    if (!is_near) own.X_WB = body.X_WB;
    own.seconds = is_near && own.is_touched && !own.is_pushed ? own.seconds + dt : 0;
  }
  if (!options_.may_sleep) return;
  for (const BodyTouch& touch : touches_) {
    if (touch.b == BodyTouch::kNoBody) continue;
    const int a = group_of(touch.a), b = group_of(touch.b);
    groups_[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
  }
  for (int i = 0; i < num_bodies(); ++i) {
    if (group_of(i) != i) continue;
    bool is_still = true;
    for (int k = i; k < num_bodies(); ++k) {
      is_still =
          is_still && (group_of(k) != i || rest(k).is_asleep || rest(k).seconds >= kStillSeconds);
    }
    for (int k = i; is_still && k < num_bodies(); ++k) {
      if (group_of(k) != i || rest(k).is_asleep) continue;
      rest(k).is_asleep = true;
      rest(k).mean_asleep_W = rest(k).mean_W;
    }
  }
}

/// Returns the energy of a body, J: of motion, height and its contacts.
double MovingBodies::energy_of(int body) const {
  const RigidBody& own = bodies_[static_cast<std::size_t>(body)];
  return kinetic_energy(own) - own.mass * dot(gravity(), own.center_W()) +
         rests_[static_cast<std::size_t>(body)].pressed;
}

void MovingBodies::add_energy() {
  energy_ = solver_->friction_energy();
  for (int i = 0; i < num_bodies(); ++i) {
    Rest& own = rest(i);
    const double before = std::exchange(own.energy, energy_of(i));
    own.growth = std::max(own.energy - before, 0.0);
    own.min_energy = std::min(own.min_energy, own.energy);
    energy_ += own.energy;
  }
}

/// Updates the stored energy from the work of the tool on each island: positive work is stored in
/// the bodies whose energy has grown, negative work is taken from all in proportion. Losses to
/// friction and damping lower it, too.
void MovingBodies::add_stored() {
  for (int first = 0; first < num_bodies(); ++first) {
    double given = 0, growth = 0, stored = 0;
    for (int i = first; i < num_bodies(); ++i) {
      if (solver_->island(i) != first) continue;
      given += solver_->given(num_bodies() + i);
      growth += rest(i).growth;
      stored += rest(i).stored;
    }
    for (int i = first; i < num_bodies() && given != 0; ++i) {
      if (solver_->island(i) != first) continue;
      Rest& own = rest(i);
      own.stored += given > 0 ? own.growth * std::min(given / std::max(growth, given), 1.0)
                              : std::max(given, -stored) * (stored > 0 ? own.stored / stored : 0);
    }
  }
  for (Rest& own : rests_) {
    own.stored = std::clamp(own.stored, 0.0, own.energy - own.min_energy);
  }
}

/// Restarts the account of stored energy: at the beginning, and under another gravity.
void MovingBodies::forget_stored() {
  add_energy();
  for (Rest& own : rests_) {
    own.min_energy = own.energy;
    own.stored = 0;
  }
  solver_->forget_given();
}

double MovingBodies::stored() const {
  double sum = 0;
  for (const Rest& own : rests_) sum += own.stored;
  return sum;
}

}}  // namespace palpate::v0
