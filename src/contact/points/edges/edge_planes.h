// The spheres that are cut at edges of the surface (thesis section 3.5).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/contact/index/sphere_clusters.h"
#include "src/contact/points/edges/edge_pieces.h"

namespace palpate { inline namespace v0 {

/// The edges of one query; see edge_pieces.h. All memory is allocated at construction.
class EdgePlanes {
 public:
  /// Keeps the view of the spheres; `clusters` are theirs and must outlive it. Without `has_edges`
  /// no piece can be added.
  EdgePlanes(std::span<const Sphere> spheres, const SphereClusters& clusters, bool has_edges);

  void clear();
  /// The pieces of one boundary sphere (eq. 3.17). R_TW and translation_W are those of X_WT.
  void add_pieces(const EdgeSums& sums, double sum_scale, const Mat3d& R_TW,
                  const Vec3d& translation_W);
  /// Call after all of them: finds the piece of every sphere. `rule` is not `none`.
  void find_nearest(const Pose& X_WT, Edges rule);
  /// Call after that, for every donor: marks the edges that cannot cut it off.
  void note(const DonorPoint& donor);

  bool empty() const { return pieces_.empty(); }
  /// Call after all of that.
  EdgesView view() const {
    return {spheres_.data(), pieces_.data(), piece_of_.data(), distance_.data(), side_.data()};
  }

 private:
  // A sphere of a cluster, seen by the camera.
  struct Seen {
    std::int32_t id;
    double u, v;
  };

  void find_nearest(std::span<const Seen> cluster);

  std::span<const Sphere> spheres_;
  const SphereClusters* clusters_;
  std::vector<EdgePiece> pieces_;
  std::vector<std::int32_t> near_;      // pieces that may be nearest to a sphere of a cluster
  std::vector<std::int32_t> piece_of_;  // nearest piece of each sphere
  std::vector<double> distance_;        // of each sphere's center in front of it
  std::vector<EdgeSide> side_;          // of each sphere
};

}}  // namespace palpate::v0
