// The first stages of the point-hit methods, run on a CPU and on a GPU, and what both find.
#pragma once

#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/index/sphere_clusters.h"
#include "src/contact/index/sphere_grid.h"
#include "src/contact/points/donors/donors.h"
#include "src/contact/points/edges/edge_planes.h"
#include "src/contact/points/edges/edge_stage.cuh"
#include "src/contact/points/scan/boundary_points.h"
#include "src/contact/points/scan/boundary_stage.cuh"
#include "src/contact/points/scan/image_window.h"
#include "src/contact/points/scan/scan_stage.cuh"
#include "src/gpu/internal/runtime.h"

namespace palpate::test::point_stages {

__global__ void __launch_bounds__(kQueryThreads, 1)
    sum_points(const __grid_constant__ PointQuery q, unsigned long long* barrier) {
  if (gpu::grid_thread() == 0) reset_counters(q);
  scan_points(q, true);
  gpu::grid_barrier(barrier);
  if (q.scan.edges != nullptr) scan_edges(q);
}

__global__ void __launch_bounds__(kQueryThreads, 1)
    take_boundary(const __grid_constant__ PointQuery q, unsigned long long* barrier) {
  find_boundary(q, true);
  gpu::grid_barrier(barrier);
  if (q.edges != Edges::none) find_edges(q);
}

__global__ void __launch_bounds__(kQueryThreads, 1)
    find_edges_alone(const __grid_constant__ PointQuery q) {
  find_edges(q);
}

struct Question {
  Pose X_WT;
  PointWeights weights = PointWeights::none;
  Edges edges = Edges::none;

  BoundaryPlaneRule plane_rule() const {
    return {weights == PointWeights::in_sums, weights == PointWeights::beside,
            edges != Edges::none};
  }
};

inline Bounds box_around(std::span<const Sphere> spheres) {
  Bounds box{{1e300, 1e300, 1e300}, {-1e300, -1e300, -1e300}};
  for (const Sphere& s : spheres) {
    for (int axis = 0; axis < 3; ++axis) {
      const double c = s.center[axis], r = s.radius;
      box.low[axis] = std::min(box.low[axis], c - r);
      box.high[axis] = std::max(box.high[axis], c + r);
    }
  }
  return box;
}

// Input of both backends.
struct Scene {
  std::vector<Sphere> spheres;
  PointCloudView cloud;
  SphereGrid grid{spheres};
  SphereClusters clusters{spheres};
  Bounds box_T = box_around(spheres);

