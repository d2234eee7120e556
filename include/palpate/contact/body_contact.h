// Rigid objects beside what the camera sees, and how they are felt.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/math/geometry.h"
#include "palpate/settings/setting_table.h"
#include "palpate/tool/tool.h"

namespace palpate::inline v0 {

// Rigid objects beside what the camera sees: some stay where they are, some move.

/// A rigid object that the tool feels beside the cloud; the depth frames need not show it.
struct SceneObject {
  std::shared_ptr<const Tool> shape;
  Pose X_WB;                                      ///< where it stays, or begins
  std::optional<double> friction = std::nullopt;  ///< its own coefficient; none: as everything
  bool moves = false;
  double mass = 0;  ///< kg, of one that moves; 0: as wood has, 500 kg/m3
};

/// kg, of one that moves.
inline double mass_of(const SceneObject& object) {
  return object.mass > 0 ? object.mass : 500 * object.shape->mesh_mass().volume;
}

/// That move, in one run.
inline constexpr int kMostMovingBodies = 32;

/// Objects that move (docs/guide/moving-bodies.md).
struct BodyOptions {
  double gravity_x = 0, gravity_y = 9.81, gravity_z = 0;  ///< m/s2, in W
  double friction = 0.5;  ///< of bodies that have no coefficient of their own
  double damping = 0.2;   ///< 1/s, of all their motion
  double sink = 1e-4;     ///< m: how deep a cube lies in what carries it
  int num_spheres = 1000;
  bool may_sleep = true;
};
inline void add_settings(SettingTable& t, BodyOptions& o) {
  t.section("bodies");
  t.add("gravity_x", o.gravity_x, {-100, 100, "m/s2"},
        "of objects that move: which way and how strongly they fall, in the world");
  t.add("gravity_y", o.gravity_y, {-100, 100, "m/s2"},
        "the same; down in the image, as of a camera that is held level");
  t.add("gravity_z", o.gravity_z, {-100, 100, "m/s2"}, "the same; away from the camera");
  t.add("friction", o.friction, {0, 10},
        "of objects that move, with all but the tool; those with a coefficient of their own have "
        "that");
  t.add("damping", o.damping, {0, 100, "1/s"}, "share of its speed that an object loses by itself");
  t.add("sink", o.sink, {1e-6, 0.01, "m"},
        "how deep a cube at rest lies in what carries it: less is stiffer");
  t.add("spheres", o.num_spheres, {0, 1 << 30, "spheres"},
        "of an object that moves, the first ones, are asked by queries; 0: all");
  t.add("sleep", o.may_sleep, "objects at rest stand still until something changes");
}

// Body against body: how much two rigid bodies share, and the wrench that follows for each.

/// Integral of lens_volume(a, b, s) over s from `distance` to a + b, m4: the potential of two balls
/// whose centres are `distance` apart. Closed form, accurate down to the lightest touch.
double lens_potential(double a, double b, double distance);

/// What two bodies share, and what that does to either of them.
struct BodyPenetration {
  /// For each body as for a tool in a cloud: volume, and the wrench on it about its own centre of
  /// mass, in W. Both volumes are the same, and the wrenches are opposite.
  ///
  /// By the field: U = w_a sum f_s G(phi_B(c_s)) over the spheres of A + w_b (the same of B's in
  /// A's field), w_a + w_b = 1; `potential` is U and the wrenches are minus its derivatives, the
  /// volume is the sum of the caps weighted likewise. The way whose spheres and grid are finer
  /// counts more (equal bodies: 1/2 each), and one that is coarse beside it is not asked: then the
  /// counts of that body stay 0. Boundary and inside spheres are as against a depth field.
  ///
  /// By the spheres: the volume is that of the intersection of the two packings.
  /// `num_boundary_spheres` are spheres that overlap some sphere of the other body; the counts of
  /// inside spheres and points stay 0, and so does the potential.
  Penetration on_a, on_b;
  /// What is close enough to be felt: by the field, spheres of either body that reach into the
  /// other; by the spheres, overlapping pairs of them, which the time grows with.
  std::int64_t num_pairs = 0;
  /// By the field, if it was wanted: how the wrench on A changes with the pose of A while B stays,
  /// and the same of B.
  std::optional<Stiffness> stiffness_a = std::nullopt, stiffness_b = std::nullopt;
  /// With them: where the volume lies, with levers from A's centre of mass and forces on A. Exact
  /// where all forces are parallel.
  VolumeMoments moments_a = {};
};

/// Measures two rigid bodies against each other, somewhere. One thread at a time.
class BodyPairQuery {
 public:
  virtual ~BodyPairQuery() = default;

