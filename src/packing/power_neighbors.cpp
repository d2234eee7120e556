#include "src/packing/power_neighbors.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kNodeSize = 8;
constexpr double kStrongest = 1e30;  // pulls are single precision

// The plane of equal power of two spheres with radii r and s, d apart, is
// (d^2 + r^2 - s^2) / 2d away from the center of the first. The twofold numerator:
double numerator(double d2, double r, double s) { return d2 + r * r - s * s; }

bool is_farther(double twice_d_distance, double d2, double reach) {
  return twice_d_distance > 0 && twice_d_distance * twice_d_distance > 4 * reach * reach * d2;
}

}  // namespace

PowerNeighbors::PowerNeighbors(std::span<const Sphere> spheres) : order_(spheres.size()) {
  std::iota(order_.begin(), order_.end(), 0u);
  build(0, spheres.size(), spheres);
  for (const std::uint32_t i : order_) spheres_.push_back(spheres[i]);
}

void PowerNeighbors::build(std::size_t begin, std::size_t end, std::span<const Sphere> spheres) {
  if (begin == end) return;
  // Brings the spheres with the least keys of [first, end) before `middle`.
  const auto split = [&](std::size_t first, std::size_t middle, auto&& key) {
    const auto at = [&](std::size_t i) { return order_.begin() + static_cast<std::ptrdiff_t>(i); };
    std::nth_element(at(first), at(middle), at(end), [&](std::uint32_t i, std::uint32_t j) {
      const float a = key(spheres[i]), b = key(spheres[j]);
      return a < b || (a == b && i < j);
    });
  };
  const std::size_t own = std::min(begin + kNodeSize, end);
  if (own < end) split(begin, own, [](const Sphere& sphere) { return -sphere.radius; });
  Node node;
  node.low = node.high = spheres[order_[begin]].center;
  for (std::size_t i = begin; i < end; ++i) {
    const Sphere& sphere = spheres[order_[i]];
    for (int k = 0; k < 3; ++k) {
      node.low[k] = std::min(node.low[k], sphere.center[k]);
      node.high[k] = std::max(node.high[k], sphere.center[k]);
    }
    node.max_radius = std::max(node.max_radius, sphere.radius);
  }
  node.begin = static_cast<std::uint32_t>(begin);
  node.end = static_cast<std::uint32_t>(own);
  const std::size_t id = nodes_.size();
  nodes_.push_back(node);
  if (own < end) {
    const Vec3f size = node.high - node.low;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const std::size_t middle = own + (end - own) / 2;
    split(own, middle, [&](const Sphere& sphere) { return sphere.center[axis]; });
    build(own, middle, spheres);
    build(middle, end, spheres);
  }
  nodes_[id].skip = static_cast<std::uint32_t>(nodes_.size());
}

bool PowerNeighbors::gather(std::size_t i, double reach, std::vector<Pull>& out) const {
  const Vec3d center = to_double(spheres_[i].center);
  const double radius = spheres_[i].radius;
  for (std::size_t n = 0; n < nodes_.size();) {
    const Node& node = nodes_[n];
    double d2 = 0;  // to the box of centers
    for (int k = 0; k < 3; ++k) {
      const double apart = std::max({0.0, static_cast<double>(node.low[k]) - center[k],
                                     center[k] - static_cast<double>(node.high[k])});
      d2 += apart * apart;
    }
    // Beyond `reach` planes come nearer with larger spheres and nearer centers.
    const double max_radius = node.max_radius;
    if (d2 > reach * reach && is_farther(numerator(d2, radius, max_radius), d2, reach)) {
      n = node.skip;
      continue;
    }
    for (std::size_t j = node.begin; j < node.end; ++j) {
      const Vec3d apart = to_double(spheres_[j].center) - center;
      const double apart2 = dot(apart, apart), other = spheres_[j].radius;
      const double top = numerator(apart2, radius, other);
      if (apart2 == 0 || is_farther(top, apart2, reach)) continue;  // itself as well
      const double scale = 2 * reach / top;
      const double strength = scale * std::sqrt(apart2);
      if (!(strength > 0 && strength < kStrongest)) return false;
      out.push_back({to_float(apart * scale), static_cast<float>(strength)});
    }
    ++n;
  }
  return true;
}

}}  // namespace palpate::v0
