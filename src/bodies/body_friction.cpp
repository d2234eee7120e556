// Friction of touching bodies: each contact is a patch that sticks by a spring and gives way at
// mu N.
//
// The normal forces are known by then, and so is how far each patch's force would move all bodies.
// The patches are solved one after the other until no force changes any more.
#include <algorithm>
#include <cmath>

#include "src/bodies/internal/body_solver.h"
#include "src/bodies/touch_matrices.h"

namespace palpate { inline namespace v0 {
namespace {

/// Sweeps over all patches: at most so many, where about ten are enough.
constexpr int kMaxSweeps = 100;
/// Change of a force at which the sweeps end, as a share of the largest limit of a patch.
constexpr double kClose = 1e-9;

}  // namespace

void BodySolver::Place::use(double new_stiffness) {
  stiffness = new_stiffness;
  friction.use(stiffness, 2 * std::sqrt(mass / stiffness));
}

double BodySolver::friction_energy() const noexcept {
  double energy = 0;
  for (const Place& place : places_) {
    const FrictionState& state = place.friction.state();
    energy +=
        0.5 * place.stiffness *
        (dot(state.bristle_W, state.bristle_W) + state.bristle_rotation * state.bristle_rotation);
  }
  return energy;
}

/// Computes the patches, and the motions of the bodies by forces in their directions.
void BodySolver::find_patches(std::span<const BodyTouch> touches, double dt) {
  for (std::size_t i = 0; i < touches.size(); ++i) {
    const BodyTouch& touch = touches[i];
    Work& work = work_[i];
    Place& place = places_[static_cast<std::size_t>(touch.place)];
    work.is_held = false;
    if (!work.is_pushing || !(touch.friction > 0)) continue;
    if (touch.grip > 0 && touch.grip != place.stiffness) place.use(touch.grip);
    LocalContact contact;
    contact.patch = touch.patch;
    contact.patch.share = 0;
    contact.patch.own_friction = touch.friction;
    work.is_held = place.friction.touch(contact, work.wrench, dt, work.patch);
    if (!work.is_held) continue;
    place.is_held = true;
    const int a = row(touch.a), b = row(touch.b);
    for (int k = 0; k < 3; ++k) {
      const std::span<Vec6> moved = motions(i, k);
      std::fill(moved.begin(), moved.end(), Vec6{});
      if (a >= 0) moved[static_cast<std::size_t>(a)] = work.patch.slides[k];
      if (b >= 0) moved[static_cast<std::size_t>(b)] = at_other(work.patch.slides[k], work.d);
      system_.solve(moved, a < 0 ? b : (b < 0 ? a : std::min(a, b)));
    }
    Vec3d columns[3];
    for (int k = 0; k < 3; ++k) {
      Vec6 moves = motion(touch, work, motions(i, k));
      if (touch.b == BodyTouch::kNoBody) {
        moves = moves + Vec6{touch.V_W.linear, touch.V_W.angular};  // of forces alone
      }
      columns[k] = dt * dt * work.patch.slid_by(moves);
    }
    work.compliance = {columns[0].x, columns[1].x, columns[2].x,
                       columns[1].y, columns[2].y, columns[2].z};
    work.grip.force = place.force;
  }
}

void BodySolver::solve_friction(std::span<const BodyTouch> touches, double dt) {
  find_patches(touches, dt);
  double limit = 0;
  const auto push = [&](std::size_t i, const Vec3d& force) {
    for (int k = 0; k < 3; ++k) {
      const std::span<const Vec6> moved = motions(i, k);
      const double by = dt * force[k];
      for (std::size_t r = 0; r < moved.size(); ++r) {
        velocities_[r] = velocities_[r] + by * moved[r];
      }
    }
  };
  for (std::size_t i = 0; i < touches.size(); ++i) {
    if (!work_[i].is_held) continue;
    limit = std::max(limit, work_[i].patch.limit);
    push(i, work_[i].grip.force);
  }
  // Each patch in turn, the others' forces as they are: the sum of all energies falls, so it ends.
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    double change = 0;
    for (std::size_t i = 0; i < touches.size(); ++i) {
      Work& work = work_[i];
      if (!work.is_held) continue;
      const Vec3d before = work.grip.force;
      const Mat3s& w = work.compliance;
      const Vec3d own{w.xx * before.x + w.xy * before.y + w.xz * before.z,
                      w.xy * before.x + w.yy * before.y + w.yz * before.z,
                      w.xz * before.x + w.yz * before.y + w.zz * before.z};
      const Vec3d slid = dt * work.patch.slid_by(motion(touches[i], work, velocities_)) - own;
      work.grip = places_[static_cast<std::size_t>(touches[i].place)].friction.hold(work.patch,
                                                                                    slid, w, dt);
      push(i, work.grip.force - before);
      change = std::max(change, norm(work.grip.force - before));
    }
    if (!(change > kClose * limit)) break;
  }
  for (std::size_t i = 0; i < touches.size(); ++i) {
    if (!work_[i].is_held) continue;
    Place& place = places_[static_cast<std::size_t>(touches[i].place)];
    place.friction.keep(work_[i].patch, work_[i].grip, dt);
    place.force = work_[i].grip.force;
  }
}

}}  // namespace palpate::v0
