// Checks of what a scene is asked, and what is wrong in one sentence.
#pragma once

#include <string>

#include "palpate/contact/scene.h"

namespace palpate { inline namespace v0 {

/// Errors: see SceneContact::measure.
Status check_scene(const Scene& scene, const ContactMethod& method, const Place& place);
Status check_poses(const ScenePoses& poses, std::size_t num_tools);
/// Errors: a point method, a GPU.
Status check_clearance(const ContactMethod& method, const Place& place, double limit);

}}  // namespace palpate::v0
