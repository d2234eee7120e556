// A build without the CUDA backend.
#include "palpate/gpu/devices.h"

namespace palpate { inline namespace v0 {

Result<std::vector<GpuInfo>> find_gpus() {
  return Error{Errc::unavailable,
               "this build has no CUDA backend: use the CPU (--backend cpu or auto), or build with "
               "-DPALPATE_CUDA=ON"};
}

}}  // namespace palpate::v0
