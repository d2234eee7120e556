// Pairs of bodies by spheres, on a GPU.
#pragma once

#include <memory>

#include "palpate/contact/body_contact.h"

namespace palpate { inline namespace v0 {

/// Errors: no such GPU, or not enough memory on it.
Result<std::unique_ptr<BodyPairQuery>> make_body_contact_cuda(std::shared_ptr<const ToolIndex> a,
                                                              std::shared_ptr<const ToolIndex> b,
                                                              int gpu);

}}  // namespace palpate::v0
