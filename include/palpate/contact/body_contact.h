// Contact of rigid bodies: CAD objects in the scene, and body against body.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/math/geometry.h"
#include "palpate/settings/setting_table.h"
#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

/// A rigid object in addition to the depth images, which need not show it; fixed or moving.
struct SceneObject {
  std::shared_ptr<const Tool> shape;
  Pose X_WB;                                      ///< its fixed or initial pose
  std::optional<double> friction = std::nullopt;  ///< own friction coefficient; none: the default
  bool moves = false;
  double mass = 0;        ///< kg, if it moves; 0: that of wood, 500 kg/m3
  std::string name = {};  ///< letters, digits and _, unique; empty: no settings
  /// Own static over kinetic and viscous (s/m) friction on the tool; either leaves texture out.
  std::optional<double> static_ratio = std::nullopt, viscous = std::nullopt;
};
/// Adds the settings that can change during a run. The section of the table must be "objects".
inline void add_settings(SettingTable& t, SceneObject& o) {
  if (o.name.empty()) return;
  t.add(o.name + ".friction", o.friction, {0, 10},
        "friction of this object; auto: that of everything else");
  t.add(o.name + ".static_ratio", o.static_ratio, {1, 10},
        "static over kinetic friction of this object; auto: that of everything else");
  t.add(o.name + ".viscous", o.viscous, {0, 100, "s/m"},
        "viscous friction of this object; auto: that of everything else");
}

/// Mass of a moving object, kg.
inline double mass_of(const SceneObject& object) {
  return object.mass > 0 ? object.mass : 500 * object.shape->mesh_mass().volume;
}

inline constexpr int kMaxMovingBodies = 32;  ///< in one run

/// Options of moving objects (docs/guide/moving-bodies.md).
struct BodyOptions {
  double gravity_x = 0, gravity_y = 9.81, gravity_z = 0;  ///< m/s2, in W
  double friction = 0.5;  ///< of bodies without their own coefficient
  double damping = 0.2;   ///< 1/s, of all motion
  double sink = 1e-4;     ///< m: how deep a cube sinks into its support
  int num_spheres = 1000;
  bool may_sleep = true;
};
inline void add_settings(SettingTable& t, BodyOptions& o) {
  t.section("bodies");
  t.add("gravity_x", o.gravity_x, {-100, 100, "m/s2"},
        "moving objects: gravity in the world frame");
  t.add("gravity_y", o.gravity_y, {-100, 100, "m/s2"},
        "the same; +y is down in the image of a level camera");
  t.add("gravity_z", o.gravity_z, {-100, 100, "m/s2"}, "the same; +z is away from the camera");
  t.add("friction", o.friction, {0, 10},
        "moving objects: friction with everything but the tool, unless they have their own");
  t.add("damping", o.damping, {0, 100, "1/s"},
        "moving objects: share of the speed lost per second");
  t.add("sink", o.sink, {1e-6, 0.01, "m"},
        "how deep a cube at rest sinks into its support: less is stiffer");
  t.add("spheres", o.num_spheres, {0, 1 << 30, "spheres"},
        "moving objects: queries use the first N spheres; 0: all");
  t.add("sleep", o.may_sleep, "moving objects: bodies at rest sleep until something changes");
}

/// Integral of lens_volume(a, b, s) over s from `distance` to a + b, m4: the potential of two balls
/// with centers `distance` apart. Closed form, accurate down to the lightest contact.
double lens_potential(double a, double b, double distance);

/// The contact of two bodies: common volume, and the wrench on each.
struct BodyPenetration {
  /// For each body, like a tool in a cloud: volume, and the wrench on it about its own center of
  /// mass, in W. Both volumes are the same, and the wrenches are opposite.
  ///
  /// `field`: U_a = sum f_s G(phi_B(c_s)) over the spheres of A, U_b the same for the spheres of B
  /// in the field of A, and U their power mean with weights w_a + w_b = 1; `potential` is U, the
  /// wrenches are minus its derivatives, and the volume is w_a and w_b of the caps. The body with
  /// finer spheres and grid gets more weight (equal bodies: 1/2 each). A body that is coarse in
  /// comparison gets none; its counts stay 0. Sphere counts are as against a depth field.
  ///
  /// `spheres`: the volume is that of the intersection of the two packings. `num_boundary_spheres`
  /// are spheres that overlap some sphere of the other body; counts of inside spheres and points,
  /// and the potential, stay 0.
  Penetration on_a, on_b;
  /// Elements in contact. `field`: spheres of either body that penetrate the other; `spheres`:
  /// overlapping pairs, which determine the time.
  std::int64_t num_pairs = 0;
  /// `field`, if requested: derivative of the wrench on A by the pose of A with B fixed, and the
  /// same for B.
  std::optional<Stiffness> stiffness_a = std::nullopt, stiffness_b = std::nullopt;
  /// Together with them: moments of the volume, with levers from A's center of mass and forces on
  /// A. Exact if all forces are parallel.
  VolumeMoments moments_a = {};
};

