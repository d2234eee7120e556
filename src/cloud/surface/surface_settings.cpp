#include "src/cloud/surface/surface_settings.h"

#include <algorithm>
#include <numbers>

#include "src/cloud/internal/lens_table.h"

namespace palpate { inline namespace v0 {
namespace {

// exp(-d^2 / (2 sigma^2)) = 2^(-d^2 * this)
double gauss_scale(double sigma) { return 1 / (2 * sigma * sigma * std::numbers::ln2); }

}  // namespace

std::vector<float> ray_table(int num, double f, double c) {
  std::vector<float> table(static_cast<std::size_t>(num + PaddedDepth::kMargin));
  for (std::size_t i = 0; i < table.size(); ++i) {
    table[i] = static_cast<float>((static_cast<double>(i) - c) / f);
  }
  return table;
}

std::vector<std::uint32_t> lens_table_of(int width, int height, const Intrinsics& k,
                                         const Distortion& distortion) {
  if (distortion == Distortion{}) return {};
  return lens_table({width, height, k, {}}, {width, height, k, distortion});
}

std::vector<float> space_exponents(const DepthFilterOptions& options) {
  std::vector<float> exponents;
  for (int dv = -options.radius; dv <= options.radius; ++dv) {
    for (int du = -options.radius; du <= options.radius; ++du) {
      exponents.push_back(
          static_cast<float>(-(du * du + dv * dv) * gauss_scale(options.sigma_space)));
    }
  }
  return exponents;
}

FilterPass filter_settings(const SurfaceOptions& options) {
  FilterPass pass;
  const bool is_bilateral = options.filter.enabled && !is_adaptive(options.filter);
  pass.radius = is_bilateral ? options.filter.radius : 0;
  pass.range = static_cast<float>(gauss_scale(options.filter.sigma_depth));
  pass.flying_gap = static_cast<float>(options.flying_pixel_gap);
  return pass;
}

NormalPass normal_settings(const NormalOptions& options, const Intrinsics& k) {
  NormalPass pass;
  pass.pixel_x = static_cast<float>(1 / k.fx);
  pass.pixel_y = static_cast<float>(1 / k.fy);
  pass.radius = options.radius;
  pass.max_depth_change = static_cast<float>(options.max_depth_change);
  const int window = 2 * options.radius + 1;
  pass.min_neighbors = static_cast<float>(std::min(options.min_neighbors, window * window));
  pass.along_ray = options.fit == PlaneFit::along_ray;
  pass.anchoring = options.anchoring;
  pass.weighting = options.weighting;
  pass.normalization = options.normalization;
  pass.weight = static_cast<float>(gauss_scale(options.weight_sigma));
  return pass;
}

}}  // namespace palpate::v0
