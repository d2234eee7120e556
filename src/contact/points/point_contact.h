// The contact query by points, on the CPU: weighted, simplified and along the leaf graph.
#pragma once

#include <memory>

#include "palpate/contact/contact.h"

namespace palpate { inline namespace v0 {

/// `method` is one of the point methods.
std::unique_ptr<ContactQuery> make_point_contact(std::shared_ptr<const ToolIndex> index,
                                                 const ContactMethod& method,
                                                 const ExecutionOptions& execution);

}}  // namespace palpate::v0
