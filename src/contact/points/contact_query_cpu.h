#pragma once

#include <memory>

#include "palpate/contact/contact_query.h"

namespace palpate {

std::unique_ptr<ContactQuery> make_contact_query_cpu(const Tool& tool,
                                                     const ContactCapacities& capacities);

}  // namespace palpate
