#include "src/bodies/internal/body_solver.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/bodies/touch_matrices.h"

namespace palpate { inline namespace v0 {
namespace {

/// Damping ratio of the stiffest direction of a contact: falling bodies do not bounce.
constexpr double kContactDampingRatio = 0.7;
/// Stretch of a sticking patch that holds the weight of the lighter body.
constexpr double kStretch = 2e-5;  // m
constexpr double kGravity = 9.81;

/// Largest speed at which deep contacts, as of a hand that enters a body between two frames, part.
constexpr double kFastestOut = 1;  // m/s

constexpr int kMaxTries = 4;  // each without the contacts that would pull

}  // namespace

BodySolver::BodySolver(int max_bodies, std::span<const double> mass_of_place)
    : islands_(static_cast<std::size_t>(max_bodies)),
      rows_(static_cast<std::size_t>(max_bodies)),
      system_(max_bodies),
      work_(mass_of_place.size()),
      velocities_(static_cast<std::size_t>(max_bodies)),
      motions_(3 * mass_of_place.size() * static_cast<std::size_t>(max_bodies)) {
  CouplingOptions options;  // coefficients come with each contact
  for (const double mass : mass_of_place) {
    places_.push_back({PatchFriction(options, 0, 0), mass, 0, {}});
    places_.back().use(mass * kGravity / kStretch);
  }
  touches_.reserve(mass_of_place.size());
}

Vec6 BodySolver::motion(const BodyTouch& touch, const Work& work,
                        std::span<const Vec6> velocities) const {
  Vec6 moves{-touch.V_W.linear, -touch.V_W.angular};
  if (touch.b != BodyTouch::kNoBody) moves = {};
  if (const int a = row(touch.a); a >= 0) moves = moves + velocities[static_cast<std::size_t>(a)];
  if (const int b = row(touch.b); b >= 0) {
    const Vec6& v = velocities[static_cast<std::size_t>(b)];
    moves = moves - Vec6{v.linear + cross(v.angular, work.d), v.angular};
  }
  return moves;
}

void BodySolver::prepare(std::span<const RigidBody> bodies, std::span<const BodyTouch> touches,
                         double dt) {
  for (std::size_t i = 0; i < touches.size(); ++i) {
    const BodyTouch& touch = touches[i];
    const RigidBody& a = bodies[static_cast<std::size_t>(touch.a)];
    Work& work = work_[i];
    work.stiffness = positive_part(touch.stiffness.m, radius_of_gyration(a));
    double mass = row(touch.a) >= 0 ? a.mass : 0;
    if (touch.b != BodyTouch::kNoBody) {
      const RigidBody& b = bodies[static_cast<std::size_t>(touch.b)];
      work.d = a.center_W() - b.center_W();
      if (mass == 0 || row(touch.b) < 0) {
        mass = std::max(mass, row(touch.b) >= 0 ? b.mass : 0.0);
      } else {
        mass = mass * b.mass / (mass + b.mass);
      }
    }
    const double k = largest(work.stiffness.m);
    work.resistance = dt + (k > 0 ? 2 * kContactDampingRatio * std::sqrt(mass / k) : 0);
    const double force = norm(touch.F_A_W.force), most = kFastestOut * work.resistance * k;
    const double share = k > 0 && force > most ? most / force : 1;
    work.wrench = {touch.F_A_W.force * share, touch.F_A_W.torque * share};
    const bool is_usable =
        is_finite(touch.F_A_W) && std::isfinite(k) && (row(touch.a) >= 0 || row(touch.b) >= 0);
    work.is_pushing = is_usable && norm(touch.F_A_W.force) > 0;
  }
}

bool BodySolver::solve_pushes(std::span<const RigidBody> bodies, std::span<const BodyTouch> touches,
                              const Forces& forces, double dt) {
  system_.begin(num_rows_);
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const RigidBody& body = bodies[i];
    const int r = rows_[i];
    if (r < 0) continue;
    const Mat6 mass = mass_matrix(body);
    Vec6& v = velocities_[static_cast<std::size_t>(r)];
    v = mass * Vec6{body.V_W.linear, body.V_W.angular} +
        Vec6{dt * body.mass * forces.gravity_W, {}};
    system_.at(r, r) = sum({}, 1 + dt * forces.damping, mass);
  }
  for (std::size_t i = 0; i < touches.size(); ++i) {
    const BodyTouch& touch = touches[i];
    const Work& work = work_[i];
    if (!work.is_pushing) continue;
    const int a = row(touch.a), b = row(touch.b);
    const double r = work.resistance;
    Vec6 impulse = dt * to_vec6(work.wrench);
    if (touch.b == BodyTouch::kNoBody) {
      impulse = impulse + (dt * r) * (work.stiffness * Vec6{touch.V_W.linear, touch.V_W.angular});
    }
    if (a >= 0) {
      Vec6& of_a = velocities_[static_cast<std::size_t>(a)];
      of_a = of_a + impulse;
      add(system_.at(a, a), dt * r, work.stiffness);
    }
    if (b < 0) continue;
    Vec6& of_b = velocities_[static_cast<std::size_t>(b)];
    of_b = of_b + at_other(impulse, work.d);
    const Mat6 t = transport(work.d), kt = product(work.stiffness, t);
    add(system_.at(b, b), dt * r, product(transposed(t), kt));
    if (a < 0) continue;
    if (a > b) {
      add(system_.at(a, b), -dt * r, kt);
    } else {
      add(system_.at(b, a), -dt * r, transposed(kt));
    }
  }
  if (!system_.factor()) return false;
  system_.solve(velocities_);
  return true;
}

/// Drops contacts that would pull at the end of the step. True if there was any.
bool BodySolver::drop_pulls(std::span<const BodyTouch> touches) {
  bool has_any = false;
  for (std::size_t i = 0; i < touches.size(); ++i) {
    Work& work = work_[i];
    if (!work.is_pushing) continue;
    const Vec6 resisted = work.stiffness * motion(touches[i], work, velocities_);
    const Vec3d& force = work.wrench.force;
    if (dot(force - work.resistance * resisted.linear, force) > 0) continue;
    work.is_pushing = false;
    has_any = true;
  }
  return has_any;
}

/// Balances the energy of each contact: bodies pay the part that their work has not covered from
/// their approach speed. The last step knew only the contacts and stiffnesses at its beginning.
void BodySolver::collect(std::span<RigidBody> bodies, std::span<const BodyTouch> touches) noexcept {
  for (Place& place : places_) place.paid += std::exchange(place.potential, 0);
  for (const BodyTouch& touch : touches) {
    Place& place = places_[static_cast<std::size_t>(touch.place)];
    if (touch.potential == BodyTouch::kUnknown) continue;
    const double owed = touch.potential - place.paid;
    place.potential = touch.potential;
    if (!(owed > 0) || !is_finite(touch.F_A_W)) continue;
    RigidBody* of[2] = {&bodies[static_cast<std::size_t>(touch.a)], nullptr};
    Wrench on[2] = {touch.F_A_W, {}};
    if (touch.b != BodyTouch::kNoBody) {
      of[1] = &bodies[static_cast<std::size_t>(touch.b)];
      const Vec6 opposite = at_other(to_vec6(on[0]), of[0]->center_W() - of[1]->center_W());
      on[1] = {opposite.linear, opposite.angular};
    }
    // Work of an impulse of `share` seconds: share * power + share^2 * moved / 2.
    double power = 0, moved = 0;
    Twist change[2];
    for (int i = 0; i < 2; ++i) {
      if (of[i] == nullptr || of[i]->is_asleep) continue;
      change[i] = changed_by(*of[i], on[i]);
      power += dot(on[i].force, of[i]->V_W.linear) + dot(on[i].torque, of[i]->V_W.angular);
      moved += dot(on[i].force, change[i].linear) + dot(on[i].torque, change[i].angular);
    }
    if (!(power < 0) || !(moved > 0)) continue;
    const double left = power * power - 2 * owed * moved;
    const double share = (-power - (left > 0 ? std::sqrt(left) : 0)) / moved;
    for (int i = 0; i < 2; ++i) {
      if (of[i] == nullptr || of[i]->is_asleep) continue;
      of[i]->V_W.linear += share * change[i].linear;
      of[i]->V_W.angular += share * change[i].angular;
    }
  }
  for (Place& place : places_) place.paid = 0;
}

/// Joins awake bodies that touch each other; a sleeping one joins no island.
void BodySolver::find_islands(std::span<const RigidBody> bodies,
                              std::span<const BodyTouch> touches) {
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    islands_[i] = bodies[i].is_asleep ? -1 : static_cast<int>(i);
  }
  for (const BodyTouch& touch : touches) {
    if (touch.b == BodyTouch::kNoBody) continue;
    const int a = islands_[static_cast<std::size_t>(touch.a)],
              b = islands_[static_cast<std::size_t>(touch.b)];
    if (a < 0 || b < 0) continue;
    std::replace(islands_.begin(), islands_.end(), std::max(a, b), std::min(a, b));
  }
}