/// Measures two rigid bodies against each other. One thread at a time.
class BodyPairQuery {
 public:
  virtual ~BodyPairQuery() = default;

  /// Starts a measurement: on a GPU, it runs until `finish` is called, which returns the result. No
  /// allocation. If a pose is not finite, there is no measurement, and the body with that pose gets
  /// StepStatus::non_finite_pose.
  virtual void start(const Pose& X_WA, const Pose& X_WB, bool wants_stiffness) noexcept = 0;
  /// Waits for the result of the last `start`.
  virtual BodyPenetration finish() noexcept = 0;

  /// `start` and `finish` together: poses of both bodies in W.
  BodyPenetration measure(const Pose& X_WA, const Pose& X_WB,
                          bool wants_stiffness = false) noexcept {
    start(X_WA, X_WB, wants_stiffness);
    return finish();
  }
};

/// Options of make_body_pair_query.
struct BodyPairOptions {
  BodyMethod method = BodyMethod::field;
  Isa isa = best_isa();  ///< on the CPU, `field` only
};

/// A GPU finds the same spheres; sums differ only by rounding. With `field`, bodies without a
/// stored field compute one now, about a second each. Errors: the place is not in this build or
/// on this machine; out of GPU memory.
Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(const Place& place,
                                                            std::shared_ptr<const ToolIndex> a,
                                                            std::shared_ptr<const ToolIndex> b,
                                                            const BodyPairOptions& options = {});
/// The same with its own indices. Both bodies must outlive it.
Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(const Place& place, const Tool& a,
                                                            const Tool& b,
                                                            const BodyPairOptions& options = {});
Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(const Place&, const Tool&&, const Tool&,
                                                            const BodyPairOptions& = {}) = delete;
Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(const Place&, const Tool&, const Tool&&,
                                                            const BodyPairOptions& = {}) = delete;
Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(const Place&, const Tool&&,
                                                            const Tool&&,
                                                            const BodyPairOptions& = {}) = delete;

/// BodyMethod::spheres on the CPU. Every pair of overlapping spheres adds the exact volume V of its
/// lens, and the force V m, where m is the unit vector from the center of B's sphere to that of
/// A's: volume times direction, as everywhere.
///
/// The force of a pair depends only on the distance of the centers and acts along the line between
/// them. So it is the exact gradient of a potential, the sum of `lens_potential` over all pairs
/// (volume integrated over depth, as for planes): closed paths do no work. The forces on both
/// bodies are opposite and on one line, so momentum is conserved. If one sphere lies within the
/// other, V is the whole smaller ball, and the force still acts along the line of centers.
/// Coincident centers define no line: the pair adds its volume and no force.
///
/// Only the spheres count, not the represented parts of the solids. Computed in double on the
/// stored numbers, in a fixed order: the same input gives the same bits. No pair is skipped,
/// whatever the cost. One thread at a time.
class BodyContact final : public BodyPairQuery {
 public:
  /// Both bodies must outlive it. All memory is allocated here.
  BodyContact(const Tool& a, const Tool& b);
  BodyContact(const Tool&&, const Tool&) = delete;
  BodyContact(const Tool&, const Tool&&) = delete;
  BodyContact(const Tool&&, const Tool&&) = delete;

  void start(const Pose& X_WA, const Pose& X_WB, bool wants_stiffness = false) noexcept override;
  BodyPenetration finish() noexcept override;

  /// The potential of the wrenches, m4. Takes about twice the time of `measure`.
  double potential(const Pose& X_WA, const Pose& X_WB) const noexcept;

 private:
  const Tool* a_;
  const Tool* b_;
  Pose X_WA_, X_WB_;
  std::vector<std::uint8_t> touched_a_, touched_b_;  // one per sphere, of this measurement
};

// Many poses of one tool against fixed bodies, in one call.

/// A body of a batch, and its fixed pose.
struct PlacedBody {
  std::shared_ptr<const ToolIndex> shape;
  Pose X_WB = {};
};

/// Measures batches against bodies, as BatchQuery does against surfaces. One thread at a time.
class BodyBatchQuery {
 public:
  virtual ~BodyBatchQuery() = default;

