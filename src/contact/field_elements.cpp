#include "src/contact/field_elements.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// Twelve balls of radius kPartRadius with centres kPartDistance from the middle of a unit ball,
// each with a twelfth of its volume: the least squares fit to the cap volumes of the ball.
constexpr double kPartRadius = 0.494, kPartDistance = 0.6823;
constexpr int kNumParts = 12;
// Spheres are felt in parts if they are larger than this share of the tool's reach.
constexpr double kLargest = 0.2;
// Of the padding: anything positive.
constexpr float kTinyRadius = 1e-6f;

struct Element {
  Vec3d centre;
  double radius;
  double own_volume, represented_volume;
  bool counted;
};

std::vector<Vec3d> icosahedron() {
  std::vector<Vec3d> corners;
  const double golden = (1 + std::sqrt(5.0)) / 2;
  for (const double a : {-1.0, 1.0}) {
    for (const double b : {-golden, golden}) {
      for (const Vec3d& corner : {Vec3d{0, a, b}, Vec3d{a, b, 0}, Vec3d{b, 0, a}}) {
        corners.push_back(normalized(corner));
      }
    }
  }
  return corners;
}

/// Elements that are small enough, after as many steps of dividing as that takes.
std::vector<Element> elements_of(const Tool& tool) {
  const Vec3d& centre_of_mass = tool.sphere_mass().centre_of_mass;
  double reach = 0;
  std::vector<Element> elements;
  for (std::size_t id = 0; id < tool.spheres().size(); ++id) {
    const Sphere& s = tool.spheres()[id];
    const double radius = s.radius;
    elements.push_back({to_double(s.centre) - centre_of_mass, radius, sphere_volume(radius),
                        static_cast<double>(tool.represented_volumes()[id]), true});
    reach = std::max(reach, norm(elements.back().centre) + radius);
  }
  const std::vector<Vec3d> corners = icosahedron();
  for (std::size_t i = 0; i < elements.size(); ++i) {
    if (elements[i].radius <= kLargest * reach) continue;
    const Element whole = elements[i];
    for (const Vec3d& corner : corners) {
      elements.push_back({whole.centre + kPartDistance * whole.radius * corner,
                          kPartRadius * whole.radius, whole.own_volume / kNumParts,
                          whole.represented_volume / kNumParts, false});
    }
    // What is left of it is only counted.
    elements[i].own_volume = elements[i].represented_volume = 0;
  }
  std::erase_if(elements, [](const Element& e) { return e.represented_volume == 0 && !e.counted; });
  return elements;
}

std::vector<Sphere> balls_of(const std::vector<Element>& elements) {
  std::vector<Sphere> balls;
  for (const Element& e : elements) {
    balls.push_back({to_float(e.centre), static_cast<float>(e.radius)});
  }
  return balls;
}

}  // namespace

FieldElements::FieldElements(const Tool& tool) : clusters(std::vector<Sphere>{}) {
  const std::vector<Element> elements = elements_of(tool);
  clusters = SphereClusters(balls_of(elements));
  radius = clusters.radius;
  own_factor.resize(radius.size());
  represented_factor.resize(radius.size());
  counted.resize(radius.size());
  for (std::size_t place = 0; place < radius.size(); ++place) {
    if (clusters.sphere_id[place] < 0) {
      radius[place] = kTinyRadius;
      continue;
    }
    const Element& e = elements[static_cast<std::size_t>(clusters.sphere_id[place])];
    own_factor[place] = static_cast<float>(e.own_volume / sphere_volume(e.radius));
    represented_factor[place] = static_cast<float>(e.represented_volume / sphere_volume(e.radius));
    counted[place] = e.counted ? 1.0f : 0.0f;
  }
  for (auto begin = radius.begin(); begin != radius.end(); begin += SphereClusters::kSize) {
    largest_radius.push_back(*std::max_element(begin, begin + SphereClusters::kSize));
  }
}

}  // namespace palpate
