// The loops over the rows of the scales, for a CPU. Rows of one level do not depend on each other,
// so any number of threads gives the same bits, and so does every instruction set.
#pragma once

#include <cstddef>

#include "palpate/core/core.h"
#include "src/cloud/surface/adaptive/scale_noise.h"
#include "src/cloud/surface/surface_kernels.h"

namespace palpate { inline namespace v0 {

/// One array of a level, with margins of cells without surface: on all sides, and at the ends of
/// rows for the widest pairs of vectors.
struct ScaleImage {
  static constexpr int kMargin = 4, kEnd = 32;

  float* cells = nullptr;  ///< cell (0, 0)
  std::ptrdiff_t stride = 0;

  float* row(int v) const { return cells + v * stride; }
};

/// The cells of one level.
struct ScaleLevel {
  int width = 0, height = 0;
  ScaleImage mean;       ///< inverse depth, 0: no surface
  ScaleImage predicted;  ///< from the wider cells; 0: none
  ScaleImage energy;     ///< of the details, see excess_of
  ScaleImage smoothed;
};

/// Columns [left, right) of a row.
struct Columns {
  int left, right;
};

/// Each does row v of the level named last, or columns of it.
struct ScaleRows {
  /// Level 0: inverse depth of the measured pixels; flying ones are none.
  void (*begin)(const FilterPass&, const ScaleLevel&, int v);
  void (*widen)(const ScaleLevel& fine, int level, const ScaleLevel& coarse, int v);
  /// Predicts two rows of `to`, of level `fine`, below columns of row v of `from`, of `coarse`.
  void (*predict)(const ScaleLevel& coarse, int level, const ScaleImage& from,
                  const ScaleLevel& fine, const ScaleImage& to, Columns columns, int v);
  /// `finer` is null at level 0.
  void (*find_energy)(const ScaleLevel* finer, const ScaleNoise&, const ScaleLevel&,
                      Columns columns, int v);
  /// `smoothed` holds the predictions from the wider level; it is null at the widest. `number`: of
  /// the level.
  void (*smooth)(int number, const ScaleLevel* wider, const ScaleNoise&, const ScaleLevel&,
                 Columns columns, int v);
  /// Depth of the smoothed pixels.
  void (*finish)(const ScaleLevel&, const FilterPass&, Columns columns, int v);
};

#define PALPATE_DECLARE_SCALE_ROWS(isa) \
  namespace isa {                       \
  ScaleRows scale_rows();               \
  }
PALPATE_DECLARE_SCALE_ROWS(isa_baseline)
PALPATE_DECLARE_SCALE_ROWS(isa_avx2)
PALPATE_DECLARE_SCALE_ROWS(isa_avx512)
#undef PALPATE_DECLARE_SCALE_ROWS

}}  // namespace palpate::v0
