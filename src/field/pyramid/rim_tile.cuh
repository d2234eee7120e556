// The tile of a level in which one block looks for silhouettes: the pixels that it reads, and the
// block's shared memory, which holds their planes, bits and a list of those that may have a
// silhouette. The host chooses tiles of which this memory fits a multiprocessor.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "src/field/depth_field_cuda.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 { namespace {

constexpr int kReach = DepthFieldLevel::kSilhouetteReach;
constexpr int kWordBits = gpu::kWarpSize;

/// Columns or rows [begin, end).
struct Span {
  int begin, end;

  __device__ int size() const { return end - begin; }
  __device__ bool has(int at) const { return at >= begin && at < end; }
};

__device__ inline int clamped_to(int value, int least, int most) {
  return value < least ? least : (value > most ? most : value);
}

/// Along one axis of a level of `size` pixels: the tile, the pixels of it and just around it that
/// queries look at, and those whose planes are read. Beyond `around` pixels around the image all
/// planes are those of the last one.
struct RimSpans {
  Span tile, requested, planes;

  __device__ RimSpans(int first, int tile_size, int size, int around) {
    constexpr int kBorder = DepthFieldLevel::kBorder;
    const int end = first + tile_size;
    tile = {first, end < size + kBorder ? end : size + kBorder};
    requested = {clamped_to(tile.begin - 1, -kSilhouetteBorder, size + kSilhouetteBorder + 1),
                 clamped_to(tile.end + 1, -kSilhouetteBorder, size + kSilhouetteBorder + 1)};
    planes = {clamped_to(requested.begin - kReach, -around, size - 1 + around),
              clamped_to(requested.end + kReach - 1, -around, size - 1 + around) + 1};
  }
};

/// One bit per pixel of a block's rows, 32 to a word; one more word of a row is 0.
struct RimBits {
  std::uint32_t* words;
  int stride;

  __device__ std::uint32_t& at(int row, int word) const { return words[row * stride + word]; }
  /// Joins the bits of `num` rows.
  __device__ std::uint32_t any_of(int first_row, int num, int word) const {
    std::uint32_t bits = 0;
    for (int row = first_row; row < first_row + num; ++row) bits |= at(row, word);
    return bits;
  }
};

/// Returns the bits of a word, each spread to the `left` columns before it and the `right` columns
/// after it. `before` and `after` are the words beside it.
__device__ inline std::uint32_t widened_bits(std::uint32_t before, std::uint32_t word,
                                             std::uint32_t after, int left, int right) {
  std::uint32_t bits = word;
  for (int k = 1; k <= left; ++k) bits |= word >> k | after << (kWordBits - k);
  for (int k = 1; k <= right; ++k) bits |= word << k | before >> (kWordBits - k);
  return bits;
}

/// A block's shared memory, of the size that RimTiling says. Rows and columns of everything but the
/// planes are counted from kReach pixels before the first requested one.
struct RimMemory {
  static constexpr int kNumBits = 4;

  TangentPlane* planes;
  float* depths;      ///< surface_depth of the planes
  RimBits right;      ///< there is an edge between a pixel and the next one of its row
  RimBits sees_edge;  ///< there is an edge in reach in the pixel's own row, or just below it
  RimBits may_have;   ///< may have a silhouette; at the end: it or a neighbor has one
  RimBits has_any;    ///< has a silhouette
  int* has_edge;
  int* num_listed;  ///< from the front of the list, and from its end
  std::uint16_t* list;
  int list_size;
  /// Nearest edges in each pixel's own row: of an exit in the lowest three bits (columns to the
  /// pixel left of the edge, and kFoundBias; 0: none), of an occluder likewise from bit 4 on. Bit
  /// 3: there is an edge between the pixel and the one below.
  std::uint8_t* found;
  int found_stride;

