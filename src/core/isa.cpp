#include "palpate/core/core.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>

namespace palpate { inline namespace v0 {
namespace {

Isa detected_isa() {
#if defined(__x86_64__)
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl")) {
    return Isa::avx512;
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return Isa::avx2;
#endif
  return Isa::baseline;
}

}  // namespace

Isa best_isa() {
  const Isa detected = detected_isa();
  const char* desired = std::getenv("PALPATE_ISA");
  if (desired == nullptr) return detected;
  for (Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
    if (std::strcmp(desired, isa_name(isa)) == 0) return std::min(isa, detected);
  }
  return detected;
}

const char* isa_name(Isa isa) {
  switch (isa) {
    case Isa::avx512: return "avx512";
    case Isa::avx2: return "avx2";
    default: return "baseline";
  }
}

}}  // namespace palpate::v0
