// Batches by the field method on a GPU: one launch, in which a block answers a pose.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/contact.h"
#include "src/contact/cuda/gpu_field.h"
#include "src/contact/field/field_tool_cuda.h"
#include "src/contact/noise/batch_rows.h"

namespace palpate { inline namespace v0 {

struct BatchJob;  // the arguments of kernels
struct BatchNoiseJob;

/// All memory is allocated at construction or by `reserve`, or with the first batch that needs it.
class FieldBatchCuda final : public BatchQuery {
 public:
  /// `num_warps`: of a block, 1 to 4; 0: as fits the tool. The bits depend on it. `max_staged`:
  /// largest number of poses from host memory, or of answers to it, on the GPU at a time.
  FieldBatchCuda(std::shared_ptr<const ToolIndex> index, const FieldMethod& method, int gpu,
                 int num_warps = 0, int max_staged = 1 << 16);
  ~FieldBatchCuda() override;

  Status measure(const SurfaceBatch& surfaces, const PoseBatch& poses, const BatchAnswers& answers,
                 std::optional<CallerStream> stream) const override;
  Status reserve(int num_surfaces, int num_poses) const override;

  const Status& status() const;

 private:
  /// Arrays on the GPU in place of those in host memory.
  struct Staged {
    std::optional<gpu::Memory> memory;
    int num_poses = 0;  ///< there is room for
    Pose* X_WT = nullptr;
    std::int32_t* surface = nullptr;
    BatchAnswers answers;
  };
  /// Surfaces that do not lie at equal distances, on the GPU.
  struct Table;

  Status check(const SurfaceBatch& surfaces, const PoseBatch& poses,
               const BatchAnswers& answers) const;
  Status grow_staged(int num_poses) const;
  Status grow_table(int num_surfaces) const;
  Status look_at(const SurfaceBatch& surfaces, gpu::Stream& stream, BatchJob& job) const;
  Status place_cameras(std::span<const Pose> X_WC, gpu::Stream& stream, BatchJob& job) const;
  Status look_at_noise(const SurfaceBatch& surfaces, gpu::Stream& stream, BatchNoiseJob& job) const;
  void launch(const BatchJob& job, int num_poses, gpu::Stream& stream) const;
  void launch_noise(BatchNoiseJob& job, int num_poses, gpu::Stream& stream) const;
  void measure_part(const PoseBatch& poses, const BatchAnswers& answers, int first, int num,
                    BatchNoiseJob& job, gpu::Stream& stream) const;

  std::shared_ptr<const ToolIndex> index_;
  int gpu_, num_warps_;  // of a block
  int max_staged_;
  gpu::Memory memory_;
  FieldTool field_tool_;
  Vec3d p_TC_;  // center of mass
  mutable gpu::Stream own_stream_, caller_stream_;
  mutable Staged staged_;
  mutable std::unique_ptr<Table> table_;
  mutable BatchRows noise_rows_;
};

/// Errors: no such GPU, or not enough memory on it.
Result<std::unique_ptr<BatchQuery>> make_batch_query_cuda(std::shared_ptr<const ToolIndex> index,
                                                          const FieldMethod& method, int gpu);

}}  // namespace palpate::v0
