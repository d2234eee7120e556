// How what a tool or a body lies on moves along itself, where cameras have an optical flow.
#pragma once

#include <span>

#include "palpate/field/sensor.h"
#include "src/haptics/internal/touched_disc.h"

namespace palpate::inline v0 {

/// Along the surface under a contact: the velocity of its point at the middle of the disc, at right
/// angles to the normal, and its turning about the normal. Zero where no camera measures it.
///
/// A pixel's flow says how what it shows moves across its ray. How far along the ray follows from
/// how fast the surface comes along its normal, which the fields of the last two frames say. Of all
/// that is under the disc the rigid motion that fits best counts. No allocation; five
/// microseconds for each camera with a flow.
Twist surface_motion(std::span<const SurfaceBlend> cameras, const TouchedDisc& disc) noexcept;

}  // namespace palpate::inline v0
