#include "src/contact/index/field_elements.h"

#include <algorithm>
#include <cmath>

#include "src/contact/index/ball_parts.h"

namespace palpate::inline v0 {
namespace {

// Spheres larger than this share of the tool's reach are split into parts.
constexpr double kLargest = 0.2;
// And evenly in parts of this share, over the sixth root of the number of spheres: that of all
// parts grows as its square root, from about 1,300 for 1,000 spheres.
constexpr double kLargestEven = 0.2214;
// A ball has at most so many times the radius of its sphere.
constexpr double kMaxGrowth = 1.5;
// So many times the volume of the ball around the tool is more than disjoint spheres can have,
// grown to balls.
constexpr double kMaxFilling = kMaxGrowth * kMaxGrowth * kMaxGrowth;

struct Element {
  Vec3d centre;
  double radius;
  double volume;  ///< that counts
  bool counted;
};

std::vector<Element> elements_of(const Tool& tool, SphereVolumes volumes, LargeSpheres large) {
  double reach = 0;
  std::vector<Element> elements;
  for (std::size_t id = 0; id < tool.spheres().size(); ++id) {
    const Sphere ball = field_ball(tool, id, volumes);
    const double radius = ball.radius;
    const double volume = volumes == SphereVolumes::own
                              ? sphere_volume(radius)
                              : static_cast<double>(tool.represented_volumes()[id]);
    elements.push_back(
        {to_double(ball.centre) - tool.sphere_mass().centre_of_mass, radius, volume, true});
    reach = std::max(reach, norm(elements.back().centre) + radius);
  }
  double filling = 0;  // of the ball around the tool
  for (const Element& e : elements) filling += sphere_volume(e.radius) / sphere_volume(reach);
  const bool is_even = large == LargeSpheres::evenly;
  double largest =
      reach *
      (is_even ? kLargestEven / std::pow(static_cast<double>(elements.size()), 1.0 / 6) : kLargest);
  if (filling > kMaxFilling) largest *= std::cbrt(filling / kMaxFilling);
  std::vector<BallPart> parts = thirty_parts();
  double parted = 0;  // radius of the last sphere in even parts
  for (std::size_t i = 0; i < elements.size(); ++i) {
    if (elements[i].radius <= largest || (is_even && !elements[i].counted)) continue;
    const Element whole = elements[i];
    if (is_even && whole.radius != parted) {
      parts = even_parts(largest / whole.radius);
      parted = whole.radius;
    }
    for (const BallPart& part : parts) {
      elements.push_back({whole.centre + whole.radius * part.centre, whole.radius * part.radius,
                          whole.volume * part.share, false});
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

Sphere field_ball(const Tool& tool, std::size_t id, SphereVolumes volumes) {
  Sphere ball = tool.spheres()[id];
  if (volumes == SphereVolumes::own) return ball;
  const double radius = ball.radius, volume = tool.represented_volumes()[id];
  const double growth = std::cbrt(volume / sphere_volume(radius));
  ball.radius = static_cast<float>(radius * std::clamp(growth, 1.0, kMaxGrowth));
  return ball;
}

FieldElements::FieldElements(const Tool& tool, SphereVolumes volumes, LargeSpheres large)
    : clusters(std::vector<Sphere>{}) {
  const std::vector<Element> elements = elements_of(tool, volumes, large);
  clusters = SphereClusters(balls_of(elements));
  radius = clusters.radius;
  factor.resize(radius.size());
  counted.resize(radius.size());
  for (std::size_t slot = 0; slot < radius.size(); ++slot) {
    if (clusters.sphere_id[slot] < 0) {  // samples what its neighbour samples, with no weight
      for (std::vector<float>* const array : {&clusters.x, &clusters.y, &clusters.z, &radius}) {
        (*array)[slot] = (*array)[slot - 1];
      }
      continue;
    }
    const Vec3f centre{clusters.x[slot], clusters.y[slot], clusters.z[slot]};
    reach = std::max(reach, norm(to_double(centre)));
    const Element& e = elements[static_cast<std::size_t>(clusters.sphere_id[slot])];
    factor[slot] = static_cast<float>(e.volume / sphere_volume(e.radius));
    counted[slot] = e.counted ? 1.0f : 0.0f;
  }
  for (auto begin = radius.begin(); begin != radius.end(); begin += SphereClusters::kSize) {
    largest_radius.push_back(*std::max_element(begin, begin + SphereClusters::kSize));
  }
}

}  // namespace palpate::inline v0
