// Volumes above that of the tool.
#pragma once

#include <cstdio>
#include <string>

namespace palpate::inline v0 {

/// The scene and each object are measured by themselves and added. `share`: of the tool's volume,
/// the largest one; empty if nothing says that they overlap.
inline std::string counted_twice(double share) {
  constexpr double kWhole = 1.01;  // a tool that is inside of one of them, within rounding
  if (!(share > kWhole)) return "";
  char text[240];
  std::snprintf(text, sizeof text,
                "%.0f %% of the tool is inside: depth images and objects overlap, and each of them "
                "counts, in volume and force, what another one counts too; move the objects apart",
                100 * share);
  return text;
}

}  // namespace palpate::inline v0
