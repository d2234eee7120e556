// The field method on a GPU: one launch, in which every thread asks the field for an element.
#pragma once

#include <span>

#include "src/contact/cuda/device_field.h"
#include "src/contact/cuda/query_answer.h"
#include "src/contact/field/field_bound.h"
#include "src/contact/field/field_elements.h"
#include "src/gpu/runtime.h"

namespace palpate {

/// An element: its centre from the centre of mass, in T.
struct alignas(16) ElementBall {
  float x = 0, y = 0, z = 0, radius = 0;
};

/// FieldElements on a GPU. A warp takes a cluster of them.
struct ElementsView {
  const ElementBall* balls = nullptr;
  const float* factors = nullptr;  ///< -factor if the element is not counted as a sphere; -0 too
  const Cluster* clusters = nullptr;
  const float* largest_radius = nullptr;  ///< per cluster
  int num_clusters = 0;
};

/// A tool as it is felt with one way to count volumes, on a GPU.
struct FeltTool {
  ElementsView elements;
  const Sphere* spheres = nullptr;  ///< felt_ball of each sphere of the tool
};

/// What the field method was last asked, on the device.
struct FieldQuestion {
  DepthFieldView fields[2];
  double weights[2] = {};
  int num_fields = 0;  ///< 0: nothing was asked
  Pose X_WT;
  SphereVolumes volumes = SphereVolumes::own;
};

/// Measures one tool against a depth field, as FieldContact. All memory is allocated at
/// construction, but that of copies of fields that lie elsewhere: with the first field of its size.
class FieldContactCuda {
 public:
  FieldContactCuda(const Tool& tool, int gpu);

  void set_field(const DepthFieldView& field) { field_ = field; }

  /// As FieldContact, to 1e-5 of its results; the same bits on every run. `X_WT` is finite, its
  /// quaternion unit. If the GPU fails, StepStatus::backend_failed and nothing else.
  Penetration measure(const Pose& X_WT, SphereVolumes volumes) noexcept;
  /// (1 - t) times the measure of `from` and t times that of `to`, in one launch. Spheres are
  /// counted by `to`.
  Penetration measure(const Pose& X_WT, SphereVolumes volumes, const DepthFieldView& from,
                      const DepthFieldView& to, double t) noexcept;

  /// Of the last measure, blended like it.
  Stiffness stiffness() noexcept;

  /// Per sphere of the tool at the last pose, as ContactQuery; by `to`.
  void describe(std::span<SphereState> states, std::span<Plane<float>> planes) noexcept;

  /// The first failure.
  const Status& status() const;

 private:
  FeltTool take(const Tool& tool, SphereVolumes volumes);
  /// What was asked last; `Sample`: with first derivatives of the field, or with second ones for a
  /// stiffness.
  template <int kNumFields, class Sample>
  Penetration measure(AnswerBox& answers) noexcept;
  const FeltTool& felt_tool() const {
    return last_.volumes == SphereVolumes::own ? own_ : represented_;
  }

  Vec3d centre_of_mass_;
  int num_spheres_;
  gpu::Memory memory_;
  gpu::Stream stream_;
  DeviceFields fields_;
  FeltTool own_, represented_;
  AnswerBox answers_, stiffness_answers_;
  DepthFieldView field_;
  FieldQuestion last_;

  // Of describe.
  SphereState* states_;
  Plane<float>* planes_;
};

}  // namespace palpate