  ImageWindow window(const Question& question) const {
    return image_window(cloud, box_T, question.X_WT);
  }
  PointScan scan(const Question& question) const {
    PointScan scan;
    scan.cloud = cloud;
    scan.grid = grid.view();
    scan.spheres = spheres.data();
    scan.R_TW = rotation_matrix(conjugate(question.X_WT.rotation));
    scan.translation_W = question.X_WT.translation;
    scan.weights = question.weights;
    return scan;
  }
};

// Results of one backend.
struct Found {
  std::vector<PointSums> sums;  // of boundary spheres
  std::vector<EdgeSums> edge_sums;
  std::vector<std::int32_t> ids;
  std::vector<Donor> donors;
  int num_donors = 0, num_points = 0;
  std::uint32_t status = 0;
  std::vector<EdgePiece> pieces;  // that exist
  std::vector<EdgePiece> piece_of_sphere;
  std::vector<double> distance;
  std::vector<EdgeSide> side;
};

inline Found query_cpu(const Scene& scene, const Question& question) {
  Found found;
  ThreadPool pool(1);
  const PointScan scan = scene.scan(question);
  const bool with_edges = question.edges != Edges::none;
  const std::size_t n = scene.spheres.size();
  BoundaryPoints points(n, pool, isa_baseline::scan_points, with_edges);
  points.collect(scan, scene.window(question), with_edges);
  EdgePlanes edges(scene.spheres, scene.clusters, with_edges);
  points.take([&](std::size_t id, const PointSums& sums, const EdgeSums& edge_sums) {
    found.sums.push_back(sums);
    found.edge_sums.push_back(edge_sums);
    const BoundarySphere sphere =
        boundary_sphere(static_cast<std::int32_t>(id), sums, scan.sum_scale, question.plane_rule(),
                        scan.R_TW, scan.translation_W);
    found.ids.push_back(sphere.sphere_id);
    found.donors.push_back(sphere.donor);
    found.num_donors += sphere.has_plane();
    found.num_points += sphere.num_points;
    if (sphere.is_ambiguous) {
      found.status |= static_cast<std::uint32_t>(StepStatus::ambiguous_normals);
    }
    if (!with_edges) return;
    edges.add_pieces(edge_sums, scan.sum_scale, scan.R_TW, scan.translation_W);
    for (const PointSums& side : edge_sums.towards) {
      const EdgePiece piece = edge_piece(side, scan.sum_scale, scan.R_TW, scan.translation_W);
      if (piece.exists()) found.pieces.push_back(piece);
    }
  });
  if (edges.empty()) return found;
  edges.find_nearest(question.X_WT, question.edges);
  for (const Donor& donor : found.donors) {
    if (donor.sphere_id >= 0) edges.note(donor.point);
  }
  const EdgesView view = edges.view();
  found.pieces.assign(view.pieces, view.pieces + found.pieces.size());
  for (std::size_t id = 0; id < n; ++id) {
    const std::int32_t piece = view.piece_of[id];
    found.piece_of_sphere.push_back(piece >= 0 ? view.pieces[piece] : EdgePiece{});
    found.distance.push_back(view.distance[id]);
    found.side.push_back(view.side[id]);
  }
  return found;
}

// The memory of a query, kept for the next one.
class OnGpu {
 public:
  explicit OnGpu(const Scene& scene, int blocks = 3) : scene_(&scene), blocks_(blocks) {
    const std::size_t n = scene.spheres.size(), num_words = (n + 31) / 32;
    const PointCloudView& cloud = scene.cloud;
    const auto channel = [&](const float* values) -> const float* {
      if (values == nullptr) return nullptr;
      return memory_.copy_of(std::span(values, cloud.size()));
    };
    cloud_ = cloud;
    for (const float* PointCloudView::*axis :
         {&PointCloudView::x, &PointCloudView::y, &PointCloudView::z, &PointCloudView::nx,
          &PointCloudView::ny, &PointCloudView::nz, &PointCloudView::edge_x,
          &PointCloudView::edge_y, &PointCloudView::edge_z}) {
      cloud_.*axis = channel(cloud.*axis);
    }
    grid_ = scene.grid.view();
    const std::size_t num_cells = static_cast<std::size_t>(grid_.num_x) *
                                  static_cast<std::size_t>(grid_.num_y) *
                                  static_cast<std::size_t>(grid_.num_z);
    std::size_t num_blocks = 0;
    for (std::size_t cell = 0; cell < num_cells; ++cell) {
      if (grid_.tags[cell] >= 0) continue;
      std::size_t last = static_cast<std::size_t>(-(grid_.tags[cell] + 1));
      while (grid_.blocks[last].goes_on()) ++last;
      num_blocks = std::max(num_blocks, last + 1);
    }
    grid_.tags = memory_.copy_of(std::span(grid_.tags, num_cells));
    grid_.blocks = memory_.copy_of(std::span(grid_.blocks, num_blocks));

    PointQuery& q = q_;
    spheres_ = memory_.copy_of(scene.spheres);
    q.num_spheres = static_cast<std::int32_t>(n);
    q.clusters.sphere_id = memory_.copy_of(scene.clusters.sphere_id);
    q.clusters.slot_of = memory_.copy_of(scene.clusters.slot_of);
    q.clusters.num_clusters = scene.clusters.num_clusters();
    q.sums = memory_.take<PointSums>(n);
    q.edge_sums = memory_.take<EdgeSums>(n);
    q.touched = memory_.take<std::uint32_t>(num_words);
    q.touched_before = memory_.take<std::uint32_t>(num_words);
    q.edge_candidates = memory_.take<EdgeCandidate>(cloud.size());
    for (std::int32_t** counter : {&q.num_edge_candidates, &q.num_pieces, &q.boundary.num,
                                   &q.boundary.num_donors, &q.boundary.num_points}) {
      *counter = memory_.take<std::int32_t>(1);
    }
    q.boundary.status = memory_.take<std::uint32_t>(1);
    q.boundary.heaviest = memory_.take<unsigned long long>(1);
    q.boundary.sphere_id = memory_.take<std::int32_t>(n);
    q.boundary.donors = memory_.take<Donor>(n);
    BoundaryList& list = q.boundary;
    for (float** values : {&list.x, &list.y, &list.z, &list.nx, &list.ny, &list.nz, &list.offset,
                           &list.weight, &list.presence}) {
      *values = memory_.take<float>(n);
    }
    q.pieces = memory_.take<EdgePiece>(4 * n);
    q.seen_pieces.u = memory_.take<double>(4 * n);
    q.seen_pieces.v = memory_.take<double>(4 * n);
    q.seen_pieces.number = memory_.take<std::int32_t>(4 * n);
    q.piece_of = memory_.take<std::int32_t>(n);
    q.edge_distance = memory_.take<double>(n);
    q.edge_side = memory_.take<EdgeSide>(n);
    q.donor = memory_.take<std::int32_t>(scene.clusters.sphere_id.size());
    q.assigned_volume = memory_.take<float>(scene.clusters.sphere_id.size());
    barrier_ = memory_.take<unsigned long long>(1);
  }

