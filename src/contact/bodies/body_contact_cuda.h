#pragma once

#include <memory>

#include "palpate/contact/body_contact.h"

namespace palpate {

/// Errors: no such GPU, or not enough memory on it.
Result<std::unique_ptr<BodyPairQuery>> make_body_contact_cuda(const Tool& a, const Tool& b,
                                                              int gpu);

}  // namespace palpate
