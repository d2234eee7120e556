#include "src/packing/solid/ray_patches.h"

#include <algorithm>
#include <cmath>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr float kRounding = 1e-5f;

}  // namespace

// A Fibonacci spiral runs from pole to pole: a piece of it is a belt, and a patch is what follows
// each other along the belt.
std::vector<RayPatch> make_ray_patches(std::size_t num) {
  constexpr std::size_t kSize = RayPatch::kSize;
  std::vector<RayPatch> patches(num);
  struct Ray {
    double turn;
    Vec3d direction;
  };
  std::vector<Ray> belt;
  const double golden = (3 - std::sqrt(5.0)) / 2;
  const auto num_belts = static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(num))));
  for (std::size_t b = 0; b < num_belts; ++b) {
    const std::size_t begin = b * num / num_belts, end = (b + 1) * num / num_belts;
    belt.clear();
    for (std::size_t i = begin * kSize; i < end * kSize; ++i) {
      const double z = 1 - (2 * static_cast<double>(i) + 1) / static_cast<double>(num * kSize);
      const double turns = golden * static_cast<double>(i), turn = turns - std::floor(turns);
      const double angle = 2 * kPi * turn, radius = std::sqrt(1 - z * z);
      belt.push_back({turn, {radius * std::cos(angle), radius * std::sin(angle), z}});
    }
    std::sort(belt.begin(), belt.end(), [](const Ray& a, const Ray& c) { return a.turn < c.turn; });
    for (std::size_t p = begin; p < end; ++p) {
      RayPatch& patch = patches[p];
      const Ray* rays = &belt[(p - begin) * kSize];
      Vec3d sum;
      for (std::size_t k = 0; k < kSize; ++k) sum += rays[k].direction;
      patch.axis = to_float(normalized(sum));
      for (std::size_t k = 0; k < kSize; ++k) {
        const Vec3f u = to_float(rays[k].direction);
        patch.x[k / 4][k % 4] = u.x;
        patch.y[k / 4][k % 4] = u.y;
        patch.z[k / 4][k % 4] = u.z;
        patch.spread = std::max(patch.spread, norm(u - patch.axis) + kRounding);
      }
    }
  }
  return patches;
}

}}  // namespace palpate::v0
