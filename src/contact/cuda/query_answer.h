// The transfer of a query's result from a GPU to the host: straight from the kernel into
// page-locked memory that the host polls, without a copy and without waiting for the stream.
#pragma once

#include <chrono>
#include <cstdint>
#include <type_traits>

#include "palpate/contact/contact.h"
#include "src/contact/field/field_element.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// Sums over the threads of a query. Counts are integers.
struct MeasureTerms {
  double volume = 0;
  double potential = 0;
  double force[3] = {}, torque[3] = {};
  double num_boundary = 0, num_inside = 0, num_points = 0;
  double status = 0;      ///< StepStatus bits, of one thread alone
  double num_rounds = 0;  ///< of the graph search, of one thread alone
  double unseen = 0;      ///< Penetration::unseen_volume
  double unused[2] = {};

  static constexpr int kNum = 16;
  /// StiffnessSums that follow if they are requested, padded with zeros to a full warp.
  static constexpr int kNumStiffness = 32;
};
static_assert(sizeof(MeasureTerms) == MeasureTerms::kNum * sizeof(double));

/// Sums over all threads.
struct QueryAnswer : MeasureTerms {
  /// Force and torque are in the frame in which they were added up.
  Penetration penetration() const {
    Penetration result;
    result.volume = volume;
    result.potential = potential;
    result.measure_W = {{force[0], force[1], force[2]}, {torque[0], torque[1], torque[2]}};
    result.num_boundary_spheres = static_cast<int>(num_boundary);
    result.num_inside_spheres = static_cast<int>(num_inside);
    result.num_points = static_cast<int>(num_points);
    result.unseen_volume = unseen;
    result.status.bits = static_cast<std::uint32_t>(status);
    return result;
  }
};
static_assert(std::is_trivially_copyable_v<QueryAnswer>);

/// Destination of the sums of finish_measure (finish_measure.cuh). An argument of the kernel.
struct MeasureOutput {
  double* partials = nullptr;           ///< all numbers of each block
  unsigned long long* count = nullptr;  ///< of the blocks that are done
  /// Page-locked. Each word is half of one of the numbers, and above it the number of the query:
  /// words are written at once, so each shows by itself that it has arrived, and the kernel needs
  /// no fence.
  std::uint64_t* words = nullptr;
  std::uint32_t query = 0;
};

/// Owns the memory for the answers of one kernel, which always has the same number of blocks.
class AnswerBox {
 public:
  static constexpr int kMaxNumbers = MeasureTerms::kNum + MeasureTerms::kNumStiffness;

  /// `num_numbers`: kMaxNumbers for kernels that also return a stiffness.
  AnswerBox(int gpu, int num_blocks, int num_numbers = MeasureTerms::kNum);

  /// Arguments for the kernel of the next query. One query at a time.
  MeasureOutput next() noexcept;

  /// Waits until this query has answered, but not longer than 50 ms (times the environment variable
  /// PALPATE_GPU_PATIENCE): then, and if the device
  /// reports an error, false, and the stream has failed.
  bool await(gpu::Stream& stream) noexcept;
  QueryAnswer answer() const;
  StiffnessSums stiffness() const;
  const double* numbers() const { return numbers_; }

  const Status& status() const { return memory_.status(); }
  int num_blocks() const { return num_blocks_; }

 private:
  bool take() noexcept;

  gpu::Memory memory_;
  int num_blocks_, num_numbers_;
  std::chrono::milliseconds longest_;
  MeasureOutput output_;
  double numbers_[kMaxNumbers] = {};
};

}}  // namespace palpate::v0
