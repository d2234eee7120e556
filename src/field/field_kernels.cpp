#include "src/field/field_kernels.h"

#include <algorithm>

namespace palpate {

#define PALPATE_DECLARE_FIELD_KERNELS(isa)                                                \
  namespace isa {                                                                         \
  bool take_planes(const PointCloudView&, const FieldImage&, int);                        \
  void widen(const FieldImage&, int, Choice, const FieldImage&, int);                     \
  void fill(const FieldImage&, int, const FieldImage&, int);                              \
  void find_steps(float, const FieldImage&, int);                                         \
  void find_tiles(const FieldImage&, int, DepthTile*);                                    \
  constexpr FieldKernels kFieldKernels{take_planes, widen, fill, find_steps, find_tiles}; \
  }
PALPATE_DECLARE_FIELD_KERNELS(isa_baseline)
#if defined(__x86_64__)
PALPATE_DECLARE_FIELD_KERNELS(isa_avx2)
PALPATE_DECLARE_FIELD_KERNELS(isa_avx512)
#endif
#undef PALPATE_DECLARE_FIELD_KERNELS

FieldKernels field_kernels(Isa isa) {
#if defined(__x86_64__)
  isa = std::min(isa, best_isa());
  if (isa == Isa::avx512) return isa_avx512::kFieldKernels;
  if (isa == Isa::avx2) return isa_avx2::kFieldKernels;
#endif
  (void)isa;
  return isa_baseline::kFieldKernels;
}

}  // namespace palpate
