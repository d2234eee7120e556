// The field method: every element of the tool queries the depth field once (theory: U = sum
// G(phi)).
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "palpate/contact/contact.h"
#include "src/contact/field/field_bound.h"
#include "src/contact/index/tool_parts.h"
#include "src/contact/internal/ball_cut.h"
#include "src/contact/noise/noise_sums.h"

namespace palpate { inline namespace v0 {

/// Sums over some elements, in W; the torque is about the center of mass C.
struct FieldSums {
  double volume = 0;
  double potential = 0;  ///< m4
  Vec3d force, torque;
  double num_boundary = 0, num_inside = 0;
  double unseen = 0;  ///< Penetration::unseen_volume

  void add(const FieldSums& other) {
    volume += other.volume;
    potential += other.potential;
    force += other.force;
    torque += other.torque;
    num_boundary += other.num_boundary;
    num_inside += other.num_inside;
    unseen += other.unseen;
  }
  Penetration penetration() const {
    Penetration result;
    result.volume = volume;
    result.potential = potential;
    result.measure_W = {force, torque};
    result.num_boundary_spheres = static_cast<int>(num_boundary);
    result.num_inside_spheres = static_cast<int>(num_inside);
    result.unseen_volume = unseen;
    return result;
  }
};

/// Keeps the results within their bounds: light contacts of balls in parts may have slightly
/// negative volumes, which become 0, and no force is longer than kLongestGradient times the volume.
inline void keep_bounds(ContactResult& result) {
  Penetration& at = result.penetration;
  const double scale = force_scale(at.volume, norm(at.measure_W.force));
  if (at.volume < 0) at.volume = 0;
  if (at.potential < 0) at.potential = 0;
  if (scale == 1) return;
  at.measure_W = {scale * at.measure_W.force, scale * at.measure_W.torque};
  if (!result.stiffness) return;
  for (double(&row)[6] : result.stiffness->m) {
    for (double& entry : row) entry *= scale;
  }
}

/// Sums of one group of clusters against one field.
struct GroupSums {
  FieldSums measure;
  StiffnessSums stiffness;  ///< if it was requested
};

/// Arguments of a query for each group of clusters.
struct MeasureJob {
  const SphereClusters* clusters = nullptr;
  ElementRows elements, wholes;           ///< wholes: a slot for each cluster
  const float* whole_depth = nullptr;     ///< likewise
  const float* whole_polar = nullptr;     ///< likewise
  const float* largest_radius = nullptr;  ///< per cluster
  const float* ball_factor = nullptr;     ///< per cluster
  int first_ball = 0;                     ///< clusters from this one on are the parts of balls
  DepthFieldView fields[2];               ///< of one camera and one size
  int num_fields = 1;
  FieldFrame frame;
  NoiseRows noise = {};  ///< of the first field, if somebody asks
};

/// A job without field and frame.
inline MeasureJob measure_job(const FieldElements& elements) {
  return {&elements.clusters,
          elements.rows(),
          elements.wholes.rows(),
          elements.wholes.depth.data(),
          elements.wholes.polar.data(),
          elements.largest_radius.data(),
          elements.ball_factor.data(),
          elements.first_ball(),
          {},
          1,
          {},
          {}};
}

/// Destination of a description: a slot for each sphere of the tool, by its number.
struct SphereCuts {
  SphereState* states = nullptr;
  Plane<float>* planes = nullptr;  ///< in T
  float p_TC[3] = {};              ///< the center of mass
  std::int8_t* deciders = nullptr;
  std::uint8_t* unseen = nullptr;
};
inline SphereCuts cuts_of(const ContactWants& wants, const Vec3d& p_TC) {
  return {wants.states.data(),
          wants.planes.data(),
          {static_cast<float>(p_TC.x), static_cast<float>(p_TC.y), static_cast<float>(p_TC.z)},
          wants.deciders.data(),
          wants.unseen.data()};
}

/// Each kernel does the elements of one group of clusters, in a fixed order.
struct FieldContactKernels {
  /// Writes the sums against each field: the same bits as against that field alone.
  void (*measure_group)(const MeasureJob&, int group, bool with_stiffness, GroupSums* sums);
  /// Writes the spheres that the first field cuts or contains; the others are outside.
  void (*describe_group)(const MeasureJob&, int group, const SphereCuts& to);
  /// Returns the volume unseen by the camera of the first field, m3; marks spheres if requested.
  double (*unseen_in_group)(const MeasureJob&, int group, std::uint8_t* spheres);
};

/// An instruction set that the processor lacks is lowered.
FieldContactKernels field_contact_kernels(Isa isa);

class DepthHull;

/// Measures one tool against depth fields.
class FieldContact final : public ContactQuery {
 public:
  FieldContact(std::shared_ptr<const ToolIndex> index, const FieldMethod& method,
               const ExecutionOptions& execution);

  using ContactQuery::measure;
  /// U = sum f_s G(phi(c_s)), G the integral of the cap volume over depth and f_s what the element
  /// counts over what it is; force and torque are minus its derivatives, exactly:
  /// F = sum f_s V_cap(phi) grad phi, torque = sum (c_s - C) x that. O(elements).
  ContactResult measure_one(const SurfaceView& from, const SurfaceView& to, double alpha,
                            const Pose& X_WT, const ContactWants& wants) const noexcept override;
  ~FieldContact() override;

 protected:
  ContactResult measure_hull(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                             const ContactWants& wants) const noexcept override;
  double unseen_by_one(const SurfaceView& surface, const Pose& X_CT,
                       std::span<std::uint8_t> unseen) const noexcept override;

 private:
  // At a pose that is finite, with a unit quaternion.
  void evaluate(std::span<const DepthFieldView> fields, const Pose& X_WT, const ContactWants& wants,
                ContactResult* results) const;
  void describe(const DepthFieldView& field, const Pose& X_WT, const ContactWants& wants) const;
  MeasureJob job(std::span<const DepthFieldView> fields, const Pose& X_WT) const;

  const FieldElements* elements_;  // of the index
  Vec3d p_TC_;                     // center of mass
  FieldContactKernels kernels_;
  mutable ThreadPool own_pool_{1};
  ThreadPool* pool_;
  // Scratch.
  mutable NoiseMemory noise_;
  mutable std::vector<GroupSums> group_sums_;  // two a group
  mutable std::vector<double> unseen_;         // of each group
  std::unique_ptr<DepthHull> hull_;
};

}}  // namespace palpate::v0
