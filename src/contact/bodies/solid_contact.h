// Contact of bodies by distance fields: the spheres of each sample the field of the other.
#pragma once

#include <memory>
#include <vector>

#include "palpate/contact/body_contact.h"
#include "src/contact/bodies/solid_pair.h"
#include "src/contact/field/field_contact.h"

namespace palpate { inline namespace v0 {

/// View of a SolidField in host memory, which must outlive it.
SolidFieldView view_of(const SolidField& field);

/// Sampling of the field of one body by the elements of another one, whatever the poses.
struct SolidSampling {
  SolidSampling(const FieldElements& elements, const SolidField& field);

  // Per slot of the elements:
  std::vector<std::int32_t> level;  ///< the grid that is sampled
  std::vector<float> rounding;      ///< per cluster: see is_clear
  /// Mean square of the lengths, m2, below which nothing is resolved: radii and spacing.
  double coarseness = 0;
  bool is_possible = true;  ///< no element is too large for the widest grid
};

/// Arguments of a query for each group of clusters.
struct SolidJob {
  const SphereClusters* clusters = nullptr;
  const float *radius = nullptr, *factor = nullptr, *counted = nullptr;  ///< per slot
  const std::int32_t* level = nullptr;                                   ///< likewise
  const float* rounding = nullptr;                                       ///< per cluster
  SolidFieldView field;
  SolidFrame frame;
};

struct SolidContactKernels {
  /// Writes the sums over the elements of one group, in W; torques are about the center that
  /// elements are relative to.
  void (*measure_solid_group)(const SolidJob&, int group, bool with_stiffness, GroupSums* sums);
};
/// An instruction set that the processor lacks is lowered.
SolidContactKernels solid_contact_kernels(Isa isa);

/// Both directions of sampling and their weights. The finer one weighs more, as the square of the
/// ratio, and in the force the one with the larger potential (decision 30). A direction that would
/// count less than a tenth, or whose spheres are too large for the other body, is not sampled.
struct SolidPair {
  SolidPair(std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b);

  /// Places the elements of both; poses are finite.
  void place(const Pose& X_WA, const Pose& X_WB, SolidFrame& of_a, SolidFrame& of_b) const;
  /// Combines the sums of both directions.
  BodyPenetration penetration(const GroupSums& of_a, const GroupSums& of_b, bool with_stiffness,
                              const Pose& X_WA, const Pose& X_WB) const;

  std::shared_ptr<const ToolIndex> a, b;
  const FieldElements *elements_a, *elements_b;
  const SolidField *field_a, *field_b;
  SolidSampling sampling_a, sampling_b;  ///< A's elements B's field; B's elements A's field
  PairWeights weights;
};

/// Pairs of bodies by distance fields, on the CPU.
class SolidContact final : public BodyPairQuery {
 public:
  SolidContact(std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b,
               Isa isa = best_isa());

  void start(const Pose& X_WA, const Pose& X_WB, bool wants_stiffness) noexcept override;
  BodyPenetration finish() noexcept override;

 private:
  GroupSums sums_of(const SolidJob& job, double weight) const;

  SolidPair pair_;
  SolidContactKernels kernels_;
  SolidJob job_a_, job_b_;
  Pose X_WA_, X_WB_;
  bool wants_stiffness_ = false;
};

}}  // namespace palpate::v0
