// Finds the pixels measured as too far that are free: the rules of far_pixels.h. A block does one
// tile with a margin as wide as an error can be: a group that goes on beyond is larger. Groups grow
// bit by bit.
#pragma once

#include "src/cloud/frames/far_pixels.h"
#include "src/cloud/surface/surface_kernels.cuh"

namespace palpate { inline namespace v0 { namespace one_lane { namespace {

inline constexpr int kFarThreads = 256;
inline constexpr int kFarRows = kStripRows + 2 * kFarSide, kFarWords = 3;
static_assert(kFarSide == kTileWidth && kTileWidth == 32 && kFarRows * kFarWords <= kFarThreads);

/// The tile and its surroundings: of each row the words left of the tile, of the tile and right.
struct FarShared {
  unsigned far[kFarRows][kFarWords];  // not decided yet
  unsigned group[kFarRows][kFarWords];
  unsigned free[kStripRows];
  int is_growing;
  int num, left, top, right, bottom, nearest, farthest;  // of the group; depths by their bits
};

/// The bits of a word of `rows` and those around them.
__device__ inline unsigned widened_bits(const unsigned (&rows)[kFarRows][kFarWords], int row,
                                        int word) {
  unsigned all = 0;
  for (int r = row > 0 ? row - 1 : 0; r <= row + 1 && r < kFarRows; ++r) {
    const unsigned middle = rows[r][word];
    all |= middle | middle << 1 | middle >> 1;
    if (word > 0) all |= rows[r][word - 1] >> 31;
    if (word + 1 < kFarWords) all |= rows[r][word + 1] << 31;
  }
  return all;
}

/// Adds to the group what is connected to it. All threads call; each has one word.
__device__ inline void grow_group(FarShared& shared, bool has_word, int row, int word) {
  do {
    __syncthreads();
    if (threadIdx.x == 0) shared.is_growing = 0;
    const unsigned grown =
        has_word ? widened_bits(shared.group, row, word) & shared.far[row][word] : 0;
    __syncthreads();
    if (has_word && grown != shared.group[row][word]) {
      shared.group[row][word] = grown;
      shared.is_growing = 1;
    }
    __syncthreads();
  } while (shared.is_growing != 0);
}

/// True if the group is an error. All threads call.
__device__ inline bool is_group_error(const FilterJob& job, const Tile& tile, FarShared& shared,
                                      bool has_word, int row, int word) {
  if (threadIdx.x == 0) {
    shared.num = 0;
    shared.left = shared.top = 1 << 20;
    shared.right = shared.bottom = -1;
    shared.nearest = __float_as_int(kNoDepth);
    shared.farthest = 0;
  }
  __syncthreads();
  const unsigned own = has_word ? shared.group[row][word] : 0;
  if (own != 0) {
    atomicAdd(&shared.num, __popc(own));
    atomicMin(&shared.top, row);
    atomicMax(&shared.bottom, row);
    atomicMin(&shared.left, 32 * word + __ffs(static_cast<int>(own)) - 1);
    atomicMax(&shared.right, 32 * word + 31 - __clz(static_cast<int>(own)));
  }
  unsigned beside = has_word ? widened_bits(shared.group, row, word) & ~own : 0;
  for (; beside != 0; beside &= beside - 1) {
    const int u = tile.u0 + 32 * (word - 1) + __ffs(static_cast<int>(beside)) - 1;
    const int v = tile.v0 + row - kFarSide;
    if (u < 0 || v < 0 || u >= job.tiling.width || v >= job.tiling.height) continue;
    const float z = raw_depth(job, tile.image, u, v);
    if (!(z < kAnyDepth)) continue;
    atomicMin(&shared.nearest, __float_as_int(z));
    atomicMax(&shared.farthest, __float_as_int(z));
  }
  __syncthreads();
  const int width = shared.right - shared.left + 1, height = shared.bottom - shared.top + 1;
  return is_far_error(shared.num, width > height ? width : height, __int_as_float(shared.nearest),
                      __int_as_float(shared.farthest));
}

/// Returns the row of the first undecided pixel of the tile; -1: none.
__device__ inline int first_undecided(const FarShared& shared) {
  for (int row = kFarSide; row < kFarSide + kStripRows; ++row) {
    if (shared.far[row][1] != 0) return row;
  }
  return -1;
}

/// Finds the free pixels of a tile: bits of shared.free. False: there are none. All threads of a
/// block call, at least kFarThreads.
__device__ inline bool find_free(const FilterJob& job, const Tile& tile, FarShared& shared) {
  const int thread = static_cast<int>(threadIdx.x);
  const int row = thread / kFarWords, word = thread % kFarWords;
  const bool has_word = row < kFarRows;
  if (has_word) {
    const int v = tile.v0 + row - kFarSide, column = tile.u0 / kTileWidth + word - 1;
    const bool inside =
        v >= 0 && v < job.tiling.height && column >= 0 && column < job.tiling.tiles_per_row;
    shared.far[row][word] = inside ? job.far[job.tiling.word(tile.image, v, column)] : 0;
  }
  __syncthreads();
  if (first_undecided(shared) < 0) return false;

  const bool is_own = has_word && word == 1 && row >= kFarSide && row < kFarSide + kStripRows;
  if (is_own) shared.free[row - kFarSide] = 0;
  for (int first = first_undecided(shared); first >= 0; first = first_undecided(shared)) {
    if (has_word) {
      const unsigned bits = row == first && word == 1 ? shared.far[row][word] : 0;
      shared.group[row][word] = bits & (0u - bits);  // the lowest
    }
    grow_group(shared, has_word, row, word);
    const bool is_error = is_group_error(job, tile, shared, has_word, row, word);
    if (is_own && !is_error) shared.free[row - kFarSide] |= shared.group[row][word];
    if (has_word) shared.far[row][word] &= ~shared.group[row][word];
    __syncthreads();
  }
  return true;
}

}}}}  // namespace palpate::v0::one_lane
