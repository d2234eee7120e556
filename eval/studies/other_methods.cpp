#include "eval/studies/other_methods.h"

#include <algorithm>
#include <cmath>

#include "eval/studies/trilinear.h"

namespace palpate::eval {
namespace {

Vec3d point(const PointCloudView& cloud, std::size_t i) {
  return to_double(Vec3f{cloud.x[i], cloud.y[i], cloud.z[i]});
}

}  // namespace

DistanceGrid::DistanceGrid(const PointCloudView& cloud, const Vec3d& middle, double side,
                           double voxel)
    : low_(middle - Vec3d{side / 2, side / 2, side / 2}),
      voxel_(voxel),
      num_(static_cast<int>(std::ceil(side / voxel))) {
  constexpr float kFar = 1e9f;
  const std::size_t num_voxels = place(0, 0, num_);
  std::vector<Vec3f> nearest(num_voxels, Vec3f{kFar, kFar, kFar});
  std::vector<Vec3d> sums(num_voxels);
  std::vector<int> counts(num_voxels);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!(cloud.z[i] > 0)) continue;
    const Vec3d at = (point(cloud, i) - low_) / voxel_;
    if (!(at.x >= 0 && at.y >= 0 && at.z >= 0 && at.x < num_ && at.y < num_ && at.z < num_))
      continue;
    const std::size_t v =
        place(static_cast<int>(at.x), static_cast<int>(at.y), static_cast<int>(at.z));
    sums[v] += point(cloud, i);
    ++counts[v];
  }
  for (std::size_t v = 0; v < num_voxels; ++v) {
    if (counts[v] > 0) nearest[v] = to_float(sums[v] / counts[v]);
  }
  spread(nearest);
  distances_.resize(num_voxels);
  for (int z = 0; z < num_; ++z) {
    for (int y = 0; y < num_; ++y) {
      for (int x = 0; x < num_; ++x) {
        const Vec3d p = centre(x, y, z);
        const std::size_t v = place(x, y, z);
        const double u = cloud.intrinsics.fx * p.x / p.z + cloud.intrinsics.cx;
        const double w = cloud.intrinsics.fy * p.y / p.z + cloud.intrinsics.cy;
        const auto column = static_cast<int>(std::lround(u)),
                   row = static_cast<int>(std::lround(w));
        bool is_behind = false;
        if (p.z > 0 && column >= 0 && row >= 0 && column < cloud.width && row < cloud.height) {
          const float seen =
              cloud.z[static_cast<std::size_t>(row) * static_cast<std::size_t>(cloud.width) +
                      static_cast<std::size_t>(column)];
          is_behind = p.z > static_cast<double>(seen);
        }
        const double distance = std::min(1e3, norm(to_double(nearest[v]) - p));
        distances_[v] = static_cast<float>(is_behind ? -distance : distance);
      }
    }
  }
}

void DistanceGrid::spread(std::vector<Vec3f>& nearest) const {
  // Both directions along each of the three ways to run through the grid.
  for (int sweep = 0; sweep < 6; ++sweep) {
    const int slow = sweep % 3, direction = sweep < 3 ? 1 : -1;
    for (int a = 0; a < num_; ++a) {
      for (int b = 0; b < num_; ++b) {
        for (int c = 0; c < num_; ++c) {
          int at[3];
          at[slow] = direction > 0 ? a : num_ - 1 - a;
          at[(slow + 1) % 3] = direction > 0 ? b : num_ - 1 - b;
          at[(slow + 2) % 3] = direction > 0 ? c : num_ - 1 - c;
          const Vec3d p = centre(at[0], at[1], at[2]);
          Vec3f& own = nearest[place(at[0], at[1], at[2])];
          double least = norm(to_double(own) - p);
          for (int k = 0; k < 9; ++k) {
            int from[3] = {at[0], at[1], at[2]};
            from[slow] -= direction;
            from[(slow + 1) % 3] += k % 3 - 1;
            from[(slow + 2) % 3] += k / 3 - 1;
            if (std::min({from[0], from[1], from[2]}) < 0) continue;
            if (std::max({from[0], from[1], from[2]}) >= num_) continue;
            const Vec3f& other = nearest[place(from[0], from[1], from[2])];
            const double distance = norm(to_double(other) - p);
            if (distance < least) least = distance, own = other;
          }
        }
      }
    }
  }
}

scenes::SignedDistance DistanceGrid::at(const Vec3d& p) const {
  const Vec3d at = (p - low_) / voxel_ - Vec3d{0.5, 0.5, 0.5};
  const int num[] = {num_, num_, num_};
  TrilinearCell<double> cell;
  if (!cell.find({at.x, at.y, at.z}, num)) return {1e3, {0, 0, -1}};
  const double distance = cell.distance(distances_.data(), num);
  double change[3];
  cell.gradient(change);
  const Vec3d gradient{change[0], change[1], change[2]};
  const double length = norm(gradient);
  return {distance, length > 0 ? gradient / length : Vec3d{0, 0, -1}};
}

GodObject::Surface GodObject::at(const Vec3d& p) const {
  const Intrinsics& k = cloud_.intrinsics;
  const int u = static_cast<int>(std::lround(k.fx * p.x / p.z + k.cx)),
            v = static_cast<int>(std::lround(k.fy * p.y / p.z + k.cy));
  const int window = static_cast<int>(std::ceil(k.fx * reach_ / p.z));
  double weights = 0, distance = 0;
  Vec3d normal;
  for (int row = std::max(0, v - window); row <= std::min(cloud_.height - 1, v + window); ++row) {
    for (int column = std::max(0, u - window); column <= std::min(cloud_.width - 1, u + window);
         ++column) {
      const auto i = static_cast<std::size_t>(row) * static_cast<std::size_t>(cloud_.width) +
                     static_cast<std::size_t>(column);
      if (!std::isfinite(cloud_.nx[i])) continue;
      const Vec3d to = p - point(cloud_, i);
      const double share = dot(to, to) / (reach_ * reach_);
      if (share >= 1) continue;
      const double weight = (1 - share) * (1 - share);
      const Vec3d n = to_double(Vec3f{cloud_.nx[i], cloud_.ny[i], cloud_.nz[i]});
      weights += weight;
      distance += weight * dot(n, to);
      normal += weight * n;
    }
  }
  if (weights == 0) return {};
  return {distance / weights, normalized(normal)};
}

Vec3d GodObject::pull(const Vec3d& p_W) {
  if (!is_held_) {
    const Surface surface = at(p_W);
    if (norm(surface.normal) == 0 || surface.distance >= 0) return {};
    proxy_ = p_W - surface.distance * surface.normal;
    is_held_ = true;
  }
  // Along the surface towards the point, and back onto it.
  for (int i = 0; i < 20; ++i) {
    Surface surface = at(proxy_);
    if (norm(surface.normal) == 0) break;
    proxy_ += -surface.distance * surface.normal;
    const Vec3d way = p_W - proxy_;
    if (dot(way, surface.normal) > 0) {
      is_held_ = false;
      return {};
    }
    const Vec3d along = way - dot(way, surface.normal) * surface.normal;
    proxy_ += 0.5 * along;
    if (norm(along) < 1e-6) break;
  }
  const Surface surface = at(proxy_);
  if (norm(surface.normal) > 0) proxy_ += -surface.distance * surface.normal;
  return proxy_ - p_W;
}

}  // namespace palpate::eval
