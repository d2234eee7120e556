// Input and output of depth estimation over time. Blocks do not depend on each other, so any number
// of threads gives the same bits.
#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/core/core.h"
#include "src/cloud/average/depth_estimate.h"

namespace palpate { inline namespace v0 {

struct EstimatePass {
  EstimateModel model;
  const std::uint16_t* counts = nullptr;  ///< width * height, of `unit` meters
  double unit = 0;
  int width = 0, height = 0;
  float *mean = nullptr, *gain = nullptr;  ///< state of each pixel, `stride` a row
  std::ptrdiff_t stride = 0;               ///< a multiple of kEstimateBlock
  BlockMemory* blocks = nullptr;           ///< likewise, of each block
  float* depth = nullptr;                  ///< width * height, m, NaN where there is none

  int blocks_per_row() const { return (width + kEstimateBlock - 1) / kEstimateBlock; }
  int num_blocks() const {
    return blocks_per_row() * ((height + kEstimateBlock - 1) / kEstimateBlock);
  }
};

/// Processes one block; blocks are numbered row by row.
using EstimateBlock = void (*)(const EstimatePass&, int block);

#define PALPATE_DECLARE_ESTIMATE_BLOCK(isa)            \
  namespace isa {                                      \
  void estimate_block(const EstimatePass&, int block); \
  }
PALPATE_DECLARE_ESTIMATE_BLOCK(isa_baseline)
PALPATE_DECLARE_ESTIMATE_BLOCK(isa_avx2)
PALPATE_DECLARE_ESTIMATE_BLOCK(isa_avx512)
#undef PALPATE_DECLARE_ESTIMATE_BLOCK

/// An instruction set that the processor lacks is lowered; all give the same bits.
EstimateBlock estimate_block_for(Isa isa);

}}  // namespace palpate::v0
