// Reading and bilateral filter of depth (thesis eq. 3.12), compiled once per instruction set.
#include <algorithm>
#include <limits>

#include "src/cloud/frames/raw_depth.h"
#include "src/cloud/surface/bilateral.h"
#include "src/cloud/surface/flying_pixel.h"
#include "src/cloud/surface/surface_kernels.h"
#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

/// Sets a bit for each pixel of a padded row that is too far.
[[gnu::always_inline]] inline void mark_far(const float* depth, int width, std::uint64_t* bits) {
  constexpr int kWordBits = 64;
  for (int begin = 0; begin < width; begin += kWordBits) {
    std::uint64_t word = 0;
    for (int u = begin; u < std::min(begin + kWordBits, width); u += kLanes) {
      word |= std::uint64_t{mask_bits(load(depth + u) > kNoDepth)} << (u - begin);
    }
    *bits++ = word;
  }
}

/// Reads depth in scalar loops, which the compiler vectorizes.
template <class ToDepth>
[[gnu::always_inline]] inline int read_rows(const RawPass& pass, const PixelWindow& part,
                                            const ToDepth& to_depth) {
  int num_valid = 0;
  const int words_per_row = (pass.width + 63) / 64;
  for (int v = part.top; v < part.bottom; ++v) {
    float* const out = pass.out + v * pass.stride;
    const std::ptrdiff_t begin = static_cast<std::ptrdiff_t>(v) * pass.width;
    const float least = pass.min_depth, most = pass.max_depth;
    int num_far = 0;
    for (int u = part.left; u < part.right; ++u) {
      const float z = to_depth(begin + u);
      const bool valid = is_usable_depth(z, least, most), far = z > most;
      out[u] = valid ? z : far ? kFarDepth : kNoDepth;
      num_valid += valid;
      num_far += far;
    }
    std::uint64_t* const bits = pass.far + static_cast<std::ptrdiff_t>(v) * words_per_row;
    if (num_far > 0) {
      mark_far(out, pass.width, bits);
    } else {
      std::fill_n(bits, words_per_row, 0);
    }
  }
  return num_valid;
}

[[gnu::always_inline]] inline void filter_rows(const FilterPass& pass, const PixelWindow& part,
                                               int radius) {
  const VecF nan = splat(std::numeric_limits<float>::quiet_NaN());
  const VecF none = splat(kNoDepth), far = splat(kFar);
  for (int v = part.top; v < part.bottom; ++v) {
    const float* in = pass.in.row(v);
    float* out = pass.out + v * pass.in.stride;
    float* depth = pass.depth + static_cast<std::ptrdiff_t>(v) * pass.in.width;
    for (int u = part.left; u < part.right; u += kLanes) {
      const VecF z = load(in + u);
      Mask valid = z < kAnyDepth;
      if (pass.flying_gap > 0) valid &= ~is_flying(in + u, pass.in.stride, z, pass.flying_gap);
      VecF result = select(valid, z, none);
      if (radius > 0 && is_any_set(valid)) {
        result = select(valid, filtered(in + u, pass.in.stride, z, radius, pass.space, pass.range),
                        none);
      }
      store(out + u, result);  // lanes beyond the width are margin and stay kNoDepth
      store_first(depth + u, select(valid, result, select(z > none, far, nan)), pass.in.width - u);
    }
  }
}

}  // namespace

int read_depth(const RawPass& pass, const PixelWindow& part) {
  const auto read = [&](const auto& to_depth) {
    const std::uint32_t* const from = pass.raw_pixels;
    if (from == nullptr) return read_rows(pass, part, to_depth);
    return read_rows(pass, part, [&to_depth, from, num = pass.num_pixels](std::ptrdiff_t i) {
      return from[i] < num ? to_depth(from[i]) : 0.0f;
    });
  };
  if (const float* const meters = pass.meters; pass.counts == nullptr) {
    return read([meters](std::ptrdiff_t i) { return meters[i]; });
  }
  const std::uint16_t* const counts = pass.counts;
  const double unit = pass.unit;
  return read([counts, unit](std::ptrdiff_t i) { return depth_of(counts[i], unit); });
}

void filter_depth(const FilterPass& pass, const PixelWindow& part) {
  if (pass.radius == 2) {
    filter_rows(pass, part, 2);  // the default, unrolled
  } else {
    filter_rows(pass, part, pass.radius);
  }
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
