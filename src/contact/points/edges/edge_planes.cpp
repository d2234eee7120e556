#include "src/contact/points/edges/edge_planes.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {
EdgePlanes::EdgePlanes(std::span<const Sphere> spheres, const SphereClusters& clusters,
                       bool has_edges)
    : spheres_(spheres), clusters_(&clusters) {
  if (!has_edges) return;
  piece_of_.assign(spheres.size(), -1);
  distance_.resize(spheres.size());
  side_.assign(spheres.size(), EdgeSide::behind);
  pieces_.reserve(spheres.size() * EdgeSums::kDirections);
  near_.reserve(spheres.size() * EdgeSums::kDirections);
}

void EdgePlanes::clear() { pieces_.clear(); }

void EdgePlanes::add_pieces(const EdgeSums& edges, double sum_scale, const Mat3d& R_TW,
                            const Vec3d& translation_W) {
  for (const PointSums& sums : edges.towards) {
    const EdgePiece piece = edge_piece(sums, sum_scale, R_TW, translation_W);
    if (piece.exists()) pieces_.push_back(piece);
  }
}

// A piece is nearest to some sphere of the cluster only if its distance from the middle exceeds
// that of the nearest one by at most twice the radius of the cluster in the image.
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
    for (std::size_t slot = begin; slot < begin + SphereClusters::kSize; ++slot) {
      const std::int32_t id = clusters_->sphere_id[slot];
      if (id < 0) continue;
      const auto i = static_cast<std::size_t>(id);
      const Vec3d c_W = R_WT * to_double(spheres_[i].center) + X_WT.translation;
      side_[i] = EdgeSide::behind;
      if (!(c_W.z > 0)) continue;  // no pixel sees it
      cluster[num++] = {id, c_W.x / c_W.z, c_W.y / c_W.z};
    }
    if (num == 0) continue;
    find_nearest({cluster, num});
    for (std::size_t k = 0; k < num; ++k) {
      const auto i = static_cast<std::size_t>(cluster[k].id);
      const Plane<double>& plane = pieces_[static_cast<std::size_t>(piece_of_[i])].plane_T;
      distance_[i] = dot(plane.normal, to_double(spheres_[i].center)) - plane.offset;
      side_[i] = edge_side(distance_[i], spheres_[i].radius, rule);
    }
  }
}

void EdgePlanes::note(const DonorPoint& donor) {
  for (EdgePiece& piece : pieces_) piece.has_beyond |= piece.is_before(donor);
}

}}  // namespace palpate::v0
