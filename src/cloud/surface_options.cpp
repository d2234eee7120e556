#include "src/cloud/surface_options.h"

#include <algorithm>
#include <string>

#include "src/cloud/surface_kernels.h"
#include "src/core/range.h"

namespace palpate {
Status check_surface_settings(int width, int height, const Intrinsics& k,
                              const SurfaceOptions& options) {
  const DepthFilterOptions& filter = options.filter;
  const NormalOptions& normals = options.normals;
  const int window = 2 * std::clamp(normals.radius, 1, kMaxWindowRadius) + 1;
  // The limits keep every intermediate result inside single precision.
  const Range ranges[] = {
      {"image width", static_cast<double>(width), 8, kMaxImageWidth},
      {"image height", static_cast<double>(height), 8, kMaxImageHeight},
      {"focal length fx", k.fx, 1, 1e6},
      {"focal length fy", k.fy, 1, 1e6},
      {"principal point cx", k.cx, -1e6, 1e6},
      {"principal point cy", k.cy, -1e6, 1e6},
      {"min_depth", options.min_depth, 1e-3, 1e3},
      {"max_depth", options.max_depth, options.min_depth, 1e3},
      {"filter.radius", static_cast<double>(filter.radius), 1, kMaxWindowRadius},
      {"filter.sigma_space", filter.sigma_space, 0.1, 1e3},
      {"filter.sigma_depth", filter.sigma_depth, 1e-6, 1},
      {"normals.radius", static_cast<double>(normals.radius), 1, kMaxWindowRadius},
      {"normals.max_depth_change", normals.max_depth_change, 1e-6, 10},
      {"normals.weight_sigma", normals.weight_sigma, 1e-6, 1e3},
      {"normals.min_neighbours", static_cast<double>(normals.min_neighbours), 3,
       static_cast<double>(window * window)},
      {"depth_change.min_step", options.depth_change.min_step, 0, 1e3},
  };
  if (const Range* const range = first_outside(ranges)) {
    return Error{Errc::invalid_argument,
                 std::string("surface estimation: ") + range->name + " is " +
                     number_text(range->value) + ", but must be from " + number_text(range->low) +
                     " to " + number_text(range->high) + "; correct this setting"};
  }
  return Done{};
}

}  // namespace palpate
