// One step in time of rigid bodies that touch each other and what stands around them.
//
// Backward Euler, linearized about the state before the step, for all bodies at once:
//
//   (M + dt (dt + t_c) J^T K J) v = M v_0 + dt (M g + J^T F)
//
// F, K, t_c: wrench, stiffness and damping time of each contact, J: how the bodies move it.
// Friction is that of decision 27: each contact is a patch that sticks by a spring and gives way at
// mu N, and the forces of all patches are found together for the v that results.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/haptics/local_contact.h"
#include "src/bodies/internal/rigid_body.h"
#include "src/bodies/symmetric_blocks.h"
#include "src/haptics/internal/friction.h"

namespace palpate::inline v0 {

/// What touches what, at the beginning of a step.
struct BodyTouch {
  static constexpr int kNoBody = -1;
  static constexpr double kUnknown = -1;

  int a = 0;
  int b = kNoBody;      ///< kNoBody: what forces do not move
  Wrench F_A_W;         ///< on a, about its center of mass; the opposite acts on b
  Stiffness stiffness;  ///< N/m, N, N m: how F_A_W changes with the pose of a while b stays
  ContactPatch patch;   ///< levers are from a's center of mass
  double friction = 0;  ///< coefficient
  double grip = 0;      ///< N/m: how stiff what sticks is; 0: by the weight of the lighter one
  /// J: what the contact holds. Set only if its source matters.
  double potential = kUnknown;
  /// How kNoBody moves: of the point of it that lies at a's center of mass.
  Twist V_W;
  /// Where what sticks is remembered: the same one as long as it is the same two that touch.
  int place = 0;
};

class BodySolver {
 public:
  /// The lighter one of what touches, for each place, kg. All memory is allocated here.
  BodySolver(int max_bodies, std::span<const double> mass_of_place);

  struct Forces {
    Vec3d gravity_W;     ///< m/s2
    double damping = 0;  ///< 1/s: of all motion
  };
  /// Before a step, of what touches now: what contacts hold beyond what bodies have put into them
  /// is taken from how fast these come together.
  void collect(std::span<RigidBody> bodies, std::span<const BodyTouch> touches) noexcept;
  /// Places and velocities after `dt`. Several touches never have one place. No allocation; the
  /// same input gives the same bits. Bodies that touch each other are solved together, and apart
  /// from all others. Those that cannot be solved stop where they are.
  void step(std::span<RigidBody> bodies, std::span<const BodyTouch> touches, const Forces& forces,
            double dt) noexcept;

  /// Of the last step: bodies that touched have the same; -1: asleep.
  int island(int body) const { return islands_[static_cast<std::size_t>(body)]; }
  /// J, that a place has put into its body a in the last step, where nobody is on the other side.
  double given(int place) const { return places_[static_cast<std::size_t>(place)].given; }
  void forget_given() noexcept {
    for (Place& place : places_) place.given = 0;
  }
  /// J, in what sticks.
  double friction_energy() const noexcept;

  /// Nothing has touched yet.
  void reset() noexcept;
  /// Of another one with the same places.
  void take_over(const BodySolver& other) {
    places_ = other.places_;
    islands_ = other.islands_;
  }

 private:
  struct Place {
    PatchFriction friction;
    double mass, stiffness;
    void use(double new_stiffness);
    Vec3d force;                     // of the last step, where the next one looks first
    double potential = 0, paid = 0;  // J: at the last step, and what bodies put into it since
    double given = 0;                // J
    bool is_held = false, was_held = false;
  };
  struct Work {
    Mat6 stiffness;  // of the contact, without what would drive
    Wrench wrench;   // on a
    Vec3d d;         // from b's center of mass to a's
    double resistance = 0;
    bool is_pushing = true;
    // Friction.
    bool is_held = false;
    TouchedPatch patch;
    Mat3s compliance;
    PatchFriction::Grip grip;
  };

  void find_islands(std::span<const RigidBody> bodies, std::span<const BodyTouch> touches);
  void solve_island(std::span<RigidBody> bodies, std::span<const BodyTouch> touches,
                    const Forces& forces, double dt);
  void prepare(std::span<const RigidBody> bodies, std::span<const BodyTouch> touches, double dt);
  bool solve_pushes(std::span<const RigidBody> bodies, std::span<const BodyTouch> touches,
                    const Forces& forces, double dt);
  bool drop_pulls(std::span<const BodyTouch> touches);
  void solve_friction(std::span<const BodyTouch> touches, double dt);
  void find_patches(std::span<const BodyTouch> touches, double dt);
  /// How a contact moves, as a's center of mass would if b stood still.
  Vec6 motion(const BodyTouch& touch, const Work& work, std::span<const Vec6> velocities) const;
  int row(int body) const {
    return body == BodyTouch::kNoBody ? -1 : rows_[static_cast<std::size_t>(body)];
  }
  std::span<Vec6> motions(std::size_t touch, int direction) {
    return std::span(motions_).subspan(
        (3 * touch + static_cast<std::size_t>(direction)) * static_cast<std::size_t>(num_rows_),
        static_cast<std::size_t>(num_rows_));
  }

  std::vector<Place> places_;
  std::vector<int> islands_;        // of each body: the first one of it; -1: asleep
  std::vector<BodyTouch> touches_;  // of one island
  std::vector<int> rows_;           // of each body; -1: asleep, or of another island
  int num_rows_ = 0;
  SymmetricBlocks system_;
  std::vector<Work> work_;        // of each touch
  std::vector<Vec6> velocities_;  // of each row
  std::vector<Vec6> motions_;     // by friction of each touch, in three directions, of each row
};

}  // namespace palpate::inline v0
