#include "src/field/pyramid/field_rows.h"

#include <algorithm>

namespace palpate { inline namespace v0 {

#define PALPATE_DECLARE_FIELD_ROWS(isa)                                                        \
  namespace isa {                                                                              \
  void take_planes(const PointCloudView&, const FieldImage&, const PixelWindow&, int);         \
  bool find_holes(const FieldImage&, const PixelWindow&, int, std::uint64_t*);                 \
  void widen(const FieldImage&, int, Choice, const FieldImage&, const PixelWindow&, int);      \
  void fill(const FieldImage&, int, const FieldImage&, const PixelWindow&, int);               \
  void find_edges(const Intrinsics&, const FieldImage&, int, const PixelWindow&, int,          \
                  const SilhouetteScratch&);                                                   \
  void find_in_row(const Intrinsics&, const FieldImage&, int, const PixelWindow&, int,         \
                   const SilhouetteScratch&);                                                  \
  void find_silhouettes(const Intrinsics&, const FieldImage&, int, const PixelWindow&, int,    \
                        const SilhouetteScratch&);                                             \
  void mark_silhouettes(const FieldImage&, const PixelWindow&, int, const SilhouetteScratch&); \
  void find_tiles(const FieldImage&, const PixelWindow&, int, DepthTile*);                     \
  constexpr FieldRows kFieldRows{                                                              \
      take_planes,      find_holes,       widen,     fill, find_edges, find_in_row,            \
      find_silhouettes, mark_silhouettes, find_tiles};                                         \
  }
PALPATE_DECLARE_FIELD_ROWS(isa_baseline)
#if defined(__x86_64__)
PALPATE_DECLARE_FIELD_ROWS(isa_avx2)
PALPATE_DECLARE_FIELD_ROWS(isa_avx512)
#endif
#undef PALPATE_DECLARE_FIELD_ROWS

FieldRows field_rows(Isa isa) {
#if defined(__x86_64__)
  isa = std::min(isa, best_isa());
  if (isa == Isa::avx512) return isa_avx512::kFieldRows;
  if (isa == Isa::avx2) return isa_avx2::kFieldRows;
#endif
  (void)isa;
  return isa_baseline::kFieldRows;
}

}}  // namespace palpate::v0
