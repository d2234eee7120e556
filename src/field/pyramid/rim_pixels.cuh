// Pixels at the rims of surfaces: edges between two of them, the search for the edges that are
// nearest to a pixel, and the pixels beyond an image, where its outermost surface goes on.
#pragma once

#include <cstddef>

#include "src/field/depth_field_cuda.h"
#include "src/field/pyramid/gap_rules.h"
#include "src/field/pyramid/rim_tile.cuh"

namespace palpate { inline namespace v0 { namespace {

using one_lane::RulePlane;

/// A pixel's plane and depth.
struct RimPixel {
  RulePlane plane;
  float depth;
};

__device__ inline bool is_edge(const RimPixel& a, const RimPixel& b, float width) {
  const bool a_is_near = one_lane::is_nearer(a.plane, b.plane);
  return one_lane::ends_between(a_is_near ? a.plane : b.plane, a_is_near ? a.depth : b.depth,
                                a_is_near ? b.plane : a.plane, width);
}

/// The two sides of an edge.
struct Edge {
  RimPixel near, far;

  __device__ Edge(const RimPixel& a, const RimPixel& b) {
    const bool a_is_near = one_lane::is_nearer(a.plane, b.plane);
    near = a_is_near ? a : b;
    far = a_is_near ? b : a;
  }
};

/// Search for the nearest silhouettes of a pixel among those that are offered. Edges farther than a
/// known one are skipped.
struct RimSearch {
  RimPixel own;
  one_lane::NearestSilhouette exit, occluder;

  __device__ bool wants_exit(float squared) const {
    return own.plane.slope > 0.0f && squared < exit.squared;
  }
  __device__ bool wants_occluder(float squared) const { return squared < occluder.squared; }
  __device__ static void set(one_lane::NearestSilhouette& to, float du, float dv, float squared,
                             const RulePlane& other) {
    to = {du, dv, squared, other};
  }
  __device__ void offer_exit(const Edge& edge, float du, float dv,
                             const one_lane::ExitLimits& limits) {
    const float squared = du * du + dv * dv;
    if (wants_exit(squared) && one_lane::is_exit(own.plane, limits, edge.far.plane)) {
      set(exit, du, dv, squared, edge.far.plane);
    }
  }
  __device__ void offer_occluder(const Edge& edge, float du, float dv, float width) {
    const float squared = du * du + dv * dv;
    if (wants_occluder(squared) && one_lane::is_occluder(own.plane, own.depth, edge.near.plane,
                                                         edge.near.depth, squared, width)) {
      set(occluder, du, dv, squared, edge.near.plane);
    }
  }
};

/// Returns the plane of a pixel beyond the image, where its outermost surface goes on.
__device__ TangentPlane plane_beyond(const TangentPlane* image, std::ptrdiff_t stride, int width,
                                     int height, int u, int v, int level) {
  // Pixel `at` of a line of `size`, from those inside of the image.
  const auto in_line = [=](int at, int size, const auto& inside) {
    if (at >= 0 && at < size) return inside(at);
    const int last = at < 0 ? 0 : size - 1, inwards = at < 0 ? 1 : -1;
    const TangentPlane line[GoingOn::kNum] = {inside(last), inside(last + inwards),
                                              inside(last + 2 * inwards),
                                              inside(last + 3 * inwards)};
    return GoingOn(line, level).at(at < 0 ? -at : at - last);
  };
  return in_line(v, height, [&](int row) {
    return in_line(u, width, [&](int column) { return image[row * stride + column]; });
  });
}

/// Pixels along one axis of a tile's planes that lie beyond an image of `size`, where its outermost
/// surface goes on for `going_on` pixels.
struct BeyondSpan {
  int size, num_before, num_after;

  /// A pixel, the last one of the image before it, the step from there into the image, and the
  /// distance from there.
  struct Pixel {
    int place, last, inwards, from;
  };

  __device__ BeyondSpan(const Span& planes, int image_size, int going_on) : size(image_size) {
    num_before = clamped_to(-planes.begin, 0, going_on);
    num_after = clamped_to(planes.end - size, 0, going_on);
  }
  /// Are the pixels by which the surface goes on among the planes?
  __device__ static bool has_line(const Span& planes, int size) {
    return size >= GoingOn::kNum && (planes.begin >= 0 || planes.end >= GoingOn::kNum) &&
           (planes.end <= size || planes.begin <= size - GoingOn::kNum);
  }
  __device__ int num() const { return num_before + num_after; }
  __device__ Pixel at(int number) const {
    if (number < num_before) return {-1 - number, 0, 1, number + 1};
    const int from = number - num_before + 1;
    return {size - 1 + from, size - 1, -1, from};
  }
};

/// Joins a pixel of a level beyond the image into the tiles at the border: those of the outermost
/// pixels bound the others.
__device__ void join_tiles(const FieldJob& job, DepthTile* tiles, int level, int u, int v,
                           const TangentPlane& plane) {
  constexpr int kSize = DepthFieldView::kTileSize;
  const DepthTile tile = tile_of<DepthTile>(plane);
  // Tiles that show column or row `at` of a level.
  const auto find = [&](int at, int size, int num) -> Span {
    if (at < 0) return {0, 1};
    if (at >= size) return {num - 1, num};
    const int last = ((at + 1) * (1 << level) - 1) / kSize;
    return {at * (1 << level) / kSize, (last < num ? last : num - 1) + 1};
  };
  const PyramidLayout::Level& image = job.layout.levels[level];
  const int tiles_wide = job.layout.tiles_wide(), tiles_high = job.layout.tiles_high();
  const Span us = find(u, image.width, tiles_wide), vs = find(v, image.height, tiles_high);
  for (int y = vs.begin; y < vs.end; ++y) {
    for (int x = us.begin; x < us.end; ++x) {
      DepthTile& to = tiles[y * tiles_wide + x];
      // Their bits grow as positive numbers do.
      atomicMin(reinterpret_cast<int*>(&to.nearest), one_lane::bits_of(tile.nearest));
      atomicMin(reinterpret_cast<int*>(&to.min_slope), one_lane::bits_of(tile.min_slope));
    }
  }
}

}}}  // namespace palpate::v0
