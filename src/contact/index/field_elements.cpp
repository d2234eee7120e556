#include "src/contact/index/field_elements.h"

#include <algorithm>
#include <cmath>

namespace palpate::inline v0 {
namespace {

// Thirty balls of radius kPartRadius with centres kPartDistance from the middle of a unit ball,
// each with a thirtieth of its volume: close to the least squares fit to the cap volumes of the
// ball.
constexpr double kPartRadius = 0.43, kPartDistance = 0.7;
// Spheres are felt in parts if they are larger than this share of the tool's reach.
constexpr double kLargest = 0.2;
// A ball has at most so many times the radius of its sphere.
constexpr double kMostGrowth = 1.5;

struct Element {
  Vec3d centre;
  double radius;
  double volume;  ///< that counts
  bool counted;
};

/// Of length 1: the midpoints of the edges of an icosahedron.
std::vector<Vec3d> icosidodecahedron() {
  std::vector<Vec3d> corners;
  const double golden = (1 + std::sqrt(5.0)) / 2;
  for (const double a : {-1.0, 1.0}) {
    corners.insert(corners.end(), {{a, 0, 0}, {0, a, 0}, {0, 0, a}});
    for (const double b : {-golden, golden}) {
      for (const double c : {-golden * golden, golden * golden}) {
        for (const Vec3d& corner : {Vec3d{a, b, c}, Vec3d{b, c, a}, Vec3d{c, a, b}}) {
          corners.push_back(normalized(corner));
        }
      }
    }
  }
  return corners;
}

/// Elements that are small enough, after as many steps of dividing as that takes.
std::vector<Element> elements_of(const Tool& tool, SphereVolumes volumes) {
  double reach = 0;
  std::vector<Element> elements;
  for (std::size_t id = 0; id < tool.spheres().size(); ++id) {
    const Sphere ball = felt_ball(tool, id, volumes);
    const double radius = ball.radius;
    const double volume = volumes == SphereVolumes::own
                              ? sphere_volume(radius)
                              : static_cast<double>(tool.represented_volumes()[id]);
    elements.push_back(
        {to_double(ball.centre) - tool.sphere_mass().centre_of_mass, radius, volume, true});
    reach = std::max(reach, norm(elements.back().centre) + radius);
  }
  const std::vector<Vec3d> corners = icosidodecahedron();
  for (std::size_t i = 0; i < elements.size(); ++i) {
    if (elements[i].radius <= kLargest * reach) continue;
    const Element whole = elements[i];
    for (const Vec3d& corner : corners) {
      elements.push_back({whole.centre + kPartDistance * whole.radius * corner,
                          kPartRadius * whole.radius,
                          whole.volume / static_cast<double>(corners.size()), false});
    }
    // What is left of it is only counted.
    elements[i].volume = 0;
  }
  std::erase_if(elements, [](const Element& e) { return e.volume == 0 && !e.counted; });
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

Sphere felt_ball(const Tool& tool, std::size_t id, SphereVolumes volumes) {
  Sphere ball = tool.spheres()[id];
  if (volumes == SphereVolumes::own) return ball;
  const double radius = ball.radius, volume = tool.represented_volumes()[id];
  const double growth = std::cbrt(volume / sphere_volume(radius));
  ball.radius = static_cast<float>(radius * std::clamp(growth, 1.0, kMostGrowth));
  return ball;
}

FieldElements::FieldElements(const Tool& tool, SphereVolumes volumes)
    : clusters(std::vector<Sphere>{}) {
  const std::vector<Element> elements = elements_of(tool, volumes);
  clusters = SphereClusters(balls_of(elements));
  radius = clusters.radius;
  factor.resize(radius.size());
  counted.resize(radius.size());
  for (std::size_t place = 0; place < radius.size(); ++place) {
    if (clusters.sphere_id[place] < 0) {  // asks what its neighbour asks, and counts nothing
      for (std::vector<float>* const array : {&clusters.x, &clusters.y, &clusters.z, &radius}) {
        (*array)[place] = (*array)[place - 1];
      }
      continue;
    }
    const Vec3f centre{clusters.x[place], clusters.y[place], clusters.z[place]};
    reach = std::max(reach, norm(to_double(centre)));
    const Element& e = elements[static_cast<std::size_t>(clusters.sphere_id[place])];
    factor[place] = static_cast<float>(e.volume / sphere_volume(e.radius));
    counted[place] = e.counted ? 1.0f : 0.0f;
  }
  for (auto begin = radius.begin(); begin != radius.end(); begin += SphereClusters::kSize) {
    largest_radius.push_back(*std::max_element(begin, begin + SphereClusters::kSize));
  }
}

}  // namespace palpate::inline v0
