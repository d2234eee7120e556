#include "src/cloud/surface_options.h"

#include "src/core/range.h"

namespace palpate {

Status check(const SurfaceOptions& options) {
  // The ranges keep every intermediate result inside single precision.
  if (Status status = check_settings(options); !status) return status;
  if (options.min_depth <= options.max_depth) return Done{};
  return Error{Errc::invalid_argument,
               "surface.min_depth must not be beyond surface.max_depth of " +
                   shortest_decimal(options.max_depth) + " m, not " +
                   shortest_decimal(options.min_depth) + " m"};
}

Status check_surface_settings(int width, int height, const Intrinsics& k,
                              const SurfaceOptions& options) {
  const Range ranges[] = {
      {"image width", static_cast<double>(width), 8, kMaxImageWidth},
      {"image height", static_cast<double>(height), 8, kMaxImageHeight},
      {"focal length fx", k.fx, 1, 1e6},
      {"focal length fy", k.fy, 1, 1e6},
      {"principal point cx", k.cx, -1e6, 1e6},
      {"principal point cy", k.cy, -1e6, 1e6},
  };
  if (const Range* const range = first_outside(ranges)) {
    return Error{Errc::invalid_argument,
                 std::string("surface estimation: ") + range->name + " is " +
                     number_text(range->value) + ", but must be from " + number_text(range->low) +
                     " to " + number_text(range->high) + "; correct this setting"};
  }
  return check(options);
}

}  // namespace palpate
