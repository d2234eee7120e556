// From a raw depth frame to an organised cloud with normals and depth-change vectors (thesis
// sections 3.4 and 3.5, equations corrected).
#pragma once

#include <memory>
#include <span>

#include "palpate/cloud/depth_source.h"
#include "palpate/cloud/point_cloud.h"
#include "palpate/core/isa.h"
#include "palpate/core/thread_pool.h"

namespace palpate {

/// Bilateral filter over the valid pixels q of a window (eq. 3.12, divided by the sum of the
/// weights): w = exp(-(du^2 + dv^2) / (2 sigma_space^2)) exp(-(z_q - z_p)^2 / (2 (sigma_depth
/// z_p^2)^2)). It fills no holes.
struct DepthFilterOptions {
  bool enabled = true;
  int radius = 2;            ///< pixels; window 2*radius+1, 1..7
  double sigma_space = 1.5;  ///< pixels, 0.1..1000
  /// Similarity width is sigma_depth * z^2 (z in metres): noise of structured light grows so. Up
  /// to 1.
  double sigma_depth = 0.01;  ///< metres at 1 m
};

/// Which plane fits the neighbours' covariance C best.
enum class PlaneFit {
  /// Only the distance along the ray r of the centre pixel is noisy, as a depth camera's is: n
  /// minimises n^T C n subject to n.r = 1, that is n ~ C^-1 r. No bias on slanted surfaces.
  along_ray,
  /// All coordinates are equally noisy: n is the eigenvector of the smallest eigenvalue (eq. 3.7).
  principal,
};

/// Plane fit over a window (eqs. 3.7-3.11): the normal is of unit length and towards the camera. No
/// normal if all neighbours lie on one line of the image: their plane would contain the eye.
struct NormalOptions {
  PlaneFit fit = PlaneFit::along_ray;
  int radius = 3;  ///< pixels; window 2*radius+1, 1..7
  /// Neighbours count only if their depth differs by at most max_depth_change * z (z in metres,
  /// depth of the centre pixel): the window must not reach across an edge.
  double max_depth_change = 0.03;
  bool anchoring = false;      ///< plane through the point itself (3.9)
  bool weighting = false;      ///< weights exp(-|p-q|^2 / (2 sigma^2)) (3.10, also in the mean)
  double weight_sigma = 0.01;  ///< metres at 1 m; grows with z^2
  /// Difference vectors scaled to unit length (3.11); those shorter than 1e-5 z are left out.
  bool normalization = false;
  int min_neighbours = 6;  ///< fewer valid neighbours (with the point itself): no normal
};

/// Where the surface ends towards something farther away (eqs. 3.13-3.16 corrected: foreground
/// only, pointing outward, orthogonal to the viewing ray). l = sum max(0, z_q - z_p - min_step)
/// (du, dv, 0) over the valid ones of the eight neighbours, then l - (l.v) v with v = p / |p|.
struct DepthChangeOptions {
  bool enabled = true;
  double min_step = 0.05;  ///< metres: smaller steps do not count
};

struct SurfaceOptions {
  DepthFilterOptions filter;
  NormalOptions normals;
  DepthChangeOptions depth_change;
  double min_depth = 0.1;   ///< metres; nearer pixels are no measurement
  double max_depth = 10.0;  ///< metres; farther pixels are no measurement
};

/// Counts of one update.
struct SurfaceStats {
  int num_valid = 0;   ///< pixels with a usable depth
  int num_points = 0;  ///< of these, points with a normal
};

/// Owns all buffers for one image size; `update` allocates nothing.
class SurfaceEstimator {
 public:
  /// Errors: size out of 8..kMaxImageWidth, intrinsics not positive and finite, options out of
  /// range. All instruction sets give the same bits; one that the processor lacks is lowered.
  static Result<SurfaceEstimator> create(int width, int height, const Intrinsics& intrinsics,
                                         const SurfaceOptions& options = {}, Isa isa = best_isa());
  SurfaceEstimator(SurfaceEstimator&&) noexcept;
  SurfaceEstimator& operator=(SurfaceEstimator&&) noexcept;
  ~SurfaceEstimator();

  /// Computes cloud and depth-change vectors of a frame of the size given at construction. The same
  /// bits for any number of threads in `pool`. No allocation.
  SurfaceStats update(const DepthFrame& frame, ThreadPool& pool);
  /// The same from depth in metres (NaN or 0: no measurement), width * height values.
  SurfaceStats update(std::span<const float> depth, ThreadPool& pool);

  /// Valid until the next update.
  PointCloudView cloud() const;
  /// Filtered depth in metres, NaN where there is no measurement.
  std::span<const float> depth() const;
  /// Depth-change vector of each pixel in camera axes (m): zero away from edges. Three arrays.
  std::span<const float> depth_change(int axis) const;

 private:
  struct Impl;
  explicit SurfaceEstimator(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
