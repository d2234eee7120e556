#include "eval/studies/other_methods.h"

#include <algorithm>
#include <cmath>

#include "eval/studies/trilinear.h"

namespace palpate::eval {
namespace {

constexpr float kFar = 1e9f;

float square_of(const Vec3f& a) { return dot(a, a); }

Vec3d point(const PointCloudView& cloud, std::size_t i) {
  return to_double(Vec3f{cloud.x[i], cloud.y[i], cloud.z[i]});
}

}  // namespace

DistanceGrid::DistanceGrid(const PointCloudView& cloud, const Vec3d& middle, double side,
                           double cell)
    : low_(middle - Vec3d{side / 2, side / 2, side / 2}),
      cell_(cell),
      num_(static_cast<int>(std::ceil(side / cell))) {
  const std::vector<Vec3f> nearest = nearest_points(cloud);
  distances_.resize(nearest.size());
  const Intrinsics& k = cloud.intrinsics;
  for (int z = 0; z < num_; ++z) {
    for (int y = 0; y < num_; ++y) {
      for (int x = 0; x < num_; ++x) {
        const Vec3f p = to_float(center(x, y, z));
        float square = square_of(nearest[place(x, y, z)] - p);
        const auto try_one = [&](int i, int j, int l) {
          if (std::min({i, j, l}) < 0 || std::max({i, j, l}) >= num_) return;
          square = std::min(square, square_of(nearest[place(i, j, l)] - p));
        };
        try_one(x - 1, y, z), try_one(x + 1, y, z), try_one(x, y - 1, z);
        try_one(x, y + 1, z), try_one(x, y, z - 1), try_one(x, y, z + 1);
        bool is_behind = false;
        if (p.z > 0) {
          const auto u = static_cast<int>(std::lround(k.fx * p.x / p.z + k.cx)),
                     v = static_cast<int>(std::lround(k.fy * p.y / p.z + k.cy));
          if (u >= 0 && v >= 0 && u < cloud.width && v < cloud.height) {
            is_behind =
                p.z > cloud.z[static_cast<std::size_t>(v) * static_cast<std::size_t>(cloud.width) +
                              static_cast<std::size_t>(u)];
          }
        }
        const float distance = std::min(kFar, std::sqrt(square));
        distances_[place(x, y, z)] = is_behind ? -distance : distance;
      }
    }
  }
}

std::vector<Vec3f> DistanceGrid::nearest_points(const PointCloudView& cloud) const {
  const std::size_t num_cells = place(0, 0, num_);
  std::vector<Vec3f> sums(num_cells);
  std::vector<std::int32_t> counts(num_cells), nearest(num_cells, -1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!(cloud.z[i] > 0)) continue;
    const Vec3d at = (point(cloud, i) - low_) / cell_;
    if (!(at.x >= 0 && at.y >= 0 && at.z >= 0 && at.x < num_ && at.y < num_ && at.z < num_))
      continue;
    const std::size_t cell =
        place(static_cast<int>(at.x), static_cast<int>(at.y), static_cast<int>(at.z));
    sums[cell] += to_float(point(cloud, i));
    ++counts[cell];
    nearest[cell] = static_cast<std::int32_t>(cell);
  }
  spread(nearest);
  std::vector<Vec3f> points(num_cells, Vec3f{kFar, kFar, kFar});
  for (std::size_t cell = 0; cell < num_cells; ++cell) {
    if (nearest[cell] < 0) continue;
    const auto from = static_cast<std::size_t>(nearest[cell]);
    points[cell] = sums[from] / static_cast<float>(counts[from]);
  }
  return points;
}

/// From cells that are their own nearest to all cells, along x, then y, then z.
void DistanceGrid::spread(std::vector<std::int32_t>& nearest) const {
  const auto n = static_cast<std::size_t>(num_);
  // Squared distances between cells so far; of a line, the start of each parabola's interval.
  std::vector<float> squares(nearest.size()), line(n), begin(n);
  std::vector<std::int32_t> owner(n);
  std::vector<std::size_t> lowest(n);
  for (std::size_t stride : {std::size_t{1}, n, n * n}) {
    for (std::size_t i = 0; i < nearest.size(); ++i) {
      if (i / stride % n != 0) continue;  // first cell of a line
      std::size_t num_lowest = 0;
      for (std::size_t q = 0; q < n; ++q) {
        owner[q] = nearest[i + q * stride];
        if (owner[q] < 0) continue;
        line[q] = squares[i + q * stride];
        float from = -kFar;
        for (; num_lowest > 0; --num_lowest) {
          const std::size_t v = lowest[num_lowest - 1];
          const auto a = static_cast<float>(v), b = static_cast<float>(q);
          from = (line[q] - line[v] + b * b - a * a) / (2 * (b - a));
          if (from > begin[num_lowest - 1]) break;
          from = -kFar;
        }
        lowest[num_lowest] = q, begin[num_lowest] = from;
        ++num_lowest;
      }
      if (num_lowest == 0) continue;
      for (std::size_t q = 0, k = 0; q < n; ++q) {
        while (k + 1 < num_lowest && begin[k + 1] < static_cast<float>(q)) ++k;
        const float away = static_cast<float>(q) - static_cast<float>(lowest[k]);
        nearest[i + q * stride] = owner[lowest[k]];
        squares[i + q * stride] = line[lowest[k]] + away * away;
      }
    }
  }
}

scenes::SignedDistance DistanceGrid::at(const Vec3d& p) const {
  const Vec3d at = (p - low_) / cell_ - Vec3d{0.5, 0.5, 0.5};
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

Penetration DistanceGrid::hinge(const Tool& tool, const Pose& X_WT) const {
  const Vec3d center = tool.sphere_mass().center_of_mass;
  const Mat3d R_WT = rotation_matrix(X_WT.rotation);
  const Vec3f to_middle = to_float(R_WT * center),
              offset = to_float(X_WT.translation - low_) - to_float(Vec3d{1, 1, 1} * (cell_ / 2));
  float R[3][3];
  for (int i = 0; i < 9; ++i) R[i / 3][i % 3] = static_cast<float>(R_WT.m[i / 3][i % 3]);
  const int num[] = {num_, num_, num_};
  const auto cells_per_meter = static_cast<float>(1 / cell_);
  Vec3f force, torque;
  for (const Sphere& s : tool.spheres()) {
    const Vec3f c{R[0][0] * s.center.x + R[0][1] * s.center.y + R[0][2] * s.center.z,
                  R[1][0] * s.center.x + R[1][1] * s.center.y + R[1][2] * s.center.z,
                  R[2][0] * s.center.x + R[2][1] * s.center.y + R[2][2] * s.center.z};
    const Vec3f at = (c + offset) * cells_per_meter;
    TrilinearCell<float> cell;
    if (!cell.find({at.x, at.y, at.z}, num)) continue;
    const float depth = s.radius - cell.distance(distances_.data(), num);
    if (!(depth > 0)) continue;
    float n[3];
    cell.gradient(n);
    const Vec3f pushed = Vec3f{n[0], n[1], n[2]} * (cells_per_meter * depth);
    force += pushed;
    torque += cross(c - to_middle, pushed);
  }
  Penetration result;
  result.measure_W = {to_double(force), to_double(torque)};
  return result;
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
  // Along the surface towards the point, then back onto the surface.
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
