// Memory in which the blocks of a batch on a GPU keep the elements that touch, each of one pose at
// a time.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>

#include "src/contact/noise/noise_rows.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

class BatchRows {
 public:
  /// Takes memory for tools of up to so many clusters, for as many blocks as run at the same time,
  /// or fewer if that is much. Error: too little memory.
  Status take(int gpu, int num_clusters, int num_parts, int resident_blocks) {
    const auto capacity = static_cast<std::size_t>(rows_of_part(num_clusters, num_parts));
    const std::size_t of_block = capacity * static_cast<std::size_t>(num_parts);
    const std::size_t most = std::min(kMaxBytes, gpu::free_memory(gpu) / 8);
    const std::size_t fitting = most / (of_block * kNumNoiseRows * sizeof(float));
    const int max_blocks = std::max(1, resident_blocks);
    num_blocks_ = std::clamp(static_cast<int>(std::min(fitting, kMaxBlocks)), 1, max_blocks);
    slowdown_ = static_cast<double>(max_blocks) / num_blocks_;
    const auto num = static_cast<std::size_t>(num_blocks_);
    gpu::Memory& memory = memory_.emplace(gpu);
    rows_.rows.first = memory.take<float>(kNumNoiseRows * num * of_block);
    rows_.rows.apart = static_cast<std::ptrdiff_t>(num * of_block);
    rows_.rows.num = memory.take<int>(num * static_cast<std::size_t>(num_parts));
    rows_.num_parts = num_parts;
    rows_.capacity = static_cast<std::ptrdiff_t>(capacity);
    const Status status = memory.status();
    if (!status) memory_.reset();
    return status;
  }

  bool is_taken() const { return memory_.has_value(); }
  int num_blocks() const { return num_blocks_; }
  /// Returns how much longer a batch takes than with memory for all blocks that run.
  double slowdown() const { return slowdown_; }
  /// Rows of the first block; see KeptRows::of_block.
  const KeptRows& rows() const { return rows_; }

 private:
  static constexpr std::size_t kMaxBytes = std::size_t{1} << 29, kMaxBlocks = 1 << 20;

  std::optional<gpu::Memory> memory_;
  KeptRows rows_;
  int num_blocks_ = 0;
  double slowdown_ = 1;
};

}}  // namespace palpate::v0
