// The field method against several cameras at once, on a GPU: one launch.
#pragma once

#include <memory>
#include <span>

#include "src/contact/cuda/query_answer.h"
#include "src/contact/field/field_tool_cuda.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

class HullCameras;

/// Destination of a description on the GPU, a slot for each sphere of the tool.
struct SphereCutsOnGpu {
  SphereState* states = nullptr;
  Plane<float>* planes = nullptr;  ///< in T
  std::int8_t* deciders = nullptr;
  std::uint8_t* unseen = nullptr;
};

/// Measures one tool against several cameras, as DepthHull, to 1e-5 of its results. All memory is
/// allocated at construction, but that of copies of fields that lie elsewhere.
class DepthHullCuda {
 public:
  /// `max_blocks`: largest number; 0: as many as run at once.
  DepthHullCuda(const FieldTool& tool, const Vec3d& p_TC, int num_spheres, int gpu,
                int max_blocks = 0);
  ~DepthHullCuda();

  /// See ContactQuery::measure; the pose is finite, with a unit quaternion.
  ContactResult measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                        const ContactWants& wants, const SphereCutsOnGpu& cuts,
                        gpu::Stream& stream) noexcept;

  /// Returns the cameras of the last measurement.
  const HullCameras& cameras() const { return *cameras_; }

  /// Returns the first failure.
  const Status& status() const;

 private:
  template <int kMaxViews, class Sample>
  bool launch(const HullCameras& cameras, AnswerBox& answers, gpu::Stream& stream) noexcept;
  template <int kMaxViews>
  void describe(const HullCameras& cameras, const ContactWants& wants, const SphereCutsOnGpu& cuts,
                gpu::Stream& stream) noexcept;

  FieldTool tool_;
  Vec3d p_TC_;  // center of mass
  int num_spheres_;
  // Scratch.
  std::unique_ptr<HullCameras> cameras_;
  AnswerBox answers_, stiffness_answers_;
};

}}  // namespace palpate::v0
