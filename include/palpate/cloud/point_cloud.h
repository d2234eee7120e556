// Oriented point clouds, organised like an image or not.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "palpate/cloud/intrinsics.h"
#include "palpate/gpu/devices.h"
#include "palpate/math/vec3.h"

namespace palpate {

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

}  // namespace palpate
