// Selects the implementation of a kernel at run time: there is one for each vector instruction set.
#pragma once

#include <algorithm>

#include "palpate/core/core.h"

// Declares the text between the brackets in the namespace of each instruction set, and lists the
// implementations of one name.
#if defined(__x86_64__)
#define PALPATE_DECLARE_KERNELS(...) \
  namespace isa_baseline {           \
  __VA_ARGS__                        \
  }                                  \
  namespace isa_avx2 {               \
  __VA_ARGS__                        \
  }                                  \
  namespace isa_avx512 {             \
  __VA_ARGS__                        \
  }
#define PALPATE_BY_ISA(name) \
  { isa_baseline::name, isa_avx2::name, isa_avx512::name }
#else
#define PALPATE_DECLARE_KERNELS(...) \
  namespace isa_baseline {           \
  __VA_ARGS__                        \
  }
#define PALPATE_BY_ISA(name) \
  { isa_baseline::name, isa_baseline::name, isa_baseline::name }
#endif

namespace palpate { inline namespace v0 {

/// Returns the best of PALPATE_BY_ISA(...) that this processor runs, but none better than `isa`.
template <class Kernel>
Kernel select_isa(const Kernel (&kernels)[3], Isa isa) {
  return kernels[static_cast<int>(std::min(isa, best_isa()))];
}

}}  // namespace palpate::v0
