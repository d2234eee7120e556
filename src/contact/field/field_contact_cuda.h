// The field method on a GPU: one launch, in which every thread queries the field for an element.
#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "src/contact/cuda/gpu_field.h"
#include "src/contact/cuda/query_answer.h"
#include "src/contact/field/field_tool_cuda.h"
#include "src/contact/hull/depth_hull_cuda.h"
#include "src/contact/noise/measure_noise_cuda.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// A query of the field method, on the device.
struct FieldQuestion {
  DepthFieldView fields[2];
  double weights[2] = {};
  Pose X_WT;
};

/// Measures one tool against depth fields, as FieldContact. All memory is allocated at
/// construction, but that of copies of fields that lie elsewhere: with the first field of its size.
class FieldContactCuda final : public ContactQuery {
 public:
  /// `num_blocks`: largest number for a large tool; 0: as many as run at once. `reserves_noise`:
  /// see ExecutionOptions.
  FieldContactCuda(std::shared_ptr<const ToolIndex> index, const FieldMethod& method, int gpu,
                   int num_blocks = 0, bool reserves_noise = false);

  using ContactQuery::measure;
  /// As FieldContact, to 1e-5 of its results, in one launch; the same bits on every run. With a
  /// stiffness other blocks add up: results then differ by rounding. Noise takes two more launches
  /// for each field.
  ContactResult measure_one(const SurfaceView& from, const SurfaceView& to, double alpha,
                            const Pose& X_WT, const ContactWants& wants) const noexcept override;

  /// Returns the first failure.
  const Status& status() const;

  /// Returns the queue of all queries, for benchmarks.
  gpu::Stream& stream() const { return stream_; }

 protected:
  ContactResult measure_hull(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                             const ContactWants& wants) const noexcept override;
  double unseen_by_one(const SurfaceView& surface, const Pose& X_CT,
                       std::span<std::uint8_t> unseen) const noexcept override;

 private:
  /// `Sample`: with first derivatives of the field, or with second ones for a stiffness.
  template <int kNumFields, class Sample>
  ContactResult evaluate(const FieldQuestion& question, AnswerBox& answers) const noexcept;
  void describe(const DepthFieldView& field, const Pose& X_WT,
                const ContactWants& wants) const noexcept;
  /// Returns the noise against a field of a question; has_noise is true. None: it is unknown.
  std::optional<MeasureNoise> noise_against(const FieldQuestion& question,
                                            int field) const noexcept;
  /// Takes the memory for noise, if it is not there. False: there is too little; the next call
  /// tries again.
  bool has_noise() const {
    if (noise_ != nullptr) return true;
    auto made = std::make_unique<MeasureNoiseCuda>(field_tool_, memory_.gpu());
    if (!made->status()) return false;
    noise_ = std::move(made);
    return true;
  }

  Vec3d center_of_mass_;
  int num_spheres_;
  gpu::Memory memory_;
  FieldTool field_tool_;
  // Scratch.
  mutable gpu::Stream stream_;
  mutable GpuFields fields_, in_front_;
  mutable AnswerBox answers_, stiffness_answers_;
  SphereState* states_;
  Plane<float>* planes_;
  std::int8_t* deciders_;
  std::uint8_t* unseen_;
  double* unseen_volume_;  // m3, in host memory
  std::unique_ptr<DepthHullCuda> hull_;
  mutable std::unique_ptr<MeasureNoiseCuda> noise_;
};

}}  // namespace palpate::v0