  /// Begins a measurement: on a GPU, it runs until `finish` is called, which returns the result. No
  /// allocation. With a pose that is not finite, nothing is measured and the body whose pose it is
  /// gets StepStatus::non_finite_pose.
  virtual void start(const Pose& X_WA, const Pose& X_WB, bool wants_stiffness) noexcept = 0;
  virtual BodyPenetration finish() noexcept = 0;

  BodyPenetration measure(const Pose& X_WA, const Pose& X_WB,
                          bool wants_stiffness = false) noexcept {
    start(X_WA, X_WB, wants_stiffness);
    return finish();
  }
};

struct BodyPairOptions {
  BodyMethod method = BodyMethod::field;
  Isa isa = best_isa();  ///< on the CPU, by the field
  int gpu = 0;           ///< which one, for the CUDA backend
};

/// A GPU finds the same, and sums that differ by rounding alone. By the field, bodies without a
/// stored field get one now, which takes about a second for each. Errors: the backend is not in
/// this build or on this machine; no memory left on the GPU.
Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(Backend backend,
                                                            std::shared_ptr<const ToolIndex> a,
                                                            std::shared_ptr<const ToolIndex> b,
                                                            const BodyPairOptions& options = {});
/// The same with indices of its own. Both bodies must outlive it.
Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(Backend backend, const Tool& a,
                                                            const Tool& b,
                                                            const BodyPairOptions& options = {});
Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(Backend, const Tool&&, const Tool&,
                                                            const BodyPairOptions& = {}) = delete;
Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(Backend, const Tool&, const Tool&&,
                                                            const BodyPairOptions& = {}) = delete;
Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(Backend, const Tool&&, const Tool&&,
                                                            const BodyPairOptions& = {}) = delete;

/// BodyMethod::spheres on the CPU. Every pair of overlapping spheres adds
/// the exact volume V of its lens, and pushes with the force V m, m being the unit vector from the
/// centre of B's sphere to that of A's: volume times direction, as everywhere.
///
/// The force of a pair depends on the distance of two centres alone, along the line between them.
/// So it is the exact gradient of a potential, the sum of `lens_potential` over all pairs (volume
/// integrated over depth, as for planes): closed paths do no work. Both bodies feel opposite forces
/// along one line, so that momentum is kept. Where one sphere lies within the other, V is the whole
/// smaller ball, and the force still points along the line of centres. Coincident centres have no
/// such line: the pair adds its volume and no force.
///
/// Only the spheres themselves count, not the parts of the solids that they represent. Computed in
/// double on the stored numbers, in a fixed order: the same input gives the same bits. No pair is
/// left out, whatever it takes. One thread at a time.
class BodyContact final : public BodyPairQuery {
 public:
  /// Both bodies must outlive it. All memory is allocated here.
  BodyContact(const Tool& a, const Tool& b);
  BodyContact(const Tool&&, const Tool&) = delete;
  BodyContact(const Tool&, const Tool&&) = delete;
  BodyContact(const Tool&&, const Tool&&) = delete;

  void start(const Pose& X_WA, const Pose& X_WB, bool wants_stiffness = false) noexcept override;
  BodyPenetration finish() noexcept override;

  /// The potential whose gradient the wrenches are, m4. Takes about twice the time of `measure`.
  double potential(const Pose& X_WA, const Pose& X_WB) const noexcept;

 private:
  const Tool* a_;
  const Tool* b_;
  Pose X_WA_, X_WB_;
  std::vector<std::uint8_t> touched_a_, touched_b_;  // one per sphere, of this measurement
};

// Many poses of one tool against bodies that stay, in one call.

/// A body of a batch, and where it stays.
struct PlacedBody {
  std::shared_ptr<const ToolIndex> shape;
  Pose X_WB = {};
};

/// Measures batches against bodies, as BatchQuery does against surfaces. One thread at a time.
class BodyBatchQuery {
 public:
  virtual ~BodyBatchQuery() = default;

