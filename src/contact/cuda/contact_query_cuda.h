// The contact query on a GPU.
#pragma once

#include <memory>

#include "palpate/contact/contact.h"

namespace palpate { inline namespace v0 {

/// Errors: no such GPU, or not enough memory on it.
Result<std::unique_ptr<ContactQuery>> make_contact_query_cuda(
    std::shared_ptr<const ToolIndex> index, const ContactMethod& method,
    const ExecutionOptions& execution);

}}  // namespace palpate::v0
