#include "src/contact/edge_planes.h"

#include <algorithm>
#include <cmath>

#include "palpate/math/two_plane_cut.h"

namespace palpate {
namespace {

Vec3d sum_of(const std::int64_t (&sum)[4]) {
  return Vec3d{static_cast<double>(sum[0]), static_cast<double>(sum[1]),
               static_cast<double>(sum[2])} /
         PointSums::kScale;
}

}  // namespace

bool EdgePiece::is_before(const LenderPoint& lender) const {
  return dot(plane_T.normal, lender.p_T) > plane_T.offset &&
         lender.range > range + EdgeSums::kSameSurface;
}

EdgePlanes::EdgePlanes(std::span<const Sphere> spheres, const SphereClusters& clusters)
    : spheres_(spheres),
      clusters_(&clusters),
      piece_of_(spheres.size(), -1),
      distance_(spheres.size()),
      side_(spheres.size(), kBehind) {
  pieces_.reserve(spheres.size() * EdgeSums::kDirections);
  near_.reserve(spheres.size() * EdgeSums::kDirections);
}

void EdgePlanes::clear() { pieces_.clear(); }

void EdgePlanes::add_pieces(const EdgeSums& edges, const Mat3d& R_TW, const Vec3d& translation_W) {
  for (const PointSums& sums : edges.towards) {
    if (sums.num_points() == 0) continue;
    const Vec3d offset_W = sum_of(sums.offset_W) / static_cast<double>(sums.num_points());
    const Vec3d p_W = translation_W + offset_W, ray_W = normalized(p_W);
    // The mean direction, orthogonal to the mean viewing ray.
    const Vec3d change_W = sum_of(sums.normal_W);
    const Vec3d n_T = R_TW * normalized(change_W - dot(change_W, ray_W) * ray_W);
    if (!(p_W.z > 0)) continue;
    const Plane<double> plane_T{n_T, dot(n_T, R_TW * offset_W)};
    pieces_.push_back({p_W.x / p_W.z, p_W.y / p_W.z, norm(p_W), plane_T});
  }
}

// A piece is nearest to some sphere of the cluster only if it is at most twice the radius of the
// cluster in the image farther from its middle than the nearest one there.
void EdgePlanes::find_nearest(std::span<const Seen> cluster) {
  const Seen& middle = cluster[cluster.size() / 2];
  const auto squared_distance = [](const EdgePiece& piece, const Seen& seen) {
    const double du = piece.u - seen.u, dv = piece.v - seen.v;
    return du * du + dv * dv;
  };
  double least = 1e300, squared_radius = 0;
  for (const EdgePiece& piece : pieces_) least = std::min(least, squared_distance(piece, middle));
  for (const Seen& seen : cluster) {
    const double du = seen.u - middle.u, dv = seen.v - middle.v;
    squared_radius = std::max(squared_radius, du * du + dv * dv);
  }
  constexpr double kSlack = 1 + 1e-9;
  const double reach = (std::sqrt(least) + 2 * std::sqrt(squared_radius)) * kSlack;
  near_.clear();
  for (std::size_t i = 0; i < pieces_.size(); ++i) {
    if (squared_distance(pieces_[i], middle) <= reach * reach) {
      near_.push_back(static_cast<std::int32_t>(i));
    }
  }
  for (const Seen& seen : cluster) {
    double nearest = 1e300;
    for (const std::int32_t i : near_) {
      const double squared = squared_distance(pieces_[static_cast<std::size_t>(i)], seen);
      if (squared < nearest) {
        nearest = squared;
        piece_of_[static_cast<std::size_t>(seen.id)] = i;
      }
    }
  }
}

void EdgePlanes::find_nearest(const Pose& X_WT, Edges rule) {
  if (empty()) return;
  const Mat3d R_WT = rotation_matrix(X_WT.rotation);
  for (std::size_t begin = 0; begin < clusters_->sphere_id.size(); begin += SphereClusters::kSize) {
    Seen cluster[SphereClusters::kSize];
    std::size_t num = 0;
    for (std::size_t place = begin; place < begin + SphereClusters::kSize; ++place) {
      const std::int32_t id = clusters_->sphere_id[place];
      if (id < 0) continue;
      const auto i = static_cast<std::size_t>(id);
      const Vec3d c_W = R_WT * to_double(spheres_[i].centre) + X_WT.translation;
      side_[i] = kBehind;
      if (!(c_W.z > 0)) continue;  // no pixel sees it
      cluster[num++] = {id, c_W.x / c_W.z, c_W.y / c_W.z};
    }
    if (num == 0) continue;
    find_nearest({cluster, num});
    for (std::size_t k = 0; k < num; ++k) {
      const auto i = static_cast<std::size_t>(cluster[k].id);
      const Plane<double>& plane = piece(cluster[k].id).plane_T;
      const double radius = spheres_[i].radius;
      const double distance = dot(plane.normal, to_double(spheres_[i].centre)) - plane.offset;
      const double from = rule == Edges::centre ? 0 : -radius;
      const double to = rule == Edges::cut ? radius : from;
      distance_[i] = distance;
      side_[i] = distance < from ? kBehind : (distance < to ? kCut : kBeyond);
    }
  }
}

void EdgePlanes::note(const LenderPoint& lender) {
  for (EdgePiece& piece : pieces_) piece.has_beyond |= piece.is_before(lender);
}

double EdgePlanes::volume(std::int32_t id, const Plane<double>& plane_T,
                          const LenderPoint& lender) const {
  const auto i = static_cast<std::size_t>(id);
  const double radius = spheres_[i].radius;
  const double distance = dot(plane_T.normal, to_double(spheres_[i].centre)) - plane_T.offset;
  if (side_[i] == kBehind || lies_beyond(id, lender)) return cap_volume(radius, distance);
  if (side_[i] == kBeyond) return 0;
  const Vec3d& edge_normal = piece(id).plane_T.normal;
  return two_plane_cut(radius, distance, distance_[i], dot(plane_T.normal, edge_normal)).volume;
}

double EdgePlanes::full_volume(std::int32_t id, const LenderPoint& lender) const {
  const auto i = static_cast<std::size_t>(id);
  const double radius = spheres_[i].radius;
  if (side_[i] == kBehind || lies_beyond(id, lender)) return sphere_volume(radius);
  return side_[i] == kBeyond ? 0 : cap_volume(radius, distance_[i]);
}

}  // namespace palpate
