// The elements of the field method: the spheres of a tool, the large ones in parts.
#pragma once

#include <cstdint>
#include <vector>

#include "palpate/contact/contact.h"
#include "src/contact/index/sphere_clusters.h"

namespace palpate { inline namespace v0 {

/// Returns the ball that stands for a sphere of a tool. With own volumes it is the sphere. With
/// represented volumes it has the centroid and the second moment of the part of the solid that the
/// sphere stands for, and by its factor also the volume: so all elements together have the volume,
/// the center of mass and the second moment of the solid, and a layer of spheres of the skin, which
/// stand for the gaps around them, goes in without a jerk.
Sphere field_ball(const Tool& tool, std::size_t id, SphereVolumes volumes);

/// A ball takes one value of the field and cuts itself by one plane. That is exact for a flat
/// surface, and wrong by percents of the tool's volume for a ball as large as a third of the tool
/// at a ridge or a curved surface. So large balls are split into smaller ones that together have
/// their volume and second moments. Of spheres that overlap far more than those of a packing only
/// still larger ones are split, so that their parts are not more.
enum class LargeSpheres {
  in_thirty,  ///< thirty parts, corrected by a plane (ball_cut.h), for surfaces that cameras see
  evenly,     ///< many (even_parts): for bodies, of which a corner goes between thirty
};

/// Elements in slots: centers are relative to the tool's center of mass.
struct ElementRows {
  const float *x = nullptr, *y = nullptr, *z = nullptr;
  const float* radius = nullptr;
  const float* factor = nullptr;   ///< volume that counts / volume of the ball
  const float* counted = nullptr;  ///< number of spheres that it stands for when they are counted
};

/// Number of clusters from which on they may count as one ball. Where two ways out are equally
/// long, forces turn within the width of a cluster, and a cluster of fewer would be too large a
/// share.
inline constexpr int kMinWholes = 128;

/// Clusters as one ball each, a slot for each cluster: with the volume, the centroid and the mean
/// radius of its elements (whole_cluster.h). Those of balls in parts never count as one.
struct WholeClusters {
  explicit WholeClusters(std::size_t num_slots = 0)
      : x(num_slots),
        y(num_slots),
        z(num_slots),
        radius(num_slots, 1),
        factor(num_slots),
        counted(num_slots),
        depth(num_slots, 1e9f),
        polar(num_slots) {}

  ElementRows rows() const {
    return {x.data(), y.data(), z.data(), radius.data(), factor.data(), counted.data()};
  }
  std::size_t num_bytes() const { return bytes_of(x, y, z, radius, factor, counted, depth, polar); }

  std::vector<float> x, y, z, radius, factor, counted;
  std::vector<float> depth;  ///< from which on a cluster counts as one, m
  std::vector<float> polar;  ///< second moment of the volume about an axis through it, m5
};

/// Elements are in cluster order; centers are relative to the tool's center of mass. The numbers
/// (`sphere_id`) of those that are counted are those of their spheres. The parts of a ball in
/// thirty are a cluster of their own, in the order of ball_places, with an element behind them that
/// has the radius of the ball and no volume. Parts that are still large are balls in parts
/// themselves: in the cluster of the larger ball they have no volume either, and only tell where
/// its plane lies.
struct FieldElements {
  FieldElements(const Tool& tool, SphereVolumes volumes,
                LargeSpheres large = LargeSpheres::in_thirty);

  std::size_t num_bytes() const {
    return clusters.num_bytes() + bytes_of(radius, factor, counted, largest_radius, ball_factor) +
           wholes.num_bytes();
  }
  ElementRows rows() const {
    return {clusters.x.data(), clusters.y.data(), clusters.z.data(),
            radius.data(),     factor.data(),     counted.data()};
  }

  /// The clusters from this one on are the parts of balls.
  int first_ball() const { return clusters.num_loose; }

  SphereClusters clusters;
  // Per slot:
  std::vector<float> radius;          ///< as in `clusters`; padding is the ball before it again
  std::vector<float> factor;          ///< volume that counts / volume of the ball; padding: 0
  std::vector<float> counted;         ///< 1: stands for its sphere when spheres are counted
  std::vector<float> largest_radius;  ///< per cluster: nothing farther away touches
  std::vector<float> ball_factor;     ///< per cluster: factor of the ball, 0 if none
  WholeClusters wholes;               ///< of whole groups
  double reach = 0;                   ///< no center is farther from the tool's center of mass, m
};

}}  // namespace palpate::v0