  Found evaluate(const Question& question) {
    PointQuery& q = q_;
    const bool with_edges = question.edges != Edges::none;
    q.scan = scene_->scan(question);
    q.scan.cloud = cloud_;
    q.scan.grid = grid_;
    q.scan.spheres = spheres_;
    q.scan.edges = with_edges ? q.edge_sums : nullptr;
    q.window = scene_->window(question);
    q.to_grid = grid_transform(q.scan);
    q.R_WT = rotation_matrix(question.X_WT.rotation);
    q.edges = question.edges;
    q.plane_rule = question.plane_rule();
    constexpr std::size_t kShared = std::max(kBoundarySharedBytes, kEdgeSharedBytes);
    const gpu::LaunchShape shape{blocks_, kQueryThreads, kShared, true};
    gpu::launch(stream_, shape, sum_points, q, barrier_);
    const std::vector<PointSums> sums = values(q.sums, scene_->spheres.size());
    const std::vector<EdgeSums> edge_sums = values(q.edge_sums, scene_->spheres.size());
    gpu::launch(stream_, shape, take_boundary, q, barrier_);
    const Found found = collect(sums, edge_sums);
    check_state();
    std::swap(q.touched, q.touched_before);
    return found;
  }

  /// The nearest piece of each sphere.
  std::vector<std::int32_t> nearest(std::vector<EdgePiece> pieces) {
    PointQuery q = q_;
    q.scan.spheres = spheres_;
    q.R_WT = rotation_matrix({});
    q.edges = Edges::cut;
    std::vector<double> u, v;
    std::vector<std::int32_t> numbers;
    for (std::size_t i = pieces.size(); i-- > 0;) {
      u.push_back(pieces[i].u);
      v.push_back(pieces[i].v);
      numbers.push_back(static_cast<std::int32_t>(i));
    }
    q.pieces = memory_.copy_of(pieces);
    q.seen_pieces = {memory_.copy_of(u), memory_.copy_of(v), memory_.copy_of(numbers)};
    q.num_pieces = memory_.copy_of(std::vector<std::int32_t>{static_cast<int>(pieces.size())});
    gpu::launch(stream_, {blocks_, kQueryThreads, kEdgeSharedBytes, true}, find_edges_alone, q);
    return values(q.piece_of, scene_->spheres.size());
  }

