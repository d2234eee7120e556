// Point clouds of the size of an image, windows of it, and clouds of several cameras laid onto each
// other.
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

namespace palpate::inline v0 {

// A rectangle of pixels.

/// Columns [left, right) and rows [top, bottom); by default those of every image.
struct PixelWindow {
  static constexpr int kEverything = 1 << 20;

  int left = 0, top = 0, right = kEverything, bottom = kEverything;

  int width() const { return right - left; }
  int height() const { return bottom - top; }
  bool is_empty() const { return left >= right || top >= bottom; }
  /// Of an image of this size.
  bool has_all(int image_width, int image_height) const {
    return left <= 0 && top <= 0 && right >= image_width && bottom >= image_height;
  }
  bool contains(const PixelWindow& other) const {
    return left <= other.left && top <= other.top && right >= other.right && bottom >= other.bottom;
  }
  PixelWindow grown(int margin) const {
    return {left - margin, top - margin, right + margin, bottom + margin};
  }
  PixelWindow clipped(int image_width, int image_height) const {
    return {std::max(left, 0), std::max(top, 0), std::min(right, image_width),
            std::min(bottom, image_height)};
  }
  /// Around both.
  PixelWindow joined(const PixelWindow& other) const {
    return {std::min(left, other.left), std::min(top, other.top), std::max(right, other.right),
            std::max(bottom, other.bottom)};
  }
  /// From multiples of `step` to multiples of `step`, not negative.
  PixelWindow aligned(int step) const {
    const auto down = [step](int at) { return std::max(at, 0) / step * step; };
    return {down(left), down(top), down(right + step - 1), down(bottom + step - 1)};
  }
  friend bool operator==(const PixelWindow&, const PixelWindow&) = default;
};

// Oriented point clouds, organised like an image or not.

/// What a query sees. Not owning, trivially copyable. Point i has coordinates x[i], y[i], z[i]
/// (camera frame C, metres) and a unit normal out of the environment. An invalid point is NaN in
/// all six. Point (u, v) of an organised cloud is i = v * width + u; an unorganised cloud has
/// height 1. The arrays are readable up to the next multiple of kPadding points; the padding is
/// NaN.
struct PointCloudView {
  static constexpr std::size_t kPadding = 64;

  const float *x = nullptr, *y = nullptr, *z = nullptr;
  const float *nx = nullptr, *ny = nullptr, *nz = nullptr;
  int width = 0, height = 0;
  /// True if point (u, v) lies on the viewing ray of pixel (u, v) of `intrinsics`. Lets a query
  /// look only at the pixels the tool can cover.
  bool pinhole = false;
  Intrinsics intrinsics;
  /// Depth-change vector of each point in camera axes, m (SurfaceEstimator::depth_change); zero
  /// away from edges. Null if there are none.
  const float *edge_x = nullptr, *edge_y = nullptr, *edge_z = nullptr;
  int gpu = kHostMemory;  ///< whose memory the arrays are in
  /// Two views with one stamp show the same values, unless it is 0.
  std::uint64_t stamp = 0;

  std::size_t size() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
};

/// Owns the arrays. All points start invalid.
class PointCloud {
 public:
  PointCloud() = default;
  PointCloud(int width, int height, std::optional<Intrinsics> pinhole = std::nullopt,
             bool has_edges = false);

  int width() const { return width_; }
  int height() const { return height_; }
  std::size_t size() const {
    return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  }
  bool has_edges() const { return has_edges_; }
  /// Mutable access to one of the six arrays, in the order x, y, z, nx, ny, nz; with edges nine: of
  /// their vectors, which are NaN at the beginning.
  float* channel(int which) { return data_.data() + static_cast<std::size_t>(which) * stride_; }
  const float* channel(int which) const {
    return data_.data() + static_cast<std::size_t>(which) * stride_;
  }
  Vec3f point(std::size_t i) const { return {channel(0)[i], channel(1)[i], channel(2)[i]}; }
  Vec3f normal(std::size_t i) const { return {channel(3)[i], channel(4)[i], channel(5)[i]}; }
  Vec3f edge(std::size_t i) const { return {channel(6)[i], channel(7)[i], channel(8)[i]}; }
  /// Stores a point with its normal (any length but zero; it is normalised). Anything not finite
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

// Where cameras are that look at one scene, found out from what they see.

/// Two views of one scene: how far their surfaces are apart, where both see the same.
struct ViewPair {
  int a = 0, b = 0;            ///< numbers of the views
  std::size_t num_points = 0;  ///< of one that have been compared with the other, both ways
  /// m, of points from the planes of the other view: the standard deviation by the median.
  double before = 0;
  double after = 0;   ///< m, likewise, with the refined poses
  double turned = 0;  ///< rad, by how much the pose of one in the other has changed
  double moved = 0;   ///< m, likewise, at the middle of what both see
};

struct AlignedViews {
  std::vector<Pose> X_WC;  ///< the first one's is as it was
  std::vector<ViewPair> pairs;
  /// m: about how far the worst camera may be off in the direction in which the scene holds it
  /// least, by the noise of what is seen; turns count at the size of the scene.
  double uncertainty = 0;
};

struct AlignOptions {
  /// m: surfaces of two views that are farther apart than this are not the same; shrinks to
  /// `least_reach` as the poses get better.
  double reach = 0.06, least_reach = 0.01;
  int max_points = 20000;  ///< of each view
  int max_rounds = 100;
};

/// Refines poses that are about right (5 cm, 5 degrees): all views at once, so that the surfaces of
/// those that see the same lie on each other (point to plane, Chen & Medioni 1992, with projective
/// association both ways, Blais & Levine 1995; robust by Tukey's weights). Organised pinhole clouds
/// with normals, in host memory. `names` are for messages. O(points x pairs x rounds): about a
/// second for four views. Errors: fewer than two views; a view that shares nothing with the others;
/// a scene with too little shape (a wall, a ball); surfaces that stay more than 5 mm apart; no
/// convergence.
Result<AlignedViews> align_views(std::span<const PointCloudView> views, std::span<const Pose> X_WC,
                                 std::span<const std::string> names,
                                 const AlignOptions& options = {});

}  // namespace palpate::inline v0
