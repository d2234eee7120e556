// Surface estimation: from a raw depth frame to an organized cloud with normals and depth-change
// vectors (thesis sections 3.4 and 3.5, equations corrected).
#pragma once

#include <memory>
#include <span>

#include "palpate/cloud/depth_noise.h"
#include "palpate/cloud/depth_source.h"
#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "palpate/settings/setting_table.h"

namespace palpate { inline namespace v0 {

/// Filter of the depth before normals are estimated. It fills no holes.
enum class Smoothing {
  bilateral,  ///< the thesis' (eq. 3.12), the same everywhere
  /// As smooth as the data allow: details of all scales up to 32 pixels are kept where they exceed
  /// the noise of the frame, which it learns. Planes become flat, edges and small shapes stay. The
  /// whole image at any window: 2 to 4 ms of a core for 640 x 480. The same bits on a GPU.
  adaptive,
};
constexpr auto names_of(Smoothing) { return std::array{"bilateral", "adaptive"}; }

/// Filter of the depth. The bilateral one goes over the valid pixels q of a window (eq. 3.12,
/// divided by the sum of the weights): w = exp(-(du^2 + dv^2) / (2 sigma_space^2)) exp(-(z_q -
/// z_p)^2 / (2 (sigma_depth z_p^2)^2)).
struct DepthFilterOptions {
  bool enabled = true;
  Smoothing smoothing = Smoothing::adaptive;
  int radius = 2;            ///< pixels; window 2*radius+1
  double sigma_space = 1.5;  ///< pixels
  /// The similarity width is sigma_depth * z^2 (z in m), like the noise of structured light.
  double sigma_depth = 0.01;  ///< meters at 1 m
};
/// True if depth is smoothed scale by scale.
inline bool is_adaptive(const DepthFilterOptions& options) {
  return options.enabled && options.smoothing == Smoothing::adaptive;
}
inline void add_settings(SettingTable& t, DepthFilterOptions& o) {
  t.add("filter", o.enabled, "filter of the depth");
  t.add("smoothing", o.smoothing,
        "filter of the depth: as smooth as the data allow, or the thesis' bilateral one, usual "
        "with its point methods");
  t.add("filter_radius", o.radius, {1, 7, "pixels"},
        "bilateral: half width of the window of 2 radius + 1 pixels");
  t.add("filter_sigma_space", o.sigma_space, {0.1, 1000, "pixels"},
        "bilateral: filter width in the image");
  t.add("filter_sigma_depth", o.sigma_depth, {1e-6, 1, "m"},
        "bilateral: filter width in depth, at a depth of 1 m");
}

/// The noise model of the plane fit to the neighbors' covariance C.
enum class PlaneFit {
  /// Only the distance along the ray r of the center pixel is noisy, as in a depth camera: n
  /// minimizes n^T C n subject to n.r = 1, that is n ~ C^-1 r. No bias on slanted surfaces.
  along_ray,
  /// All coordinates are equally noisy: n is the eigenvector of the smallest eigenvalue (3.7).
  principal,
};
constexpr auto names_of(PlaneFit) { return std::array{"along_ray", "principal"}; }

/// Plane fit over a window (eqs. 3.7-3.11). The normal has unit length and points to the camera. No
/// normal if all neighbors lie on one image line: their plane would contain the eye.
struct NormalOptions {
  PlaneFit fit = PlaneFit::along_ray;
  int radius = 3;  ///< pixels; window 2*radius+1
  /// Neighbors count only if their depth differs by at most max_depth_change * z (z: depth of the
  /// center pixel, m), so the window does not reach across an edge.
  double max_depth_change = 0.03;
  bool anchoring = false;      ///< plane through the point itself (3.9)
  bool weighting = false;      ///< weights exp(-|p-q|^2 / (2 sigma^2)) (3.10, also in the mean)
  double weight_sigma = 0.01;  ///< meters at 1 m; grows with z^2
  /// Difference vectors scaled to unit length (3.11); those below 1e-5 z are ignored.
  bool normalization = false;
  /// With fewer valid neighbors (including the point): no normal. Larger than the window: all.
  int min_neighbors = 6;
};
inline void add_settings(SettingTable& t, NormalOptions& o) {
  t.add("plane_fit", o.fit, "noise model of the plane fit: along the ray, or all coordinates");
  t.add("normal_radius", o.radius, {1, 7, "pixels"}, "neighborhood for normals");
  t.add("normal_max_depth_change", o.max_depth_change, {1e-6, 10},
        "share of the depth; a neighbor farther off belongs to another surface");
  t.add("anchoring", o.anchoring, "fit planes through the point itself");
  t.add("weighting", o.weighting, "weight near neighbors more");
  t.add("weight_sigma", o.weight_sigma, {1e-6, 10, "m"},
        "width of the neighbor weights, at a depth of 1 m");
  t.add("normalization", o.normalization, "scale difference vectors to unit length");
  t.add("min_neighbors", o.min_neighbors, {3, 225, "pixels"},
        "minimum valid neighbors for a normal; more than the window has: all of them");
}

/// Silhouettes of the foreground (eqs. 3.13-3.16 corrected: outward, orthogonal to the viewing
/// ray). l = sum max(0, z_q - z_p - min_step) (du, dv, 0) over the valid ones of the 8 neighbors,
/// then l - (l.v) v with v = p / |p|.
struct DepthChangeOptions {
  bool enabled = true;
  double min_step = 0.05;  ///< meters: smaller steps do not count
};
inline void add_settings(SettingTable& t, DepthChangeOptions& o) {
  t.add("depth_change", o.enabled, "compute depth-change vectors, for `edges`");
  t.add("depth_change_min_step", o.min_step, {0, 1000, "m"}, "smaller depth steps do not count");
}

/// Options of surface estimation: filter, normals and range of depth.
struct SurfaceOptions {
  DepthFilterOptions filter = {};
  NormalOptions normals = {};
  DepthChangeOptions depth_change = {};
  double min_depth = 0.1;   ///< meters; nearer pixels are no measurement
  double max_depth = 10.0;  ///< meters; farther pixels are no points: space is free up to here
  /// Flying pixels: a pixel between the depths of two opposite neighbors and farther from both than
  /// this share of its own depth lies on neither surface and is discarded. So are surfaces steeper
  /// than atan(this * focal length in pixels). 0: no pixel is discarded.
  double flying_pixel_gap = 0;
  /// Random noise of a pixel, for the standard deviations of measurements (ContactWants::noise). 0:
  /// learned from each frame by adaptive smoothing; without it that of a Kinect v1.
  MeasurementNoise noise = {0, 0, 0};
};
/// True if somebody has said what the noise is.
inline bool is_known(const MeasurementNoise& noise) {
  return noise.at_zero > 0 || noise.growth > 0;
}
inline void add_settings(SettingTable& t, SurfaceOptions& o) {
  t.section("surface");
  t.add("min_depth", o.min_depth, {1e-3, 1e3, "m"}, "nearer pixels are no measurement");
  t.add("max_depth", o.max_depth, {1e-3, 1e3, "m"},
        "farther pixels are no surface: space is free up to here");
  t.add("flying_pixel_gap", o.flying_pixel_gap, {0, 1},
        "share of the depth; removes pixels between two opposite neighbors and farther "
        "from both; 0: off");
  t.add("noise_at_zero", o.noise.at_zero, {0, 1, "m"},
        "standard deviations of measurements: random noise of a pixel at depth 0; 0 with "
        "noise_growth 0: as adaptive smoothing learns it");
  t.add("noise_growth", o.noise.growth, {0, 1, "m"},
        "the same: what it grows by at 1 m; it grows with the square of the depth");
  t.add("noise_length", o.noise.length, {0, 64, "pixels"},
        "the same: correlation length of the noise over the image; 0: pixels are independent");
  add_settings(t, o.filter);
  add_settings(t, o.normals);
  add_settings(t, o.depth_change);
}
/// Checks the options. Errors: a setting out of range; min_depth greater than max_depth.
Status check(const SurfaceOptions& options);
/// Options for the noise and the edges of a kind of sensor (docs/reference/cameras.md, "By kind of
/// sensor"). For none: the defaults.
SurfaceOptions surface_options_for(SensorKind sensor);

/// Counts of one update.
struct SurfaceStats {
  int num_valid = 0;   ///< pixels with a usable depth, including flying pixels
  int num_points = 0;  ///< of these, points with a normal
};

/// The parts to compute for a frame; the rest can follow later by complete().
struct SurfaceParts {
  PixelWindow points;  ///< where points are needed; outside there may be more, or old ones
  bool depth_change = true;
};

/// Estimates surfaces of one image size. Owns all buffers; `update` allocates nothing.
class SurfaceEstimator {
 public:
  /// Allocates all buffers. Errors: size out of 8..kMaxImageWidth, intrinsics not positive and
  /// finite, options out of range. All instruction sets give the same bits; an unsupported one
  /// falls back to a lower one. Images with lens `distortion` are undistorted on reading: each
  /// pixel takes the nearest raw pixel.
  static Result<SurfaceEstimator> create(int width, int height, const Intrinsics& intrinsics,
                                         const SurfaceOptions& options = {}, Isa isa = best_isa(),
                                         const Distortion& distortion = {});
  SurfaceEstimator(SurfaceEstimator&&) noexcept;
  SurfaceEstimator& operator=(SurfaceEstimator&&) noexcept;
  ~SurfaceEstimator();

  /// Computes cloud and depth-change vectors of an image in host memory, of the size given at
  /// construction. Same bits for any number of threads in `pool` and for any `parts`. O(pixels). No
  /// allocation.
  SurfaceStats update(const DepthImageView& image, ThreadPool& pool,
                      const SurfaceParts& parts = {});
  /// The same from depth in meters (NaN or 0: no measurement), width * height values.
  SurfaceStats update(std::span<const float> depth, ThreadPool& pool,
                      const SurfaceParts& parts = {});
  /// Computes the parts that the last update omitted. Existing parts keep their values.
  void complete(ThreadPool& pool);

  /// Valid until the next update. Has edge vectors only if the depth change was computed.
  PointCloudView cloud() const;
  /// Filtered depth in meters, width * height values: NaN where there is no measurement, infinite
  /// where everything is farther than max_depth.
  std::span<const float> depth() const;
  /// Depth-change vectors, camera axes, m; zero away from edges. `axis`: 0 x, 1 y, 2 z.
  std::span<const float> depth_change(int axis) const;

 private:
  struct Impl;
  explicit SurfaceEstimator(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}}  // namespace palpate::v0
