// Volumes above that of the tool.
#pragma once

#include <algorithm>
#include <cstdio>
#include <string>

#include "palpate/contact/contact.h"

namespace palpate { inline namespace v0 {

/// The scene and each object are measured by themselves and added. Says why the largest sum is more
/// than the tool, if it is; empty: it is not.
inline std::string more_than_whole(const Tool& tool, const ContactOptions& contact, double volume) {
  constexpr double kWhole = 1.01;  // inside one of them, within rounding
  const double whole = full_volume(tool, contact);
  if (!(volume > kWhole * whole)) return "";
  const double whole_in_object = full_volume(
      tool, contact.bodies == BodyMethod::field ? SphereVolumes::represented : SphereVolumes::own);
  char percent[40];
  std::snprintf(percent, sizeof percent, "%.0f %% of the tool", 100 * volume / whole);
  if (volume > kWhole * std::max(whole, whole_in_object)) {
    return percent +
           std::string(
               " is inside: depth images and objects overlap, and each of them counts, in "
               "volume and force, what another one counts too; move the objects apart");
  }
  return percent + std::string(" is inside: objects count its whole mesh, the method ") +
         name_of(contact.method) +
         " only its spheres; --volumes represented counts the mesh in both";
}

}}  // namespace palpate::v0
