// First stage of a query: finds the points in each sphere, and their sums (thesis section 3.2.1 and
// eq. 3.3).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "palpate/cloud/point_cloud.h"
#include "palpate/math/geometry.h"
#include "src/contact/index/sphere_grid.h"
#include "src/core/internal/select_isa.h"

namespace palpate { inline namespace v0 {

/// Sums of the points inside one sphere, in fixed point: integers add up to the same bits in any
/// order, on any number of threads and on any backend. One cache line.
struct alignas(64) PointSums {
  /// Counts per meter (and per unit of a normal, and per point): see finest_sum_scale. Rounds at
  /// 5e-13 m.
  static constexpr double kFinestScale = 1099511627776.0;  // 2^40

  std::int64_t offset_W[4] = {0, 0, 0,
                              0};  ///< sum of p - t, world axes, t the tool's translation; points
  std::int64_t normal_W[4] = {0, 0, 0, 0};  ///< sum of normals, world axes; of kernel weights

  PALPATE_HOSTDEV bool has_points() const { return offset_W[3] != 0; }
  PALPATE_HOSTDEV double num_points(double scale) const {
    return static_cast<double>(offset_W[3]) / scale;
  }
  PALPATE_HOSTDEV double weight(double scale) const {
    return static_cast<double>(normal_W[3]) / scale;
  }
  PALPATE_HOSTDEV Vec3d offset(double scale) const { return sum_of(offset_W, scale); }  ///< m
  PALPATE_HOSTDEV Vec3d normal(double scale) const { return sum_of(normal_W, scale); }

  void add(const PointSums& other) {
    for (int i = 0; i < 4; ++i) {
      offset_W[i] += other.offset_W[i];
      normal_W[i] += other.normal_W[i];
    }
  }

 private:
  PALPATE_HOSTDEV static Vec3d sum_of(const std::int64_t (&sum)[4], double scale) {
    return Vec3d{static_cast<double>(sum[0]), static_cast<double>(sum[1]),
                 static_cast<double>(sum[2])} /
           scale;
  }
};

/// The finest scale, a power of two, in which the sums of so many points in one sphere fit, none
/// farther than `reach` (m) from the tool's origin: 2^40 up to 8 million points within 1 m.
inline double finest_sum_scale(std::size_t num_points, double reach) {
  constexpr double kMaxCounts = 9e18;  // of an int64
  const double most = static_cast<double>(num_points) * std::max(1.0, reach);
  double scale = PointSums::kFinestScale;
  while (most * scale > kMaxCounts) scale /= 2;
  return scale;
}

/// Kernel weights (1 - |p - c|^2 / r^2)^2 of the points of a sphere.
enum class PointWeights {
  none,
  beside,   ///< only summed
  in_sums,  ///< applied to offsets and normals as well
};

/// The same of a sphere's edge points, by the direction in which the surface ends: to the right and
/// left in the image, down and up. Contours of depth images are ragged, so each point is replaced
/// by the mean of the edge points around its pixel, and unit depth-change vectors of this mean take
/// the place of normals.
struct EdgeSums {
  static constexpr int kDirections = 4;
  /// Shorter depth-change vectors (m) are noise.
  static constexpr double kMinChange = 0.005;
  static constexpr int kRadius = 4;  ///< pixels; a square around the point
  /// Depth cameras see nothing beside a near surface where their projector is in its shadow, so a
  /// surface also ends at missing pixels in its row or column (at most so many) behind which
  /// something lies farther away by more than kMinStep (m).
  static constexpr int kMaxHole = 64;
  static constexpr double kMinStep = 0.05;
  /// Edge points whose depths differ by more (m) belong to different surfaces.
  static constexpr double kSameSurface = 0.02;

  PointSums towards[kDirections];
};

/// Input of a scan, and the sums that all scans share.
struct PointScan {
  PointCloudView cloud;
  SphereGridView grid;
  const Sphere* spheres = nullptr;
  Mat3d R_TW;           ///< world to tool, double: decides close calls
  Vec3d translation_W;  ///< of X_WT
  PointWeights weights = PointWeights::none;
  double sum_scale = PointSums::kFinestScale;  ///< of all sums
  /// One per sphere; null if edges do not matter. Added to atomically: edge points are few.
  EdgeSums* edges = nullptr;

  // Image window: rows and columns that can hold a point of the tool.
  int row_begin = 0, row_end = 0, column_begin = 0, column_end = 0;
};

/// Adds the points of rows [row_begin, row_end) of the window to `sums` (one per sphere) and sets
/// the sphere's byte in `touched`. An unorganized cloud is one row: it is cut by columns instead.
using ScanPoints = void (*)(const PointScan& scan, int row_begin, int row_end, int column_begin,
                            int column_end, PointSums* sums, std::uint8_t* touched);

PALPATE_DECLARE_KERNELS(void scan_points(const PointScan&, int, int, int, int, PointSums*,
                                         std::uint8_t*);)

/// Calls visit(sphere_id), ascending, for every set byte of `touched`, and clears it. The length
/// must be a multiple of eight.
template <class Visit>
void take_touched(std::span<std::uint8_t> touched, Visit&& visit) {
  for (std::size_t begin = 0; begin < touched.size(); begin += 8) {
    std::uint64_t eight;
    std::memcpy(&eight, &touched[begin], sizeof eight);
    if (eight == 0) continue;
    for (std::size_t id = begin; id < begin + 8; ++id) {
      if (touched[id] != 0) visit(id);
    }
    std::memset(&touched[begin], 0, sizeof eight);
  }
}

}}  // namespace palpate::v0
