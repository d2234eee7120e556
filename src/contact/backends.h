// Makers of contact queries: by points on a CPU, and all of them on a GPU.
#pragma once

#include <memory>

#include "palpate/contact/body_contact.h"
#include "palpate/contact/contact.h"

namespace palpate { inline namespace v0 {

/// Makes the query by points on a CPU: weighted, simplified or along the leaf graph. `method` is
/// one of these.
std::unique_ptr<ContactQuery> make_point_contact(std::shared_ptr<const ToolIndex> index,
                                                 const ContactMethod& method,
                                                 const ExecutionOptions& execution);

/// Makes the query on a GPU; `reserves_noise`: see ExecutionOptions. Errors: no such GPU, or not
/// enough memory on it.
Result<std::unique_ptr<ContactQuery>> make_contact_query_cuda(
    std::shared_ptr<const ToolIndex> index, const ContactMethod& method, int gpu,
    bool reserves_noise = false);

/// Pairs of bodies by spheres. Errors as above.
Result<std::unique_ptr<BodyPairQuery>> make_body_contact_cuda(std::shared_ptr<const ToolIndex> a,
                                                              std::shared_ptr<const ToolIndex> b,
                                                              int gpu);

/// Pairs of bodies by their distance fields. Errors as above.
Result<std::unique_ptr<BodyPairQuery>> make_solid_contact_cuda(std::shared_ptr<const ToolIndex> a,
                                                               std::shared_ptr<const ToolIndex> b,
                                                               int gpu);

}}  // namespace palpate::v0
