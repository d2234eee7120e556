// Options as the stages of surface estimation take them, and the tables that they read.
#pragma once

#include <vector>

#include "palpate/cloud/surface_estimator.h"
#include "src/cloud/surface/surface_kernels.h"

namespace palpate { inline namespace v0 {

/// An error names the first setting that is out of range.
Status check_surface_settings(int width, int height, const Intrinsics& intrinsics,
                              const SurfaceOptions& options, const Distortion& distortion = {});

/// (i - c) / f for i = 0 ... num - 1 and a margin of PaddedDepth::kMargin more.
std::vector<float> ray_table(int num, double f, double c);

/// RawPass::raw_pixels; empty without distortion.
std::vector<std::uint32_t> lens_table_of(int width, int height, const Intrinsics& k,
                                         const Distortion& distortion);

/// FilterPass::space.
std::vector<float> space_exponents(const DepthFilterOptions& options);

/// All but the pointers and the image.
FilterPass filter_settings(const SurfaceOptions& options);
NormalPass normal_settings(const NormalOptions& options, const Intrinsics& k);

}}  // namespace palpate::v0
