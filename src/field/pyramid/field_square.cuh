// A square of an image, of which one block makes all levels: its place, the pixels of its levels in
// shared memory, and the steps that the kernels of a field have in common. So no level is read back
// from memory to make the next one.
#pragma once

#include <cstddef>

#include "src/field/depth_field_cuda.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 { namespace {

// A block makes all levels of a square of level 0, of which the widest level has one pixel. A
// thread has two by two pixels of level 0.
constexpr int kLevels = DepthFieldView::kMaxLevels;
constexpr int kSquare = 1 << (kLevels - 1), kQuads = kSquare / 2, kThreads = kQuads * kQuads;
constexpr int kTile = DepthFieldView::kTileSize;
static_assert(kSquare == 2 * kTile && kThreads == 256);

/// The pixels of the levels from 1 on that belong to a square.
struct SquareLevels {
  SharedPixel<TangentPlane> pixels[(kThreads * 4 - 1) / 3];

  __device__ static int first(int level) {
    int at = 0;
    for (int k = 1; k < level; ++k) at += (kSquare >> k) * (kSquare >> k);
    return at;
  }
  __device__ SharedPixel<TangentPlane>& at(int level, int x, int y) {
    return pixels[first(level) + y * (kSquare >> level) + x];
  }
};

/// A square of an image and this thread's place in it.
struct Place {
  int image;
  int square_u, square_v;  ///< number of the square
  int x, y;                ///< of the thread's pixel of level 1 in the square

  __device__ Place(const FieldJob& job)
      : image(static_cast<int>(blockIdx.x) / job.num_squares()),
        square_u(static_cast<int>(blockIdx.x) % job.num_squares() % job.squares_wide),
        square_v(static_cast<int>(blockIdx.x) % job.num_squares() / job.squares_wide),
        x(static_cast<int>(threadIdx.x) % kQuads),
        y(static_cast<int>(threadIdx.x) / kQuads) {}

  /// First column and row of the thread's four pixels.
  __device__ int u() const { return square_u * kSquare + 2 * x; }
  __device__ int v() const { return square_v * kSquare + 2 * y; }
};

template <class Pixel>
__device__ Pixel* pixel(const FieldJob& job, Pixel* pixels, int level, int u, int v) {
  return pixels + job.layout.origin(level) + static_cast<std::ptrdiff_t>(v) * job.layout.stride + u;
}

/// Makes the levels 1..top of a square in `out`, and with Choice::majority their shares, from the
/// four pixels that each thread has of level 0. Entries of `quad` outside of the image are ignored.
__device__ void widen_square(const FieldJob& job, const Place& place, const TangentPlane (&quad)[4],
                             int top, Choice choice, TangentPlane* out, float* shares,
                             SquareLevels& levels) {
  if (top < 1) return;
  const auto store = [&](int level, int x, int y, const SharedPixel<TangentPlane>& wide) {
    levels.at(level, x, y) = wide;
    const int u = place.square_u * (kSquare >> level) + x;
    const int v = place.square_v * (kSquare >> level) + y;
    *pixel(job, out, level, u, v) = wide.plane;
    if (choice == Choice::majority) *pixel(job, shares, level, u, v) = wide.share;
  };
  const auto inside = [&](int level, int x, int y) {
    const int size = kSquare >> level;
    return place.square_u * size + x < job.layout.levels[level].width &&
           place.square_v * size + y < job.layout.levels[level].height;
  };
  if (inside(1, place.x, place.y)) {
    const SharedPixel<TangentPlane> four[4] = {
        {quad[0], 1}, {quad[1], 1}, {quad[2], 1}, {quad[3], 1}};
    store(1, place.x, place.y, widened(four, 1, choice));
  }
  for (int level = 2; level <= top; ++level) {
    __syncthreads();
    const int size = kSquare >> level;
    const int x = static_cast<int>(threadIdx.x) % size, y = static_cast<int>(threadIdx.x) / size;
    if (y >= size || !inside(level, x, y)) continue;  // to the next barrier
    // At an odd end the last one counts twice.
    const int x1 = 2 * x + inside(level - 1, 2 * x + 1, 2 * y);
    const int y1 = 2 * y + inside(level - 1, 2 * x, 2 * y + 1);
    const SharedPixel<TangentPlane> four[4] = {
        levels.at(level - 1, 2 * x, 2 * y), levels.at(level - 1, x1, 2 * y),
        levels.at(level - 1, 2 * x, y1), levels.at(level - 1, x1, y1)};
    store(level, x, y, widened(four, level, choice));
  }
}

/// Calls f(index in the quad, u, v) for those of a thread's four pixels that are in the image.
template <class F>
__device__ void for_quad(const FieldJob& job, const Place& place, const F& f) {
  const PyramidLayout::Level& image = job.layout.levels[0];
  for (int k = 0; k < 4; ++k) {
    const int u = place.u() + k % 2, v = place.v() + k / 2;
    if (u < image.width && v < image.height) f(k, u, v);
  }
}

/// At an odd end the last pixel counts twice.
__device__ void complete_quad(const FieldJob& job, const Place& place, TangentPlane (&quad)[4]) {
  if (place.u() + 1 >= job.layout.levels[0].width) quad[1] = quad[0], quad[3] = quad[2];
  if (place.v() + 1 >= job.layout.levels[0].height) quad[2] = quad[0], quad[3] = quad[1];
}

constexpr int kWarps = kThreads / gpu::kWarpSize;

struct SquareScratch {
  SquareLevels levels;
  DepthTile tiles[kWarps][2];  // of each warp's pixels in the left and the right tile
};

/// Makes the tiles and the wider levels of a square without holes.
__device__ void finish_square(const FieldJob& job, const FieldArrays& arrays, const Place& place,
                              TangentPlane (&quad)[4], SquareScratch& shared) {
  // A warp has two rows of 16 threads: the left half of each is in one tile.
  DepthTile tile = empty_tile<DepthTile>();
  for_quad(job, place, [&](int k, int, int) { tile = join(tile, tile_of<DepthTile>(quad[k])); });
  for (int step = 1; step < gpu::kWarpSize; step *= 2) {
    if (step == kTile / 2) continue;
    tile = join(tile, {__shfl_xor_sync(gpu::kWholeWarp, tile.nearest, step),
                       __shfl_xor_sync(gpu::kWholeWarp, tile.min_slope, step)});
  }
  const int lane = gpu::lane_id();
  if (lane % 8 == 0 && lane < 16) shared.tiles[gpu::warp_id()][lane / 8] = tile;

  complete_quad(job, place, quad);
  widen_square(job, place, quad, job.layout.num_levels - 1, Choice::majority, arrays.planes,
               arrays.shares, shared.levels);
  __syncthreads();
  if (threadIdx.x < 4) {
    const int side = static_cast<int>(threadIdx.x) % 2, row = static_cast<int>(threadIdx.x) / 2;
    DepthTile all = empty_tile<DepthTile>();
    for (int k = 0; k < kWarps / 2; ++k) all = join(all, shared.tiles[row * kWarps / 2 + k][side]);
    const int u = 2 * place.square_u + side, v = 2 * place.square_v + row;
    const int tiles_wide = (job.layout.levels[0].width + kTile - 1) / kTile;
    const int tiles_high = (job.layout.levels[0].height + kTile - 1) / kTile;
    if (u < tiles_wide && v < tiles_high) arrays.tiles[v * tiles_wide + u] = all;
  }
}

}}}  // namespace palpate::v0