void BodySolver::step(std::span<RigidBody> bodies, std::span<const BodyTouch> touches,
                      const Forces& forces, double dt) noexcept {
  for (Place& place : places_) place.was_held = std::exchange(place.is_held, false);
  forget_given();
  find_islands(bodies, touches);
  for (int first = 0; first < static_cast<int>(bodies.size()); ++first) {
    if (islands_[static_cast<std::size_t>(first)] != first) continue;
    num_rows_ = 0;
    for (std::size_t i = 0; i < bodies.size(); ++i) {
      rows_[i] = islands_[i] == first ? num_rows_++ : -1;
    }
    touches_.clear();
    for (const BodyTouch& touch : touches) {
      if (row(touch.a) >= 0 || row(touch.b) >= 0) touches_.push_back(touch);
    }
    solve_island(bodies, touches_, forces, dt);
  }
  for (Place& place : places_) {
    if (place.is_held || !place.was_held) continue;
    place.friction.reset();
    place.force = {};
  }
}

void BodySolver::solve_island(std::span<RigidBody> bodies, std::span<const BodyTouch> touches,
                              const Forces& forces, double dt) {
  prepare(bodies, touches, dt);
  bool is_solved = solve_pushes(bodies, touches, forces, dt);
  for (int i = 0; is_solved && i < kMaxTries && drop_pulls(touches); ++i) {
    is_solved = solve_pushes(bodies, touches, forces, dt);
  }
  if (is_solved) solve_friction(touches, dt);
  for (std::size_t i = 0; is_solved && i < touches.size(); ++i) {
    const Work& work = work_[i];
    if (!work.is_pushing) continue;
    Place& place = places_[static_cast<std::size_t>(touches[i].place)];
    const Vec6 moves = motion(touches[i], work, velocities_);
    const Vec6 push = to_vec6(work.wrench) - work.resistance * (work.stiffness * moves);
    const auto work_of = [dt](const Vec6& wrench, const Vec6& v) {
      return dt * (dot(wrench.linear, v.linear) + dot(wrench.angular, v.angular));
    };
    if (touches[i].potential != BodyTouch::kUnknown) place.paid = -work_of(push, moves);
    if (touches[i].b != BodyTouch::kNoBody || row(touches[i].a) < 0) continue;
    const Vec6 held = work.is_held ? work.patch.wrench(work.grip.force) : Vec6{};
    const double given =
        work_of(push + held, velocities_[static_cast<std::size_t>(row(touches[i].a))]);
    place.given = std::isfinite(given) ? given : 0;
  }
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    RigidBody& body = bodies[i];
    if (rows_[i] < 0) continue;
    const RigidBody before = body;
    const Vec6& v = velocities_[static_cast<std::size_t>(rows_[i])];
    body.V_W = {v.linear, v.angular};
    // A free body moves at the mean of both velocities, as in free fall.
    const bool is_free = std::none_of(touches.begin(), touches.end(), [i](const BodyTouch& touch) {
      return touch.a == static_cast<int>(i) || touch.b == static_cast<int>(i);
    });
    const Vec3d late = is_free ? forces.gravity_W * (dt / 2) : Vec3d{};
    if (is_solved && is_finite(v)) move(body, dt * (body.V_W.linear - late), dt);
    if (!is_solved || !is_finite(body.X_WB) || !is_finite(v)) {
      body = before;
      body.V_W = {};
    }
  }
}

}}  // namespace palpate::v0
