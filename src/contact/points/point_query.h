// Arguments of one query of the point-hit methods on a GPU, passed by value. All pointers are to
// memory of one GPU.
//
// The kernel is one cooperative grid that runs the stages below, with a barrier between them:
//
//   scan_stage.cuh      points -> sums per sphere, bit per touched sphere; then, if edges matter,
//                       edge points -> edge sums per sphere
//   boundary_stage.cuh  sums -> boundary spheres with planes, in order; pieces of edges
//   edge_stage.cuh      which piece of which edge cuts which sphere         (if edges matter)
//   assignment_stage.cuh    weighted, simplified: planes for untouched spheres -> measure
//   graph_stage.cuh     graph: the same along the leaf graph
//   (contact_query_cuda.cu adds the measures up in a fixed order and hands them to the host)
//
// Nothing depends on the order in which threads run: sums of points are integers, lists are in the
// order of sphere ids or used as sets, and measures are added up slot by slot.
#pragma once

#include <cstdint>

#include "palpate/contact/contact.h"
#include "src/contact/index/sphere_clusters.h"
#include "src/contact/points/donors/donor.h"
#include "src/contact/points/graph/graph_rule.h"
#include "src/contact/points/scan/boundary_plane.h"
#include "src/contact/points/scan/image_window.h"
#include "src/contact/points/scan/point_lookup.h"

namespace palpate { inline namespace v0 {

/// Threads of each block of the kernel.
inline constexpr int kQueryThreads = 512;

/// SphereClusters on the GPU.
struct ClustersView {
  const float *x = nullptr, *y = nullptr, *z = nullptr, *radius = nullptr, *volume = nullptr;
  const std::int32_t* sphere_id = nullptr;  ///< of each slot; -1 for padding
  const std::int32_t* slot_of = nullptr;    ///< of each sphere
  const Cluster* clusters = nullptr;
  const Cluster* groups = nullptr;
  std::int32_t num_clusters = 0, num_groups = 0;

  PALPATE_HOSTDEV std::int32_t num_slots() const { return num_clusters * SphereClusters::kSize; }
};

/// A sphere, loaded at once.
struct alignas(16) SlotSphere {
  float x = 0, y = 0, z = 0, radius = 0;

  PALPATE_HOSTDEV Vec3d center() const { return to_double(Vec3f{x, y, z}); }
};

/// Some neighbors of a slot: neighbors[begin ... end) of a row.
struct alignas(16) RowPart {
  std::int32_t slot = 0, row_begin = 0, begin = 0, end = 0;
};

/// The leaf graph by slots, rows one after the other; edges go both ways. See SortedGraph.
struct SortedGraphView {
  /// Parts by which rows are processed: large spheres have thousands of neighbors.
  static constexpr int kPart = 16;

  const SlotSphere* spheres = nullptr;  ///< of each slot
  const std::int32_t* row_starts =
      nullptr;                              ///< of each slot (padding has empty rows), and one more
  const std::int32_t* neighbors = nullptr;  ///< slots
  const RowPart* more_parts = nullptr;      ///< of all rows, without the first of each
  std::int32_t num_more_parts = 0;
};

/// Boundary spheres of a query, ascending by sphere id. Entry i of all arrays is the same one; one
/// without plane has donors[i].sphere_id < 0, lies far away (x = y = z = 1e12) and has normal,
/// offset, weight and presence 0.
struct BoundaryList {
  std::int32_t* num = nullptr;         ///< of all
  std::int32_t* num_donors = nullptr;  ///< of those with a plane
  std::int32_t* sphere_id = nullptr;
  Donor* donors = nullptr;
  /// The same in single precision, for hot loops.
  float *x = nullptr, *y = nullptr, *z = nullptr;  ///< centers
  float *nx = nullptr, *ny = nullptr, *nz = nullptr, *offset = nullptr;
  float *weight = nullptr, *presence = nullptr;
  std::int32_t* num_points = nullptr;  ///< sum
  std::uint32_t* status = nullptr;     ///< StepStatus bits
  /// The donor with most weight, ties to the lowest index: the greatest of (bits of the weight as
  /// float) << 32 | (0xffffffff - index). 0: none.
  unsigned long long* heaviest = nullptr;
};

/// A point inside a sphere that may be an edge point: the second step of the scan decides.
struct EdgeCandidate {
  std::int32_t point, sphere_id;
};

/// The pieces of edges that exist, in any order, as the camera sees them: EdgePiece::u and v.
struct SeenPieces {
  double *u = nullptr, *v = nullptr;
  std::int32_t* number = nullptr;  ///< among PointQuery::pieces
};

/// State of a slot in the graph search.
struct alignas(8) SlotState {
  std::int32_t round = 0;       ///< reached in this query if >= GraphSearch::first_round
  std::int32_t num_offers = 0;  ///< 0 between queries
};

struct GraphSearch {
  /// Number of offers that are always read; the array has so many more at its end.
  static constexpr int kFirstOffers = 4;

