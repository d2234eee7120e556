#include "src/cloud/surface/surface_stages.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "src/cloud/surface/surface_settings.h"
#include "src/core/internal/assert.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kMargin = PaddedDepth::kMargin;
static_assert(kMargin >= kMaxWindowRadius);

SurfaceKernels kernels_for(Isa isa) {
#if defined(__x86_64__)
  if (isa == Isa::avx512) {
    return {isa_avx512::read_depth, isa_avx512::filter_depth, isa_avx512::estimate_normals,
            isa_avx512::find_depth_change};
  }
  if (isa == Isa::avx2) {
    return {isa_avx2::read_depth, isa_avx2::filter_depth, isa_avx2::estimate_normals,
            isa_avx2::find_depth_change};
  }
#endif
  (void)isa;
  return {isa_baseline::read_depth, isa_baseline::filter_depth, isa_baseline::estimate_normals,
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
                             const SurfaceOptions& options, Isa isa, const Distortion& distortion)
    : options_(options),
      kernels_(kernels_for(std::min(isa, best_isa()))),
      width_(width),
      height_(height),
      stride_(padded_stride(width)),
      raw_pixels_(lens_table_of(width, height, k, distortion)),
      raw_(padded_image(height, stride_)),
      filtered_(padded_image(height, stride_)),
      far_(width, height),
      ray_x_(ray_table(width, k.fx, k.cx)),
      ray_y_(ray_table(height, k.fy, k.cy)),
      space_(space_exponents(options.filter)),
      strip_counts_(static_cast<std::size_t>((height + kStripRows - 1) / kStripRows)),
      cloud_(width, height, k) {
  const std::size_t num_pixels = cloud_.size();
  depth_.assign(num_pixels, std::numeric_limits<float>::quiet_NaN());
  for (std::vector<float>& axis : change_) axis.assign(num_pixels, 0.0f);

  raw_pass_.min_depth = static_cast<float>(options.min_depth);
  raw_pass_.max_depth = static_cast<float>(options.max_depth);
  raw_pass_.out = first_pixel(raw_, stride_);
  raw_pass_.stride = stride_;
  raw_pass_.width = width;
  raw_pass_.far = far_.bits();
  if (!raw_pixels_.empty()) raw_pass_.raw_pixels = raw_pixels_.data();
  raw_pass_.num_pixels = static_cast<std::uint32_t>(num_pixels);

  filter_pass_ = filter_settings(options);
  filter_pass_.in = {first_pixel(raw_, stride_), stride_, width, height};
  filter_pass_.out = first_pixel(filtered_, stride_);
  filter_pass_.depth = depth_.data();
  filter_pass_.space = space_.data();
  if (is_adaptive(options.filter)) adaptive_.emplace(width, height, isa);
  noise_ = frame_noise(options.noise);

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

// Returns the sum of `task(part)`, which is a count, over the strips of the window, enlarged to
// whole parts.
template <class Task>
int SurfaceStages::sum_over_strips(ThreadPool& pool, const PixelWindow& window, const Task& task) {
  static_assert(kColumnStep == kStripRows);
  const PixelWindow all = window.clipped(width_, height_).aligned(kColumnStep);
  const int num_strips = std::max(all.height(), 0) / kStripRows;
  pool.parallel_for(num_strips, [&](int strip) {
    const int top = all.top + strip * kStripRows;
    const PixelWindow part{all.left, top, all.right, top + kStripRows};
    strip_counts_[static_cast<std::size_t>(strip)] = task(part.clipped(width_, height_));
  });
  return std::accumulate(strip_counts_.begin(), strip_counts_.begin() + num_strips, 0);
}

int SurfaceStages::read(const DepthImageView& image, ThreadPool& pool) {
  PALPATE_ASSERT(image.width == width_ && image.height == height_ && image.gpu == kHostMemory &&
                 (image.counts != nullptr || image.meters != nullptr));
  RawPass pass = raw_pass_;
  pass.counts = image.counts;
  pass.meters = image.counts == nullptr ? image.meters : nullptr;
  pass.unit = image.unit;
  return read(pass, pool);
}

int SurfaceStages::read(const RawPass& pass, ThreadPool& pool) {
  return sum_over_strips(pool, {},
                         [&](const PixelWindow& part) { return kernels_.read_depth(pass, part); });
}

void SurfaceStages::filter(ThreadPool& pool, const PixelWindow& desired) {
  // Normals are made in whole parts.
  const PixelWindow normals = desired.clipped(width_, height_).aligned(kColumnStep);
  const PixelWindow filtered = normals.grown(normal_pass_.radius);
  far_.drop_errors(first_pixel(raw_, stride_), stride_,
                   filtered.clipped(width_, height_).aligned(kColumnStep));
  if (adaptive_) {
    adaptive_->run(filter_pass_, filtered.clipped(width_, height_).aligned(kColumnStep), pool);
    if (!is_known(options_.noise)) noise_ = adaptive_->noise();
    return;
  }
  sum_over_strips(pool, filtered, [&](const PixelWindow& part) {
    kernels_.filter_depth(filter_pass_, part);
    return 0;
  });
}

int SurfaceStages::estimate_normals(ThreadPool& pool, const PixelWindow& desired) {
  return sum_over_strips(pool, desired, [&](const PixelWindow& part) {
    return kernels_.estimate_normals(normal_pass_, part);
  });
}

void SurfaceStages::find_depth_change(ThreadPool& pool) {
  if (!options_.depth_change.enabled) return;
  sum_over_strips(pool, {}, [&](const PixelWindow& part) {
    kernels_.find_depth_change(change_pass_, part);
    return 0;
  });
}

}}  // namespace palpate::v0
