#include "src/run/region_lookup.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

/// Materials that the labels give at one place, each by its weight.
struct Mix {
  Ground ground;
  double seen = 0;  // weight of all pixels

  void add(const Material& m, double weight) {
    ground.share += weight;
    ground.friction += weight * m.friction;
    ground.static_friction += weight * m.friction * m.static_ratio;
    ground.viscous += weight * m.viscous;
    ground.ridges += weight * m.friction * m.ridges;
    ground.grain += weight * m.friction * m.grain;
  }
};

/// Adds the materials of the four pixels around a point, by weight; none beyond the image.
void look_at(const RegionLookup& camera, const Vec3d& p_C, Mix& mix) {
  const MaterialRegions& regions = *camera.regions;
  if (!(p_C.z > 0)) return;
  const double u = camera.intrinsics.fx * p_C.x / p_C.z + camera.intrinsics.cx,
               v = camera.intrinsics.fy * p_C.y / p_C.z + camera.intrinsics.cy;
  visit_pixels_around(u, v, regions.width, regions.height, [&](int column, int row, double weight) {
    const std::size_t label =
        regions.labels[static_cast<std::size_t>(row) * static_cast<std::size_t>(regions.width) +
                       static_cast<std::size_t>(column)];
    mix.seen += weight;
    if (label < regions.materials.size() && regions.materials[label]) {
      mix.add(*regions.materials[label], weight);
    }
  });
}

Error refused(std::string why) { return {Errc::invalid_argument, std::move(why)}; }

bool is_possible(const Material& m) {
  const auto within = [](double value, double low, double high) {
    return value >= low && value <= high;
  };
  return within(m.friction, 0, 10) && within(m.static_ratio, 1, 10) && within(m.viscous, 0, 100) &&
         within(m.ridges, 0, 1) && within(m.grain, 0, 1);
}

}  // namespace

Result<std::vector<RegionLookup>> region_lookups(
    std::span<const std::shared_ptr<const MaterialRegions>> regions,
    std::span<const DepthStreamInfo> streams) {
  std::vector<RegionLookup> lookups;
  if (regions.size() > streams.size()) {
    return refused("there are labels for " + std::to_string(regions.size()) +
                   " cameras, but only " + std::to_string(streams.size()) +
                   " of them: one label image for each");
  }
  for (std::size_t k = 0; k < regions.size(); ++k) {
    const DepthStreamInfo& stream = streams[k];
    const MaterialRegions* const own = regions[k].get();
    if (own == nullptr || own->labels.empty()) {
      lookups.push_back({nullptr, stream.intrinsics});
      continue;
    }
    const std::size_t num =
        static_cast<std::size_t>(stream.width) * static_cast<std::size_t>(stream.height);
    if (own->width != stream.width || own->height != stream.height || own->labels.size() != num) {
      return refused("labels of " + std::to_string(own->width) + " x " +
                     std::to_string(own->height) + " pixels do not fit depth images of " +
                     std::to_string(stream.width) + " x " + std::to_string(stream.height) +
                     ": give one label for each pixel");
    }
    if (stream.is_moving) {
      return refused("labels need a static camera; remove them for a moving one");
    }
    for (const std::optional<Material>& material : own->materials) {
      if (material && !is_possible(*material)) {
        return refused(
            "a material has a friction of 0 to 10, a static_ratio of 1 to 10, a viscous "
            "part of 0 to 100 s/m, and ridges and grain of 0 to 1");
      }
    }
    lookups.push_back({regions[k], stream.intrinsics});
  }
  return lookups;
}

Ground ground_at(std::span<const RegionLookup> lookups, std::span<const SurfaceBlend> cameras,
                 const TouchedDisc& disc) noexcept {
  const double length = norm(disc.n_W);
  if (!(length > 0) || lookups.empty()) return {};
  const Vec3d n = disc.n_W / length;
  // The disc's axis t follows the image's x axis; a surface whose normal is that axis is not seen.
  const std::size_t num = std::min(lookups.size(), cameras.size());
  const double radius = disc.radius();
  Ground ground;
  std::array<Pose, kMaxCameras> X_CW;
  Vec3d t;
  for (std::size_t k = num; k-- > 0;) {
    X_CW[k] = inverse(cameras[k].to.X_WC);
    if (lookups[k].regions) t = rotate(cameras[k].to.X_WC.rotation, Vec3d{1, 0, 0});
  }
  t = t - n * dot(n, t);
  const double along = norm(t);
  if (!(along > 1e-6)) return {};
  t = t / along;
  const Vec3d s = cross(n, t);
  for (const DiscSpot& spot : kDiscSpots) {
    const Vec3d p_W = disc.p_W + t * (radius * spot.x) + s * (radius * spot.y);
    Mix mix;
    for (std::size_t k = 0; k < num; ++k) {
      if (lookups[k].regions) look_at(lookups[k], X_CW[k] * p_W, mix);
    }
    if (!(mix.seen > 0)) continue;
    const double by = 1 / ((mix.seen > 1 ? mix.seen : 1) * kNumDiscSpots);
    ground.share += by * mix.ground.share;
    ground.friction += by * mix.ground.friction;
    ground.static_friction += by * mix.ground.static_friction;
    ground.viscous += by * mix.ground.viscous;
    ground.ridges += by * mix.ground.ridges;
    ground.grain += by * mix.ground.grain;
  }
  return ground;
}

}}  // namespace palpate::v0
