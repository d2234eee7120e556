#include "src/cloud/surface/surface_settings.h"

#include "src/cloud/internal/lens_table.h"

namespace palpate { inline namespace v0 {

Status check(const SurfaceOptions& options) {
  // The ranges keep every intermediate result inside single precision.
  if (Status status = check_settings(options); !status) return status;
  if (options.min_depth <= options.max_depth) return Done{};
  return Error{Errc::invalid_argument,
               "surface.min_depth must not be beyond surface.max_depth of " +
                   shortest_decimal(options.max_depth) + " m, not " +
                   shortest_decimal(options.min_depth) + " m"};
}

SurfaceOptions surface_options_for(SensorKind sensor) {
  SurfaceOptions options;
  switch (sensor) {
    case SensorKind::none: break;
    case SensorKind::structured_light:
      options.filter.radius = 3;
      options.filter.sigma_space = 2.5;
      break;
    case SensorKind::active_stereo:
      options.filter.radius = 3;
      options.filter.sigma_space = 2.5;
      options.filter.sigma_depth = 0.02;
      options.flying_pixel_gap = 0.03;
      break;
    case SensorKind::tof: options.flying_pixel_gap = 0.015; break;
  }
  return options;
}

Status check_surface_settings(int width, int height, const Intrinsics& intrinsics,
                              const SurfaceOptions& options, const Distortion& distortion) {
  Intrinsics k = intrinsics;
  SettingTable image;
  image.add("image width", width, {8, kMaxImageWidth, "pixels"}, "");
  image.add("image height", height, {8, kMaxImageHeight, "pixels"}, "");
  image.add("focal length fx", k.fx, {1, 1e6, "pixels"}, "");
  image.add("focal length fy", k.fy, {1, 1e6, "pixels"}, "");
  image.add("principal point cx", k.cx, {-1e6, 1e6, "pixels"}, "");
  image.add("principal point cy", k.cy, {-1e6, 1e6, "pixels"}, "");
  if (Status status = check_settings(image); !status) return status;
  if (Status status = check_distortion(distortion); !status) return status;
  return check(options);
}

}}  // namespace palpate::v0
