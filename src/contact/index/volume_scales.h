// The factor by which each sphere's volume counts.
#pragma once

#include <vector>

#include "palpate/contact/contact.h"
#include "src/contact/index/sphere_clusters.h"

namespace palpate { inline namespace v0 {

/// Factors of V_s: represented / own volume of each sphere, or ones.
struct VolumeScales {
  std::vector<float> of_sphere;
  std::vector<float> of_slot;  ///< of SphereClusters

  std::size_t num_bytes() const { return bytes_of(of_sphere, of_slot); }

  VolumeScales(const Tool& tool, const SphereClusters& clusters, SphereVolumes volumes)
      : of_sphere(tool.spheres().size(), 1.0f), of_slot(clusters.x.size(), 1.0f) {
    if (volumes == SphereVolumes::own) return;
    for (std::size_t id = 0; id < of_sphere.size(); ++id) {
      const double own = sphere_volume(static_cast<double>(tool.spheres()[id].radius));
      const double represented = static_cast<double>(tool.represented_volumes()[id]);
      of_sphere[id] = static_cast<float>(represented / own);
      of_slot[static_cast<std::size_t>(clusters.slot_of[id])] = of_sphere[id];
    }
  }
};

}}  // namespace palpate::v0
