// The buffers of surface estimation and its stages one by one, for the estimator and the benchmark.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "palpate/cloud/surface_estimator.h"
#include "src/cloud/frames/far_pixels.h"
#include "src/cloud/surface/adaptive/adaptive_filter.h"
#include "src/cloud/surface/surface_kernels.h"

namespace palpate { inline namespace v0 {

/// Call the stages in the order read, filter, estimate_normals, find_depth_change. None allocates.
/// Points may be requested in a window alone: filter and normals then do that and what it needs.
class SurfaceStages {
 public:
  /// Settings as check_surface_settings accepts them.
  SurfaceStages(int width, int height, const Intrinsics& intrinsics, const SurfaceOptions& options,
                Isa isa, const Distortion& distortion = {});
  SurfaceStages(const SurfaceStages&) = delete;  // the passes point into the buffers
  SurfaceStages& operator=(const SurfaceStages&) = delete;

  /// Depth in meters, kNoDepth for what is no measurement, kFarDepth for what is too far; returns
  /// the number of depths.
  int read(const DepthImageView& image, ThreadPool& pool);
  /// Filters depth, and decides which of the far pixels are errors.
  void filter(ThreadPool& pool, const PixelWindow& desired = {});
  int estimate_normals(ThreadPool& pool, const PixelWindow& desired = {});  ///< number of points
  void find_depth_change(ThreadPool& pool);

  const PointCloud& cloud() const { return cloud_; }
  float max_depth() const { return raw_pass_.max_depth; }
  const FrameNoise& noise() const { return noise_; }
  std::span<const float> depth() const { return depth_; }
  std::span<const float> depth_change(int axis) const { return change_[axis]; }
  std::size_t num_pixels() const { return depth_.size(); }

 private:
  int read(const RawPass& pass, ThreadPool& pool);
  template <class Task>
  int sum_over_strips(ThreadPool& pool, const PixelWindow& window, const Task& task);

  SurfaceOptions options_;
  SurfaceKernels kernels_;
  int width_, height_;
  std::ptrdiff_t stride_;
  std::vector<std::uint32_t> raw_pixels_;  // undistortion table; empty: no distortion
  std::vector<float> raw_, filtered_;      // padded
  FarGroups far_;
  std::optional<AdaptiveFilter> adaptive_;
  FrameNoise noise_;
  std::vector<float> ray_x_, ray_y_, space_;
  std::vector<float> depth_, change_[3];
  std::vector<int> strip_counts_;
  PointCloud cloud_;
  RawPass raw_pass_;
  FilterPass filter_pass_;
  NormalPass normal_pass_;
  DepthChangePass change_pass_;
};

}}  // namespace palpate::v0