  /// Each pose of the tool against one body: `body_of_pose` has P numbers of them, or is empty if
  /// there is one body or each pose has its own. A number that no body has gives
  /// StepStatus::no_surface. A pose is answered what BodyPairQuery::measure answers on the tool, to
  /// the bit, whatever else is in the batch: with body b BodyPenetration::on_a and stiffness_a at
  /// X_WA = X_WT and X_WB. Errors: sizes that do not fit; answers in the memory of a GPU.
  virtual Status measure(std::span<const Pose> X_WT, std::span<const std::int32_t> body_of_pose,
                         const BatchAnswers& answers) const = 0;
};

/// On a CPU, by the threads of `pool` (null: the caller's alone). The indices share what is known
/// of a shape between all its places; one without a stored field gets it now, which takes about a
/// second. Errors: no body; a body without a shape; on a GPU there are no batches against bodies.
Result<std::unique_ptr<BodyBatchQuery>> make_body_batch_query(Backend backend,
                                                              std::shared_ptr<const ToolIndex> tool,
                                                              std::vector<PlacedBody> bodies,
                                                              const BodyPairOptions& options = {},
                                                              ThreadPool* pool = nullptr);

// Several bodies at once: any number of moving tools and of rigid objects around one cloud.

/// What one body feels: the cloud, and all other bodies together.
struct BodyMeasure {
  Penetration cloud;
  std::optional<Stiffness> stiffness;  ///< of `cloud`, if it was wanted
  VolumeMoments moments;               ///< likewise
  Penetration bodies;                  ///< sum over the other bodies, see BodyPenetration
  /// Of `bodies` while they stay, likewise, by BodyMethod::field.
  std::optional<Stiffness> bodies_stiffness;
  /// With it. Of an object: those of what it does to the tool, about that one.
  VolumeMoments bodies_moments;
  std::int64_t num_pairs = 0;  ///< sum of BodyPenetration::num_pairs with other bodies

  /// Volume and wrench of both shares; counts and potential of the cloud alone. What lies both in
  /// the cloud and in another body counts in both. Away from other bodies, the bits of `cloud`.
  Penetration total() const;
};

/// Moving tools feel the cloud, each other and the objects; objects stay where they are put and
/// feel the tools. Bodies are known by the number that adding them returned: 0, 1, ...
class BodyWorld {
 public:
  /// `method`: how bodies are measured against each other.
  explicit BodyWorld(BodyMethod method = BodyMethod::field) : method_(method) {}

  /// A tool that moves. `cloud_query` measures it against the cloud; null: it feels bodies alone.
  /// `tool` must outlive the world.
  int add_tool(const Tool& tool, std::unique_ptr<ContactQuery> cloud_query);
  int add_tool(const Tool&&, std::unique_ptr<ContactQuery>) = delete;
  /// An object that stays where it is. `object` must outlive the world.
  int add_object(const Tool& object, const Pose& X_WB);
  int add_object(const Tool&&, const Pose&) = delete;

  /// How a pair of bodies is measured; see make_body_pair_query.
  using MakePairQuery = std::function<Result<std::unique_ptr<BodyPairQuery>>(
      std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b)>;
  /// Lets other queries than those on the CPU measure the pairs of the bodies added so far, e.g. on
  /// a GPU: there, pairs are measured all at once, and at the same time as the cloud. Error: the
  /// first one of `make`; nothing has changed then.
  Status measure_pairs_by(const MakePairQuery& make);

  int num_bodies() const { return static_cast<int>(bodies_.size()); }
  const Pose& pose(int body) const { return at(body).X_WB; }
  void set_pose(int body, const Pose& X_WB) noexcept { at(body).X_WB = X_WB; }
  /// What the next measurements give for a tool beside its penetration.
  void set_wants(int body, const ContactWants& wants) noexcept { at(body).wants = wants; }

  /// Measures every tool against the surface and every pair of bodies once, except two objects. No
  /// allocation; the same bits for the same poses and surface.
  void measure(const SurfaceView& surface) noexcept { measure(surface, surface, 1); }
  /// Between two surfaces, as ContactQuery.
  void measure(const SurfaceView& from, const SurfaceView& to, double alpha) noexcept {
    const SurfaceBlend camera{from, to, alpha};
    measure({&camera, 1});
  }
  /// Against cameras, as ContactQuery.
  void measure(std::span<const SurfaceBlend> cameras) noexcept;
  /// Of the last `measure`.
  const BodyMeasure& measured(int body) const { return at(body).measured; }

 private:
  struct Body {
    std::shared_ptr<const ToolIndex> index;
    std::unique_ptr<ContactQuery> cloud_query;  // null: does not feel the cloud
    bool moves;
    Pose X_WB;
    ContactWants wants;
    BodyMeasure measured;
  };
  struct Pair {
    int a, b;
    std::unique_ptr<BodyPairQuery> query;
  };

  int add(Body body);
  Body& at(int body) { return bodies_[static_cast<std::size_t>(body)]; }
  const Body& at(int body) const { return bodies_[static_cast<std::size_t>(body)]; }

  BodyMethod method_;
  std::vector<Body> bodies_;
  std::vector<Pair> pairs_;
};

}  // namespace palpate::inline v0
