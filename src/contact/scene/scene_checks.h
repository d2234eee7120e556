// Checks of what a scene is asked, and what is wrong in one sentence.
#pragma once

#include <string>

#include "palpate/contact/scene.h"

namespace palpate { inline namespace v0 {

// Each returns an error of one sentence, or Done.

/// Errors: an empty scene; too many surfaces; surfaces in different places, or not in that of the
/// contact; several that were not made to be joined, or with a point method.
Status check_scene(const Scene& scene, const ContactMethod& method, const Place& place);
/// Errors: arrays on a GPU where the contact is not.
Status check_memory(int gpu, const Place& place);
/// Errors: sizes that do not match; several tools without indices; an index out of range.
Status check_poses(const ScenePoses& poses, std::size_t num_tools);
/// Errors: standard deviations of a point method, which does not say what noise does to it.
Status check_noise(const BatchAnswers& answers, const ContactMethod& method);
/// Errors: a point method; a limit that is not above 0; a smoothing below 0.
Status check_clearance(const ContactMethod& method, double limit, double smoothing);

}}  // namespace palpate::v0