  /// Measures each pose of the tool against one body: `body_of_pose` has P indices of bodies, or is
  /// empty if there is one body or each pose has its own. An invalid index gives
  /// StepStatus::no_surface. The result of a pose is that of BodyPairQuery::measure on the tool
  /// (on_a, stiffness_a at X_WA = X_WT and X_WB): on a CPU to the bit, on a GPU to 1e-5. Errors:
  /// sizes that do not match; answers on another device; standard deviations on a GPU.
  virtual Status measure(std::span<const Pose> X_WT, std::span<const std::int32_t> body_of_pose,
                         const BatchAnswers& answers) const = 0;
};

/// Creates a batch query: on a CPU over the threads of `pool` (null: only the caller's), on a GPU
/// with BodyMethod::field alone. A shape without a stored field computes one now, in about a
/// second. Errors: no body or shape; the backend is not here; out of GPU memory.
Result<std::unique_ptr<BodyBatchQuery>> make_body_batch_query(
    const Place& place, const std::shared_ptr<const ToolIndex>& tool,
    const std::vector<PlacedBody>& bodies, const BodyPairOptions& options = {},
    ThreadPool* pool = nullptr);

// Several bodies: any number of moving tools and of rigid objects around one cloud.

/// Contacts of one body: with the cloud, and with all other bodies together.
struct BodyMeasure {
  Penetration cloud;
  std::optional<Stiffness> stiffness;  ///< of `cloud`, if requested
  VolumeMoments moments;               ///< of `cloud`, if requested
  std::optional<MeasureNoise> noise;   ///< likewise
  Penetration bodies;                  ///< sum over the other bodies, see BodyPenetration
  /// Stiffness of `bodies`, which stay fixed, if requested and with BodyMethod::field.
  std::optional<Stiffness> bodies_stiffness;
  VolumeMoments bodies_moments;  ///< with it; of an object: of its force, about the tool's C
  std::int64_t num_pairs = 0;    ///< sum of BodyPenetration::num_pairs with other bodies

  /// Volume and wrench of both shares; counts and potential of the cloud only. Volume both in the
  /// cloud and in another body counts in both. Without other bodies near: the bits of `cloud`.
  Penetration total() const;
};

/// A set of bodies. Moving tools are measured against the cloud, each other and the objects;
/// objects are fixed and measured against the tools. Adding a body returns its number: 0, 1, ...
class BodyWorld {
 public:
  /// `method`: how bodies are measured against each other.
  explicit BodyWorld(BodyMethod method = BodyMethod::field) : method_(method) {}

  /// Adds a moving tool. `cloud_query` measures it against the cloud; null: only against bodies.
  /// `tool` must outlive the world.
  int add_tool(const Tool& tool, std::unique_ptr<ContactQuery> cloud_query);
  int add_tool(const Tool&&, std::unique_ptr<ContactQuery>) = delete;
  /// Adds a fixed object. `object` must outlive the world.
  int add_object(const Tool& object, const Pose& X_WB);
  int add_object(const Tool&&, const Pose&) = delete;

  /// Creates the query of a pair of bodies; see make_body_pair_query.
  using MakePairQuery = std::function<Result<std::unique_ptr<BodyPairQuery>>(
      std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b)>;
  /// Replaces the CPU queries of all pairs of the bodies added so far, e.g. by a GPU: there, all
  /// pairs are measured concurrently, together with the cloud. Error: the first one of `make`; then
  /// nothing has changed.
  Status measure_pairs_by(const MakePairQuery& make);

  int num_bodies() const { return static_cast<int>(bodies_.size()); }
  const Pose& pose(int body) const { return at(body).X_WB; }
  void set_pose(int body, const Pose& X_WB) noexcept { at(body).X_WB = X_WB; }
  /// Optional outputs of the next measurements of a tool.
  void set_wants(int body, const ContactWants& wants) noexcept { at(body).wants = wants; }

  /// Measures every tool against the surface, and every pair of bodies except two objects. No
  /// allocation. The same poses and surface give the same bits.
  void measure(const SurfaceView& surface) noexcept { measure(surface, surface, 1); }
  /// Between two surfaces, see ContactQuery.
  void measure(const SurfaceView& from, const SurfaceView& to, double alpha) noexcept {
    const SurfaceBlend camera{from, to, alpha};
    measure({&camera, 1});
  }
  /// Against cameras, see ContactQuery.
  void measure(std::span<const SurfaceBlend> cameras) noexcept;
  /// Result of the last `measure`.
  const BodyMeasure& measured(int body) const { return at(body).measured; }

 private:
  struct Body {
    std::shared_ptr<const ToolIndex> index;
    std::unique_ptr<ContactQuery> cloud_query;  // null: not measured against the cloud
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

}}  // namespace palpate::v0