 private:
  template <class T>
  std::vector<T> values(const T* from, std::size_t num) {
    std::vector<T> result(num);
    if (num > 0) stream_.copy(result.data(), from, num * sizeof(T));
    EXPECT_TRUE(stream_.wait()) << stream_.status().error().message;
    return result;
  }
  template <class T>
  T value(const T* from) {
    return values(from, 1)[0];
  }

  Found collect(const std::vector<PointSums>& sums, const std::vector<EdgeSums>& edge_sums) {
    const PointQuery& q = q_;
    Found found;
    const auto num = static_cast<std::size_t>(value(q.boundary.num));
    found.ids = values(q.boundary.sphere_id, num);
    found.donors = values(q.boundary.donors, num);
    for (const std::int32_t id : found.ids) {
      found.sums.push_back(sums[static_cast<std::size_t>(id)]);
      found.edge_sums.push_back(edge_sums[static_cast<std::size_t>(id)]);
    }
    found.num_donors = value(q.boundary.num_donors);
    found.num_points = value(q.boundary.num_points);
    found.status = value(q.boundary.status);
    check_floats(found);
    if (value(q.num_pieces) == 0) return found;
    const std::vector<EdgePiece> pieces = values(q.pieces, 4 * num);
    for (const EdgePiece& piece : pieces) {
      if (piece.exists()) found.pieces.push_back(piece);
    }
    EXPECT_EQ(found.pieces.size(), static_cast<std::size_t>(value(q.num_pieces)));
    const std::size_t n = scene_->spheres.size();
    found.distance = values(q.edge_distance, n);
    found.side = values(q.edge_side, n);
    for (const std::int32_t piece : values(q.piece_of, n)) {
      found.piece_of_sphere.push_back(pieces[static_cast<std::size_t>(piece)]);
    }
    return found;
  }

  // The list in single precision, and what each slot knows, follow from the donors.
  void check_floats(const Found& found) {
    const BoundaryList& list = q_.boundary;
    const std::size_t num = found.donors.size();
    const float* const channels[] = {list.x,  list.y,      list.z,      list.nx,      list.ny,
                                     list.nz, list.offset, list.weight, list.presence};
    std::vector<float> lists[9];
    for (int k = 0; k < 9; ++k) lists[k] = values(channels[k], num);
    const std::vector<std::int32_t> donor = values(q_.donor, scene_->clusters.sphere_id.size());
    std::int32_t heaviest = -1;
    for (std::size_t i = 0; i < num; ++i) {
      const Donor& l = found.donors[i];
      const auto id = static_cast<std::size_t>(found.ids[i]);
      const bool lends = l.sphere_id >= 0;
      const Vec3f c = lends ? scene_->spheres[id].center : Vec3f{1e12f, 1e12f, 1e12f};
      const Vec3f normal = to_float(l.plane_T.normal);
      const float expected[9] = {c.x,
                                 c.y,
                                 c.z,
                                 normal.x,
                                 normal.y,
                                 normal.z,
                                 static_cast<float>(l.plane_T.offset),
                                 static_cast<float>(l.weight),
                                 lends ? static_cast<float>(l.presence) : 0.0f};
      for (int k = 0; k < 9; ++k) ASSERT_EQ(lists[k][i], expected[k]) << k << " of " << i;
      ASSERT_EQ(donor[static_cast<std::size_t>(scene_->clusters.slot_of[id])],
                lends ? static_cast<std::int32_t>(i) : -1);
      if (lends && (heaviest < 0 || lists[7][i] > lists[7][static_cast<std::size_t>(heaviest)])) {
        heaviest = static_cast<std::int32_t>(i);
      }
    }
    const unsigned long long rank = value(list.heaviest);
    ASSERT_EQ(rank == 0, heaviest < 0);
    if (heaviest >= 0) {
      ASSERT_EQ(0xffffffffu - static_cast<std::uint32_t>(rank),
                static_cast<std::uint32_t>(heaviest));
    }
  }

