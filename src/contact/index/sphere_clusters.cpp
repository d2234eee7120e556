#include "src/contact/index/sphere_clusters.h"

#include <algorithm>

namespace palpate { inline namespace v0 {
namespace {

// Puts ids into an order in which every aligned run of `kSize * 2^k` is compact: halves the longest
// side of the box around the centers, at a multiple of the run length, again and again.
void sort_spatially(std::span<const Sphere> spheres, std::span<std::int32_t> ids) {
  if (ids.size() <= SphereClusters::kSize) return;
  Vec3f low = spheres[static_cast<std::size_t>(ids[0])].center, high = low;
  for (std::int32_t id : ids) {
    const Vec3f& c = spheres[static_cast<std::size_t>(id)].center;
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], c[axis]);
      high[axis] = std::max(high[axis], c[axis]);
    }
  }
  const Vec3f size = high - low;
  const int axis = size.x >= size.y ? (size.x >= size.z ? 0 : 2) : (size.y >= size.z ? 1 : 2);
  std::size_t half = SphereClusters::kSize;
  while (half * 2 < ids.size()) half *= 2;
  std::nth_element(ids.begin(), ids.begin() + static_cast<std::ptrdiff_t>(half), ids.end(),
                   [&](std::int32_t a, std::int32_t b) {
                     const float ca = spheres[static_cast<std::size_t>(a)].center[axis];
                     const float cb = spheres[static_cast<std::size_t>(b)].center[axis];
                     return ca != cb ? ca < cb : a < b;
                   });
  sort_spatially(spheres, ids.first(half));
  sort_spatially(spheres, ids.subspan(half));
}

// Slots [begin, end), rounded outwards.
Cluster enclose(const SphereClusters& c, std::size_t begin, std::size_t end) {
  Vec3f low{1e30f, 1e30f, 1e30f}, high = -low;
  for (std::size_t i = begin; i < end; ++i) {
    if (c.sphere_id[i] < 0) continue;
    low = {std::min(low.x, c.x[i]), std::min(low.y, c.y[i]), std::min(low.z, c.z[i])};
    high = {std::max(high.x, c.x[i]), std::max(high.y, c.y[i]), std::max(high.z, c.z[i])};
  }
  Cluster cluster{(low + high) * 0.5f, (high - low) * 0.50001f, 0};
  for (std::size_t i = begin; i < end; ++i) {
    if (c.sphere_id[i] < 0) continue;
    const float distance = norm(Vec3f{c.x[i], c.y[i], c.z[i]} - cluster.center);
    cluster.reach = std::max(cluster.reach, (distance + c.radius[i]) * 1.00001f);
  }
  return cluster;
}

}  // namespace

SphereClusters::SphereClusters(std::span<const Sphere> spheres,
                               std::span<const std::int32_t> together, int in_run)
    : run(in_run) {
  std::vector<char> is_loose(spheres.size(), 1);
  for (const std::int32_t id : together) is_loose[static_cast<std::size_t>(id)] = 0;
  std::vector<std::int32_t> order;
  for (std::size_t id = 0; id < spheres.size(); ++id) {
    if (is_loose[id] != 0) order.push_back(static_cast<std::int32_t>(id));
  }
  num_loose_spheres = static_cast<int>(order.size());
  sort_spatially(spheres, order);
  // Spheres of like size next to each other: vectors of them take the same branches.
  for (std::size_t begin = 0; begin < order.size(); begin += kSize) {
    const auto from = order.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto to =
        order.begin() + static_cast<std::ptrdiff_t>(std::min(begin + kSize, order.size()));
    std::sort(from, to, [&](std::int32_t a, std::int32_t b) {
      const float ra = spheres[static_cast<std::size_t>(a)].radius;
      const float rb = spheres[static_cast<std::size_t>(b)].radius;
      return ra != rb ? ra > rb : a < b;
    });
  }

  constexpr std::size_t kClusterSize = kSize;
  order.resize((order.size() + kClusterSize - 1) / kClusterSize * kClusterSize, -1);
  num_loose = static_cast<int>(order.size() / kClusterSize);
  for (std::size_t i = 0; i < together.size(); ++i) {
    order.push_back(together[i]);
    if (static_cast<int>(i) % run != run - 1) continue;
    order.resize((order.size() + kClusterSize - 1) / kClusterSize * kClusterSize, -1);
  }
  const std::size_t num_slots = order.size();
  for (std::vector<float>* array : {&x, &y, &z, &radius, &volume}) array->assign(num_slots, 0.0f);
  sphere_id.assign(num_slots, -1);
  slot_of.resize(spheres.size());
  for (std::size_t slot = 0; slot < order.size(); ++slot) {
    const std::int32_t id = order[slot];
    if (id < 0) continue;
    const Sphere& s = spheres[static_cast<std::size_t>(id)];
    x[slot] = s.center.x;
    y[slot] = s.center.y;
    z[slot] = s.center.z;
    radius[slot] = s.radius;
    volume[slot] = static_cast<float>(sphere_volume(static_cast<double>(s.radius)));
    sphere_id[slot] = id;
    slot_of[static_cast<std::size_t>(id)] = static_cast<std::int32_t>(slot);
  }
  for (std::size_t begin = 0; begin < num_slots; begin += kSize) {
    clusters.push_back(enclose(*this, begin, begin + kSize));
  }
  constexpr std::size_t kGroup = static_cast<std::size_t>(kSize) * kClustersPerGroup;
  for (std::size_t begin = 0; begin < num_slots; begin += kGroup) {
    groups.push_back(enclose(*this, begin, std::min(begin + kGroup, num_slots)));
  }
}

}}  // namespace palpate::v0
