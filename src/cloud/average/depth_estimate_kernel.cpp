// Estimates of depth over time, compiled once per instruction set.
#include "src/cloud/average/depth_estimate_kernel.h"

#include <algorithm>
#include <limits>

#include "src/cloud/frames/raw_depth.h"
#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

constexpr int kSide = kEstimateBlock, kTile = kEstimateTile;

/// Measurements and gains of a block, row by row; there are no measurements beyond the image.
struct Block {
  alignas(64) float measured[kSide * kSide];
  alignas(64) float own_gain[kSide * kSide];
  int left, top, width, height;  ///< in the image
};

[[gnu::always_inline]] inline void read(const EstimatePass& pass, Block& block) {
  const double unit = pass.unit;
  for (int v = 0; v < block.height; ++v) {
    const std::uint16_t* const counts =
        pass.counts + static_cast<std::ptrdiff_t>(block.top + v) * pass.width + block.left;
    float* const to = block.measured + v * kSide;
    // A scalar loop, which the compiler vectorizes.
    for (int u = 0; u < block.width; ++u) to[u] = depth_of(counts[u], unit);
    for (int u = block.width; u < kSide; ++u) to[u] = 0;
  }
}

/// Copies a number of each tile of a row of tiles to all of its columns.
template <class OfTile>
[[gnu::always_inline]] inline void spread(float* columns, const OfTile& of_tile) {
  for (int tile = 0; tile < kTilesPerBlock; ++tile) {
    std::fill_n(columns + tile * kTile, kTile, of_tile(tile));
  }
}

/// Sums over each column of a row of tiles, from the top down: the same in vectors of any width.
struct ColumnSums {
  alignas(64) float sum[kSide], num[kSide], bounded[kSide], num_seen[kSide], squares[kSide],
      num_known[kSide], num_gone[kSide];
};

[[gnu::always_inline]] inline void add_deviations(const EstimatePass& pass, Block& block, int v0,
                                                  const float* scales, ColumnSums& columns) {
  const int rows = std::min(kTile, block.height - v0);
  for (int u = 0; u < kSide; u += kLanes) {
    const VecF scale = load(scales + u);
    VecF sum{}, num{}, bounded{}, num_seen{}, squares{}, num_known{}, num_gone{};
    for (int v = v0; v < v0 + rows; ++v) {
      const std::ptrdiff_t at = (block.top + v) * pass.stride + block.left + u;
      const int i = v * kSide + u;
      const PixelDeviation d = deviation_of(load(block.measured + i), load(pass.mean + at),
                                            load(pass.gain + at), scale, pass.model);
      store(block.own_gain + i, d.gain);
      sum += d.sum;
      num += d.num;
      bounded += d.bounded;
      num_seen += d.num_seen;
      squares += d.squares;
      num_known += d.num_known;
      num_gone += d.num_gone;
    }
    store(columns.sum + u, sum);
    store(columns.num + u, num);
    store(columns.bounded + u, bounded);
    store(columns.num_seen + u, num_seen);
    store(columns.squares + u, squares);
    store(columns.num_known + u, num_known);
    store(columns.num_gone + u, num_gone);
  }
}

[[gnu::always_inline]] inline void find_changes(const EstimatePass& pass, Block& block,
                                                BlockMemory& memory, BlockChange& all) {
  alignas(64) float scales[kSide];
  for (int v = 0; v < kTilesPerBlock; ++v) {
    ColumnSums columns{};
    const int first = v * kTilesPerBlock;
    spread(scales, [&](int u) { return memory.noise_scale(first + u); });
    if (v * kTile < block.height) add_deviations(pass, block, v * kTile, scales, columns);
    for (int u = 0; u < kTilesPerBlock; ++u) {
      TileSum tile;
      for (int i = u * kTile; i < (u + 1) * kTile; ++i) {
        tile.deviations.sum += columns.sum[i];
        tile.deviations.num += columns.num[i];
        tile.bounded.sum += columns.bounded[i];
        tile.bounded.num += columns.num_seen[i];
        tile.squares += columns.squares[i];
        tile.num_known += columns.num_known[i];
        tile.num_gone += columns.num_gone[i];
      }
      all.take(first + u, tile);
      all.test(0, first + u, memory, pass.model);
      memory.learn_noise(first + u, tile, scales[u * kTile]);
    }
  }
  for (int level = 1; level < kEstimateLevels; ++level) {
    const int side = level_side(level);
    for (int i = 0; i < side * side; ++i) {
      all.join(level, i % side, i / side);
      all.test(level, first_entry(level) + i, memory, pass.model);
    }
  }
  for (int level = 0; level < kEstimateLevels; ++level) all.learn_turns(level, memory);
}

[[gnu::always_inline]] inline void estimate(const EstimatePass& pass, const Block& block,
                                            const BlockChange& all) {
  const VecF nan = splat(std::numeric_limits<float>::quiet_NaN());
  for (int v0 = 0; v0 < block.height; v0 += kTile) {
    alignas(64) float follow[kSide], gain[kSide], keep[kSide];
    SharedChange tiles[kTilesPerBlock];
    for (int u = 0; u < kTilesPerBlock; ++u) tiles[u] = all.of_tile(u, v0 / kTile);
    spread(follow, [&](int u) { return tiles[u].follow; });
    spread(gain, [&](int u) { return tiles[u].gain; });
    spread(keep, [&](int u) { return tiles[u].keep; });
    for (int v = v0; v < std::min(v0 + kTile, block.height); ++v) {
      float* const depth =
          pass.depth + static_cast<std::ptrdiff_t>(block.top + v) * pass.width + block.left;
      for (int u = 0; u < block.width; u += kLanes) {
        const std::ptrdiff_t at = (block.top + v) * pass.stride + block.left + u;
        const int i = v * kSide + u;
        const PixelEstimate e = estimate_of(
            load(block.measured + i), load(pass.mean + at), load(pass.gain + at),
            load(block.own_gain + i), load(follow + u), load(gain + u), load(keep + u), pass.model);
        store(pass.mean + at, e.mean);
        store(pass.gain + at, e.gain);
        store_first(depth + u, select(e.depth > splat(0.0f), e.depth, nan), block.width - u);
      }
    }
  }
}

}  // namespace

void estimate_block(const EstimatePass& pass, int index) {
  Block block;
  block.left = index % pass.blocks_per_row() * kSide;
  block.top = index / pass.blocks_per_row() * kSide;
  block.width = std::min(kSide, pass.width - block.left);
  block.height = std::min(kSide, pass.height - block.top);
  BlockChange changes;
  read(pass, block);
  find_changes(pass, block, pass.blocks[index], changes);
  estimate(pass, block, changes);
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