  SlotState* slots = nullptr;
  double* path_length = nullptr;  ///< of each slot reached
  Offer* offers = nullptr;        ///< as many for each slot as it has neighbors, at its row
  /// Two, used in turn: the rows of the slots that a round reached, in parts, in any order, and an
  /// empty part for each further offer. Room for as many as there are edges, and all parts.
  RowPart* listed[2] = {};
  std::int32_t* num_listed = nullptr;  ///< three, used in turn, all 0 between queries
  std::int32_t* num_rounds = nullptr;  ///< so far, as reported by a block that continued alone
  /// The boundary spheres themselves; at least 1, and greater than first_round + rounds of the
  /// query before.
  std::int32_t first_round = 1;
};

struct PointQuery {
  // The query. `scan` holds cloud, grid, spheres, R_TW and translation; scan.edges is null if
  // edges do not matter.
  ImageWindow window;
  GridTransform to_grid;  ///< grid_transform(scan)
  PointScan scan;
  Mat3d R_WT;
  Vec3d origin;  ///< center of mass: torques are about it
  MethodKind method = MethodKind::simplified;
  PriorityRule priority;
  InsideVolume inside = InsideVolume::full;
  Edges edges = Edges::none;            ///< `none` if the cloud has no depth-change vectors
  BoundaryPlaneRule plane_rule;         ///< fades_in: Continuity `entry` or `both`
  const float* volume_scale = nullptr;  ///< per sphere: factor of V_s

  // The tool.
  std::int32_t num_spheres = 0;
  ClustersView clusters;
  SortedGraphView graph;

  // Scratch. `sums`, `edge_sums` and `num_edge_candidates` are zero between queries.
  PointSums* sums = nullptr;         ///< per sphere
  EdgeSums* edge_sums = nullptr;     ///< per sphere
  std::uint32_t* touched = nullptr;  ///< bit per sphere; all zero before the query, kept after it
  std::uint32_t* touched_before = nullptr;   ///< that of the query before; the scan stage clears it
  EdgeCandidate* edge_candidates = nullptr;  ///< as many as the cloud has points, if edges matter
  std::int32_t* num_edge_candidates = nullptr;
  BoundaryList boundary;
  EdgePiece* pieces = nullptr;         ///< four per boundary sphere: number 4 i + direction
  std::int32_t* num_pieces = nullptr;  ///< that exist
  SeenPieces seen_pieces;              ///< of those that exist; room for all
  std::int32_t* piece_of = nullptr;    ///< per sphere
  double* edge_distance = nullptr;     ///< per sphere
  EdgeSide* edge_side = nullptr;       ///< per sphere
  GraphSearch search;

  // Kept for states and planes, by slot: index into BoundaryList or -1 (of boundary spheres: their
  // own), and V_s of untouched spheres, else 0. An untouched sphere with V_s = 0 may have -1 or the
  // donor in front of whose plane it lies.
  std::int32_t* donor = nullptr;
  float* assigned_volume = nullptr;

  PALPATE_HOSTDEV EdgesView edges_view() const {
    return {scan.spheres, pieces, piece_of, edge_distance, edge_side};
  }
  /// Call after the boundary stage.
  PALPATE_HOSTDEV DonorsView donors_view() const {
    return {scan.spheres, boundary.donors, *boundary.num};
  }
  PALPATE_HOSTDEV double scale(std::int32_t id) const {
    return static_cast<double>(volume_scale[id]);
  }
};

}}  // namespace palpate::v0
