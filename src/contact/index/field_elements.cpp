#include "src/contact/internal/field_elements.h"

#include <algorithm>
#include <cmath>

#include "src/contact/internal/ball_cut.h"
#include "src/contact/internal/ball_parts.h"
#include "src/contact/internal/whole_cluster.h"

namespace palpate { inline namespace v0 {
namespace {

// Spheres larger than this share of the tool's reach are split into parts.
constexpr double kLargest = 0.2;
// Share for even parts, over the sixth root of the number of spheres: the number of all parts grows
// as its square root, from about 1,300 for 1,000 spheres.
constexpr double kLargestEven = 0.2214;
// Largest filling of the ball around the tool: disjoint spheres, stretched to balls
// (RepresentedParts), have less.
constexpr double kMaxFilling = 1.5 * 1.5 * 1.5;
// Distance of a ball in parts from a surface, in its radii, from which none of its parts touches
// it.
constexpr float kBallMargin = 1.25f;

struct Element {
  Vec3d center;
  double radius;
  double volume;  ///< that counts, m3
  bool counted;
};

/// Also returns the indices of the elements of each ball in thirty parts, and each volume.
std::vector<Element> elements_of(const Tool& tool, SphereVolumes volumes, LargeSpheres large,
                                 std::vector<std::int32_t>& balls,
                                 std::vector<double>& volumes_of_balls) {
  double reach = 0;
  std::vector<Element> elements;
  for (std::size_t id = 0; id < tool.spheres().size(); ++id) {
    const Sphere ball = field_ball(tool, id, volumes);
    const double radius = ball.radius;
    const double volume = volumes == SphereVolumes::own
                              ? sphere_volume(radius)
                              : static_cast<double>(tool.represented_volumes()[id]);
    elements.push_back(
        {to_double(ball.center) - tool.sphere_mass().center_of_mass, radius, volume, true});
    reach = std::max(reach, norm(elements.back().center) + radius);
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
  const std::size_t num_spheres = elements.size();
  for (std::size_t i = 0; i < elements.size(); ++i) {
    // Even parts are small enough, and so are the elements without volume.
    if (elements[i].radius <= largest || elements[i].volume == 0) continue;
    if (is_even && i >= num_spheres) break;
    const Element whole = elements[i];
    if (is_even && whole.radius != parted) {
      parts = even_parts(largest / whole.radius);
      parted = whole.radius;
    }
    std::vector<std::int32_t> run;
    for (const BallPart& part : parts) {
      run.push_back(static_cast<std::int32_t>(elements.size()));
      elements.push_back({whole.center + whole.radius * part.center, whole.radius * part.radius,
                          whole.volume * part.share, false});
    }
    elements[i].volume = 0;
    if (is_even) continue;
    // A part has its place in the cluster of the larger ball.
    run.push_back(static_cast<std::int32_t>(i < num_spheres ? i : elements.size()));
    if (i >= num_spheres) elements.push_back({whole.center, whole.radius, 0, false});
    balls.insert(balls.end(), run.begin(), run.end());
    volumes_of_balls.push_back(whole.volume);
  }
  return elements;
}

/// Makes each cluster of loose elements one ball.
WholeClusters wholes_of(const FieldElements& elements) {
  const SphereClusters& c = elements.clusters;
  constexpr std::size_t kSize = SphereClusters::kSize;
  WholeClusters wholes(static_cast<std::size_t>(c.num_groups()) *
                       SphereClusters::kClustersPerGroup);
  if (c.num_loose < kMinWholes) return wholes;
  for (std::size_t cluster = 0; cluster < static_cast<std::size_t>(c.num_loose); ++cluster) {
    const auto center = [&](std::size_t slot) {
      return to_double(Vec3f{c.x[slot], c.y[slot], c.z[slot]});
    };
    const auto for_each = [&](const auto& f) {
      for (std::size_t slot = cluster * kSize; slot < (cluster + 1) * kSize; ++slot) {
        const double radius = elements.radius[slot];
        f(slot, radius, static_cast<double>(elements.factor[slot]) * sphere_volume(radius));
      }
    };
    double volume = 0, counted = 0, mean = 0, depth = 0, polar = 0;
    Vec3d first;
    for_each([&](std::size_t slot, double, double its_volume) {
      volume += its_volume;
      first += its_volume * center(slot);
      counted += static_cast<double>(elements.counted[slot]);
    });
    if (!(volume > 0)) continue;
    const Vec3d at = first / volume;
    for_each([&](std::size_t slot, double radius, double its_volume) {
      const double distance = norm(center(slot) - at);
      mean += its_volume / volume * radius;
      depth = std::max(depth, distance + deep_limit(radius));
      // A ball has 2/5 of its squared radius, and a distance 2/3 of its square in the mean over
      // all axes.
      polar += its_volume * (0.4 * radius * radius + 2.0 / 3 * distance * distance);
    });
    const double radius = mean;
    wholes.x[cluster] = static_cast<float>(at.x);
    wholes.y[cluster] = static_cast<float>(at.y);
    wholes.z[cluster] = static_cast<float>(at.z);
    wholes.radius[cluster] = static_cast<float>(radius);
    wholes.factor[cluster] = static_cast<float>(volume / sphere_volume(radius));
    wholes.counted[cluster] = static_cast<float>(counted);
    wholes.depth[cluster] = static_cast<float>(depth);
    wholes.polar[cluster] = static_cast<float>(polar);
  }
  return wholes;
}

std::vector<Sphere> balls_of(const std::vector<Element>& elements) {
  std::vector<Sphere> balls;
  for (const Element& e : elements) {
    balls.push_back({to_float(e.center), static_cast<float>(e.radius)});
  }
  return balls;
}

}  // namespace

Sphere field_ball(const Tool& tool, std::size_t id, SphereVolumes volumes) {
  return volumes == SphereVolumes::own ? tool.spheres()[id] : tool.represented_balls()[id];
}

FieldElements::FieldElements(const Tool& tool, SphereVolumes volumes, LargeSpheres large)
    : clusters(std::vector<Sphere>{}) {
  (void)ball_places();  // made here, not by the first query
  std::vector<std::int32_t> balls;
  std::vector<double> volumes_of_balls;
  const std::vector<Element> elements = elements_of(tool, volumes, large, balls, volumes_of_balls);
  clusters = SphereClusters(balls_of(elements), balls, kNumBallParts + 1);
  radius = clusters.radius;
  factor.resize(radius.size());
  counted.resize(radius.size());
  for (std::size_t slot = 0; slot < radius.size(); ++slot) {
    if (clusters.sphere_id[slot] < 0) {  // repeats its neighbor, with no weight
      for (std::vector<float>* const array : {&clusters.x, &clusters.y, &clusters.z, &radius}) {
        (*array)[slot] = (*array)[slot - 1];
      }
      continue;
    }
    const Vec3f center{clusters.x[slot], clusters.y[slot], clusters.z[slot]};
    reach = std::max(reach, norm(to_double(center)));
    const Element& e = elements[static_cast<std::size_t>(clusters.sphere_id[slot])];
    factor[slot] = static_cast<float>(e.volume / sphere_volume(e.radius));
    counted[slot] = e.counted ? 1.0f : 0.0f;
  }
  for (int cluster = 0; cluster < clusters.num_clusters(); ++cluster) {
    const auto begin = radius.begin() + std::ptrdiff_t{cluster} * SphereClusters::kSize;
    const float largest = *std::max_element(begin, begin + SphereClusters::kSize);
    const int ball = cluster - first_ball();
    largest_radius.push_back(ball < 0 ? largest : kBallMargin * largest);
    const double share = ball < 0 ? 0
                                  : volumes_of_balls[static_cast<std::size_t>(ball)] /
                                        sphere_volume(static_cast<double>(largest));
    ball_factor.push_back(static_cast<float>(share));
  }
  if (large == LargeSpheres::in_thirty) wholes = wholes_of(*this);
}

}}  // namespace palpate::v0
