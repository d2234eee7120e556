#include "src/cloud/surface_stages.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "palpate/core/assert.h"
#include "src/cloud/raw_depth.h"
#include "src/cloud/surface_settings.h"

namespace palpate {
namespace {

constexpr int kMargin = PaddedDepth::kMargin;
static_assert(kMargin >= kMaxWindowRadius);

SurfaceKernels kernels_for(Isa isa) {
#if defined(__x86_64__)
  if (isa == Isa::avx512) {
    return {isa_avx512::filter_depth, isa_avx512::estimate_normals, isa_avx512::find_depth_change};
  }
  if (isa == Isa::avx2) {
    return {isa_avx2::filter_depth, isa_avx2::estimate_normals, isa_avx2::find_depth_change};
  }
#endif
  (void)isa;
  return {isa_baseline::filter_depth, isa_baseline::estimate_normals,
          isa_baseline::find_depth_change};
}

// A row of whole vectors, and margins on both sides.
std::ptrdiff_t padded_stride(int width) {
  return (width + kMargin - 1) / kMargin * kMargin + 2 * kMargin;
}

std::vector<float> padded_image(int height, std::ptrdiff_t stride) {
  return std::vector<float>(static_cast<std::size_t>((height + 2 * kMargin) * stride), kNoDepth);
}

float* first_pixel(std::vector<float>& padded, std::ptrdiff_t stride) {
  return padded.data() + kMargin * stride + kMargin;
}

}  // namespace

SurfaceStages::SurfaceStages(int width, int height, const Intrinsics& k,
                             const SurfaceOptions& options, Isa isa)
    : options_(options),
      kernels_(kernels_for(std::min(isa, best_isa()))),
      width_(width),
      height_(height),
      stride_(padded_stride(width)),
      raw_(padded_image(height, stride_)),
      filtered_(padded_image(height, stride_)),
      ray_x_(ray_table(width, k.fx, k.cx)),
      ray_y_(ray_table(height, k.fy, k.cy)),
      space_(space_exponents(options.filter)),
      strip_counts_(static_cast<std::size_t>((height + kStripRows - 1) / kStripRows)),
      cloud_(width, height, k) {
  const std::size_t num_pixels = cloud_.size();
  depth_.assign(num_pixels, std::numeric_limits<float>::quiet_NaN());
  for (std::vector<float>& axis : change_) axis.assign(num_pixels, 0.0f);

  filter_pass_ = filter_settings(options.filter);
  filter_pass_.in = {first_pixel(raw_, stride_), stride_, width, height};
  filter_pass_.out = first_pixel(filtered_, stride_);
  filter_pass_.depth = depth_.data();
  filter_pass_.space = space_.data();

  normal_pass_ = normal_settings(options.normals, k);
  normal_pass_.in = {first_pixel(filtered_, stride_), stride_, width, height};
  for (int channel = 0; channel < 6; ++channel) {
    normal_pass_.cloud[channel] = cloud_.channel(channel);
  }
  normal_pass_.ray_x = ray_x_.data();
  normal_pass_.ray_y = ray_y_.data();

  change_pass_.in = normal_pass_.in;
  for (int axis = 0; axis < 3; ++axis) change_pass_.change[axis] = change_[axis].data();
  change_pass_.ray_x = ray_x_.data();
  change_pass_.ray_y = ray_y_.data();
  change_pass_.min_step = static_cast<float>(options.depth_change.min_step);
}

// Runs `task(row_begin, row_end)`, which returns a count, for each strip.
template <class Task>
int SurfaceStages::sum_over_strips(ThreadPool& pool, const Task& task) {
  pool.parallel_for(static_cast<int>(strip_counts_.size()), [&](int strip) {
    const int row_begin = strip * kStripRows;
    strip_counts_[static_cast<std::size_t>(strip)] =
        task(row_begin, std::min(row_begin + kStripRows, height_));
  });
  return std::accumulate(strip_counts_.begin(), strip_counts_.end(), 0);
}

template <class ToDepth>
int SurfaceStages::read_pixels(ThreadPool& pool, const ToDepth& to_depth) {
  const float min_depth = static_cast<float>(options_.min_depth);
  const float max_depth = static_cast<float>(options_.max_depth);
  return sum_over_strips(pool, [&](int row_begin, int row_end) {
    int num_valid = 0;
    for (int v = row_begin; v < row_end; ++v) {
      float* out = first_pixel(raw_, stride_) + v * stride_;
      const std::size_t begin = static_cast<std::size_t>(v) * static_cast<std::size_t>(width_);
      for (int u = 0; u < width_; ++u) {
        const float z = to_depth(begin + static_cast<std::size_t>(u));
        const bool valid = is_usable_depth(z, min_depth, max_depth);
        out[u] = valid ? z : kNoDepth;
        num_valid += valid;
      }
    }
    return num_valid;
  });
}

int SurfaceStages::read(const DepthFrame& frame, ThreadPool& pool) {
  PALPATE_ASSERT(frame.width == width_ && frame.height == height_ &&
                 frame.pixels.size() == num_pixels());
  const std::uint16_t* pixels = frame.pixels.data();
  const double unit = frame.unit;
  return read_pixels(pool, [pixels, unit](std::size_t i) { return depth_of(pixels[i], unit); });
}

int SurfaceStages::read(std::span<const float> depth, ThreadPool& pool) {
  PALPATE_ASSERT(depth.size() == num_pixels());
  return read_pixels(pool, [depth](std::size_t i) { return depth[i]; });
}

void SurfaceStages::filter(ThreadPool& pool) {
  sum_over_strips(pool, [&](int row_begin, int row_end) {
    kernels_.filter_depth(filter_pass_, row_begin, row_end);
    return 0;
  });
}

int SurfaceStages::estimate_normals(ThreadPool& pool) {
  return sum_over_strips(pool, [&](int row_begin, int row_end) {
    return kernels_.estimate_normals(normal_pass_, row_begin, row_end);
  });
}

void SurfaceStages::find_depth_change(ThreadPool& pool) {
  if (!options_.depth_change.enabled) return;
  sum_over_strips(pool, [&](int row_begin, int row_end) {
    kernels_.find_depth_change(change_pass_, row_begin, row_end);
    return 0;
  });
}

}  // namespace palpate
