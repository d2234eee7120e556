#include "palpate/contact/contact.h"

#include <string>
#include <utility>

#include "src/contact/batch/field_batch.h"
#include "src/contact/batch/field_batch_cuda.h"

namespace palpate { inline namespace v0 {

Result<std::unique_ptr<BatchQuery>> make_batch_query(const Place& place,
                                                     std::shared_ptr<const ToolIndex> index,
                                                     const ContactMethod& method,
                                                     const ExecutionOptions& execution) {
  const auto* const field = std::get_if<FieldMethod>(&method);
  if (field == nullptr) {
    return Error{Errc::invalid_argument,
                 std::string("batches are measured by the method field, not by ") +
                     name_of(contact_options(method).method) +
                     ": create the contact with FieldMethod, or measure pose by pose"};
  }
  switch (place.backend) {
    case Backend::cpu:
      return std::unique_ptr<BatchQuery>(
          std::make_unique<FieldBatch>(std::move(index), *field, execution));
    case Backend::cuda: break;
  }
#if defined(PALPATE_CUDA)
  return make_batch_query_cuda(std::move(index), *field, place.gpu);
#else
  return find_gpus().error();
#endif
}

}}  // namespace palpate::v0
