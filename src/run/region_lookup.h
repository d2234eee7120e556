// Material regions: the labels under a contact.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "palpate/field/sensor.h"
#include "palpate/haptics/local_contact.h"
#include "src/haptics/internal/touched_disc.h"

namespace palpate::inline v0 {

/// Of one camera.
struct RegionLookup {
  std::shared_ptr<const MaterialRegions> regions;  ///< null: it has none
  Intrinsics intrinsics;                           ///< of the whole image, not of a smaller one
};

/// For each camera that has regions; empty if none has. Errors: regions of another size than the
/// camera's images, more of them than cameras, a camera that moves, a material that cannot be.
Result<std::vector<RegionLookup>> region_lookups(
    std::span<const std::shared_ptr<const MaterialRegions>> regions,
    std::span<const DepthStreamInfo> streams);

/// Materials under the contact, each with the share of the normal force that rests on it: that of
/// an even disc of this torsion radius. Labels count as each pixel's weight between its neighbours
/// says, so shares change without a jump while the tool slides across a border. Where several
/// cameras have labels, all that see a place count. No allocation; about a microsecond.
Ground ground_at(std::span<const RegionLookup> lookups, std::span<const SurfaceBlend> cameras,
                 const TouchedDisc& disc) noexcept;

}  // namespace palpate::inline v0
