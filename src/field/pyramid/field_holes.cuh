// Holes of a field on a GPU: a block fills those of its square of level 0, from the runs of missing
// pixels between two surfaces, and from wider levels where there is no such run. It reads wider
// pixels also around its square, so that blocks need not wait for each other.
#pragma once

#include <cstddef>

#include "src/field/depth_field_cuda.h"
#include "src/field/pyramid/field_square.cuh"
#include "src/field/pyramid/gap_rules.h"

namespace palpate { inline namespace v0 { namespace {

/// Pixels that fill the holes of a square: of each level those from `start` on, counted from the
/// square's first one, as many as the level before reads.
struct Surroundings {
  static constexpr int kNum = 18 * 18 + 12 * 12 + 8 * 8 + 6 * 6 + 5 * 5;

  TangentPlane pixels[kNum];

  __device__ static int size(int level) {
    return level == 1 ? 18 : (level == 2 ? 12 : (level == 3 ? 8 : (level == 4 ? 6 : 5)));
  }
  __device__ static int start(int level) { return level == 1 ? -1 : -2; }
  __device__ static int first(int level) {
    int at = 0;
    for (int k = 1; k < level; ++k) at += size(k) * size(k);
    return at;
  }
  __device__ static int first_u(int level, int square) {
    return square * (kSquare >> level) + start(level);
  }
};

/// Returns the plane that fills the run of missing pixels around one of them, number `at` of `size`
/// in a row or column whose pixels lie `step` apart.
__device__ TangentPlane filling_at(const TangentPlane* pixel, int at, int size, std::ptrdiff_t step,
                                   float width) {
  const auto find_end = [&](int most, int sign) {
    int to = 1;
    while (to <= most && !pixel[sign * to * step].is_surface()) ++to;
    return to;
  };
  const int before = find_end(at < kMaxRun ? at : kMaxRun, -1);
  const int room = size - 1 - at, left = kMaxRun + 1 - before;
  if (before > at || left <= 0) return {};
  const int after = find_end(room < left ? room : left, 1);
  if (after > room || after > left) return {};
  return filling_of_run(pixel[-before * step], pixel[after * step],
                        static_cast<float>(before + after) * width);
}

/// Fills the holes among a thread's pixels of level 0. `around`: shared by the block.
__device__ void fill_quad(const FieldJob& job, const FieldArrays& arrays, const Place& place,
                          TangentPlane (&quad)[4], Surroundings& around) {
  // Calls f(u, v, pixel) for this thread's pixels of a level.
  const auto for_pixels = [&](int level, const auto& f) {
    const int size = Surroundings::size(level);
    const PyramidLayout::Level& image = job.layout.levels[level];
    for (int i = static_cast<int>(threadIdx.x); i < size * size; i += kThreads) {
      const int u = Surroundings::first_u(level, place.square_u) + i % size;
      const int v = Surroundings::first_u(level, place.square_v) + i / size;
      if (u < 0 || v < 0 || u >= image.width || v >= image.height) continue;
      f(u, v, around.pixels[Surroundings::first(level) + i]);
    }
  };
  // Interpolates `level` at pixel (u, v) of the level before.
  const auto look_up = [&](int level, int u, int v) {
    const PyramidLayout::Level& image = job.layout.levels[level];
    const int u1 = second_nearest(u, image.width), v1 = second_nearest(v, image.height);
    const auto at = [&](int wide_u, int wide_v) {
      return around.pixels[Surroundings::first(level) +
                           (wide_v - Surroundings::first_u(level, place.square_v)) *
                               Surroundings::size(level) +
                           wide_u - Surroundings::first_u(level, place.square_u)];
    };
    const TangentPlane four[4] = {at(u / 2, v / 2), at(u1, v / 2), at(u / 2, v1), at(u1, v1)};
    return interpolated(four, level);
  };
  for (int level = 1; level <= job.num_filled; ++level) {
    for_pixels(level, [&](int u, int v, TangentPlane& plane) {
      plane = *pixel(job, arrays.nearest, level, u, v);
    });
  }
  __syncthreads();
  for (int level = job.num_filled - 1; level >= 1; --level) {
    for_pixels(level, [&](int u, int v, TangentPlane& plane) {
      if (!plane.is_surface()) plane = look_up(level + 1, u, v);
    });
    __syncthreads();
  }
  for_quad(job, place, [&](int k, int u, int v) {
    if (quad[k].is_surface()) return;
    if (job.fills_runs) {
      const TangentPlane* const by_row = pixel(job, arrays.nearest, 0, u, v);
      quad[k] = by_row->is_surface() ? *by_row
                                     : filling_at(by_row, v, job.layout.levels[0].height,
                                                  job.layout.stride, job.width_v);
      if (job.filled != nullptr && quad[k].is_surface()) {
        atomicOr(job.filled + v * job.squares_wide + place.square_u, 1u << u % kSquare);
      }
    }
    if (!quad[k].is_surface()) quad[k] = look_up(1, u, v);
    *pixel(job, arrays.planes, 0, u, v) = quad[k];
  });
}

}}}  // namespace palpate::v0
