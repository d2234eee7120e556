// Point clouds of the size of an image, pixel windows, and the alignment of clouds from several
// cameras.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/core.h"
#include "palpate/gpu/devices.h"
#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

// A rectangle of pixels.

/// Columns [left, right) and rows [top, bottom); the default covers every image.
struct PixelWindow {
  static constexpr int kEverything = 1 << 20;

  int left = 0, top = 0, right = kEverything, bottom = kEverything;

  int width() const { return right - left; }
  int height() const { return bottom - top; }
  bool is_empty() const { return left >= right || top >= bottom; }
  /// True if it covers an image of this size.
  bool has_all(int image_width, int image_height) const {
    return left <= 0 && top <= 0 && right >= image_width && bottom >= image_height;
  }
  bool contains(const PixelWindow& other) const {
    return left <= other.left && top <= other.top && right >= other.right && bottom >= other.bottom;
  }
  /// Larger by `margin` pixels on each side.
  PixelWindow grown(int margin) const {
    return {left - margin, top - margin, right + margin, bottom + margin};
  }
  /// The part inside of an image of this size.
  PixelWindow clipped(int image_width, int image_height) const {
    return {std::max(left, 0), std::max(top, 0), std::min(right, image_width),
            std::min(bottom, image_height)};
  }
  /// Bounding window of both.
  PixelWindow joined(const PixelWindow& other) const {
    return {std::min(left, other.left), std::min(top, other.top), std::max(right, other.right),
            std::max(bottom, other.bottom)};
  }
  /// Extended to multiples of `step`, clamped at 0.
  PixelWindow aligned(int step) const {
    const auto down = [step](int at) { return std::max(at, 0) / step * step; };
    return {down(left), down(top), down(right + step - 1), down(bottom + step - 1)};
  }
  friend bool operator==(const PixelWindow&, const PixelWindow&) = default;
};

// Oriented point clouds, organized like an image or not.

struct FrameNoise;  // of a frame by scale, see src/cloud/internal/frame_noise.h

/// Input of a query. Non-owning, trivially copyable. Point i has coordinates x[i], y[i], z[i]
/// (camera frame C, m) and a unit normal that points out of the environment. An invalid point is
/// NaN in all six. Point (u, v) of an organized cloud is i = v * width + u; an unorganized cloud
/// has height 1. The arrays are readable up to the next multiple of kPadding points; the padding is
/// NaN.
struct PointCloudView {
  static constexpr std::size_t kPadding = 64;

  const float *x = nullptr, *y = nullptr, *z = nullptr;
  const float *nx = nullptr, *ny = nullptr, *nz = nullptr;
  int width = 0, height = 0;
  /// True if point (u, v) lies on the viewing ray of pixel (u, v) of `intrinsics`. Then a query
  /// reads only the pixels that the tool can cover.
  bool pinhole = false;
  Intrinsics intrinsics;
  /// Depth-change vector of each point, camera axes, m (SurfaceEstimator::depth_change); zero away
  /// from edges. Null if there are none.
  const float *edge_x = nullptr, *edge_y = nullptr, *edge_z = nullptr;
  /// Measured depth of each pixel of a pinhole cloud, m; infinite: farther than `max_depth`, so
  /// that there is no point, and the ray is free up to there. Null: unknown.
  const float* depth = nullptr;
  float max_depth = 0;
  const FrameNoise* noise = nullptr;  ///< random noise of the depth; null: unknown
  int gpu = kHostMemory;              ///< whose memory the arrays are in
  /// Two views with the same stamp show the same values, except for stamp 0.
  std::uint64_t stamp = 0;

  std::size_t size() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
};

/// A point cloud that owns its arrays. All points start invalid.
class PointCloud {
 public:
  PointCloud() = default;
  /// Size in pixels. `pinhole`: the camera of an organized cloud. `has_edges`: with depth-change
  /// vectors.
  PointCloud(int width, int height, std::optional<Intrinsics> pinhole = std::nullopt,
             bool has_edges = false);

