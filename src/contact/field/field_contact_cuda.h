// The field method on a GPU: one launch, in which every thread asks the field for an element.
#pragma once

#include <memory>

#include "src/contact/cuda/gpu_field.h"
#include "src/contact/cuda/query_answer.h"
#include "src/contact/field/field_bound.h"
#include "src/contact/index/tool_parts.h"
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
  double reach = 0;                 ///< as FieldElements
};

/// What the field method is asked, on the device.
struct FieldQuestion {
  DepthFieldView fields[2];
  double weights[2] = {};
  Pose X_WT;
};

/// Measures one tool against depth fields, as FieldContact. All memory is allocated at
/// construction, but that of copies of fields that lie elsewhere: with the first field of its size.
class FieldContactCuda final : public ContactQuery {
 public:
  FieldContactCuda(std::shared_ptr<const ToolIndex> index, const FieldMethod& method, int gpu);

  using ContactQuery::measure;
  /// As FieldContact, to 1e-5 of its results, in one launch; the same bits on every run. With a
  /// stiffness other blocks add up: what is measured then differs by rounding.
  ContactResult measure(const SurfaceView& from, const SurfaceView& to, double alpha,
                        const Pose& X_WT, const ContactWants& wants) const noexcept override;

  /// The first failure.
  const Status& status() const;

 private:
  FeltTool take(SphereVolumes volumes);
  /// `Sample`: with first derivatives of the field, or with second ones for a stiffness.
  template <int kNumFields, class Sample>
  ContactResult ask(const FieldQuestion& question, AnswerBox& answers) const noexcept;
  void describe(const DepthFieldView& field, const Pose& X_WT,
                const ContactWants& wants) const noexcept;

  Vec3d centre_of_mass_;
  int num_spheres_;
  gpu::Memory memory_;
  FeltTool felt_tool_;
  // Scratch.
  mutable gpu::Stream stream_;
  mutable GpuFields fields_;
  mutable AnswerBox answers_, stiffness_answers_;
  SphereState* states_;
  Plane<float>* planes_;
};

}  // namespace palpate
