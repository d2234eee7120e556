// Ends of the surface: planes along viewing rays that keep the tool's spheres from taking beyond it
// (thesis section 3.5, eq. 3.17 corrected). Shared by host and device.
//
// A boundary sphere has up to four pieces of edge, one for each side of the image. The piece that
// counts for a sphere is the nearest one *in the image*, of any boundary sphere: so an edge may
// bend and turn corners. Surfaces behind an edge are unaffected: planes of donors that lie beyond
// the edge and farther away are not cut by it.
#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/contact/contact.h"
#include "src/contact/points/scan/point_scan.h"
#include "src/math/internal/two_plane_cut.h"

namespace palpate { inline namespace v0 {

/// The points behind a donor's plane, as the edges need them.
struct DonorPoint {
  Vec3d p_T;         ///< mean
  double range = 0;  ///< from the camera, m
};

/// A piece of an edge: the edge points of one boundary sphere that look to one side of the image.
struct EdgePiece {
  double u = 0, v = 0;      ///< of their mean, in the image of a camera with focal length 1
  double range = 0;         ///< of their mean from the camera, m; 0: there is no such piece
  Plane<double> plane_T;    ///< contains the viewing ray; the surface is behind it
  bool has_beyond = false;  ///< some donor lies beyond it

  PALPATE_HOSTDEV bool exists() const { return range > 0; }
  PALPATE_HOSTDEV bool is_before(const DonorPoint& donor) const {
    return dot(plane_T.normal, donor.p_T) > plane_T.offset &&
           donor.range > range + EdgeSums::kSameSurface;
  }
};

/// Piece of one side of one boundary sphere (eq. 3.17); R_TW and translation_W are those of X_WT.
PALPATE_HOSTDEV inline EdgePiece edge_piece(const PointSums& sums, double sum_scale,
                                            const Mat3d& R_TW, const Vec3d& translation_W) {
  if (!sums.has_points()) return {};
  const Vec3d offset_W = sums.offset(sum_scale) / sums.num_points(sum_scale);
  const Vec3d p_W = translation_W + offset_W, ray_W = normalized(p_W);
  // The mean direction, orthogonal to the mean viewing ray.
  const Vec3d change_W = sums.normal(sum_scale);
  const Vec3d n_T = R_TW * normalized(change_W - dot(change_W, ray_W) * ray_W);
  if (!(p_W.z > 0)) return {};
  const Plane<double> plane_T{n_T, dot(n_T, R_TW * offset_W)};
  return {p_W.x / p_W.z, p_W.y / p_W.z, norm(p_W), plane_T};
}

/// Position of a sphere relative to its edge. A sphere behind it, as far as the rule counts, is as
/// without edges.
enum class EdgeSide : std::uint8_t { behind, cut, beyond };

/// `distance` of the center in front of the edge plane; `rule` is not `none`.
PALPATE_HOSTDEV inline EdgeSide edge_side(double distance, double radius, Edges rule) {
  const double from = rule == Edges::center ? 0 : -radius;
  const double to = rule == Edges::cut ? radius : from;
  return distance < from ? EdgeSide::behind : (distance < to ? EdgeSide::cut : EdgeSide::beyond);
}

/// Assignment of pieces of edges to the spheres that they cut; not owning.
struct EdgesView {
  const Sphere* spheres = nullptr;
  const EdgePiece* pieces = nullptr;
  // Per sphere:
  const std::int32_t* piece_of = nullptr;
  const double* distance = nullptr;  ///< of its center in front of its edge
  const EdgeSide* side = nullptr;

  /// False if the sphere lies behind its edge with all that counts: it is as without edges.
  PALPATE_HOSTDEV bool concerns(std::int32_t id) const { return side[id] != EdgeSide::behind; }
  /// True if a sphere may not use the plane of a donor at all.
  PALPATE_HOSTDEV bool forbids(std::int32_t id, const DonorPoint& donor) const {
    return side[id] == EdgeSide::beyond && !piece(id).is_before(donor);
  }
  /// True if a sphere may use no donor's plane.
  PALPATE_HOSTDEV bool cuts_off(std::int32_t id) const {
    return side[id] == EdgeSide::beyond && !piece(id).has_beyond;
  }
  /// Volume of the sphere behind the donor's plane and, as far as the rule says, its edge.
  PALPATE_HOSTDEV double volume(std::int32_t id, const Plane<double>& plane_T,
                                const DonorPoint& donor) const {
    const double radius = static_cast<double>(spheres[id].radius);
    const double d = dot(plane_T.normal, to_double(spheres[id].center)) - plane_T.offset;
    if (is_as_without(id, donor)) return cap_volume(radius, d);
    if (side[id] == EdgeSide::beyond) return 0;
    const Vec3d& edge_normal = piece(id).plane_T.normal;
    return two_plane_cut(radius, d, distance[id], dot(plane_T.normal, edge_normal)).volume;
  }
  /// The same for a sphere that would be wholly inside.
  PALPATE_HOSTDEV double full_volume(std::int32_t id, const DonorPoint& donor) const {
    const double radius = static_cast<double>(spheres[id].radius);
    if (is_as_without(id, donor)) return sphere_volume(radius);
    return side[id] == EdgeSide::beyond ? 0 : cap_volume(radius, distance[id]);
  }

 private:
  PALPATE_HOSTDEV const EdgePiece& piece(std::int32_t id) const { return pieces[piece_of[id]]; }
  PALPATE_HOSTDEV bool is_as_without(std::int32_t id, const DonorPoint& donor) const {
    return side[id] == EdgeSide::behind || piece(id).is_before(donor);
  }
};

}}  // namespace palpate::v0
