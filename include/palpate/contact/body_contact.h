// Body against body: how much two rigid bodies share, and the wrench that follows for each.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/contact/contact_query.h"
#include "palpate/math/pose.h"
#include "palpate/tool/tool.h"

namespace palpate {

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

}  // namespace palpate
