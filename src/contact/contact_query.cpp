#include "palpate/contact/contact_query.h"

#include "src/contact/cuda/contact_query_cuda.h"
#include "src/contact/points/contact_query_cpu.h"

namespace palpate {

Result<std::unique_ptr<ContactQuery>> make_contact_query(Backend backend, const Tool& tool,
                                                         const ContactCapacities& capacities) {
  switch (backend) {
    case Backend::cpu: return make_contact_query_cpu(tool, capacities);
    case Backend::cuda: break;
  }
#if defined(PALPATE_CUDA)
  return make_contact_query_cuda(tool, capacities);
#else
  return find_gpus().error();
#endif
}

}  // namespace palpate
