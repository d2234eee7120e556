// Contact queries on a GPU, or by the emulator.
#pragma once

#include "src/contact/backends.h"
#include "tests/test_util/contact_queries.h"

namespace palpate::test {

/// `tool` must outlive it.
inline ContactQueries cuda_queries(const Tool& tool) {
  return {tool, [](std::shared_ptr<const ToolIndex> index, const ContactMethod& method) {
            return make_contact_query_cuda(std::move(index), method, 0);
          }};
}

}  // namespace palpate::test
