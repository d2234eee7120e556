// Motion of the surface under a tool or a body along itself, from the optical flow of cameras.
#pragma once

#include <span>

#include "palpate/field/sensor.h"
#include "src/haptics/internal/touched_disc.h"

namespace palpate { inline namespace v0 {

/// Returns the motion of the surface under a contact along itself: the velocity of its point at the
/// center of the disc, at right angles to the normal, and its rotation about the normal. Zero where
/// no camera measures it.
///
/// A pixel's flow gives the velocity across its ray. The velocity along the ray follows from the
/// speed of the surface along its normal, which the fields of the last two frames give. The rigid
/// motion that fits all samples under the disc best is returned. No allocation; five microseconds
/// for each camera with a flow.
Twist surface_motion(std::span<const SurfaceBlend> cameras, const TouchedDisc& disc) noexcept;

}}  // namespace palpate::v0
