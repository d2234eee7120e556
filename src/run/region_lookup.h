// Material regions: the labels under a contact.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "palpate/field/sensor.h"
#include "palpate/haptics/local_contact.h"
#include "src/haptics/internal/touched_disc.h"

namespace palpate { inline namespace v0 {

/// Material regions of one camera.
struct RegionLookup {
  std::shared_ptr<const MaterialRegions> regions;  ///< null: it has none
  Intrinsics intrinsics;                           ///< of the whole image, not of a smaller one
};

/// Creates the lookup of each camera; empty if none has regions. Errors: regions of another size
/// than the images, more of them than cameras, a moving camera, an impossible material.
Result<std::vector<RegionLookup>> region_lookups(
    std::span<const std::shared_ptr<const MaterialRegions>> regions,
    std::span<const DepthStreamInfo> streams);

/// Returns the mean material under the contact, weighted by the share of the normal force on each
/// region: that of an even disc of this torsion radius. Labels are interpolated between pixels, so
/// shares change without a jump while the tool slides across a border. Where several cameras have
/// labels, all that see a place count. No allocation; about a microsecond.
Ground ground_at(std::span<const RegionLookup> lookups, std::span<const SurfaceBlend> cameras,
                 const TouchedDisc& disc) noexcept;

}}  // namespace palpate::v0
