// Input and output of the three stages of surface estimation. Each stage works on strips of whole
// rows that do not depend on each other, so any number of threads gives the same bits.
#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/cloud/point_cloud.h"

namespace palpate { inline namespace v0 {

/// Invalid depth in padded images: a large number that fails every "close enough" test by itself
/// and, unlike NaN, survives minima and maxima.
inline constexpr float kNoDepth = 1e9f;
inline constexpr float kAnyDepth = 1e8f;  ///< valid means depth < kAnyDepth
/// Invalid depth that was measured as farther than `max_depth`.
inline constexpr float kFarDepth = 2 * kNoDepth;

inline constexpr int kMaxWindowRadius = 7;
inline constexpr int kStripRows = 16;  ///< rows per task

/// A depth image with a margin of kNoDepth, so that windows and vectors may reach over the border.
struct PaddedDepth {
  static constexpr int kMargin = 16;  ///< >= kMaxWindowRadius and >= the widest vector

  const float* pixels = nullptr;  ///< pixel (0, 0)
  std::ptrdiff_t stride = 0;      ///< floats from row to row
  int width = 0, height = 0;

  const float* row(int v) const { return pixels + v * stride; }
};

/// Raw depth to meters: kNoDepth without measurement, kFarDepth where it is too far.
struct RawPass {
  const std::uint16_t* counts = nullptr;  ///< width a row, of `unit` meters
  const float* meters = nullptr;          ///< instead, if there are no counts
  double unit = 0;
  float min_depth = 0, max_depth = 0;
  float* out = nullptr;  ///< padded
  std::ptrdiff_t stride = 0;
  int width = 0;
  std::uint64_t* far = nullptr;               ///< one bit a pixel: too far; rows begin at a word
  const std::uint32_t* raw_pixels = nullptr;  ///< raw pixel of each pixel; null: the same one
  std::uint32_t num_pixels = 0;               ///< raw pixels; larger numbers see nothing
};

/// Bilateral filter (eq. 3.12): z_p' = sum w z_q / sum w over the valid q of the window, w =
/// exp(-(du^2 + dv^2) / (2 sigma_space^2)) exp(-(z_q - z_p)^2 / (2 s^2)), s = sigma_depth z_p^2.
/// Invalid pixels stay invalid, and flying ones become so; they stay neighbors of other pixels, too
/// far off to count.
struct FilterPass {
  PaddedDepth in;
  float* out = nullptr;          ///< padded like `in`
  float* depth = nullptr;        ///< width * height, NaN where invalid, infinite where far
  int radius = 0;                ///< 0: copy
  const float* space = nullptr;  ///< -(du^2 + dv^2) / (2 sigma_space^2 ln 2), row-major window
  float range = 0;               ///< 1 / (2 sigma_depth^2 ln 2)
  float flying_gap = 0;          ///< SurfaceOptions::flying_pixel_gap
};

/// Unprojection and plane fit (eqs. 3.7-3.11). Neighbors of p: the valid pixels q of the window
/// with |z_q - z_p| <= max_depth_change z_p, p included. No normal if they are fewer than
/// min_neighbors or all on one line of the image.
struct NormalPass {
  PaddedDepth in;
  float* cloud[6] = {};          ///< x, y, z, nx, ny, nz
  const float* ray_x = nullptr;  ///< (u - cx) / fx of each column, readable kMargin beyond the last
  const float* ray_y = nullptr;  ///< (v - cy) / fy of each row
  float pixel_x = 0, pixel_y = 0;  ///< 1 / fx, 1 / fy
  int radius = 3;
  float max_depth_change = 0;
  float min_neighbors = 0;
  bool along_ray = true;  ///< PlaneFit::along_ray, else principal
  bool anchoring = false, weighting = false, normalization = false;
  float weight = 0;  ///< 1 / (2 weight_sigma^2 ln 2)
};

/// Depth change (eqs. 3.13-3.16 corrected): l = sum max(0, z_q - z_p - min_step) (du, dv, 0) over
/// the valid ones of the eight neighbors, then l - (l.v) v with v = p / |p|.
struct DepthChangePass {
  PaddedDepth in;
  float* change[3] = {};
  const float* ray_x = nullptr;
  const float* ray_y = nullptr;
  float min_step = 0;
};

/// Columns of a part begin at a multiple of this.
inline constexpr int kColumnStep = 16;

/// Each does one part of the image: rows of one strip, columns from a multiple of kColumnStep to
/// another one or to the end of the rows; depth is read in whole rows.
struct SurfaceKernels {
  int (*read_depth)(const RawPass&, const PixelWindow& part);  ///< number of measurements
  void (*filter_depth)(const FilterPass&, const PixelWindow& part);
  int (*estimate_normals)(const NormalPass&, const PixelWindow& part);  ///< number of points
  void (*find_depth_change)(const DepthChangePass&, const PixelWindow& part);
};

#define PALPATE_DECLARE_SURFACE_KERNELS(isa)                          \
  namespace isa {                                                     \
  int read_depth(const RawPass&, const PixelWindow&);                 \
  void filter_depth(const FilterPass&, const PixelWindow&);           \
  int estimate_normals(const NormalPass&, const PixelWindow&);        \
  void find_depth_change(const DepthChangePass&, const PixelWindow&); \
  }
PALPATE_DECLARE_SURFACE_KERNELS(isa_baseline)
PALPATE_DECLARE_SURFACE_KERNELS(isa_avx2)
PALPATE_DECLARE_SURFACE_KERNELS(isa_avx512)
#undef PALPATE_DECLARE_SURFACE_KERNELS

}}  // namespace palpate::v0
