// The field method: every element of the tool asks the depth field once (theory: U = sum G(phi)).
#pragma once

#include <vector>

#include "palpate/contact/contact_query.h"
#include "palpate/field/depth_field.h"
#include "src/contact/field/field_bound.h"
#include "src/contact/field/field_element.h"
#include "src/contact/field/field_elements.h"

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

/// Measures one tool against a depth field. All memory is allocated at construction.
class FieldContact {
 public:
  /// `tool` and `pool` must outlive it.
  FieldContact(const Tool& tool, ThreadPool& pool, Isa isa);

  void set_field(const DepthFieldView& field) { field_ = field; }

  /// U = sum f_s G(phi(c_s)), G the integral of the cap volume over depth and f_s what the element
  /// counts over what it is; force and torque are minus its derivatives, exactly:
  /// F = sum f_s V_cap(phi) grad phi, torque = sum (c_s - C) x that. `X_WT` is finite, its
  /// quaternion unit. O(elements). The same bits for any number of threads.
  Penetration measure(const Pose& X_WT, SphereVolumes volumes) noexcept;

  /// At the last pose, as ContactQuery. O(elements).
  Stiffness stiffness() const noexcept;

  /// Per sphere of the tool at the last pose, as ContactQuery. O(spheres).
  void describe(std::span<SphereState> states, std::span<Plane<float>> planes) const noexcept;

 private:
  MeasureJob job() const;
  const FieldElements& elements() const {
    return volumes_ == SphereVolumes::own ? own_ : represented_;
  }

  const Tool* tool_;
  ThreadPool* pool_;
  FieldContactKernels kernels_;
  FieldElements own_, represented_;
  DepthFieldView field_;
  std::vector<FieldSums> group_sums_;
  mutable std::vector<StiffnessSums> group_stiffness_;
  Pose X_WT_;
  SphereVolumes volumes_ = SphereVolumes::own;
};

}  // namespace palpate
