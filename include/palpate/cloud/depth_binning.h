// Smaller depth images: less to compute where a computer cannot keep up.
#pragma once

#include "palpate/cloud/depth_source.h"

namespace palpate {

inline constexpr int kMaxBinning = 8;

/// The stream of images whose pixels are squares of `binning` times `binning` pixels. What is left
/// at the right and at the bottom is cut off.
DepthStreamInfo binned(const DepthStreamInfo& stream, int binning);

/// Each pixel is the rounded mean of those of its square that show the same surface: measurements
/// that are within 1/32 of their (lower) median. So no pixel floats between two surfaces. None
/// where nothing was measured. Of counts in host memory. Allocates only if `small` is too small.
/// O(pixels).
void bin_depth(const DepthImageView& image, int binning, DepthFrame& small);

}  // namespace palpate