  int width() const { return width_; }
  int height() const { return height_; }
  std::size_t size() const {
    return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  }
  bool has_edges() const { return has_edges_; }
  /// Mutable access to an array, not bounds-checked: 0..5 are x, y, z, nx, ny, nz; with edges 6..8
  /// are their vectors, initially NaN.
  float* channel(int which) { return data_.data() + static_cast<std::size_t>(which) * stride_; }
  const float* channel(int which) const {
    return data_.data() + static_cast<std::size_t>(which) * stride_;
  }
  /// Point i in m, its unit normal, and its depth-change vector; i = row * width + column.
  Vec3f point(std::size_t i) const { return {channel(0)[i], channel(1)[i], channel(2)[i]}; }
  Vec3f normal(std::size_t i) const { return {channel(3)[i], channel(4)[i], channel(5)[i]}; }
  Vec3f edge(std::size_t i) const { return {channel(6)[i], channel(7)[i], channel(8)[i]}; }
  /// Sets a point and its normal (any nonzero length; it is normalized). A value that is not finite
  /// or a zero normal makes the point invalid.
  void set(std::size_t i, const Vec3f& p, const Vec3f& n);

  PointCloudView view() const;

 private:
  int width_ = 0, height_ = 0;
  std::size_t stride_ = 0;
  std::optional<Intrinsics> pinhole_;
  bool has_edges_ = false;
  std::vector<float> data_;
};

/// Points of one capture as a sensor delivers them, m, in its own frame. Non-owning. Organized like
/// an image: point (u, v) is v * width + u, not finite without a measurement; otherwise height 1.
struct PointsView {
  int width = 0, height = 1;
  std::span<const Vec3f> points;   ///< width * height
  std::span<const Vec3f> normals;  ///< likewise, out of the environment; empty: unknown
};

// Refinement of the poses of several cameras from their views of one scene.

/// Two views of one scene: the distance of their surfaces where both overlap.
struct ViewPair {
  int a = 0, b = 0;            ///< numbers of the views
  std::size_t num_points = 0;  ///< compared points of one view with the other, both ways
  /// m: robust standard deviation (by the median) of point-to-plane distances.
  double before = 0;
  double after = 0;   ///< m, the same with the refined poses
  double turned = 0;  ///< rad, change of the relative rotation
  double moved = 0;   ///< m, change of the relative position, at the center of the overlap
};

/// Result of align_views: the refined camera poses, and how well the views fit.
struct AlignedViews {
  std::vector<Pose> X_WC;  ///< the first one is unchanged
  std::vector<ViewPair> pairs;
  /// m: estimated error of the worst camera in the direction that the scene constrains least, from
  /// the noise of the views; rotations are scaled by the size of the scene.
  double uncertainty = 0;
};

/// Options of align_views.
struct AlignOptions {
  /// m: points of two views farther apart than this do not correspond; shrinks to `min_reach` as
  /// the poses converge.
  double reach = 0.06, min_reach = 0.01;
  int max_points = 20000;  ///< per view
  int max_rounds = 100;
};

/// Refines approximate poses (within 5 cm, 5 degrees) of all views together, so that
/// overlapping surfaces coincide (point to plane, Chen & Medioni 1992, with projective
/// association both ways, Blais & Levine 1995; robust with Tukey weights). Views: organized
/// pinhole clouds with normals, in host memory. `names` are for messages. O(points x pairs x
/// rounds): about a second for four views. Errors: fewer than two views; a view without
/// overlap; a scene with too little shape (a wall, a ball); surfaces that stay more than 5 mm
/// apart; no convergence.
Result<AlignedViews> align_views(std::span<const PointCloudView> views, std::span<const Pose> X_WC,
                                 std::span<const std::string> names,
                                 const AlignOptions& options = {});

}}  // namespace palpate::v0
