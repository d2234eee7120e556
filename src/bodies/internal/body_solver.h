// One step in time of rigid bodies that touch each other and their surroundings.
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

namespace palpate { inline namespace v0 {

/// A contact of two bodies, or of one with its surroundings, at the beginning of a step.
struct BodyTouch {
  static constexpr int kNoBody = -1;
  static constexpr double kUnknown = -1;

  int a = 0;
  int b = kNoBody;      ///< kNoBody: the surroundings, which forces do not move
  Wrench F_A_W;         ///< on a, about its center of mass; the opposite acts on b
  Stiffness stiffness;  ///< N/m, N, N m: how F_A_W changes with the pose of a while b stays
  ContactPatch patch;   ///< levers are from a's center of mass
  double friction = 0;  ///< coefficient
  double grip = 0;      ///< N/m: stiffness of sticking; 0: from the weight of the lighter body
  /// J: energy stored in the contact. Set only if its source matters.
  double potential = kUnknown;
  /// Velocity of the surroundings, at their point that lies at a's center of mass.
  Twist V_W;
  /// Index of the contact's friction state: the same as long as the same two touch.
  int place = 0;
};

class BodySolver {
 public:
  /// `mass_of_place`: mass of the lighter body, for each place, kg. All memory is allocated here.
  BodySolver(int max_bodies, std::span<const double> mass_of_place);

  struct Forces {
    Vec3d gravity_W;     ///< m/s2
    double damping = 0;  ///< 1/s: of all motion
  };
  /// Call before a step, with its touches: takes the energy that contacts store beyond the work of
  /// their bodies from the approach speed of these.
  void collect(std::span<RigidBody> bodies, std::span<const BodyTouch> touches) noexcept;
  /// Moves the bodies on by `dt`, s. Several touches never have one place. No allocation; the same
  /// input gives the same bits. Bodies that touch each other are solved together, and apart from
  /// all others. Those that cannot be solved stop where they are.
  void step(std::span<RigidBody> bodies, std::span<const BodyTouch> touches, const Forces& forces,
            double dt) noexcept;

  /// Returns the island of a body in the last step, the same for bodies that touched; -1: asleep.
  int island(int body) const { return islands_[static_cast<std::size_t>(body)]; }
  /// Returns the work of a place on its body a in the last step, J; 0 if it has a body b.
  double given(int place) const { return places_[static_cast<std::size_t>(place)].given; }
  void forget_given() noexcept {
    for (Place& place : places_) place.given = 0;
  }
  /// Returns the energy stored in sticking contacts, J.
  double friction_energy() const noexcept;

  /// Copies the state of another solver with the same places.
  void take_over(const BodySolver& other) {
    places_ = other.places_;
    islands_ = other.islands_;
  }

 private:
  struct Place {
    PatchFriction friction;
    double mass, stiffness;
    void use(double new_stiffness);
    Vec3d force;                     // friction of the last step, first guess of the next one
    double potential = 0, paid = 0;  // J: at the last step, and work of the bodies on it since
    double given = 0;                // J: work on body a
    bool is_held = false, was_held = false;
  };
  struct Work {
    Mat6 stiffness;  // of the contact, without negative eigenvalues
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
  /// Returns the velocity of a relative to b, at a's center of mass.
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
  std::vector<int> islands_;        // of each body: first body of its island; -1: asleep
  std::vector<BodyTouch> touches_;  // of one island
  std::vector<int> rows_;           // of each body; -1: asleep, or of another island
  int num_rows_ = 0;
  SymmetricBlocks system_;
  std::vector<Work> work_;        // of each touch
  std::vector<Vec6> velocities_;  // of each row
  std::vector<Vec6> motions_;     // of each row, per friction of each touch in three directions
};

}}  // namespace palpate::v0
