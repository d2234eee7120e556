// Results of a scene in the arrays of the caller.
#pragma once

#include <cstddef>
#include <span>

#include "palpate/contact/scene.h"

namespace palpate { inline namespace v0 {

/// Writes the spheres of a pose: their depth, the volume of the cap, its direction in W and the
/// camera that determined it. Zeros for those outside, and up to max_spheres.
void put_spheres(std::size_t pose, const SpherePicture& picture, std::span<const Sphere> spheres,
                 const Pose& X_WT, const SceneAnswers& answers);

/// Writes the results of all groups, from the clearances and volumes of their poses: of equal
/// clearances the first pose counts.
void put_groups(const ScenePoses& poses, const SceneAnswers& answers);

}}  // namespace palpate::v0
