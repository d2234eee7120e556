// The field method: every element of the tool asks the depth field once (theory: U = sum G(phi)).
#pragma once

#include <memory>
#include <vector>

#include "palpate/contact/contact_query.h"
#include "src/contact/field/field_bound.h"
#include "src/contact/field/field_element.h"
#include "src/contact/index/tool_parts.h"

namespace palpate {

/// Sums over some elements, in W; the torque is about the centre of mass C.
struct FieldSums {
  double volume = 0;
  double potential = 0;  ///< m4
  Vec3d force, torque;
  double num_boundary = 0, num_inside = 0;

  void add(const FieldSums& other) {
    volume += other.volume;
    potential += other.potential;
    force += other.force;
    torque += other.torque;
    num_boundary += other.num_boundary;
    num_inside += other.num_inside;
  }
};

/// What one query asks of each group of clusters.
struct MeasureJob {
  const SphereClusters* clusters = nullptr;
  const float *radius = nullptr, *factor = nullptr, *counted = nullptr;  ///< per place
  const float* largest_radius = nullptr;                                 ///< per cluster
  DepthFieldView field;
  FieldFrame frame;
};

/// Where a description goes: a place for each sphere of the tool, by its number.
struct SphereCuts {
  SphereState* states = nullptr;
  Plane<float>* planes = nullptr;  ///< in T
  float p_TC[3] = {};              ///< the centre of mass
};

/// Each does the elements of one group of clusters, in a fixed order.
struct FieldContactKernels {
  FieldSums (*measure_group)(const MeasureJob&, int group);
  /// The same, and the stiffness in the same pass.
  FieldSums (*measure_stiffness_group)(const MeasureJob&, int group, StiffnessSums& stiffness);
  /// Writes what is cut or inside; the rest is outside.
  void (*describe_group)(const MeasureJob&, int group, const SphereCuts& to);
};

/// Measures one tool against depth fields.
class FieldContact final : public ContactQuery {
 public:
  FieldContact(std::shared_ptr<const ToolIndex> index, const FieldMethod& method,
               const ContactCapacities& capacities);

  using ContactQuery::measure;
  /// U = sum f_s G(phi(c_s)), G the integral of the cap volume over depth and f_s what the element
  /// counts over what it is; force and torque are minus its derivatives, exactly:
  /// F = sum f_s V_cap(phi) grad phi, torque = sum (c_s - C) x that. O(elements).
  ContactResult measure(const Surfaces& from, const Surfaces& to, double alpha, const Pose& X_WT,
                        const ContactWants& wants) const noexcept override;

 private:
  // At a pose that is finite, with a unit quaternion.
  MeasureJob job(const DepthFieldView& field, const Pose& X_WT) const;
  ContactResult ask(const DepthFieldView& field, const Pose& X_WT, bool with_stiffness) const;
  void describe(const MeasureJob& asked, const ContactWants& wants) const;

  const FieldElements* elements_;  // of the index
  Vec3d p_TC_;                     // centre of mass
  FieldContactKernels kernels_;
  mutable ThreadPool own_pool_{1};
  ThreadPool* pool_;
  // Scratch.
  mutable std::vector<FieldSums> group_sums_;
  mutable std::vector<StiffnessSums> group_stiffness_;
};

}  // namespace palpate
