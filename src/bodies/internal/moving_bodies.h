// Objects that move in the world of the depth cameras: their contacts and motion.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/body_contact.h"
#include "src/bodies/internal/body_solver.h"

namespace palpate { inline namespace v0 {

/// Friction of an object of a run; none: the default. Between objects the coefficient alone counts.
struct ObjectFriction {
  std::optional<double> coefficient, static_ratio = std::nullopt, viscous = std::nullopt;
};
using ObjectFrictions = std::vector<ObjectFriction>;
inline ObjectFrictions frictions_of(const std::vector<SceneObject>& objects) {
  ObjectFrictions frictions;
  for (const SceneObject& o : objects) {
    frictions.push_back({o.friction, o.static_ratio, o.viscous});
  }
  return frictions;
}

/// Simulates bodies that touch the surfaces that cameras see, each other, fixed objects, and the
/// tool. All memory is allocated at construction; the same input gives the same bits.
class MovingBodies {
 public:
  /// Takes all objects of a run. Errors: options out of range, the backend, more than
  /// kMaxMovingBodies moving objects, a mass out of range.
  static Result<std::unique_ptr<MovingBodies>> create(const std::vector<SceneObject>& objects,
                                                      const BodyOptions& options,
                                                      const Place& place, ThreadPool* threads);

  int num_bodies() const { return static_cast<int>(bodies_.size()); }
  std::span<const RigidBody> bodies() const { return bodies_; }
  /// Returns the index of a body among the objects.
  std::size_t object(int body) const { return shown(body).object; }
  /// Returns the shape that queries read: the first spheres of the object.
  const Tool& shape(int body) const { return *shown(body).shape; }

  /// Contact of the tool with a body, about the body's reference of torques.
  struct Push {
    Wrench F_B_W;
    Stiffness stiffness;  ///< N/m, N, N m
    ContactPatch patch;
    double friction = 0;
    double grip = 0;  ///< N/m: see BodyTouch
    Twist V_W;        ///< of the tool's point at that reference
  };
  /// Moves the bodies on by `dt`, s. `pushes` has one for each body. Without surfaces nothing
  /// moves. False: the backend has failed.
  bool step(std::span<const SurfaceBlend> cameras, std::span<const Push> pushes,
            double dt) noexcept;

  /// Sets options from the next step on; `frictions` are those of all objects of the run. The
  /// number of spheres stays. A body whose own friction changes wakes up; other changes wake all.
  void use(const BodyOptions& options, const ObjectFrictions& frictions) noexcept;
  /// Continues from the state of another simulation of the same objects.
  void take_over(const MovingBodies& other) noexcept;

  /// Returns the energy at the beginning of the last step, J: of motion, height and contacts.
  double energy() const { return energy_; }
  /// Returns the part of it that the tool has put in and may get back, J. At most its work, as far
  /// as that has raised the energy of the bodies, and what each still has above its minimum.
  double stored() const;
  /// Returns the contacts of the last step, for tests.
  std::span<const BodyTouch> touches() const { return touches_; }

 private:
  struct Body {
    std::size_t object = 0;
    std::shared_ptr<const Tool> shape;
    std::shared_ptr<const ToolIndex> index;
    std::unique_ptr<ContactQuery> cloud;
    double reach = 0;                // from the center of mass, m
    double volume = 0;               // of all its spheres, m3
    double friction = 0, scale = 0;  // coefficient; N/m3: from the options
  };
  /// An object that does not move.
  struct Fixture {
    std::size_t object = 0;
    std::shared_ptr<const Tool> shape;
    std::shared_ptr<const ToolIndex> index;
    Pose X_WB;
    Vec3d center_W;
    double reach = 0, friction = 0;
  };
  struct Pair {
    int a = 0, b = 0;         // bodies; b: or a fixture
    bool is_fixture = false;  // b is one
    std::unique_ptr<BodyPairQuery> query;
    bool is_near = false;
  };
  // A body is still once it has stayed within this shift and this rotation for this time, s.
  static constexpr double kStillSeconds = 0.5, kStillShift = 1e-3 /* m */,
                          kStillTurn = 0.03 /* rad */;
  /// Rest and energy of a body.
  struct Rest {
    Pose X_WB;                // near which it has stayed
    double seconds = 0;       // for this time
    Vec3d mean_W;             // supporting force, averaged over about a quarter of a second, N
    Vec3d mean_asleep_W;      // the same when it fell asleep
    Vec3d force_W;            // supporting force of this step
    double stiffness = 0;     // of this step, N/m
    bool is_touched = false;  // by anything
    bool is_pushed = false;   // by the tool, or lies on a moving surface
    bool is_asleep = false;
    bool is_covered = false;  // by something between it and a camera
    double pressed = 0;       // contact energy of this step, J: half where two bodies touch
    double energy = 0;        // at the last step, J
    double min_energy = 0;    // minimum of it so far, J
    double growth = 0;        // since the step before, J, if positive
    double stored = 0;        // part of its energy from the tool, J
  };

  MovingBodies(const BodyOptions& options) : options_(options) {}
  Status add(const std::vector<SceneObject>& objects, const Place& place, ThreadPool* threads);
  Status add_pairs(const Place& place);
  bool touch_clouds(std::span<const SurfaceBlend> cameras);
  void touch_pairs();
  void touch_tool(std::span<const Push> pushes);
  void use_materials(const ObjectFrictions& frictions);
  void add_touch(const BodyTouch& touch);
  void wake(double dt);
  double energy_of(int body) const;
  void add_energy();
  void add_stored();
  void forget_stored();
  void fall_asleep(double dt);
  int group_of(int body);

  const Body& shown(int body) const { return shapes_[static_cast<std::size_t>(body)]; }
  RigidBody& moving(int body) { return bodies_[static_cast<std::size_t>(body)]; }
  Rest& rest(int body) { return rests_[static_cast<std::size_t>(body)]; }
  Vec3d gravity() const { return {options_.gravity_x, options_.gravity_y, options_.gravity_z}; }

  BodyOptions options_;
  std::vector<Body> shapes_;
  std::vector<Fixture> fixtures_;
  std::vector<Pair> pairs_;
  std::vector<RigidBody> bodies_;
  std::vector<Rest> rests_;
  std::vector<int> groups_;  // disjoint sets of touching bodies: parent, or itself
  std::vector<BodyTouch> touches_;
  double energy_ = 0;  // J
  std::unique_ptr<BodySolver> solver_;
};

}}  // namespace palpate::v0
