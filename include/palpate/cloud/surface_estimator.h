// From a raw depth frame to an organised cloud with normals and depth-change vectors (thesis
// sections 3.4 and 3.5, equations corrected).
#pragma once

#include <memory>
#include <span>

#include "palpate/cloud/depth_source.h"
#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "palpate/settings/setting_table.h"

namespace palpate::inline v0 {

/// Bilateral filter over the valid pixels q of a window (eq. 3.12, divided by the sum of the
/// weights): w = exp(-(du^2 + dv^2) / (2 sigma_space^2)) exp(-(z_q - z_p)^2 / (2 (sigma_depth
/// z_p^2)^2)). It fills no holes.
struct DepthFilterOptions {
  bool enabled = true;
  int radius = 2;            ///< pixels; window 2*radius+1
  double sigma_space = 1.5;  ///< pixels
  /// Similarity width is sigma_depth * z^2 (z in metres): noise of structured light grows so.
  double sigma_depth = 0.01;  ///< metres at 1 m
};
inline void add_settings(SettingTable& t, DepthFilterOptions& o) {
  t.add("filter", o.enabled, "bilateral filter of the depth");
  t.add("filter_radius", o.radius, {1, 7, "pixels"}, "window of 2 radius + 1 pixels a side");
  t.add("filter_sigma_space", o.sigma_space, {0.1, 1000, "pixels"},
        "distance in the image at which a pixel counts less");
  t.add("filter_sigma_depth", o.sigma_depth, {1e-6, 1, "m"},
        "difference of depth at which a pixel counts less, at a depth of 1 m");
}

/// Which plane fits the neighbours' covariance C best.
enum class PlaneFit {
  /// Only the distance along the ray r of the centre pixel is noisy, as a depth camera's is: n
  /// minimises n^T C n subject to n.r = 1, that is n ~ C^-1 r. No bias on slanted surfaces.
  along_ray,
  /// All coordinates are equally noisy: n is the eigenvector of the smallest eigenvalue (eq. 3.7).
  principal,
};
constexpr auto names_of(PlaneFit) { return std::array{"along_ray", "principal"}; }

/// Plane fit over a window (eqs. 3.7-3.11): the normal is of unit length and towards the camera. No
/// normal if all neighbours lie on one line of the image: their plane would contain the eye.
struct NormalOptions {
  PlaneFit fit = PlaneFit::along_ray;
  int radius = 3;  ///< pixels; window 2*radius+1
  /// Neighbours count only if their depth differs by at most max_depth_change * z (z in metres,
  /// depth of the centre pixel): the window must not reach across an edge.
  double max_depth_change = 0.03;
  bool anchoring = false;      ///< plane through the point itself (3.9)
  bool weighting = false;      ///< weights exp(-|p-q|^2 / (2 sigma^2)) (3.10, also in the mean)
  double weight_sigma = 0.01;  ///< metres at 1 m; grows with z^2
  /// Difference vectors scaled to unit length (3.11); those shorter than 1e-5 z are left out.
  bool normalization = false;
  /// Fewer valid neighbours (with the point itself): no normal. More than the window has: all.
  int min_neighbours = 6;
};
inline void add_settings(SettingTable& t, NormalOptions& o) {
  t.add("plane_fit", o.fit, "which coordinates of a pixel are noisy: its depth or all");
  t.add("normal_radius", o.radius, {1, 7, "pixels"}, "around a point for its normal");
  t.add("normal_max_depth_change", o.max_depth_change, {1e-6, 10},
        "share of the depth; a pixel farther off belongs to another surface");
  t.add("anchoring", o.anchoring, "planes through the point itself");
  t.add("weighting", o.weighting, "near neighbours count more");
  t.add("weight_sigma", o.weight_sigma, {1e-6, 10, "m"},
        "distance at which a neighbour counts less, at a depth of 1 m");
  t.add("normalization", o.normalization, "all neighbours count the same");
  t.add("min_neighbours", o.min_neighbours, {3, 225, "pixels"},
        "fewer with a depth around a point give no normal; more than the window has: all of it");
}

/// Where the surface ends towards something farther away (eqs. 3.13-3.16 corrected: foreground
/// only, pointing outward, orthogonal to the viewing ray). l = sum max(0, z_q - z_p - min_step)
/// (du, dv, 0) over the valid ones of the eight neighbours, then l - (l.v) v with v = p / |p|.
struct DepthChangeOptions {
  bool enabled = true;
  double min_step = 0.05;  ///< metres: smaller steps do not count
};
inline void add_settings(SettingTable& t, DepthChangeOptions& o) {
  t.add("depth_change", o.enabled, "find where the surface ends, for `edges`");
  t.add("depth_change_min_step", o.min_step, {0, 1000, "m"}, "smaller steps do not count");
}

struct SurfaceOptions {
  DepthFilterOptions filter;
  NormalOptions normals;
  DepthChangeOptions depth_change;
  double min_depth = 0.1;   ///< metres; nearer pixels are no measurement
  double max_depth = 10.0;  ///< metres; farther pixels are no measurement
  /// A pixel between the depths of two opposite neighbours and farther from both than this share of
  /// its own depth lies on neither of the surfaces at an edge: it is no measurement. Surfaces
  /// steeper than atan(this * focal length in pixels) are lost with them. 0: all pixels count.
  double flying_pixel_gap = 0;
};
inline void add_settings(SettingTable& t, SurfaceOptions& o) {
  t.section("surface");
  t.add("min_depth", o.min_depth, {1e-3, 1e3, "m"}, "nearer pixels are no measurement");
  t.add("max_depth", o.max_depth, {1e-3, 1e3, "m"}, "farther pixels are no measurement");
  t.add(
      "flying_pixel_gap", o.flying_pixel_gap, {0, 1},
      "share of the depth; a pixel between the depths of two opposite neighbours and farther from "
      "both is no measurement; 0: all count");
  add_settings(t, o.filter);
  add_settings(t, o.normals);
  add_settings(t, o.depth_change);
}
/// Errors: a setting out of range; min_depth beyond max_depth.
Status check(const SurfaceOptions& options);
/// What the noise and the edges of such a camera ask for (docs/guide/cameras.md, "By kind of
/// sensor"). Of none: the defaults.
SurfaceOptions surface_options_for(SensorKind sensor);

/// Counts of one update.
struct SurfaceStats {
  int num_valid = 0;   ///< pixels with a usable depth, flying ones among them
  int num_points = 0;  ///< of these, points with a normal
};

/// What is made of a frame; the rest can follow later.
struct SurfaceParts {
  PixelWindow points;  ///< where points are needed; around it there may be more, or old ones
  bool depth_change = true;
};

/// Owns all buffers for one image size; `update` allocates nothing.
class SurfaceEstimator {
 public:
  /// Errors: size out of 8..kMaxImageWidth, intrinsics not positive and finite, options out of
  /// range. All instruction sets give the same bits; one that the processor lacks is lowered.
  /// Images that a lens has bent by `distortion` are straightened as they are read, each pixel from
  /// the nearest one.
  static Result<SurfaceEstimator> create(int width, int height, const Intrinsics& intrinsics,
                                         const SurfaceOptions& options = {}, Isa isa = best_isa(),
                                         const Distortion& distortion = {});
  SurfaceEstimator(SurfaceEstimator&&) noexcept;
  SurfaceEstimator& operator=(SurfaceEstimator&&) noexcept;
  ~SurfaceEstimator();

  /// Computes cloud and depth-change vectors of an image in host memory, of the size given at
  /// construction. The same bits for any number of threads in `pool`, and for any parts where they
  /// are. No allocation.
  SurfaceStats update(const DepthImageView& image, ThreadPool& pool,
                      const SurfaceParts& parts = {});
  /// The same from depth in metres (NaN or 0: no measurement), width * height values.
  SurfaceStats update(std::span<const float> depth, ThreadPool& pool,
                      const SurfaceParts& parts = {});
  /// Makes what the last update left out. What it has made keeps its values.
  void complete(ThreadPool& pool);

  /// Valid until the next update. Without edge vectors unless the depth change was made.
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

}  // namespace palpate::inline v0
