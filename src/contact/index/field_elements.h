// The elements of the field method: the spheres of a tool, the large ones in parts.
#pragma once

#include <cstdint>
#include <vector>

#include "palpate/contact/contact.h"
#include "src/contact/index/sphere_clusters.h"

namespace palpate::inline v0 {

/// The ball that stands for a sphere of a tool. With own volumes it is the sphere. With represented
/// volumes it is as large as the part of the solid that the sphere stands for: a sphere of the
/// skin, which stands for the gaps around it, becomes wider, not denser, and a layer of such
/// spheres goes in without a jerk. It grows by half at most, which bounds how early it touches;
/// what is missing is made up for by its factor.
Sphere field_ball(const Tool& tool, std::size_t id, SphereVolumes volumes);

/// A ball takes one value of the field and cuts itself by one plane. That is exact for a flat
/// surface, and wrong by percents of the tool's volume for a ball as large as a third of the tool
/// at a ridge or a curved surface. So large balls are split into smaller ones that together have
/// their volume and second moments. Of spheres that overlap far more than those of a packing only
/// still larger ones are split, so that their parts are not more.
enum class LargeSpheres {
  in_thirty,  ///< thirty parts (thirty_parts): few, for the surfaces that cameras see
  evenly,     ///< many (even_parts): for bodies, of which a corner goes between thirty
};

/// Elements are in cluster order; centres are relative to the tool's centre of mass. The numbers
/// (`sphere_id`) of those that are counted are those of their spheres.
struct FieldElements {
  FieldElements(const Tool& tool, SphereVolumes volumes,
                LargeSpheres large = LargeSpheres::in_thirty);

  std::size_t num_bytes() const {
    return clusters.num_bytes() + bytes_of(radius, factor, counted, largest_radius);
  }

  SphereClusters clusters;
  // Per slot:
  std::vector<float> radius;          ///< as in `clusters`; padding is the ball before it again
  std::vector<float> factor;          ///< volume that counts / volume of the ball; padding: 0
  std::vector<float> counted;         ///< 1: stands for its sphere when spheres are counted
  std::vector<float> largest_radius;  ///< per cluster
  double reach = 0;                   ///< no centre is farther from the tool's centre of mass, m
};

}  // namespace palpate::inline v0
