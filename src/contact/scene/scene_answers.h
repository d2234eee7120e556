// Results of a scene in the arrays of the caller.
#pragma once

#include <cstddef>
#include <span>

#include "palpate/contact/scene.h"
#include "src/contact/clearance/clearance_rules.h"

namespace palpate { inline namespace v0 {

/// Writes the clearance of a pose.
void put_clearance(std::size_t pose, const Clearance& at, const SceneAnswers& answers);

/// Writes the spheres of a pose, and zeros up to max_spheres. `radii` are those of `spheres`.
void put_spheres(std::size_t pose, const SpherePicture& picture, std::span<const Sphere> spheres,
                 const Pose& X_WT, const SceneAnswers& answers);

/// Writes the results of all groups, from the clearances and volumes of their poses.
void put_groups(const ScenePoses& poses, const SceneAnswers& answers);

}}  // namespace palpate::v0
