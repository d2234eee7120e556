// Where the surface ends: planes along viewing rays that keep the tool's spheres from borrowing
// beyond it (thesis section 3.5, eq. 3.17 corrected).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/contact/contact_query.h"
#include "src/contact/point_scan.h"
#include "src/contact/sphere_clusters.h"

namespace palpate {

/// The points behind a lender's plane, as the edges need them.
struct LenderPoint {
  Vec3d p_T;         ///< mean
  double range = 0;  ///< from the camera, m
};

/// A piece of an edge: the edge points of one boundary sphere that look to one side of the image.
struct EdgePiece {
  double u = 0, v = 0;      ///< of their mean, in the image of a camera with focal length 1
  double range = 0;         ///< of their mean from the camera, m
  Plane<double> plane_T;    ///< contains the viewing ray; the surface is behind it
  bool has_beyond = false;  ///< some lender lies beyond it

  bool is_before(const LenderPoint& lender) const;
};

/// Which piece of which edge cuts which sphere. A boundary sphere has up to four pieces, one for
/// each side of the image. What matters to a sphere is the piece nearest to it *in the image*,
/// whoever found it: so an edge may bend and turn corners.
///
/// An edge says nothing about surfaces behind it: planes of lenders that lie beyond the edge and
/// farther away are not cut by it.
class EdgePlanes {
 public:
  /// Keeps the view of the spheres; `clusters` are theirs and must outlive it.
  EdgePlanes(std::span<const Sphere> spheres, const SphereClusters& clusters);

  void clear();
  /// The pieces of one boundary sphere (eq. 3.17). R_TW and translation_W are those of X_WT.
  void add_pieces(const EdgeSums& sums, const Mat3d& R_TW, const Vec3d& translation_W);
  /// After all of them: finds the piece of every sphere. `rule` is not `none`.
  void find_nearest(const Pose& X_WT, Edges rule);
  /// After that, for every lender: lets the edges know which of them they cannot cut off.
  void note(const LenderPoint& lender);

  bool empty() const { return pieces_.empty(); }
  /// False if the sphere lies behind its edge with all that counts: it is as without edges.
  bool concerns(std::int32_t id) const { return side_[static_cast<std::size_t>(id)] != kBehind; }
  /// True if a sphere may not use the plane of a lender at all.
  bool forbids(std::int32_t id, const LenderPoint& lender) const {
    return side_[static_cast<std::size_t>(id)] == kBeyond && !lies_beyond(id, lender);
  }
  /// True if a sphere may use no lender's plane.
  bool cuts_off(std::int32_t id) const {
    const auto i = static_cast<std::size_t>(id);
    return side_[i] == kBeyond && !piece(id).has_beyond;
  }
  /// Volume of the sphere behind the lender's plane and, as far as the rule says, its edge.
  double volume(std::int32_t id, const Plane<double>& plane_T, const LenderPoint& lender) const;
  /// The same of a sphere that would be inside as a whole.
  double full_volume(std::int32_t id, const LenderPoint& lender) const;

 private:
  enum Side : std::uint8_t { kBehind, kCut, kBeyond };

  // A sphere of a cluster, seen by the camera.
  struct Seen {
    std::int32_t id;
    double u, v;
  };

  const EdgePiece& piece(std::int32_t id) const {
    return pieces_[static_cast<std::size_t>(piece_of_[static_cast<std::size_t>(id)])];
  }
  bool lies_beyond(std::int32_t id, const LenderPoint& lender) const {
    return piece(id).is_before(lender);
  }
  void find_nearest(std::span<const Seen> cluster);

  std::span<const Sphere> spheres_;
  const SphereClusters* clusters_;
  std::vector<EdgePiece> pieces_;
  std::vector<std::int32_t> near_;      // pieces that may be nearest to a sphere of a cluster
  std::vector<std::int32_t> piece_of_;  // nearest piece of each sphere
  std::vector<double> distance_;        // of each sphere's centre in front of it
  std::vector<Side> side_;              // of each sphere
};

}  // namespace palpate
