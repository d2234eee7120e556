#include "palpate/contact/contact_query.h"

#include "src/contact/contact_query_cpu.h"

namespace palpate {

Result<std::unique_ptr<ContactQuery>> make_contact_query(Backend backend, const Tool& tool,
                                                         const ContactCapacities& capacities) {
  switch (backend) {
    case Backend::cpu: return make_contact_query_cpu(tool, capacities);
    case Backend::cuda: break;
  }
  return Error{Errc::unavailable,
               "this build has no CUDA backend: use the CPU (--backend cpu or auto)"};
}

}  // namespace palpate