  // All is ready for the next query.
  void check_state() {
    const auto all_zero = [&](const auto* from, std::size_t num) {
      for (const auto& v : values(reinterpret_cast<const std::uint32_t*>(from),
                                  num * sizeof(*from) / sizeof(std::uint32_t))) {
        if (v != 0) return false;
      }
      return true;
    };
    const std::size_t n = scene_->spheres.size();
    EXPECT_TRUE(all_zero(q_.sums, n));
    EXPECT_TRUE(all_zero(q_.edge_sums, n));
    EXPECT_TRUE(all_zero(q_.touched_before, (n + 31) / 32));
    EXPECT_TRUE(all_zero(q_.num_edge_candidates, 1));
  }

  const Scene* scene_;
  int blocks_;
  gpu::Memory memory_{0};
  gpu::Stream stream_{0, gpu::Priority::high};
  PointCloudView cloud_;
  SphereGridView grid_;
  const Sphere* spheres_ = nullptr;
  PointQuery q_;
  unsigned long long* barrier_ = nullptr;
};

inline void expect_near(const Plane<double>& a, const Plane<double>& b) {
  EXPECT_NEAR(norm(a.normal - b.normal), 0, 1e-12);
  EXPECT_NEAR(a.offset, b.offset, 1e-12);
}

inline void expect_same(const PointSums& a, const PointSums& b) {
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(a.offset_W[i], b.offset_W[i]);
    EXPECT_EQ(a.normal_W[i], b.normal_W[i]);
  }
}

inline void expect_near(const EdgePiece& a, const EdgePiece& b) {
  EXPECT_NEAR(a.u, b.u, 1e-12);
  EXPECT_NEAR(a.v, b.v, 1e-12);
  EXPECT_NEAR(a.range, b.range, 1e-12);
  expect_near(a.plane_T, b.plane_T);
  EXPECT_EQ(a.has_beyond, b.has_beyond);
}

inline void expect_same(const Found& got, const Found& want) {
  ASSERT_EQ(got.ids, want.ids);
  EXPECT_EQ(got.num_donors, want.num_donors);
  EXPECT_EQ(got.num_points, want.num_points);
  EXPECT_EQ(got.status, want.status);
  for (std::size_t i = 0; i < want.ids.size(); ++i) {
    SCOPED_TRACE(i);
    expect_same(got.sums[i], want.sums[i]);
    for (int k = 0; k < EdgeSums::kDirections; ++k) {
      expect_same(got.edge_sums[i].towards[k], want.edge_sums[i].towards[k]);
    }
    const Donor &a = got.donors[i], &b = want.donors[i];
    EXPECT_EQ(a.sphere_id, b.sphere_id);
    expect_near(a.plane_T, b.plane_T);
    EXPECT_NEAR(norm(a.point.p_T - b.point.p_T), 0, 1e-12);
    EXPECT_NEAR(a.point.range, b.point.range, 1e-12);
    EXPECT_NEAR(a.weight, b.weight, 1e-9 * b.weight);
    EXPECT_NEAR(a.presence, b.presence, 1e-9);
    if (testing::Test::HasFailure()) return;
  }
  ASSERT_EQ(got.pieces.size(), want.pieces.size());
  for (std::size_t i = 0; i < want.pieces.size(); ++i) {
    SCOPED_TRACE(i);
    expect_near(got.pieces[i], want.pieces[i]);
  }
  ASSERT_EQ(got.side, want.side);
  for (std::size_t id = 0; id < want.side.size(); ++id) {
    if (want.side[id] == EdgeSide::behind && want.piece_of_sphere[id].range == 0) continue;
    SCOPED_TRACE(id);
    EXPECT_NEAR(got.distance[id], want.distance[id], 1e-12);
    expect_near(got.piece_of_sphere[id], want.piece_of_sphere[id]);
    if (testing::Test::HasFailure()) return;
  }
}

}  // namespace palpate::test::point_stages
