// Unprojection and normals by a plane fit (thesis section 3.4, eqs. 3.7-3.11), compiled once per
// instruction set: kLanes pixels of a row at once, a strip of rows at a time.
#include <limits>

#include "src/cloud/surface/surface_kernels.h"
#include "src/cloud/surface/window_moments.h"
#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

inline VecF column_reference(const PaddedDepth& in, int u, int row_begin, int row_end) {
  const int num_rows = row_end - row_begin;
  VecF reference = splat(kNoDepth);
  for (int i = 0; i < num_rows; ++i) {
    const VecF z = load(in.row(row_begin + reference_row(i, num_rows)) + u);
    reference = select(reference < kAnyDepth, reference, z);
  }
  return reference;
}

inline PixelFrame frame_at(const NormalPass& pass, int u, int v) {
  return {load(pass.ray_x + u), splat(pass.ray_y[v]), pass.pixel_x, pass.pixel_y};
}

// Writes kLanes pixels of the cloud and returns how many are points.
[[gnu::always_inline]] inline int store_points(const NormalPass& pass, int u, int v,
                                               const Neighbors& neighbors, bool along_ray) {
  const VecF nan = splat(std::numeric_limits<float>::quiet_NaN());
  const VecF z = load(pass.in.row(v) + u);
  const PixelFrame frame = frame_at(pass, u, v);
  const UnitNormal normal = unit_normal(neighbors.e, frame, along_ray);
  const VecI valid = neighbors.valid & normal.exists;
  const VecF values[6] = {frame.ray_x * z, frame.ray_y * z, z, normal.n.x, normal.n.y, normal.n.z};
  const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(v) * pass.in.width + u;
  for (int channel = 0; channel < 6; ++channel) {
    store_first(pass.cloud[channel] + at, select(valid, values[channel], nan), pass.in.width - u);
  }
  return __builtin_popcount(mask_bits(valid));
}

// Rows of one column of pixels, in order.
struct RowsAround {
  const WindowRow* center;

  [[gnu::always_inline]] const WindowRow& operator()(int k) const { return center[k]; }
};

// kLanes columns of a strip. Each step runs over all rows before the next starts: the eigenvectors
// are long chains of dependent operations, and only neighbors of their kind can fill the gaps.
[[gnu::always_inline]] inline int do_columns(const NormalPass& pass, int u, int row_begin,
                                             int row_end, int radius, bool along_ray) {
  const bool separable = !pass.anchoring && !pass.weighting && !pass.normalization;
  const VecF reference = column_reference(pass.in, u, row_begin, row_end);
  WindowRow rows[kStripRows + 2 * kMaxWindowRadius];
  if (separable && mask_bits(reference < kAnyDepth) != 0) {
    for (int v = row_begin - radius; v < row_end + radius; ++v) {
      rows[v - row_begin + radius] = sum_row(pass.in.row(v) + u, reference, radius);
    }
  }

  const VecI none = VecI{};
  Neighbors neighbors[kStripRows];
  for (int v = row_begin; v < row_end; ++v) {
    Neighbors& here = neighbors[v - row_begin];
    here.valid = none;
    const float* center = pass.in.row(v) + u;
    const VecF z = load(center);
    const VecI valid = z < kAnyDepth;
    if (mask_bits(valid) == 0) continue;
    VecI whole = none;
    if (separable) {
      const RowsAround around{rows + (v - row_begin + radius)};
      const WholeWindow window = sum_columns(around, reference, radius);
      whole = valid & is_whole(window, z, pass.max_depth_change);
      here = {covariance(window.sums, mean_of(window.sums)), whole};
    }
    const VecI rest = valid & ~whole;
    if (mask_bits(rest) != 0) {
      const Neighbors direct = gather_directly(pass, center, frame_at(pass, u, v), radius);
      here = {blend(whole, here.e, direct.e), whole | (rest & direct.valid)};
    }
  }

  int num_points = 0;
  for (int v = row_begin; v < row_end; ++v) {
    num_points += store_points(pass, u, v, neighbors[v - row_begin], along_ray);
  }
  return num_points;
}

}  // namespace

int estimate_normals(const NormalPass& shared, const PixelWindow& part) {
  const NormalPass pass = shared;  // a local copy: no store can alias it
  int num_points = 0;
  for (int u = part.left; u < part.right; u += kLanes) {
    if (pass.radius != 3) {
      num_points += do_columns(pass, u, part.top, part.bottom, pass.radius, pass.along_ray);
    } else if (pass.along_ray) {  // unrolled
      num_points += do_columns(pass, u, part.top, part.bottom, 3, true);
    } else {
      num_points += do_columns(pass, u, part.top, part.bottom, 3, false);
    }
  }
  return num_points;
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
