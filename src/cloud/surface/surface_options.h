// Validation of the settings of surface estimation.
#pragma once

#include "palpate/cloud/surface_estimator.h"

namespace palpate { inline namespace v0 {

/// An error names the first setting that is out of range.
Status check_surface_settings(int width, int height, const Intrinsics& intrinsics,
                              const SurfaceOptions& options, const Distortion& distortion = {});

}}  // namespace palpate::v0