  __device__ explicit RimMemory(const RimTiling& tiling)
      : planes(&gpu::shared_memory<TangentPlane>()),
        depths(reinterpret_cast<float*>(planes + tiling.num_planes)) {
    const int stride = tiling.num_words + 1;
    auto* words = reinterpret_cast<std::uint32_t*>(depths + tiling.num_planes);
    for (RimBits* bits : {&right, &sees_edge, &may_have, &has_any}) {
      *bits = {words, stride};
      words += tiling.num_rows * stride;
    }
    has_edge = reinterpret_cast<int*>(words);
    num_listed = has_edge + 1;
    list = reinterpret_cast<std::uint16_t*>(num_listed + 2);
    found_stride = tiling.num_words * kWordBits;
    list_size = tiling.num_rows * found_stride;
    found = reinterpret_cast<std::uint8_t*>(list + list_size);
  }

  static std::size_t num_bytes(const RimTiling& t) {
    const auto rows = static_cast<std::size_t>(t.num_rows);
    const auto words = static_cast<std::size_t>(t.num_words);
    return static_cast<std::size_t>(t.num_planes) * (sizeof(TangentPlane) + sizeof(float)) +
           kNumBits * rows * (words + 1) * sizeof(std::uint32_t) + 3 * sizeof(int) +
           rows * words * kWordBits * (sizeof *list + sizeof *found);
  }

  /// Puts the pixels of a word on the list. Their order does not matter.
  __device__ void put(std::uint32_t bits, int row, int word, bool at_end) const {
    if (bits == 0) return;
    int at = atomicAdd(num_listed + at_end, __popc(bits));
    for (; bits != 0; bits &= bits - 1, ++at) {
      const int column = word * kWordBits + __ffs(static_cast<int>(bits)) - 1;
      list[at_end ? list_size - 1 - at : at] =
          static_cast<std::uint16_t>(row << kColumnBits | column);
    }
  }
  static constexpr int kColumnBits = 8;
};
constexpr int kFoundBias = kReach + 1, kFoundBits = 4, kEdgeBelow = 8;

/// Returns the bits of columns [begin, end) that are in a word.
__device__ inline std::uint32_t span_bits(int begin, int end, int word) {
  const int first = clamped_to(begin - word * kWordBits, 0, kWordBits);
  const int last = clamped_to(end - word * kWordBits, 0, kWordBits);
  return static_cast<std::uint32_t>((std::uint64_t{1} << last) - (std::uint64_t{1} << first));
}

/// Returns the tiling of a level by tiles of a size.
RimTiling rim_tiling(const FieldJob& job, int level, int wide, int high) {
  // See RimSpans: pixels that are requested, and that have planes.
  const auto num_requested = [](int tile, int size) {
    return std::min(tile + 2, size + 2 * kSilhouetteBorder + 1);
  };
  const auto num_planes = [&](int tile, int size) {
    return std::min(num_requested(tile, size) + 2 * kReach, size + 2 * (job.going_on + 1));
  };
  const auto& image = job.layout.levels[level];
  RimTiling tiling{wide, high};
  tiling.num_planes = num_planes(wide, image.width) * num_planes(high, image.height);
  tiling.num_rows = num_requested(high, image.height) + 2 * kReach;
  tiling.num_words =
      (num_requested(wide, image.width) + 2 * kReach - 1 + kWordBits - 1) / kWordBits;
  tiling.shared_bytes = RimMemory::num_bytes(tiling);
  return tiling;
}

/// Returns large tiles of a level, which share little: as wide and high as shared memory allows,
/// all alike. Small levels are one tile each.
RimTiling large_rim_tiles(const FieldJob& job, int level) {
  constexpr std::size_t kMaxShared = 48 << 10;
  constexpr int kWide = 89, kWords = 3;  // with what is around it
  constexpr int kBorders = 2 * DepthFieldLevel::kBorder;
  const auto& image = job.layout.levels[level];
  const int columns = image.width + kBorders, rows = image.height + kBorders;
  const bool fits = rim_tiling(job, level, columns, 1).num_words <= kWords;
  for (int num = 1;; ++num) {
    const RimTiling tiling = rim_tiling(job, level, fits ? columns : kWide, (rows + num - 1) / num);
    if (tiling.shared_bytes <= kMaxShared) return tiling;
  }
}

}}}  // namespace palpate::v0
