// The planes that bound the power cell of a sphere.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// A plane, seen from a point that is not on it: the points x with pull . (x - point) = 1. In a
/// unit direction u it is met at the distance 1 / (pull . u); it is 1 / strength away.
struct Pull {
  Vec3f pull;
  float strength = 0;  ///< |pull|
};

/// A k-d tree over spheres of many sizes. A node keeps the largest ones of its part for itself, so
/// those below are small and most of them are passed over together.
class PowerNeighbors {
 public:
  explicit PowerNeighbors(std::span<const Sphere> spheres);

  /// Number of sphere i of the tree in what the constructor got. Few steps lie between near
  /// spheres.
  std::size_t original(std::size_t i) const { return order_[i]; }
  const Sphere& sphere(std::size_t i) const { return spheres_[i]; }
  std::size_t size() const { return spheres_.size(); }

  /// Appends the planes of equal power between sphere i and the others, as seen from its center and
  /// with `reach` for the unit of length: all that are nearer than that, and perhaps some more.
  /// False if the center is behind one of them; this takes spheres that overlap.
  bool gather(std::size_t i, double reach, std::vector<Pull>& out) const;

 private:
  struct Node {
    Vec3f low, high;  ///< of all centers from here to `skip`
    float max_radius = 0;
    std::uint32_t begin = 0, end = 0;  ///< spheres of its own
    std::uint32_t skip = 0;            ///< the first node that is not below
  };
  void build(std::size_t begin, std::size_t end, std::span<const Sphere> spheres);

  std::vector<Node> nodes_;  ///< depth first
  std::vector<std::uint32_t> order_;
  std::vector<Sphere> spheres_;
};

}}  // namespace palpate::v0
